"""What this process does for all that runs in it: threads, interpreters below it, memory, cores."""

import contextlib
import ctypes
import gc
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import TypeVar

ValueT = TypeVar("ValueT")

SAFE_PATH = "PYTHONSAFEPATH"
"""The variable that keeps an interpreter from looking for modules in the working directory."""
# Numbers of new objects, of collections, and of collections of older objects after which Python
# collects garbage. The defaults of 700, 10 and 10 take a tenth of the time while libraries load and
# figures are drawn, because hundreds of thousands of objects are in use.
_COLLECT_AFTER = 50_000, 20, 50


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
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(SAFE_PATH, None)
        else:
            os.environ[SAFE_PATH] = before


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
