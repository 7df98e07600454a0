"""When to leave: departures are planned until, by the paths found, no other can beat the best.

On the same path a vessel that leaves later never overtakes. So a later departure brings no earlier
arrival over all paths either (FIFO). If a voyage begun at t takes D at best, one begun at s > t
takes D - (s - t) at least.

The rate at which the current changes gives a tighter bound. On a fixed path dt/dx = σ(x, t) = 1/g,
with g the speed over ground. So the arrival A, as a function of the departure t, obeys
dA/dt = exp ∫ ∂σ/∂t dx = exp(-∫ (∂g/∂t) / g dt) >= exp(-ρ D), where D is the time under way and ρ
bounds |∂g/∂t| / g on any course (:attr:`renew.voyage.voyage.Voyage.speed_change`). On the path
that is best from s, this gives A(t) <= A(s) - exp(-ρ D) (s - t). So a voyage begun at s takes at
least D(t) - L (s - t), with L = 1 - exp(-ρ D), between 0 and 1. As only voyages that beat the best
one matter, D in L is at most the sum of the best duration and s - t.

Where this bound is below the best duration by more than a tolerance, the next departure to plan is
the first one that the bound leaves open. Each plan settles a part tolerance / L of the window. So
window / tolerance plans are enough on any scene, and far fewer where the current changes slowly
(one, where it does not change); the more durations differ, the fewer are needed.

D(t) is taken from the path found, not from a lower bound: the choice is settled to within the error
of the paths and of the current's table, and is no proof. It rests on FIFO: nothing is known where
the current reaches the vessel's speed in places. Adaptive padding depends on the hours of passage:
a later departure may have more room, so a bound starts from the earliest arrival of this departure
and all later ones.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from renew.planner.departures import Sailing, Sailings
from renew.results import Departures, Plan

Progress = Callable[[int, float], None]
"""Called after each plan: the number of plans, and how much better (s) the best may become."""

# Number of rounds in which the middles of the intervals beside the best departure are planned.
_FINER = 3
# Lower limit of the slope, to avoid dividing by zero.
_FLATTEST = 1e-12
# Share of the tolerance below which a difference counts as rounding.
_ROUNDING = 1e-6


class _Interval(NamedTuple):
    """From one departure to the next (s).

    A voyage begun at `begin` takes at least `duration` (s); a voyage begun later takes at least
    that minus `slope` times its delay.
    """

    begin: float
    end: float
    duration: float
    slope: float

    @property
    def least_duration(self) -> float:
        """Time (s) that every voyage begun in the interval takes at least."""
        return self.duration - self.slope * (self.end - self.begin)

    def reach(self, goal: float) -> float:
        """Departure (s) up to which no voyage of the interval takes less than `goal` (s)."""
        return self.begin + (self.duration - goal) / max(self.slope, _FLATTEST)


class DepartureWindow:
    """Planned departures (n,), s, ascending; more are added where one may beat the best.

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
        """The sailing that takes least time; of equals, the earliest."""
        return min(self.sailings, key=lambda one: one.duration)

    @property
    def unproven(self) -> float:
        """Time (s) by which a departure that is not planned may beat the best planned one."""
        if math.isinf(self._change) or self.best.found is None:
            return math.inf
        bound = min((one.least_duration for one in self._intervals()), default=math.inf)
        return max(0.0, self.best.duration - bound)

    def refine(self, tolerance: float) -> None:
        """Plan more departures until none between can beat the best by more than `tolerance` s.

        Where arrivals have no bound, departures are planned one tolerance apart.
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
        """Plan departures ever closer to the best one, on both sides; no bound needs them."""
        for _ in range(_FINER):
            times = [one.departure for one in self.sailings]
            at = times.index(self.best.departure)
            for beside in (*times[max(at - 1, 0) : at], *times[at + 1 : at + 2]):
                self._plan((times[at] + beside) / 2)
        self.sailings = self._planner.by_arrival(self.sailings)

    def replace(self, sailing: Sailing) -> None:
        """Replace the sailing of the same departure."""
        kept = [one for one in self.sailings if one.departure != sailing.departure]
        self._insert(kept, sailing)
        self.sailings = self._planner.by_arrival(self.sailings)

    def departures(self, plan: Plan) -> Departures:
        """The result, with the plan at the best departure."""
        return Departures.of([one.outcome for one in self.sailings], self.unproven, plan)

    def _plan(self, departure: float) -> None:
        """Plan one more departure."""
        self._insert(self.sailings, self._planner.sailing(departure))
        if self._progress is not None:
            self._progress(len(self.sailings), self.unproven)

    def _insert(self, others: Sequence[Sailing], sailing: Sailing) -> None:
        """Add a sailing to others, in order of departure."""
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
