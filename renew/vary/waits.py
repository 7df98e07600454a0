"""Plan a voyage that may wait for water to open: at its start, and wherever the vessel can hold.

The way that arrives first (:mod:`renew.planner.clock_way`) says where to wait and until when. Its
parts between waits are planned one by one, each from the time at which its wait ends; so each part
has classes, padding, turns and hours of its own. The roadmap's way is a little longer than the path
that is planned, which would come too early: the wait lasts until the path itself meets no shut
water.

Of the places at which it may wait a vessel takes the cheapest, and waits as early as it can, unless
that makes it later. At the start, as in a harbour, it burns nothing; in an anchorage what it burns
at rest. Elsewhere it holds its place in the current c, which takes the fuel of a speed of |c|.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.planner.clock_way import TimedWay, clock_way, waiting_early
from renew.planner.plan import check_start_open, is_hindered, plan_beside, plan_request, planner_of
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
    """A wait at a `place` (2,), m, from `begin` until `end` (s), which burns `fuel`."""

    place: FloatArray
    begin: float
    end: float
    fuel: float = 0.0
    at_anchor: bool = False


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


def plan_waiting(
    request: Request,
    longest: float,
    *,
    tick: float = 10.0,
    anchorage: BaseGeometry | None = None,
) -> WaitingPlan:
    """Plan with waits of up to `longest` (s) each, where they let the vessel arrive earlier.

    Parameters
    ----------
    request : Request
        What is asked, at the vessel's own speed.
    longest : float
        Longest wait (s).
    tick : float
        Times at which waits end are whole multiples of this (s), as no vessel leaves to the second.
    anchorage : BaseGeometry, optional
        Water (m) in which the vessel can anchor, however strong the current is.

    Raises
    ------
    PlanningError
        That of the plan without a wait, if waiting leads to no way either.
    """
    check_start_open(request, request.departure, longest)
    found, way, planner = None, None, planner_of(request)
    if is_hindered(request):
        way = clock_way(planner, request.areas, longest, anchorage)
    if way is not None:
        early = waiting_early(way, planner.problem.voyage)
        found = _along(request, early, tick, anchorage)
        if found is None or found.arrival > way.arrive[-1] + _WORTH:
            # Waits in more places keep closer to the hours of the way.
            other = _along(request, way, tick, anchorage)
            if other is not None and (found is None or other.arrival < found.arrival - _WORTH):
                found = other
    return found if found and found.waits else WaitingPlan((plan_request(request),), ())


def _along(
    request: Request, way: TimedWay, tick: float, anchorage: BaseGeometry | None
) -> WaitingPlan | None:
    """Plan the parts of a way between its waits; None where one of them has no plan."""
    parts, waits = list[Plan](), list[Wait]()
    at, now = 0, request.departure
    stops = [int(one) for one in way.waits if one > 0][: _MOST_PARTS - 1]
    for last in [*stops, len(way.points) - 1]:
        between = way.points[at + 1 : last]
        passed = [via for via in request.stops[1:-1] if (between == via).all(axis=1).any()]
        asked = replace(request, stops=np.stack([way.points[at], *passed, way.points[last]]))
        leave = max(now, float(way.leave[at]))
        if leave > request.departure:
            leave = tick * math.ceil(leave / tick)
        plan = plan_beside(replace(asked, departure=leave), way.part(at, last), tick * _LATER)
        if plan is None:
            return None
        leave = float(plan.best.times[0])
        if leave > now + tick:
            anchored = anchorage is not None and shapely.intersects_xy(anchorage, *way.points[at])
            wait = Wait(way.points[at], now, leave, at_anchor=at > 0 and bool(anchored))
            waits.append(_with_fuel(request, wait) if at > 0 else wait)
        parts.append(plan)
        at, now = last, float(plan.best.times[-1])
    return WaitingPlan(tuple(parts), tuple(waits))


def _with_fuel(request: Request, wait: Wait) -> Wait:
    """Return a wait on the way with its fuel: the vessel lies at anchor, or holds its place."""
    times = np.linspace(wait.begin, wait.end, _SAMPLES)
    points = np.broadcast_to(wait.place, (_SAMPLES, 2))
    strength = np.linalg.norm(request.current.velocity(points, times), axis=-1)
    rates = request.vessel.rates(0.0 * strength if wait.at_anchor else strength)
    return replace(wait, fuel=float(rates.mean()) * (wait.end - wait.begin))
