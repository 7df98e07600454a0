"""What a first plan calls, compiled in two processes while the first run fetches its data."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Callable, Iterator

from pipeline.machine.interpreters import python_command, python_environment

_COMPILE = "from renew.warming import rehearse_half; rehearse_half({half})"


@contextlib.contextmanager
def first_compilation() -> Iterator[Callable[[], None]]:
    """Begin to compile where nothing is compiled yet; give what waits for the end of it.

    A process that fails or is killed costs time alone: what it leaves out is compiled when it is
    called. One core would have no less to do, and what can't be kept is of no use to others.
    """
    processes = [_compiling(half) for half in range(2)] if _pays() else []
    try:
        yield lambda: _wait(processes)
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _pays() -> bool:
    """Whether nothing is compiled, and two processes may compile at once."""
    from renew._compiled import is_cold

    return len(os.sched_getaffinity(0)) > 1 and is_cold()


def _compiling(half: int) -> subprocess.Popen[bytes]:
    """Start a process that compiles a half."""
    return subprocess.Popen(  # noqa: S603 - this interpreter
        python_command("-c", _COMPILE.format(half=half)),
        env=python_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _wait(processes: list[subprocess.Popen[bytes]]) -> None:
    """Wait for processes to end."""
    for process in processes:
        process.wait()
