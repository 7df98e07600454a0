"""Least fuel to be there in time, where the vessel chooses its speed from leg to leg.

Where the current is steady classes are planned by prices of time
(:mod:`renew.planner.price_search`), else at one speed, and then hour by hour
(:mod:`renew.planner.clock_search`).

Land is padded for the highest speed, and then once more for the highest that is sailed, if that is
much lower: straits open, and paths are shorter. The padding for a speed covers all lower ones: how
far a turn reaches towards an edge is, for a given heading and current, the largest over time of
something linear in v, hence convex in v; at v = 0 it is the drift, than which it is no less at any
v; so it never falls as v rises. Beside that, hard-over turns are flown at the very speeds at which
each leg is sailed.
"""

import contextlib
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from renew.errors import ParameterError, PlanningError
from renew.inputs.arguments import check_speed_choice
from renew.inputs.shut_area import ShutArea
from renew.paths.speeds_by_clock import constant_speed
from renew.planner.areas import plan_around
from renew.planner.classes import plan_classes
from renew.planner.clock_search import ClockSearch
from renew.planner.departure_window import Progress
from renew.planner.one_class import ClassPlanner
from renew.planner.price_search import PriceSearch
from renew.planner.task import Task
from renew.results.plan import Departed, Departures, Plan, TradeOff
from renew.voyage.checks import check_current_at_endpoints
from renew.voyage.voyage import Voyage

# Share of the highest speed below which the padding for it is too wide to be left so.
_MUCH_LOWER = 0.95
# Rounds in which a route at one speed is looked for, and the share by which its speed may change in
# the last.
_ONE_SPEED_ROUNDS, _SAME = 4, 1e-7

_PlannerUpTo: TypeAlias = Callable[[float | None], ClassPlanner]
"""Gives the planner for speeds up to one (m/s), or up to the highest that the vessel may choose."""


def plan_with_speeds(task: Task, departure: float) -> Plan:
    """Plan at a departure (s) with a choice of speeds, around areas that are shut for some hours.

    Where the current does not change, with prices of time. ArrivalError where no route arrives in
    time even at the highest speed. Speeds are not chosen to pass an area before or after it is
    shut: a class whose least-fuel route may meet it falls away. Other arrivals would be at it at
    other times, and there is no trade-off.
    """
    check_speed_choice(task.vessel)

    def plan(closed: Sequence[ShutArea]) -> tuple[Plan, ClassPlanner]:
        @functools.cache
        def planner_up_to(most: float | None) -> ClassPlanner:
            planner = task.planner(closed, most)
            if planner.problem.voyage.departure == departure:
                return planner
            return planner.for_problem(planner.problem.leaving(departure))

        return _plan_up_to(planner_up_to), planner_up_to(None)

    found = plan_around(task.areas, plan)
    return replace(found, trade_off=None) if task.areas else found


def departures_with_speeds(
    task: Task, departures: Sequence[float], progress: Progress | None
) -> Departures:
    """Plan each of some departures (s), ascending; refused where none leaves a route.

    The one of least fuel is best: a voyage begun at another time meets another current, and has
    another time to be there. Nothing is known of departures between them, since what bounds
    arrivals at one speed (:mod:`renew.planner.departure_window`) does not bound fuel.
    """
    check_speed_choice(task.vessel)
    plans: list[Plan | PlanningError] = []
    for departure in departures:
        try:
            plans.append(plan_with_speeds(task, departure))
        except PlanningError as error:
            plans.append(error)
        if progress is not None:
            progress(len(plans), math.inf)
    outcomes = [
        Departed(departure, cause=one)
        if isinstance(one, PlanningError)
        else Departed(
            departure,
            float(one.best.times[-1]),
            one.best.fuel,
            one.best.path,
            one.best.times,
            one.best.homotopy,
        )
        for departure, one in zip(departures, plans, strict=True)
    ]
    chosen = plans[min(range(len(plans)), key=lambda at: outcomes[at].fuel)]
    if isinstance(chosen, PlanningError):
        raise chosen
    return Departures.of(outcomes, math.inf, chosen)


