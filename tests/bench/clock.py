"""Time of a call, warm: what the code takes on a quiet machine; and of a command."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from tests.conftest import ROOT

ResultT = TypeVar("ResultT")


class Took(NamedTuple):
    """Time on the wall and of the process on all its threads (s)."""

    wall: float
    cpu: float


def warm(run: Callable[[], ResultT], times: int = 3) -> tuple[Took, ResultT]:
    """Least times of some runs after one that is not counted, and what the last of them gave."""
    result = run()
    taken = []
    for _ in range(times):
        wall, cpu = time.perf_counter(), time.process_time()
        result = run()
        taken.append(Took(time.perf_counter() - wall, time.process_time() - cpu))
    return Took(min(t.wall for t in taken), min(t.cpu for t in taken)), result


class Ran(NamedTuple):
    """What a command took: time on the wall and of the processor (s), largest memory (GB)."""

    wall: float
    cpu: float
    peak: float


def ran(*words: str) -> Ran:
    """Run Python with these words, and the processes that it starts; RuntimeError if it fails."""
    begin = time.perf_counter()
    command = [sys.executable, *words]
    # Modules are compiled once and kept, as on a user's machine.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    unheard = subprocess.DEVNULL
    child = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=unheard, stderr=unheard)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{' '.join(words)} ended with {child.returncode}")
    taken = time.perf_counter() - begin
    return Ran(taken, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e6)
