"""Compile the planner's kernels in two processes while the first run fetches its data."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Callable, Iterator

from pipeline.machine.interpreters import python_command, python_environment

_COMPILE = "from renew.warming import rehearse_half; rehearse_half({half})"


@contextlib.contextmanager
def first_compilation() -> Iterator[Callable[[], None]]:
    """Start to compile if nothing is compiled yet; yield a function that waits for the end.

    If a process fails or is killed, kernels that it did not compile are compiled when they are
    called. With a single core, or without a lasting cache, no process is started.
    """
    processes = [_compiling(half) for half in range(2)] if _pays() else []
    try:
        yield lambda: _wait(processes)
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _pays() -> bool:
    """Whether nothing is compiled yet, and two processes can run in parallel."""
    from renew._compiled import is_cold

    return len(os.sched_getaffinity(0)) > 1 and is_cold()


def _compiling(half: int) -> subprocess.Popen[bytes]:
    """Start a process that compiles half of the kernels, 0 or 1."""
    return subprocess.Popen(  # noqa: S603 - this interpreter
        python_command("-c", _COMPILE.format(half=half)),
        env=python_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _wait(processes: list[subprocess.Popen[bytes]]) -> None:
    """Wait until all processes have ended."""
    for process in processes:
        process.wait()
