"""Plan a voyage that may wait for water to open: at its start, and wherever the vessel can hold.

The way that arrives first (:mod:`renew.planner.clock_way`) says where to wait and until when. Its
parts between waits are planned one by one, each from the time at which its wait ends; so each part
has classes, padding, turns and hours of its own. The roadmap's way is a little longer than the path
that is planned, which would come too early: the wait lasts until the path itself meets no shut
water.

A vessel waits as early as it can, unless that makes it later. At the start, as in a harbour, it
burns nothing. Elsewhere it holds its place in the current c, which takes the fuel of a speed of
|c|; at anchor it would take nothing.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from renew._types import FloatArray
from renew.errors import PlanningError, UnreachableError
from renew.planner.clock_way import TimedWay, clock_way, waiting_early
from renew.planner.plan import plan_beside, plan_request, planner_of
from renew.request import Request
from renew.results import Plan

# Ticks by which a part may have to begin later than the way that leads it: its path is shorter.
_LATER = np.concatenate([np.arange(60.0), np.arange(60.0, 1_080.0, 12.0)])
# Time (s) that waits in more places have to save.
_WORTH = 60.0
# Largest number of parts: each wait is for one opening, and a voyage meets few.
_MOST_PARTS = 8
# Number of times in a wait at which the current is sampled.
_SAMPLES = 49


@dataclass(frozen=True, eq=False)
class Wait:
    """A wait at a `place` (2,), m, from `begin` until `end` (s); it burns `fuel`."""

    place: FloatArray
    begin: float
    end: float
    fuel: float = 0.0


@dataclass(frozen=True, eq=False)
class WaitingPlan:
    """A voyage in parts: the vessel waits before each of the `waits`' ends, and then sails on.

    Attributes
    ----------
    parts : the plan of each part, in order; a single one where it waits nowhere on the way.
    waits : before the first part, if it leaves later than asked, and between the parts.
    """

    parts: tuple[Plan, ...]
    waits: tuple[Wait, ...]

    @property
    def arrival(self) -> float:
        """When it comes to the goal by the best routes (s)."""
        return float(self.parts[-1].best.times[-1])

    @property
    def fuel(self) -> float:
        """Fuel of the best routes, and of the waits."""
        return sum(one.best.fuel for one in self.parts) + sum(one.fuel for one in self.waits)


def plan_waiting(request: Request, longest: float, *, tick: float = 10.0) -> WaitingPlan:
    """Plan with waits of up to `longest` (s) each, where they let the vessel arrive earlier.

    Parameters
    ----------
    request : Request
        What is asked, at the vessel's own speed.
    longest : float
        Longest wait (s).
    tick : float
        Times at which waits end are whole multiples of this (s), as no vessel leaves to the second.

    Raises
    ------
    PlanningError
        That of the plan without a wait, if waiting leads to no way either.
    """
    failure: PlanningError | None = None
    plain: WaitingPlan | None = None
    try:
        plain = WaitingPlan((plan_request(request),), ())
    except UnreachableError as error:
        failure = error
    if plain is not None and not plain.parts[0].shut:
        return plain
    way = clock_way(planner_of(request), request.areas, longest)
    found: WaitingPlan | None = None
    if way is not None:
        found = _along(request, waiting_early(way, planner_of(request).problem.voyage), tick)
        if found is None or found.arrival > way.arrive[-1] + _WORTH:
            # Waits in more places keep closer to the hours of the way.
            other = _along(request, way, tick)
            if other is not None and (found is None or other.arrival < found.arrival - _WORTH):
                found = other
    if found is None or (plain is not None and plain.arrival <= found.arrival):
        if plain is None and failure is not None:
            raise failure
        found = plain
    assert found is not None  # noqa: S101 - one of the two is there
    return found


def _along(request: Request, way: TimedWay, tick: float) -> WaitingPlan | None:
    """Plan the parts of a way between its waits; None where one of them has no plan."""
    parts, waits = list[Plan](), list[Wait]()
    at, now = 0, request.departure
    stops = [int(one) for one in way.waits if one > 0][: _MOST_PARTS - 1]
    for last in [*stops, len(way.points) - 1]:
        passed = [via for via in request.stops[1:-1] if _is_passed(via, way.points[at + 1 : last])]
        asked = replace(request, stops=np.stack([way.points[at], *passed, way.points[last]]))
        leave = max(now, float(way.leave[at]))
        if leave > request.departure:
            leave = tick * math.ceil(leave / tick)
        plan = plan_beside(replace(asked, departure=leave), way.part(at, last), tick * _LATER)
        if plan is None:
            return None
        leave = float(plan.best.times[0])
        if leave > now + tick:
            waits.append(_wait(request, way.points[at], (now, leave), is_on_way=at > 0))
        parts.append(plan)
        at, now = last, float(plan.best.times[-1])
    return WaitingPlan(tuple(parts), tuple(waits))


def _is_passed(point: FloatArray, points: FloatArray) -> bool:
    """Whether a point (2,) is one of some (n, 2)."""
    return bool((points == point).all(axis=1).any())


def _wait(
    request: Request, place: FloatArray, hours: tuple[float, float], *, is_on_way: bool
) -> Wait:
    """Return a wait between two times (s), with its fuel where the vessel holds its place."""
    vessel, (begin, end) = request.vessel, hours
    if not is_on_way:
        return Wait(place, begin, end)
    times = np.linspace(begin, end, _SAMPLES)
    points = np.broadcast_to(place, (_SAMPLES, 2))
    strength = np.linalg.norm(request.current.velocity(points, times), axis=-1)
    return Wait(place, begin, end, float(vessel.rates(strength).mean()) * (end - begin))
