"""Regular messages that a command is still working, for commands that have no stages to report."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

# Time between two lines, s.
_PAUSE_S = 30.0


@contextlib.contextmanager
def still_at_work() -> Iterator[None]:
    """Write a line on standard error every _PAUSE_S inside the `with` block."""
    begun, ended = time.monotonic(), threading.Event()

    def beat() -> None:
        while not ended.wait(_PAUSE_S):
            seconds = time.monotonic() - begun
            print(f"still at work, after {seconds:.0f} s", file=sys.stderr, flush=True)  # noqa: T201 - to the user

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
