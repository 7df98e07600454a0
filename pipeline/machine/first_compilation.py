"""Compile the planner's kernels in two processes while a first run loads its data."""

import contextlib
import subprocess
from collections.abc import Callable, Iterator

from pipeline.machine.interpreters import cores, python_command, python_environment

_COMPILE = "from renew.warming import rehearse_half; rehearse_half({half})"


@contextlib.contextmanager
def first_compilation() -> Iterator[Callable[[], None]]:
    """Start to compile if nothing is compiled yet; yield a function that waits for the end.

    If a process fails or is killed, kernels that it did not compile are compiled when they are
    called. With a single core, or without a lasting cache, no process is started.
    """
    processes = [_compiling(half) for half in range(2)] if _can_compile_ahead() else []

    def wait() -> None:
        for process in processes:
            process.wait()

    try:
        yield wait
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _can_compile_ahead() -> bool:
    """Whether nothing is compiled yet, and two processes can run in parallel."""
    from renew._compiled import is_cold

    return cores() > 1 and is_cold()


def _compiling(half: int) -> subprocess.Popen[bytes]:
    """Start a process that compiles half of the kernels, 0 or 1."""
    return subprocess.Popen(  # noqa: S603 - this interpreter
        python_command("-c", _COMPILE.format(half=half)),
        env=python_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
