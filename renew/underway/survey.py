"""Survey a route: from which places a haven is reached within limits; proven, refuted, or neither.

Between two stations the vessel may carry on and turn off at the next one: its time to the haven is
then at most the rest of the stretch and the way from there. So one planned way covers all places
before it, as far as the limits go. Conversely, a vessel at x has passed a place a before it, and
needs at least the least time from a to the haven, less the time from a to x. So bounds at close
samples prove all places between them uncovered.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.bounds.fuel_lower_bound import HavenBound, least_time
from renew.errors import PlanningError
from renew.inputs.openings import Haven
from renew.planner.plan import planner_of
from renew.underway.coverage import Diversion, State, Stretch
from renew.underway.diversions import Diverter, Limits

SAMPLES = 360
"""Number of samples in the time of a limit."""
# Largest number of samples in all.
_MOST_SAMPLES = 6_000
# Number of samples between two stations at first.
_STATIONS = 120
# Number of samples between two stations without a way up to which no place between them is tried.
_CLOSE = 4
# Multiple of a limit up to which bounds with a clock are close.
_ENOUGH = 1.5
# Least time between the places from which bounds with a clock are taken, as a share of the limit.
_PART = 1 / 24
# Number of cells of the finest grid of bounds with a clock.
_PROOF_CELLS = 128_000
# Factor on the limits up to which bounds are close.
_ABOVE = 1.02


@dataclass(eq=False)
class Survey:
    """A survey of a route at samples, close together in time.

    `times` (n,), s, are those of the samples, `limit` (n,), s, the limits there, and `least` (m, n)
    bounds on the time to each haven (s), by `bounds` if they are known.
    """

    diverter: Diverter
    havens: tuple[Haven, ...]
    limits: Limits
    bounds: Sequence[HavenBound] = ()
    times: FloatArray = field(init=False)
    limit: FloatArray = field(init=False)
    least: FloatArray = field(init=False)
    cause: PlanningError | None = None
    _known: dict[int, list[Diversion]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Take samples, and the bound from each to each haven."""
        begin, end = self.diverter.begin, self.diverter.end
        tightest = min(self.diverter.limit(begin, self.limits), end - begin)
        step = max(tightest / SAMPLES, (end - begin) / _MOST_SAMPLES)
        self.times = np.linspace(begin, end, max(2, math.ceil((end - begin) / step) + 1))
        self.limit = np.array([self.diverter.limit(one, self.limits) for one in self.times])
        places = np.array([self.diverter.row(time)[:2] for time in self.times.tolist()])
        if not self.bounds:
            last = end + self.diverter.off(end)
            self.bounds = bounds_to(self.havens, self.diverter, float(self.limit.max()), last)
        self.least = np.array([one.at(places) for one in self.bounds])
        if not self.diverter.request.current.is_steady:
            self._raise_with_clock()

    def _raise_with_clock(self) -> None:
        """Raise the bounds by those from places of the route, which know the hours.

        In a current that changes they are closer than the bounds from the havens.
        """
        at, last = 0, len(self.times) - 1
        while at < last:
            if self.is_out[at]:
                at += 1
                continue
            limit = float(self.limit[at])
            least = self._least_from(at, _ENOUGH * limit)
            ahead = self.times[at:] - self.times[at]
            self.least[:, at:] = np.maximum(self.least[:, at:], least - ahead)
            # Where a haven is near, it is so for a while.
            at += max(1, int(max(_PART * limit, abs(least - limit) / 2) / self.step))

    def _least_from(self, sample: int, enough: float) -> float:
        """Return a bound on the time (s) to any haven from a sample, close up to `enough` (s)."""
        voyage, least = planner_of(self.diverter.request).problem.voyage, math.inf
        time = float(self.times[sample])
        for haven, known in zip(self.havens, self.least[:, sample].tolist(), strict=True):
            bound = known
            if bound < min(enough, least):
                ahead = replace(voyage, start=self.diverter.row(time)[:2], goal=haven.place)
                bound = max(bound, least_time(ahead.leaving(time), _PROOF_CELLS, enough))
            least = min(least, bound)
        return least

    @property
    def step(self) -> float:
        """Time (s) between two samples."""
        return float(self.times[1] - self.times[0])

    @property
    def is_out(self) -> BoolArray:
        """From which samples to the next (n - 1,) nobody gets to a haven within the limits."""
        return np.asarray(self.least.min(axis=0)[:-1] - self.step > self.limit[:-1])

    def stretches(self) -> list[Stretch]:
        """Return the whole route in stretches."""
        return _joined(list(self._backwards())[::-1])

    def first_gap(self) -> Stretch | None:
        """Return a stretch that is not covered, None if there is none; quicker than all of them."""
        if self.is_out.any():
            least = self.least.min(axis=0)[:-1] - self.limit[:-1]
            worst = int(least.argmax())
            return self._stretch(worst, worst + 1, "uncovered")
        return next((one for one in self._backwards() if one.state != "covered"), None)

    def _backwards(self) -> Iterator[Stretch]:
        """Yield stretches from the end backwards: each way helps to plan the one before it."""
        is_out = self.is_out
        edges = [0, *(np.flatnonzero(np.diff(is_out)) + 1).tolist(), len(is_out)]
        for first, last in reversed(list(itertools.pairwise(edges))):
            if is_out[first]:
                yield self._stretch(first, last, "uncovered")
                continue
            count = max(1, math.ceil((last - first) / _STATIONS))
            stations = np.linspace(first, last, count + 1).round().astype(int).tolist()
            for a, b in reversed(list(itertools.pairwise(stations))):
                yield from self._with_fewer_ways(list(self._settled(a, b)))

    def _with_fewer_ways(self, stretches: Sequence[Stretch]) -> Iterator[Stretch]:
        """Yield stretches between two stations, the last first, by as few of their ways as do."""
        way: Diversion | None = None
        for one in stretches:
            if one.diversion is not None and way is not None and self._is_within(way, one.begin):
                longest = self._longest(one.begin, way)
                yield replace(one, diversion=way, longest=longest)
                continue
            way = one.diversion
            yield one

    def _settled(self, first: int, last: int) -> Iterator[Stretch]:
        """Yield the stretches between two samples, the last first."""
        before = float(self.times[first])
        ways = [one for one in self._ways(last) if self._is_within(one, before)]
        if ways:
            way = min(ways, key=lambda one: one.longest)
            stretch = self._stretch(first, last, "covered")
            yield replace(stretch, diversion=way, longest=self._longest(before, way))
        elif last - first == 1 or (
            last - first <= _CLOSE and not self._ways(first) and not self._ways(last)
        ):
            yield replace(self._stretch(first, last, "not settled"), cause=self.cause)
        else:
            middle = (first + last) // 2
            yield from self._settled(middle, last)
            yield from self._settled(first, middle)

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

    def _planned_at(self, sample: int) -> list[Diversion]:
        """Plan ways from a sample, until no other haven can be nearer."""
        ways, time = list[Diversion](), float(self.times[sample])
        for number in np.argsort(self.least[:, sample], kind="stable").tolist():
            least = self.least[number, sample]
            if least > self.limit[sample] or any(one.duration <= least for one in ways):
                break
            way = self.planned(number, sample)
            if way is not None and self._is_within(way, time):
                ways.append(way)
        return ways

    def quickest(self, sample: int) -> Diversion | None:
        """Return the way from a sample that gets to any haven soonest, whatever the limits."""
        best: Diversion | None = None
        for number in np.argsort(self.least[:, sample], kind="stable").tolist():
            if best is not None and best.longest <= self.least[number, sample]:
                break
            way = self.planned(number, sample)
            if way is not None and (best is None or way.longest < best.longest):
                best = way
        return best

    def planned(self, number: int, sample: int, *, is_thorough: bool = True) -> Diversion | None:
        """Return the way to a haven from a sample, near a known one if that is good enough.

        If not `is_thorough`, one near a known one is good enough.
        """
        haven, time = self._haven(number), float(self.times[sample])
        near = self.diverter.nearest(number, time, self.step * _STATIONS)
        for start in (near, None) if near else (None,):
            try:
                way = self.diverter.to(number, haven, time, start)
            except PlanningError as error:
                self.cause = error
                continue
            if start is None or not is_thorough or self._is_within(way, time):
                return way
        return None

    def _haven(self, number: int) -> Haven:
        """Return a haven by its number; -1 is the start."""
        if number < 0:
            return Haven("start", self.diverter.route.path[0])
        return self.havens[number]


def bounds_to(
    havens: Sequence[Haven], diverter: Diverter, limit: float, last: float
) -> tuple[HavenBound, ...]:
    """Return the bounds on the time to havens, close up to a limit (s), for vessels until `last`.

    They hold for whoever is under way between the route's departure and `last` (s).
    """
    voyage, most = planner_of(diverter.request).problem.voyage, _ABOVE * limit
    return tuple(
        HavenBound.of(replace(voyage, goal=one.place), most, last + most) for one in havens
    )


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
