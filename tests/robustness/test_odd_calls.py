"""Odd calls of the public API give a right result or a documented error, in bounded time."""

from __future__ import annotations

import gc
import resource
import warnings
from collections.abc import Iterable
from pathlib import Path

import pytest

import renew
from tests.robustness.campaign import SEED, number
from tests.robustness.limits import TooSlowError, cpu_limit, failure
from tests.robustness.odd_calls import broken, odd_call
from tests.strategies import random_scene

SAMPLE = 60
# Longest time of a call, s: one with chosen speeds in a current that changes takes 20.
_MAX_CALL_S = 60.0
# Plans before memory is measured (the compiler's and the allocator's pools are filled then), and
# those in which it may grow by 5 %.
_WARM_PLANS, _PLANS = 50, 300


def failures(cases: Iterable[int], seed: str) -> list[str]:
    """Make odd calls; describe those that ended otherwise than by a result or a documented error.

    Not documented are another class of error, a warning, a result that breaks its function's
    promises, and a call that takes longer than the limit.
    """
    found = []
    for case in cases:
        call = odd_call([int(seed), case])
        try:
            with cpu_limit(_MAX_CALL_S), warnings.catch_warnings():
                warnings.simplefilter("error")
                faults = broken(call, call.function(**call.arguments))
        except renew.PlanningError:
            continue
        except (Exception, TooSlowError) as error:  # noqa: BLE001 - these are what is looked for
            faults = [failure(case, error)]
        found += [f"{call}: {fault}" for fault in faults]
    return found


def test_a_sample_of_odd_calls_is_answered_or_refused() -> None:
    assert failures(range(SAMPLE), SEED) == []


@pytest.mark.slow
def test_odd_calls_are_answered_or_refused() -> None:
    found = failures(range(number("calls", 1000)), SEED)
    assert not found, "\n".join(found)


def _memory_kb() -> int:
    """Resident memory of this process, kB."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() // 1024


@pytest.mark.slow
def test_memory_does_not_grow_over_many_plans() -> None:
    def plan(seed: int) -> None:
        random_scene(seed % 10, islands=5).plan(classes=4)

    for seed in range(_WARM_PLANS):
        plan(seed)
    before = _memory_kb()
    for seed in range(_PLANS):
        plan(seed)
    assert _memory_kb() <= 1.05 * before
