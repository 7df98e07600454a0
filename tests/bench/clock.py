"""Time of a call, warm: what the code takes on a quiet machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

ResultT = TypeVar("ResultT")


class Took(NamedTuple):
    """Time on the wall and of the process on all its threads (s)."""

    wall: float
    cpu: float


def warm(run: Callable[[], ResultT], times: int = 3) -> tuple[Took, ResultT]:
    """Least times of some runs after one that is not counted, and what the last of them gave."""
    result = run()
    taken = []
    for _ in range(times):
        wall, cpu = time.perf_counter(), time.process_time()
        result = run()
        taken.append(Took(time.perf_counter() - wall, time.process_time() - cpu))
    return Took(min(t.wall for t in taken), min(t.cpu for t in taken)), result
