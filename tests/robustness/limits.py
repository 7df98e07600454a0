"""Limits on the robustness tests: the number of their cases, CPU time, memory; what broke them."""

import contextlib
import os
import random
import resource
import signal
import traceback
from collections.abc import Iterator
from types import FrameType

MAX_CPU_S = 20
"""Maximum CPU time of a case, s."""

MAX_MEMORY_BYTES = 2 * 1024**3
"""Maximum memory of a process that runs cases, bytes."""


class TooSlowError(BaseException):
    """A case used up its CPU time; not an Exception, so that no handler under test catches it."""


@contextlib.contextmanager
def cpu_limit(seconds: float = MAX_CPU_S) -> Iterator[None]:
    """Interrupt the body after some CPU time; compiled code is interrupted when it returns."""

    def interrupt(signum: int, frame: FrameType | None) -> None:
        del signum, frame
        raise TooSlowError(f"more than {seconds:g} s of CPU time")

    before = signal.signal(signal.SIGPROF, interrupt)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def limit_memory() -> None:
    """Limit the memory of this process: beyond it an allocation raises MemoryError."""
    resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))


def failure(case: int, error: BaseException) -> str:
    """Describe how a case failed: the error, and the last lines of code that it came through."""
    frames = traceback.extract_tb(error.__traceback__)[-3:]
    places = " < ".join(f"{frame.filename}:{frame.lineno}" for frame in reversed(frames))
    return f"case {case}: {type(error).__name__}: {str(error)[:300]} [{places}]"


SEED = os.environ.get("RENEW_ROBUSTNESS_SEED", "20260111")
"""Seed of all cases; another one draws others."""


def number(kind: str, default: int) -> int:
    """Return the number of cases of a kind, such as `RENEW_ROBUSTNESS_NIGHTS=2000`."""
    return int(os.environ.get(f"RENEW_ROBUSTNESS_{kind.upper()}", default))


def draw(kind: str, case: int) -> random.Random:
    """Return the random numbers of a case, the same in each campaign with this seed."""
    return random.Random(f"{SEED} {kind} {case}")  # noqa: S311 - a test's seed
