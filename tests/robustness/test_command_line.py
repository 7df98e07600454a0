"""The command line ends with a known exit code and without a traceback, however it is used."""

from __future__ import annotations

import os
import random
import resource
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tests.robustness.command_lines import odd_command_line
from tests.robustness.limits import MAX_CPU_S, MAX_MEMORY_BYTES

if TYPE_CHECKING:
    from pathlib import Path

    from tests.robustness.command_lines import CommandLine

SEED = 20_260_111
RUNS = 200
SAMPLE = range(6, 11)  # none of them waits for a network
EXIT_CODES = {0, 1, 2, 130, 143}
# Time after which a run counts as hung, s: it may wait for the processor, and for a scheduler.
_HUNG_S = 150


def failure_of(line: CommandLine, root: Path) -> str:
    """Run a command line; describe how it failed, or "" where it ended as it must."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (3 * MAX_CPU_S, 3 * MAX_CPU_S))
        resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
        for stream in line.closed:
            os.close(stream)

    code = (
        f"import sys; sys.path.insert(0, {str(root)!r}); from pipeline.cli.main import main; main()"
    )
    try:
        ended = subprocess.run(
            [sys.executable, "-c", code, *line.arguments],
            cwd=line.folder,
            env=line.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            preexec_fn=limited,
            timeout=_HUNG_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "hung"
    errors = ended.stderr.decode(errors="replace")
    if "Traceback" in errors or ended.returncode not in EXIT_CODES:
        return f"exit code {ended.returncode}: {errors[-1500:]}"
    return ""


def failures(folder: Path, root: Path, cases: range) -> list[str]:
    """Run odd command lines; describe those that failed."""
    found = []
    for case in cases:
        line = odd_command_line(random.Random(f"{SEED} {case}"), folder / str(case))  # noqa: S311 - a test's seed
        why = failure_of(line, root)
        if why:
            changed = {k: v for k, v in line.environment.items() if k != "PATH"}
            found.append(f"case {case}: {line.arguments} {changed} closed {line.closed}: {why}")
        shutil.rmtree(line.folder, ignore_errors=True)
    return found


def test_a_sample_of_odd_command_lines_ends_as_it_must(tmp_path: Path, root: Path) -> None:
    found = failures(tmp_path, root, SAMPLE)
    assert not found, "\n".join(found)


@pytest.mark.slow
def test_two_hundred_odd_command_lines_end_as_they_must(tmp_path: Path, root: Path) -> None:
    found = failures(tmp_path, root, range(RUNS))
    assert not found, "\n".join(found)
