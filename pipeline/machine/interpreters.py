"""Python processes that this program starts: with a deadline, and ignoring the working directory.

A user who plans in a downloaded folder does not mean to run the code in it: no interpreter started
here, or by one of them, looks for modules in the working directory.
"""

import contextlib
import ctypes
import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar

ValueT = TypeVar("ValueT")

_ROOT = Path(__file__).resolve().parents[2]
_SAFE_PATH = "PYTHONSAFEPATH"
# Time to read a killed process's last output, s: its whole session is killed, so pipes close.
_DRAIN_S = 5.0
# Time between two checks whether a process has to end, and whether a parent still runs, s.
_PAUSE_S, _PARENT_S = 0.05, 0.5
# Numbers of new objects, of collections, and of collections of older objects after which Python
# collects garbage. The defaults of 700, 10 and 10 take a tenth of the time while libraries load and
# figures are drawn, because hundreds of thousands of objects are in use.
_COLLECT_AFTER = 50_000, 20, 50


@dataclass(frozen=True, slots=True)
class ProcessResult:
    """How a process ended: `exit_code` is None where it was killed."""

    exit_code: int | None
    stdout: str
    stderr: str


def python_command(*arguments: str) -> list[str]:
    """Return the command of an interpreter like this one; see `python_environment`."""
    return [sys.executable, "-P", *arguments]


def python_environment() -> Mapping[str, str]:
    """Return the variables of an interpreter: it finds this program's packages, wherever they lie.

    An empty entry of PYTHONPATH means the working directory, and is left out.
    """
    entries = [str(_ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, entries)), _SAFE_PATH: "1"}


def end_with_parent(parent: int) -> None:
    """End this process, from a thread, once its parent (a process id) has ended, however it did."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def begun(function: Callable[[], ValueT]) -> Future[ValueT]:
    """Call a function that may never return, in a thread that does not keep the program alive."""
    outcome: Future[ValueT] = Future()

    def call() -> None:
        try:
            outcome.set_result(function())
        except BaseException as error:  # noqa: BLE001 - raised again in the caller's thread
            outcome.set_exception(error)

    threading.Thread(target=call, daemon=True).start()
    return outcome


@contextlib.contextmanager
def ignoring_working_directory() -> Iterator[None]:
    """Keep every interpreter that libraries start in the block out of the working directory.

    `multiprocessing`, and with it Dask, starts interpreters by a command line of its own; all of
    them inherit this process's variables.
    """
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_SAFE_PATH, None)
        else:
            os.environ[_SAFE_PATH] = before


def run_python(
    arguments: Sequence[str], stdin: str, limit_s: float, stop: threading.Event | None = None
) -> ProcessResult:
    """Run an interpreter with some input; kill it and its children after the limit or at `stop`."""
    deadline = time.monotonic() + limit_s
    with subprocess.Popen(  # noqa: S603 - the arguments are this package's own
        python_command(*arguments),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=python_environment(),
        start_new_session=True,
    ) as process:
        threading.Thread(target=_feed, args=(process.stdin, stdin), daemon=True).start()
        process.stdin = None
        try:
            while time.monotonic() < deadline and not (stop and stop.is_set()):
                with contextlib.suppress(subprocess.TimeoutExpired):
                    stdout, stderr = process.communicate(timeout=_PAUSE_S)
                    return ProcessResult(process.returncode, stdout, stderr)
        except BaseException:
            _kill_session(process)
            raise
        _kill_session(process)
        stderr = ""
        with contextlib.suppress(subprocess.TimeoutExpired):
            _, stderr = process.communicate(timeout=_DRAIN_S)
        return ProcessResult(None, "", stderr)


def _feed(pipe: IO[str], text: str) -> None:
    """Write a process's input: `communicate` drops what a pipe does not hold at its first call."""
    with contextlib.suppress(OSError), pipe:
        pipe.write(text)


def _kill_session(process: subprocess.Popen[str]) -> None:
    """Kill a process and all that it started in its session."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        process.kill()
    process.wait()


@contextlib.contextmanager
def seldom_collecting() -> Iterator[None]:
    """Collect garbage less often inside the `with` block."""
    usual = gc.get_threshold()
    gc.set_threshold(*_COLLECT_AFTER)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def give_back_memory() -> None:
    """Give freed memory back to the system, which the C library otherwise keeps for later."""
    with contextlib.suppress(OSError, AttributeError):  # another C library than GNU's
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
