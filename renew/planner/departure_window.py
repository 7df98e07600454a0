"""Plan departures until, by the paths found, no other departure can beat the best one.

On the same path a vessel that leaves later never overtakes. So a later departure never arrives
earlier, over all paths too (FIFO). If the best voyage from departure t takes D, a voyage from
s > t takes at least D - (s - t).

The rate at which the current changes gives a tighter bound. On a fixed path dt/dx = σ(x, t) = 1/g,
where g is the speed over ground. So the arrival A, as a function of the departure t, obeys
dA/dt = exp ∫ ∂σ/∂t dx = exp(-∫ (∂g/∂t) / g dt) >= exp(-ρ D), where D is the time under way and ρ
bounds |∂g/∂t| / g on any course (:attr:`renew.voyage.voyage.Voyage.speed_change`). On the best path
from s, this gives A(t) <= A(s) - exp(-ρ D) (s - t). So a voyage from s takes at least
D(t) - L (s - t), with L = 1 - exp(-ρ D), between 0 and 1. Only voyages that beat the best one
matter, so D in L is at most the best duration plus s - t.

The next planned departure is the first at which this bound is below the best duration by more than
a tolerance. Each plan covers tolerance / L of the window, so window / tolerance plans are always
enough. Slowly changing currents need far fewer plans, and a steady one needs one plan.

D(t) is the duration on the path that was found, not a lower bound. So the choice is exact to within
the errors of the paths and of the current's table, and is no proof. It depends on FIFO, which fails
where the current reaches the vessel's speed. Adaptive padding depends on the hours of passage, so a
later departure may have more room. The bound therefore starts from the earliest arrival of this
departure and all later ones.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from renew.planner.departures import Sailing, Sailings
from renew.results import Departures, Plan

Progress = Callable[[int, float], None]
"""Called after each plan: number of plans, and time (s) by which the best may still improve."""

# Number of rounds that plan the middles of both intervals beside the best departure.
_FINER = 3
# Lower limit of the slope, to avoid division by zero.
_FLATTEST = 1e-12
# Share of the tolerance below which a difference is a rounding error.
_ROUNDING = 1e-6


class _Interval(NamedTuple):
    """The interval between two successive departures (s).

    A voyage from `begin` takes at least `duration` (s). A voyage that departs later takes at least
    `duration` minus `slope` times the delay.
    """

    begin: float
    end: float
    duration: float
    slope: float

    @property
    def least_duration(self) -> float:
        """Lower bound (s) on the duration of all voyages that depart in the interval."""
        return self.duration - self.slope * (self.end - self.begin)

    def reach(self, goal: float) -> float:
        """Return the departure (s) before which no voyage is shorter than `goal` (s)."""
        return self.begin + (self.duration - goal) / max(self.slope, _FLATTEST)


class DepartureWindow:
    """Planned departures (n,), s, ascending; further ones are added where one may beat the best.

    No voyage takes less than `least_duration` (s). `speed_change` (1/s) is the largest relative
    change of the speed over ground per second; if infinite, departures between planned ones have no
    bound. Departures that are added are whole multiples of `spacing` (s) after the first, unless
    it is 0.
    """

    def __init__(
        self,
        sailings: Sailings,
        departures: Sequence[float],
        least_duration: float,
        *,
        speed_change: float,
        spacing: float = 0.0,
        progress: Progress | None,
    ) -> None:
        self._planner, self._least, self._change = sailings, least_duration, speed_change
        self._first, self._spacing = departures[0], spacing
        self._progress = progress
        self.sailings: list[Sailing] = []
        for departure in departures:
            self._plan(departure)
        self.sailings = self._planner.by_arrival(self.sailings)

    @property
    def best(self) -> Sailing:
        """The shortest sailing; of equal ones, the earliest."""
        return min(self.sailings, key=lambda one: one.duration)

    @property
    def unproven(self) -> float:
        """Time (s) by which a departure that is not planned may beat the best planned one."""
        if math.isinf(self._change) or self.best.found is None:
            return math.inf
        bound = min((one.least_duration for one in self._intervals()), default=math.inf)
        return max(0.0, self.best.duration - bound)

    def refine(self, tolerance: float) -> None:
        """Plan departures until no other can beat the best by more than `tolerance` s.

        Where durations have no bound, departures are planned one tolerance apart. The tolerance is
        at least the spacing.
        """
        tolerance = max(tolerance, self._spacing)
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
            self._plan(self._on_grid(max(one.reach(goal), one.begin + tolerance)))
        self.sailings = self._planner.by_arrival(self.sailings)

    def refine_around_best(self) -> None:
        """Plan departures ever closer to the best one, on both sides; no bound requires them."""
        for _ in range(_FINER):
            times = [one.departure for one in self.sailings]
            at = times.index(self.best.departure)
            for begin, end in itertools.pairwise(times[max(at - 1, 0) : at + 2]):
                middle = self._on_grid((begin + end) / 2)
                if begin < middle < end:
                    self._plan(middle)
        self.sailings = self._planner.by_arrival(self.sailings)

    def replace(self, sailing: Sailing) -> None:
        """Replace the sailing of an equal departure."""
        kept = [one for one in self.sailings if one.departure != sailing.departure]
        self._insert(kept, sailing)
        self.sailings = self._planner.by_arrival(self.sailings)

    def departures(self, plan: Plan) -> Departures:
        """Return the result, with the plan of the best departure."""
        return Departures.of([one.outcome for one in self.sailings], self.unproven, plan)

    def _on_grid(self, departure: float) -> float:
        """The last departure (s) up to this one that may be added."""
        if not self._spacing:
            return departure
        steps = math.floor((departure - self._first) / self._spacing + _ROUNDING)
        return self._first + steps * self._spacing

    def _plan(self, departure: float) -> None:
        """Plan a further departure."""
        self._insert(self.sailings, self._planner.sailing(departure))
        if self._progress is not None:
            self._progress(len(self.sailings), self.unproven)

    def _insert(self, others: Sequence[Sailing], sailing: Sailing) -> None:
        """Insert a sailing into others, in order of departure."""
        self.sailings = sorted((*others, sailing), key=lambda one: one.departure)

    def _intervals(self) -> Iterator[_Interval]:
        """Yield the intervals between departures, with bounds on durations."""
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
