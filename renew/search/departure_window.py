"""When to leave: departures planned where the best one may still be, until the choice is proven.

A vessel that leaves later never overtakes on the same path, and so the earliest arrival over all
paths doesn't come earlier with a later departure either (FIFO). If she who leaves at t arrives at
A at best, a voyage begun at s > t takes A - s at least. That is the proof between departures.
Where it is short of the best duration by more than a tolerance, the next departure is planned as
far on as it reaches, at s = A - (best duration - tolerance). Each plan settles as much of the
window as the tolerance, or more: window over tolerance of them prove the choice on any scene, and
the more durations differ the fewer are needed.

It is as good as the paths are optimal, and rests on FIFO: where the current is as strong as the
vessel in places, nothing is proven. With adaptive padding land is padded for the hours of passage,
so that a later departure may find more room; then the earliest arrival of all later ones counts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from renew.route import Departures, Plan
from renew.search.sailings import DeparturePlanner, Sailing

Progress = Callable[[int, float], None]
"""Told after each plan: how many there are, and by how many seconds the best may be beaten."""

# Number of rounds in which the middles of the intervals beside the best departure are planned.
_FINER = 3
# Share of the tolerance that counts as none.
_ROUNDING = 1e-6


class _Interval(NamedTuple):
    """From one departure to the next (s); nobody who leaves in it arrives before `arrival` (s)."""

    begin: float
    end: float
    arrival: float

    @property
    def least_duration(self) -> float:
        """Time (s) that any voyage takes that is begun in it."""
        return self.arrival - self.end


class DepartureWindow:
    """Departures (n,), s, ascending, each planned; and more of them where it is worth it.

    No voyage takes less than `least_duration` (s), whatever the departure. Without FIFO nothing is
    proven.
    """

    def __init__(
        self,
        sailings: DeparturePlanner,
        departures: Sequence[float],
        least_duration: float,
        *,
        is_fifo: bool,
        progress: Progress | None,
    ) -> None:
        self._planner, self._least, self._is_fifo = sailings, least_duration, is_fifo
        self._progress = progress
        self.sailings: list[Sailing] = []
        for departure in departures:
            self._plan(departure)
        self.sailings = self._planner.in_order(self.sailings)

    @property
    def best(self) -> Sailing:
        """The sailing that takes least time, the earliest of those that do."""
        return min(self.sailings, key=lambda one: one.duration)

    @property
    def unproven(self) -> float:
        """Time (s) by which a departure between those planned may beat the best of these."""
        if not self._is_fifo or self.best.found is None:
            return math.inf
        bound = min((one.least_duration for one in self._intervals()), default=math.inf)
        return max(0.0, self.best.duration - bound)

    def refine(self, tolerance: float) -> None:
        """Plan more departures until none between can beat the best by more than so many seconds.

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
            self._plan(max(one.arrival - goal, one.begin + tolerance))
        self.sailings = self._planner.in_order(self.sailings)

    def look_closer(self) -> None:
        """Plan departures beside the best one, ever closer to it; nothing is proven by these."""
        for _ in range(_FINER):
            times = [one.departure for one in self.sailings]
            at = times.index(self.best.departure)
            for beside in (*times[max(at - 1, 0) : at], *times[at + 1 : at + 2]):
                self._plan((times[at] + beside) / 2)
        self.sailings = self._planner.in_order(self.sailings)

    def replace(self, sailing: Sailing) -> None:
        """Take another sailing of the same departure."""
        kept = [one for one in self.sailings if one.departure != sailing.departure]
        self._insert(kept, sailing)
        self.sailings = self._planner.in_order(self.sailings)

    def departures(self, plan: Plan) -> Departures:
        """What has been found, with the plan at the best departure."""
        sailings = self.sailings
        return Departures(
            departures=np.array([one.departure for one in sailings]),
            arrivals=np.array([one.arrival for one in sailings]),
            fuels=np.array([one.fuel for one in sailings]),
            paths=tuple(one.found.path if one.found else None for one in sailings),
            times=tuple(one.times for one in sailings),
            homotopies=tuple(one.homotopy for one in sailings),
            reasons=tuple("" if one.found else one.reason for one in sailings),
            unproven=self.unproven,
            plan=plan,
        )

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
            yield _Interval(
                here.departure, after.departure, max(bound, here.departure + self._least)
            )
