"""When to leave: departures planned until, by the paths found, none between can beat the best.

A vessel that leaves later never overtakes on the same path, and so the earliest arrival over all
paths doesn't come earlier with a later departure either (FIFO). If a voyage begun at t takes D at
best, one begun at s > t takes D - (s - t) at least.

How fast the current changes says more. On a fixed path dt/dx = σ(x, t) = 1/g, so that arrivals A of
departures t obey dA/dt = exp ∫ ∂σ/∂t dx = exp(-∫ (∂g/∂t) / g dt) >= exp(-ρ D), where ρ bounds
|∂g/∂t| / g on any course (:attr:`renew.voyage.voyage.Voyage.speed_change`) and D the time under way
of these departures. Sail the best path of s from t: A(t) <= A(s) - exp(-ρ D) (s - t), and so the
voyage begun at s takes D(t) - L (s - t) at least, with L = 1 - exp(-ρ D), between 0 and 1. Only
voyages that beat the best one matter, so D is no more than the best duration and s - t.

Where that is short of the best duration by more than a tolerance, the next departure is planned as
far on as the bound reaches. Each plan settles as much of the window as the tolerance over L: window
over tolerance of them settle the choice on any scene, far fewer where the current changes slowly
(one, where it does not), and the more durations differ the fewer are needed.

D is taken from the path that was found, not from a lower bound, so the choice is settled to within
the error of the paths and of the current's table, and is no proof. It rests on FIFO: where the
current is as strong as the vessel in places, nothing is known. With adaptive padding land is
padded for the hours of passage, so that a later departure may find more room; then the earliest
arrival of all later ones counts.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from renew.planner.departures import Sailing, Sailings
from renew.results.plan import Departures, Plan

Progress = Callable[[int, float], None]
"""Told after each plan: how many there are, and by how many seconds the best may be beaten."""

# Number of rounds in which the middles of the intervals beside the best departure are planned.
_FINER = 3
# Lower limit of the slope, to avoid dividing by zero.
_FLATTEST = 1e-12
# Share of the tolerance that counts as none.
_ROUNDING = 1e-6


class _Interval(NamedTuple):
    """From one departure to the next (s).

    A voyage begun at its beginning takes `duration` (s) at least, a later one less by `slope` times
    the time between, at most.
    """

    begin: float
    end: float
    duration: float
    slope: float

    @property
    def least_duration(self) -> float:
        """Time (s) that any voyage takes that is begun in it."""
        return self.duration - self.slope * (self.end - self.begin)

    def reach(self, goal: float) -> float:
        """Departure (s) up to which no voyage in it takes less than `goal` (s)."""
        return self.begin + (self.duration - goal) / max(self.slope, _FLATTEST)


class DepartureWindow:
    """Departures (n,), s, ascending, each planned; and more of them where it is worth it.

    No voyage takes less than `least_duration` (s), whatever the departure. In a second the speed
    over ground changes by a share `speed_change` (1/s) at most; where that is infinite, nothing is
    known of departures between those planned.
    """

    def __init__(
        self,
        sailings: Sailings,
        departures: Sequence[float],
        least_duration: float,
        *,
        speed_change: float,
        progress: Progress | None,
    ) -> None:
        self._planner, self._least, self._change = sailings, least_duration, speed_change
        self._progress = progress
        self.sailings: list[Sailing] = []
        for departure in departures:
            self._plan(departure)
        self.sailings = self._planner.by_arrival(self.sailings)

    @property
    def best(self) -> Sailing:
        """The sailing that takes least time, the earliest of those that do."""
        return min(self.sailings, key=lambda one: one.duration)

    @property
    def unproven(self) -> float:
        """Time (s) by which a departure between those planned may beat the best of these."""
        if math.isinf(self._change) or self.best.found is None:
            return math.inf
        bound = min((one.least_duration for one in self._intervals()), default=math.inf)
        return max(0.0, self.best.duration - bound)

    def refine(self, tolerance: float) -> None:
        """Plan more departures until none between can beat the best by more than `tolerance` s.

        Where nothing bounds an arrival, departures a tolerance apart have to do.
        """
        while True:
            goal = self.best.duration - tolerance
            slack = _ROUNDING * tolerance
            open_ones = [
                one
                for one in self._intervals()
                if one.least_duration < goal - slack and one.end - one.begin > tolerance + slack
            ]
            if not open_ones:
                break
            one = min(open_ones, key=lambda interval: interval.least_duration)
            self._plan(max(one.reach(goal), one.begin + tolerance))
        self.sailings = self._planner.by_arrival(self.sailings)

    def refine_around_best(self) -> None:
        """Plan departures beside the best one, ever closer to it; these settle nothing more."""
        for _ in range(_FINER):
            times = [one.departure for one in self.sailings]
            at = times.index(self.best.departure)
            for beside in (*times[max(at - 1, 0) : at], *times[at + 1 : at + 2]):
                self._plan((times[at] + beside) / 2)
        self.sailings = self._planner.by_arrival(self.sailings)

    def replace(self, sailing: Sailing) -> None:
        """Take another sailing of the same departure."""
        kept = [one for one in self.sailings if one.departure != sailing.departure]
        self._insert(kept, sailing)
        self.sailings = self._planner.by_arrival(self.sailings)

    def departures(self, plan: Plan) -> Departures:
        """What has been found, with the plan at the best departure."""
        return Departures.of([one.outcome for one in self.sailings], self.unproven, plan)

    def _plan(self, departure: float) -> None:
        """Plan one more departure."""
        self._insert(self.sailings, self._planner.sailing(departure))
        if self._progress is not None:
            self._progress(len(self.sailings), self.unproven)

    def _insert(self, others: Sequence[Sailing], sailing: Sailing) -> None:
        """Take one more sailing, in its place."""
        self.sailings = sorted((*others, sailing), key=lambda one: one.departure)

    def _intervals(self) -> Iterator[_Interval]:
        """Intervals between departures, with the bounds on arrivals."""
        least_after = list(itertools.accumulate((one.arrival for one in self.sailings[::-1]), min))
        bound = -math.inf
        for (here, after), least in zip(
            itertools.pairwise(self.sailings), least_after[:0:-1], strict=True
        ):
            if here.is_late:
                bound = math.inf
            elif here.found is not None:
                bound = least
            begin, end = here.departure, after.departure
            longest = self.best.duration + end - begin
            slope = 1.0 if math.isinf(self._change) else -math.expm1(-self._change * longest)
            yield _Interval(begin, end, max(bound - begin, self._least), slope)
