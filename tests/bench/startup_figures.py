"""Times until RENEW answers: imports, help, and the first plan of a process, compiled before."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

from tests.bench.figure import Figure, at_most
from tests.conftest import ROOT

FIRST_PLAN = """
import renew
from tests.strategies import PAPER_VESSEL, single_gyre
renew.plan(*single_gyre(), PAPER_VESSEL, (10.0, 10.0), (90.0, 90.0))
"""


def figures() -> Iterator[Figure]:
    """Yield each command's least time of three, after one that is not counted (s)."""
    commands = {
        "import renew": (("-c", "import renew"), 0.5),
        "import renew and plan the single gyre": (("-c", FIRST_PLAN), 1.0),
        "renew --help": (("-m", "pipeline.cli.main", "--help"), 0.25),
    }
    for name, (words, limit) in commands.items():
        times = [_seconds(*words) for _ in range(4)]
        yield at_most(f"{name}: CPU time", min(times[1:]), limit, " s")


def _seconds(*words: str) -> float:
    """Time of the processor that a process of Python takes (s): others may be at work."""
    with subprocess.Popen([sys.executable, *words], cwd=ROOT, stdout=subprocess.DEVNULL) as child:
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{' '.join(words)} ended with {child.returncode}")
    return usage.ru_utime + usage.ru_stime