def _plan_up_to(planner_up_to: _PlannerUpTo) -> Plan:
    """Plan with speeds up to the highest, by planners for a highest speed (m/s)."""
    voyage = planner_up_to(None).problem.voyage
    if voyage.waters.current_change > 0 and len(voyage.via):
        raise ParameterError(
            "speeds can't be chosen on a way with via points in a current that changes; leave out "
            "speed or via, or plan from one via point to the next with an arrival at each"
        )
    if voyage.waters.current_change == 0:
        return _plan_and_narrow(planner_up_to, PriceSearch)
    plan = _plan_and_narrow(planner_up_to, ClockSearch)
    return _with_one_speed(plan, planner_up_to, voyage)


def _with_one_speed(plan: Plan, planner_up_to: _PlannerUpTo, voyage: Voyage) -> Plan:
    """The plan, or one whose best route is sailed at one speed, where that needs less fuel.

    A vessel that never goes faster can turn in less room.
    """
    path, best = plan.best.path, plan.best
    speed = 0.0
    for _ in range(_ONE_SPEED_ROUNDS):
        before, speed = speed, constant_speed(path, voyage)
        if abs(speed - before) <= _SAME * speed:
            break
        with contextlib.suppress(PlanningError):
            (route,) = plan_classes(planner_up_to(speed), 1).routes or (best,)
            path = route.path
            if route.times[-1] <= voyage.deadline and route.fuel < best.fuel:
                best = route
    if best is plan.best:
        return plan
    routes = [best, *(route for route in plan.routes if route.homotopy != best.homotopy)]
    bound = plan.best.fuel_bound
    return replace(plan, routes=tuple(replace(route, fuel_bound=bound) for route in routes))


def _plan_and_narrow(
    planner_up_to: _PlannerUpTo, search: Callable[[ClassPlanner], PriceSearch]
) -> Plan:
    """Plan by a search up to the highest speed, and again with padding for the highest one sailed.

    ArrivalError where no route arrives in time even at the highest speed.
    """
    planner = planner_up_to(None)
    check_current_at_endpoints(planner.problem.voyage)
    plan = search(planner).plan()
    highest = float(plan.best.speeds.max())
    if (
        not planner.options.is_adaptive
        or highest > _MUCH_LOWER * planner.problem.voyage.vessel.speed
    ):
        return plan
    try:
        slower = search(planner_up_to(highest)).plan()
    except PlanningError:
        # Water that only a faster vessel can stem.
        return plan
    return plan if slower.best.fuel >= plan.best.fuel else _cheaper_of_each_class(plan, slower)


def _cheaper_of_each_class(plan: Plan, slower: Plan) -> Plan:
    """The cheaper route of each class of two plans; a longer way may need the higher speeds."""
    by_fuel = sorted([*slower.routes, *plan.routes], key=lambda route: route.fuel)
    cheapest = {route.homotopy: route for route in reversed(by_fuel)}
    # Proven is what holds for all speeds.
    bound = plan.best.fuel_bound
    routes = [
        replace(route, fuel_bound=bound) for route in by_fuel if cheapest[route.homotopy] is route
    ]
    rejected = {one.homotopy: one for one in (*slower.rejected, *plan.rejected)}
    return replace(
        plan,
        routes=tuple(routes[: max(len(plan.routes), len(slower.routes))]),
        rejected=tuple(one for name, one in rejected.items() if name not in cheapest),
        trade_off=_cheaper(plan.trade_off, slower.trade_off),
    )


def _cheaper(one: TradeOff | None, other: TradeOff | None) -> TradeOff | None:
    """The cheaper of two trade-offs for each arrival."""
    if one is None or other is None:
        return one or other
    arrivals = np.union1d(one.arrivals, other.arrivals)
    fuels = [np.interp(arrivals, c.arrivals, c.fuels, left=math.inf) for c in (one, other)]
    return TradeOff(arrivals, np.min(fuels, axis=0))
