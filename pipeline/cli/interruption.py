"""Handle Ctrl-C and SIGTERM: clean up, print a message, and end within seconds."""

import _thread
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

MESSAGE = "stopped; finished stages are kept, run again to continue"
# Time for the main thread to clean up, s. Then the process ends, the system releases its locks, and
# the seasons' processes end, too.
_GRACE_S = 3.0
# Time between two attempts to interrupt the main thread, s.
_PAUSE_S = 0.05
# Time limit for the calls of `saying_last`, s: a monitoring service may take ten to answer.
_LAST_WORDS_S = 20.0
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SHOW_CURSOR = "\x1b[?25h"


_last_words: list[Callable[[int], None]] = []


class Stopped(KeyboardInterrupt):
    """A signal stopped the program; the exit code is 128 plus the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_code = 128 + number


def exit_code(error: KeyboardInterrupt) -> int:
    """Return the exit code of a program that was stopped."""
    return error.exit_code if isinstance(error, Stopped) else 128 + signal.SIGINT


@contextlib.contextmanager
def saying_last(words: Callable[[int], None]) -> Iterator[None]:
    """Call a function with the exit code if a signal arrives inside the `with` block.

    It is called in a separate thread, before anything is cleaned up. The process ends after it has
    returned, or after `_LAST_WORDS_S`.
    """
    _last_words.append(words)
    try:
        yield
    finally:
        _last_words.remove(words)


@contextlib.contextmanager
def ending_promptly() -> Iterator[None]:
    """Raise `Stopped` in the main thread at the first signal; then end without waiting for threads.

    C code may delay the signal's handler in the main thread, and an interpreter waits for its
    threads before it ends. So an extra thread ends the process if it still runs after `_GRACE_S`.
    """
    number, is_raised = 0, False
    said = threading.Event()
    earlier_hook = sys.unraisablehook

    def handle(asked: int, frame: FrameType | None) -> None:
        nonlocal number, is_raised
        number = number or asked
        if not is_raised and not _is_in_compiler(frame):
            is_raised = True  # only once: `timeout` signals the process and its group
            raise Stopped(number)

    def raise_again(unraisable: "sys.UnraisableHookArgs") -> None:
        """Let `handle` raise again if `Stopped` was lost in a destructor or garbage collector."""
        nonlocal is_raised
        if isinstance(unraisable.exc_value, Stopped):
            is_raised = False
        else:
            earlier_hook(unraisable)

    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_end_after_signal, args=(reader, said), daemon=True).start()
    sys.unraisablehook = raise_again
    caught = [name for name in _SIGNALS if signal.getsignal(name) != signal.SIG_IGN]
    for name in caught:
        signal.signal(name, handle)
    try:
        yield
    finally:
        if number:
            said.wait(_LAST_WORDS_S)
            _end(number)
        for name in caught:  # everything is cleaned up: a later signal ends the process at once
            signal.signal(name, lambda asked, _frame: _end(asked))


def _is_in_compiler(frame: FrameType | None) -> bool:
    """Whether Numba's compiler is running: an error raised in it crashes its callers in C."""
    while frame is not None:
        if "/numba/" in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


def _end_after_signal(reader: int, said: threading.Event) -> None:
    """Wait for a signal; end the process if it still runs some seconds later."""
    while True:
        number = os.read(reader, 1)[0]
        if number in _SIGNALS:
            threading.Thread(target=_say_last, args=(128 + number, said), daemon=True).start()
            deadline = time.monotonic() + _GRACE_S
            while time.monotonic() < deadline:
                time.sleep(_PAUSE_S)
                _thread.interrupt_main(
                    signal.Signals(number)
                )  # the handler may not have raised yet
            said.wait(_LAST_WORDS_S)
            with contextlib.suppress(Exception):
                os.write(sys.stderr.fileno(), f"{MESSAGE}\n".encode())
            _end(number)


def _say_last(exit_code: int, said: threading.Event) -> None:
    """Call the functions of `saying_last`, and then set the event."""
    for words in tuple(_last_words):
        with contextlib.suppress(Exception):
            words(exit_code)
    said.set()


def _end(number: int) -> None:
    """End the process and its threads at once; show the terminal's cursor again."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            if stream.isatty():
                stream.write(_SHOW_CURSOR)
            stream.flush()
    os._exit(128 + number)
