"""Plan routes that keep out of areas while the areas are shut.

An area that is always shut is no-go like land. An area that is shut for some hours is first taken
as open. A route is dropped if the vessel, early, on time, late or in a turn, may be in the area
during these hours. All areas that routes met are then closed like land, and the voyage is planned
again, until no route meets an area. The plan with the best route is returned. So no route enters a
shut area; but the vessel never waits, and only the least-fuel path of each class through an area is
tried.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from renew.errors import InfeasibleError, PlanningError, Text, UnreachableError, from_until
from renew.inputs.chart import Chart, ShutArea, polygons_of
from renew.planner.harmonic_mean import chosen_class
from renew.planner.one_class import ClassPlanner
from renew.results import Plan, Rejected, Route
from renew.turns.passage_windows import meeting


def with_always_shut(chart: Chart, areas: Sequence[ShutArea]) -> Chart:
    """Return the chart without the water of areas that are always shut."""
    always = [area for area in areas if area.is_always_shut]
    return chart.without(polygons_of(always), is_land=True) if always else chart


def meets(route: Route, area: ShutArea, planner: ClassPlanner) -> InfeasibleError | None:
    """Return why the vessel may be in an area while it is shut on this route, or None."""
    voyage = planner.problem.voyage.leaving(float(route.times[0]))
    options = planner.options
    reach = planner.problem.reach if options.is_adaptive else options.min_width
    for line, times in (
        (route.path, route.times),
        (route.trajectory[:, 1:3], route.trajectory[:, 0]),
    ):
        found = meeting(line, times, area, voyage, reach)
        if found is not None:
            where, begin, end = found
            return InfeasibleError(
                "near {0} the vessel, or a turn that it begins, may be in {1},{2}",
                where,
                area.text,
                from_until(begin, end),
            )
    return None


def without_meeting(
    plan: Plan, areas: Sequence[ShutArea], planner: ClassPlanner
) -> tuple[Plan, dict[ShutArea, float]]:
    """Return the plan without routes that meet shut areas, and the least fuel to meet each area."""
    routes, rejected, met = list[Route](), list(plan.rejected), dict[ShutArea, float]()
    for route in plan.routes:
        reasons = {area: reason for area in areas if (reason := meets(route, area, planner))}
        if not reasons:
            routes.append(route)
            continue
        met |= {area: min(route.fuel, met.get(area, route.fuel)) for area in reasons}
        reason = next(iter(reasons.values()))
        rejected.append(
            Rejected(
                route.homotopy, str(reason), route.channel, cause=reason, fuel_source=route.fuel
            )
        )
    chosen = chosen_class(routes) if routes else 0
    return replace(plan, routes=tuple(routes), rejected=tuple(rejected), chosen=chosen), met


def plan_around(
    areas: Sequence[ShutArea],
    plan: Callable[[Sequence[ShutArea]], tuple[Plan, ClassPlanner]],
) -> Plan:
    """Return the best plan whose routes keep out of areas while the areas are shut.

    `plan` returns a plan and its planner, with the given areas closed like land.
    """
    open_areas, closed = list(areas), list[ShutArea]()
    plans: list[Plan] = []
    met: dict[ShutArea, float] = {}
    failure: PlanningError | None = None
    while True:
        try:
            found, planner = plan(closed)
        except PlanningError as error:
            if not closed:
                raise
            failure = error
            break
        kept, met_here = without_meeting(found, open_areas, planner)
        if kept.routes:
            plans.append(kept)
        if not met_here:
            break
        met |= met_here
        closed = [*closed, *met_here]
        open_areas = [area for area in open_areas if area not in met_here]
    if plans:
        best = min(plans, key=lambda one: one.best.harmonic_mean)
        cheaper = (area for area in areas if met.get(area, math.inf) < best.best.fuel)
        return replace(best, shut=tuple(cheaper))
    raise unavoidable(closed, failure)


def unavoidable(closed: Sequence[ShutArea], failure: PlanningError | None) -> UnreachableError:
    """Return the error if every way meets a shut area, and no way leads around the areas."""
    around = Text("") if failure is None else Text("; around them: {0}", (failure.text,))
    return UnreachableError(
        "every way may meet {0}{1}. Depart at another time, so as to pass before or after, or let "
        "the area be entered",
        Text.joined("; ", [area.text for area in closed]),
        around,
    )
