"""The places of a route at which to turn off last, and at which the nearest haven changes."""

import math

import numpy as np

from renew.planner.plan import planner_of
from renew.underway.coverage import Diversion, EqualPoint, LastTurn
from renew.underway.diversions import Limits
from renew.underway.survey import SAMPLES, Survey

# Number of samples up to which the last turn is narrowed.
_LAST = 6
# Largest time to a haven for which an equal point is searched, as a multiple of the limit; number
# of times that the search is widened.
_EQUAL, _WIDENED = 1.5, 3
# Difference of the times to two havens that counts as none, in steps between samples.
_EQUAL_BY = 0.5


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
    end = bad
    while True:
        good, bad, way = _narrowed(survey, number, good, bad, way, limits)
        # Near the last place another class may lead further.
        further = survey.planned(number, bad)
        if bad == end or further is None or not survey.diverter.is_within(further, limits):
            break
        good, bad, way = bad, end, further
    return LastTurn(way, not_after)


def _narrowed(
    survey: Survey, number: int, good: int, bad: int, way: Diversion, limits: Limits
) -> tuple[int, int, Diversion]:
    """Return two samples close together: by ways near each other, the first is the last within.

    A known `way` from the first of the two given ones is within the limits.
    """
    beyond = math.inf
    while bad - good > _LAST:
        # Between two known ways the excess over the limits is nearly linear.
        spare = -survey.diverter.excess(way, limits)
        share = 0.5 if math.isinf(beyond) else spare / (spare + beyond)
        wide, least = bad - good, _LAST // 2
        middle = good + min(max(round(share * wide), least), wide - least)
        further = survey.planned(number, middle, is_thorough=False)
        excess = math.inf if further is None else survey.diverter.excess(further, limits)
        if further is not None and excess <= 0:
            good, way = middle, further
        else:
            bad, beyond = middle, excess
    return good, bad, way


def no_return(survey: Survey) -> LastTurn | None:
    """Return the last place from which the way back to the start is within the endurance."""
    limits = Limits(endurance=survey.limits.endurance)
    if math.isinf(limits.endurance):
        return None
    voyage = planner_of(survey.diverter.request).problem.voyage
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
        before, after = (
            survey.planned(number, sample, is_thorough=False) for number in (one, other)
        )
        return None if before is None or after is None else EqualPoint(before, after)

    def lacks(point: EqualPoint | None) -> float:
        return math.nan if point is None else point.before.duration - point.after.duration

    last, wide = len(survey.times) - 1, SAMPLES // 24
    for _ in range(_WIDENED):
        low, high = max(change - wide, 0), min(change + wide, last)
        below, above = lacks(both(low)), lacks(both(high))
        if below <= 0 < above:
            break
        wide *= 2
    else:
        return None
    while high - low > 1:
        # The difference is nearly linear; a step stays off the ends, so that both come nearer.
        share = -below / (above - below)
        middle = low + min(max(round(share * (high - low)), 1), high - low - 1)
        found = lacks(both(middle))
        if abs(found) <= _EQUAL_BY * survey.step:
            return both(middle)
        if found <= 0:
            low, below = middle, found
        elif found > 0:
            high, above = middle, found
        else:
            return None
    return both(high)
