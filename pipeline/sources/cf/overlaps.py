"""Forecasts that overlap in time, as when a pattern finds yesterday's file and today's."""

import bisect
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

Step = tuple[int, int]
"""A step: the number of its file, and its index there."""


def latest_steps(
    index: list[Step], times: Mapping[Step, Any], references: Sequence[Any]
) -> list[Step]:
    """Return steps in their order in time, without those in the span of a later forecast.

    All stay where no two have the same time, or a file has no reference time.
    """
    twice = any(times[one] == times[after] for one, after in itertools.pairwise(index))
    if not twice or not all(references):
        return index
    own: dict[Any, list[Any]] = {}
    for step in index:
        own.setdefault(references[step[0]], []).append(times[step])
    ascending = sorted(own)

    def is_covered(step: Step) -> bool:
        later = ascending[bisect.bisect(ascending, references[step[0]]) :]
        return any(own[one][0] <= times[step] <= own[one][-1] for one in later)

    return [step for step in index if not is_covered(step)]
