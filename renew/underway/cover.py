"""Find out where along a route a haven can be reached in time: proven, refuted, or not settled.

Between two stations the vessel may carry on and turn off at the next one: its time to the haven is
then at most the rest of the stretch and the way from there. So one planned way covers all places
before it, as far as the limits go. Conversely, a vessel at x has passed a place a before it, and
needs at least the least time from a to the haven, less the time from a to x. So bounds at close
samples prove all places between them uncovered.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Unpack

import numpy as np

from renew._types import FloatArray
from renew.bounds.haven_bound import HavenBound
from renew.errors import PlanningError
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.haven import Haven
from renew.inputs.options import Changes, PlanOptions, Request
from renew.inputs.vessel import Vessel
from renew.planner.task import Task
from renew.results import Route
from renew.underway.coverage import Coverage, Diversion, EqualPoint, LastTurn, State, Stretch
from renew.underway.diversions import Diverter, Limits
from renew.underway.usable_havens import check_cover, usable
from renew.voyage.voyage import Voyage

# Numbers of samples: in the time of a limit; in all, at most; between two stations at first; up to
# which no place is tried between two ends without a way; up to which the last turn is narrowed.
_SAMPLES, _MOST_SAMPLES, _STATIONS, _CLOSE, _LAST = 360, 6_000, 120, 4, 6
# Largest time to a haven for which an equal point is searched, as a multiple of the limit; number
# of times that the search is widened.
_EQUAL, _WIDENED = 1.5, 3


def cover(
    route: Route,
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    havens: Sequence[Haven],
    *,
    within: float | None = None,
    within_fuel: float | None = None,
    endurance: float | None = None,
    options: PlanOptions | None = None,
    **changes: Unpack[Changes],
) -> Coverage:
    """Find out from which places of a route a planned way leads to a haven within limits.

    Parameters
    ----------
    route : Route
        A route at constant speed, from `renew.plan` or `renew.replan`.
    chart, current, vessel
        Those that the route was planned with.
    havens : sequence of Haven
        The user's list; nothing is added to it.
    within : float, optional
        Longest time to a haven (s).
    within_fuel : float, optional
        Most fuel to a haven (fuel units).
    endurance : float, optional
        Fuel on board at departure (fuel units): a diversion can use what is left where the vessel
        turns off.
    options, **changes
        Those of the route's plan, such as ``drift="crab"``.

    Returns
    -------
    Coverage
        Stretches that are covered, uncovered, or not settled; abort points, the point of no return
        and equal points. Ways begin on the route's heading; they are padded and steered as for
        :func:`renew.plan`, and their turns are simulated, from the end of the first arc on.

    Raises
    ------
    ParameterError
        No limit, or one that no route can keep; a route that chose speeds, or of another vessel or
        current; havens that can't be used, if none is left.
    """
    limits = check_cover(
        route, chart, vessel, havens, within=within, within_fuel=within_fuel, endurance=endurance
    )
    options = PlanOptions() if options is None else options
    begin = float(route.trajectory[0, 0])
    request = Request(**{**vars(options), **changes}, departure=begin)
    ends = np.vstack([route.path[0], route.path[-1]])
    task = Task(chart, as_field(current), vessel, ends, (), request)
    usable_ones, left_out = usable(havens, task, route)
    survey = _Survey(Diverter(task, route), tuple(usable_ones), limits)
    stretches = survey.stretches()
    abort_points, equal_points = survey.abort_points(), survey.equal_points()
    faults = [survey.diverter.fault(number) for number in range(len(usable_ones))]
    found = list(zip(usable_ones, faults, strict=True))
    left_out += [(haven, fault) for haven, fault in found if fault is not None]
    return Coverage(
        route=route,
        abort_points=abort_points,
        no_return=survey.no_return(),
        equal_points=equal_points,
        havens=tuple(haven for haven, fault in found if fault is None),
        left_out=tuple(left_out),
        stretches=tuple(stretches),
        diversions=survey.diverter.found,
        within=limits.within,
        within_fuel=limits.within_fuel,
        endurance=limits.endurance,
    )


@dataclass(eq=False)
class _Survey:
    """A survey of a route at samples, close together in time."""

    diverter: Diverter
    havens: tuple[Haven, ...]
    limits: Limits
    times: FloatArray = field(init=False)
    limit: FloatArray = field(init=False)
    least: FloatArray = field(init=False)
    cause: PlanningError | None = None

    def __post_init__(self) -> None:
        """Take samples, and the bound from each to each haven."""
        begin, end = self.diverter.begin, self.diverter.end
        tightest = min(self.diverter.limit(begin, self.limits), end - begin)
        step = max(tightest / _SAMPLES, (end - begin) / _MOST_SAMPLES)
        self.times = np.linspace(begin, end, max(2, math.ceil((end - begin) / step) + 1))
        self.limit = np.array([self.diverter.limit(one, self.limits) for one in self.times])
        places = np.array([self.diverter.row(time)[:2] for time in self.times.tolist()])
        voyage = self.diverter.task.planner().problem.voyage
        self.least = np.array([self._bound(voyage, one, places) for one in self.havens])

    def _bound(self, voyage: Voyage, haven: Haven, places: FloatArray) -> FloatArray:
        """Return the least time (n,), s, from each sample to a haven."""
        most = 1.02 * float(self.limit.max())
        last = float(self.times[-1]) + self.diverter.off(float(self.times[-1])) + most
        bound = HavenBound.of(replace(voyage, goal=haven.place), most, last)
        return bound.at(places)

    @property
    def step(self) -> float:
        """Time (s) between two samples."""
        return float(self.times[1] - self.times[0])

    def stretches(self) -> list[Stretch]:
        """Return the whole route in stretches."""
        least = self.least.min(axis=0)
        is_out = least[:-1] - self.step > self.limit[:-1]
        edges = [0, *(np.flatnonzero(np.diff(is_out)) + 1).tolist(), len(is_out)]
        found = list[Stretch]()
        # From the end backwards: each way helps to plan the one before it.
        for first, last in reversed(list(itertools.pairwise(edges))):
            if is_out[first]:
                found.append(self._stretch(first, last, "uncovered"))
                continue
            count = max(1, math.ceil((last - first) / _STATIONS))
            stations = np.linspace(first, last, count + 1).round().astype(int).tolist()
            for a, b in reversed(list(itertools.pairwise(stations))):
                found += self._settled(a, b)
        return _joined(found[::-1])

    def _settled(self, first: int, last: int) -> list[Stretch]:
        """Return the stretches between two samples, the last first."""
        before = float(self.times[first])
        ways = [one for one in self._ways(last) if self._is_within(one, before)]
        if ways:
            way = min(ways, key=lambda one: one.longest)
            stretch = self._stretch(first, last, "covered")
            return [replace(stretch, diversion=way, longest=self._longest(before, way))]
        if last - first == 1 or (
            last - first <= _CLOSE and not self._ways(first) and not self._ways(last)
        ):
            return [replace(self._stretch(first, last, "not settled"), cause=self.cause)]
        middle = (first + last) // 2
        return self._settled(middle, last) + self._settled(first, middle)

    def _stretch(self, first: int, last: int, state: State) -> Stretch:
        """Return a stretch between two samples."""
        least = float(self.least[:, first : last + 1].min()) - self.step
        return Stretch(
            float(self.times[first]), float(self.times[last]), state, least=max(least, 0.0)
        )

    def _is_within(self, way: Diversion, time: float) -> bool:
        """Whether a way keeps the limits from a place before it, passed at a time (s)."""
        return self.diverter.is_within(way, self.limits, time)

    def _longest(self, time: float, way: Diversion) -> float:
        """Return the most time (s) to a haven, going on from a time (s) to a later way."""
        return self.diverter.longest_from(time, way) if time < way.time else way.longest

    def _ways(self, sample: int) -> list[Diversion]:
        """Return ways from a sample within the limits: the nearest haven's among them."""
        if sample not in self._known:
            self._known[sample] = self._planned_at(sample)
        return self._known[sample]

    _known: dict[int, list[Diversion]] = field(default_factory=dict)

    def _planned_at(self, sample: int) -> list[Diversion]:
        """Plan ways from a sample, until no other haven can be nearer."""
        ways, time = list[Diversion](), float(self.times[sample])
        for number in np.argsort(self.least[:, sample], kind="stable").tolist():
            least = self.least[number, sample]
            if least > self.limit[sample] or any(one.duration <= least for one in ways):
                break
            way = self._planned(number, sample)
            if way is not None and self._is_within(way, time):
                ways.append(way)
        return ways

    def _planned(self, number: int, sample: int) -> Diversion | None:
        """Return the way to a haven from a sample, near a known one if that is good enough."""
        haven, time = self._haven(number), float(self.times[sample])
        near = self.diverter.nearest(number, time, self.step * _STATIONS)
        for start in (near, None) if near else (None,):
            try:
                way = self.diverter.to(number, haven, time, start)
            except PlanningError as error:
                self.cause = error
                continue
            if start is None or self._is_within(way, time):
                return way
        return None

    def _haven(self, number: int) -> Haven:
        """Return a haven by its number; -1 is the start."""
        if number < 0:
            return Haven("start", self.diverter.route.path[0])
        return self.havens[number]

    def abort_points(self) -> tuple[LastTurn, ...]:
        """Return the last place for each haven that is within the limits from some place."""
        found = list[LastTurn]()
        for number, least in enumerate(self.least):
            may_be = np.flatnonzero(least[:-1] - self.step <= self.limit[:-1])
            if not len(may_be):
                continue
            known = self.diverter.left(number, self.limits)
            first = int(np.searchsorted(self.times, max(known, default=0.0)))
            if not known:
                first = int((least - self.limit).argmin())
            last = self._last_turn(number, first, int(may_be[-1]) + 1, self.limits)
            if last is not None:
                found.append(last)
        return tuple(found)

    def _last_turn(self, number: int, good: int, bad: int, limits: Limits) -> LastTurn | None:
        """Return the last sample between two from which a haven is within limits, if any."""
        not_after, way = float(self.times[bad]), self._planned(number, good)
        if way is None or not self.diverter.is_within(way, limits):
            return None
        beyond = math.inf
        while bad - good > _LAST:
            # Between two known ways the excess over the limits is nearly linear.
            spare = -self.diverter.excess(way, limits)
            share = 0.5 if math.isinf(beyond) else spare / (spare + beyond)
            wide, least = bad - good, _LAST // 2
            middle = good + min(max(round(share * wide), least), wide - least)
            further = self._planned(number, middle)
            excess = math.inf if further is None else self.diverter.excess(further, limits)
            if further is not None and excess <= 0:
                good, way = middle, further
            else:
                bad, beyond = middle, excess
        return LastTurn(way, not_after)

    def no_return(self) -> LastTurn | None:
        """Return the last place from which the way back to the start is within the endurance."""
        limits = Limits(endurance=self.limits.endurance)
        if math.isinf(limits.endurance):
            return None
        voyage = self.diverter.task.planner().problem.voyage
        places = np.array([self.diverter.row(time)[:2] for time in self.times.tolist()])
        quickest = voyage.vessel.speed + voyage.table.strongest
        back = np.linalg.norm(places - voyage.start, axis=1) / quickest
        left = [self.diverter.limit(time, limits) for time in self.times.tolist()]
        may_be = np.flatnonzero(back <= left)
        last = min(int(may_be[-1]) + 1, len(self.times) - 1)
        for good in (last, last // 2, last // 8, last // 32):
            found = self._last_turn(-1, good, last, limits) if good > 0 else None
            if found is not None:
                return found
        return None

    def equal_points(self) -> tuple[EqualPoint, ...]:
        """Return the places where the nearest haven changes."""
        nearest = self.least.argmin(axis=0)
        found = list[EqualPoint]()
        for change in (np.flatnonzero(np.diff(nearest)) + 1).tolist():
            one, other = int(nearest[change - 1]), int(nearest[change])
            if self.least[one, change] <= _EQUAL * self.limit[change]:
                point = self._equal_point(one, other, change)
                found += [] if point is None else [point]
        return tuple(found)

    def _equal_point(self, one: int, other: int, change: int) -> EqualPoint | None:
        """Return the place near a sample before which one haven is nearer, after it the other."""

        def both(sample: int) -> EqualPoint | None:
            before, after = self._planned(one, sample), self._planned(other, sample)
            return None if before is None or after is None else EqualPoint(before, after)

        def lacks(point: EqualPoint | None) -> float:
            return math.nan if point is None else point.before.duration - point.after.duration

        last, wide = len(self.times) - 1, _SAMPLES // 24
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


def _joined(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Return stretches in order; neighbours with the same way, or both without one, are joined."""
    joined = list[Stretch]()
    for one in stretches:
        last = joined[-1] if joined else None
        if last is None or last.state != one.state or last.diversion is not one.diversion:
            joined.append(one)
            continue
        joined[-1] = replace(last, end=one.end, least=min(last.least, one.least))
    return joined
