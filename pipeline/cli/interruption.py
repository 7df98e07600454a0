"""Ctrl-C and SIGTERM: clean up, say so, and end within seconds, even while threads still plan."""

from __future__ import annotations

import _thread
import contextlib
import os
import signal
import sys
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

MESSAGE = "stopped; finished stages are kept, run again to continue"
# Time for the main thread to clean up, s; past it the system does: it releases locks, and season
# processes end when this one does.
_GRACE_S = 3.0
# Time between two attempts to interrupt the main thread, s.
_PAUSE_S = 0.05
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SHOW_CURSOR = "\x1b[?25h"


class Stopped(KeyboardInterrupt):
    """A signal asks the program to end: its exit code is 128 plus the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_code = 128 + number


def exit_code(error: KeyboardInterrupt) -> int:
    """Exit code of a program that was stopped."""
    return error.exit_code if isinstance(error, Stopped) else 128 + signal.SIGINT


@contextlib.contextmanager
def ending_promptly() -> Iterator[None]:
    """Raise `Stopped` in the main thread for the first signal; then end without waiting for others.

    Code in C may keep the main thread from seeing the signal, and an interpreter that ends waits
    for its threads: so a thread of its own ends the process where the main thread has not done so.
    """
    number, is_raised = 0, False

    def handle(asked: int, frame: FrameType | None) -> None:
        nonlocal number, is_raised
        number = number or asked
        if not is_raised and not _is_in_compiler(frame):
            is_raised = True  # once: `timeout` signals the process and its group
            raise Stopped(number)

    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_end_after_signal, args=(reader,), daemon=True).start()
    for name in _SIGNALS:
        if signal.getsignal(name) != signal.SIG_IGN:
            signal.signal(name, handle)
    try:
        yield
    finally:
        if number:
            _end(number)


def _is_in_compiler(frame: FrameType | None) -> bool:
    """Whether Numba's compiler is at work, whose callers in C crash where it raises an error."""
    while frame is not None:
        if "/numba/" in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


def _end_after_signal(reader: int) -> None:
    """Wait for a signal; end the process if the main thread has not done so some seconds later."""
    while True:
        number = os.read(reader, 1)[0]
        if number in _SIGNALS:
            deadline = time.monotonic() + _GRACE_S
            while time.monotonic() < deadline:
                time.sleep(_PAUSE_S)
                _thread.interrupt_main(
                    signal.Signals(number)
                )  # for a handler that could not raise before
            with contextlib.suppress(Exception):
                os.write(sys.stderr.fileno(), f"{MESSAGE}\n".encode())
            _end(number)


def _end(number: int) -> None:
    """End the process at once, its threads with it."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            if stream.isatty():
                stream.write(_SHOW_CURSOR)
            stream.flush()
    os._exit(128 + number)
