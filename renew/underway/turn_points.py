"""The places of a route at which to turn off last, and at which the nearest haven changes."""

import math

import numpy as np

from renew.underway.coverage import EqualPoint, LastTurn
from renew.underway.diversions import Limits
from renew.underway.survey import SAMPLES, Survey

# Number of samples up to which the last turn is narrowed.
_LAST = 6
# Largest time to a haven for which an equal point is searched, as a multiple of the limit; number
# of times that the search is widened.
_EQUAL, _WIDENED = 1.5, 3


def abort_points(survey: Survey) -> tuple[LastTurn, ...]:
    """Return the last place for each haven that is within the limits from some place."""
    found = list[LastTurn]()
    for number, least in enumerate(survey.least):
        may_be = np.flatnonzero(least[:-1] - survey.step <= survey.limit[:-1])
        if not len(may_be):
            continue
        known = survey.diverter.left(number, survey.limits)
        first = int(np.searchsorted(survey.times, max(known, default=0.0)))
        if not known:
            first = int((least - survey.limit).argmin())
        last = _last_turn(survey, number, first, int(may_be[-1]) + 1, survey.limits)
        if last is not None:
            found.append(last)
    return tuple(found)


def _last_turn(survey: Survey, number: int, good: int, bad: int, limits: Limits) -> LastTurn | None:
    """Return the last sample between two from which a haven is within limits, if any."""
    not_after, way = float(survey.times[bad]), survey.planned(number, good)
    if way is None or not survey.diverter.is_within(way, limits):
        return None
    beyond = math.inf
    while bad - good > _LAST:
        # Between two known ways the excess over the limits is nearly linear.
        spare = -survey.diverter.excess(way, limits)
        share = 0.5 if math.isinf(beyond) else spare / (spare + beyond)
        wide, least = bad - good, _LAST // 2
        middle = good + min(max(round(share * wide), least), wide - least)
        further = survey.planned(number, middle)
        excess = math.inf if further is None else survey.diverter.excess(further, limits)
        if further is not None and excess <= 0:
            good, way = middle, further
        else:
            bad, beyond = middle, excess
    return LastTurn(way, not_after)


def no_return(survey: Survey) -> LastTurn | None:
    """Return the last place from which the way back to the start is within the endurance."""
    limits = Limits(endurance=survey.limits.endurance)
    if math.isinf(limits.endurance):
        return None
    voyage = survey.diverter.task.planner().problem.voyage
    places = np.array([survey.diverter.row(time)[:2] for time in survey.times.tolist()])
    quickest = voyage.vessel.speed + voyage.table.strongest
    back = np.linalg.norm(places - voyage.start, axis=1) / quickest
    left = [survey.diverter.limit(time, limits) for time in survey.times.tolist()]
    may_be = np.flatnonzero(back <= left)
    last = min(int(may_be[-1]) + 1, len(survey.times) - 1)
    for good in (last, last // 2, last // 8, last // 32):
        found = _last_turn(survey, -1, good, last, limits) if good > 0 else None
        if found is not None:
            return found
    return None


def equal_points(survey: Survey) -> tuple[EqualPoint, ...]:
    """Return the places where the nearest haven changes."""
    nearest = survey.least.argmin(axis=0)
    found = list[EqualPoint]()
    for change in (np.flatnonzero(np.diff(nearest)) + 1).tolist():
        one, other = int(nearest[change - 1]), int(nearest[change])
        if survey.least[one, change] <= _EQUAL * survey.limit[change]:
            point = _equal_point(survey, one, other, change)
            found += [] if point is None else [point]
    return tuple(found)


def _equal_point(survey: Survey, one: int, other: int, change: int) -> EqualPoint | None:
    """Return the place near a sample before which one haven is nearer, after it the other."""

    def both(sample: int) -> EqualPoint | None:
        before, after = survey.planned(one, sample), survey.planned(other, sample)
        return None if before is None or after is None else EqualPoint(before, after)

    def lacks(point: EqualPoint | None) -> float:
        return math.nan if point is None else point.before.duration - point.after.duration

    last, wide = len(survey.times) - 1, SAMPLES // 24
    for _ in range(_WIDENED):
        low, high = max(change - wide, 0), min(change + wide, last)
        if lacks(both(low)) <= 0 < lacks(both(high)):
            break
        wide *= 2
    else:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        if lacks(both(middle)) <= 0:
            low = middle
        else:
            high = middle
    return both(high)
