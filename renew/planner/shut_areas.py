"""Keep routes out of areas that are shut for some hours, or while the tide is too low.

An area that is always shut is no-go like land. An area that is shut for some hours is first taken
as open. A route is dropped if the vessel, early, on time, late or in a turn, may be in the area
during these hours. All areas that routes met are then closed like land, and the voyage is planned
again, until no route meets an area. The plan with the best route is returned. So no route enters a
shut area; but the vessel never waits, and only the least-fuel path of each class through an area is
tried.

A full turn is taken to carry the vessel as far as :class:`renew.turns.turn_reach.TurnReach` says,
for as long as the turn lasts. The vessel can get no farther, so a path that is found free of an
area is safe.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import InfeasibleError, PlanningError, Text, UnreachableError, from_until
from renew.inputs.chart import Chart
from renew.inputs.shut_areas import Area, ShutArea, polygons_of
from renew.inputs.vessel import Vessel
from renew.planner.one_class import ClassPlanner
from renew.planner.sampled_paths import chosen_class
from renew.planner.task import Task
from renew.results import Plan, Rejected, Route
from renew.voyage.voyage import early_and_late

# Distance between the points at which a path is tested, in v/ω, and their largest number.
_SPACING, _MAX_POINTS = 0.5, 20_000


def with_always_shut(chart: Chart, areas: Sequence[ShutArea]) -> Chart:
    """Return the chart without the water of areas that are always shut."""
    always = [area for area in areas if area.is_always_shut]
    return chart.without(polygons_of(always), is_land=True) if always else chart


def meetings(
    route: Route, areas: Sequence[Area], planner: ClassPlanner
) -> dict[Area, InfeasibleError]:
    """Return the areas that the vessel may enter on a route while they are shut, with reasons."""
    if not areas:
        return {}
    voyage = planner.problem.voyage.leaving(float(route.times[0]))
    tree = shapely.STRtree([area.polygon for area in areas])
    found = dict[Area, InfeasibleError]()
    for line, times in (
        (route.path, route.times),
        (route.trajectory[:, 1:3], route.trajectory[:, 0]),
    ):
        points, passed = _densified(line, times, _spacing(line, voyage.vessel))
        far = np.full(len(points), planner.options.min_width)
        if planner.options.is_adaptive:
            far = planner.problem.reach(points)
        legs = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
        leg, which = tree.query(legs, predicate="dwithin", distance=np.maximum(far[:-1], far[1:]))
        early, late = voyage.early_and_late(passed)
        begin, end = early[:-1], late[1:] + voyage.vessel.turn_period
        for at in np.unique(which).tolist():
            near = np.sort(leg[which == at])
            met = near[areas[at].is_shut(begin[near], end[near])]
            if len(met) and areas[at] not in found:
                found[areas[at]] = InfeasibleError(
                    "near {0} the vessel, or a turn that it begins, may be in {1},{2}",
                    points[met[0]],
                    areas[at].text(voyage.departure),
                    from_until(float(begin[met].min()), float(end[met].max())),
                )
    return {area: found[area] for area in areas if area in found}


def _spacing(line: FloatArray, vessel: Vessel) -> float:
    """Length (m) of the pieces into which a line (n, 2) is cut for the test."""
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    return max(_SPACING * vessel.turning_radius, length / _MAX_POINTS)


def _densified(
    line: FloatArray, times: FloatArray, spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Return points (m, 2) on a line, at most `spacing` (m) apart, with their times (m,), s."""
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(lengths / spacing)).astype(int)
    leg = np.repeat(np.arange(len(lengths)), pieces)
    share = (np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[leg]
    points = line[leg] + share[:, None] * (line[leg + 1] - line[leg])
    passed = times[leg] + share * (times[leg + 1] - times[leg])
    return np.vstack([points, line[-1:]]), np.append(passed, times[-1:])


def without_meeting(
    plan: Plan, areas: Sequence[Area], planner: ClassPlanner
) -> tuple[Plan, dict[Area, float]]:
    """Return the plan without routes that meet areas, and the least fuel of these, by area."""
    routes, rejected, met = list[Route](), list(plan.rejected), dict[Area, float]()
    for route in plan.routes:
        reasons = meetings(route, areas, planner)
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
    areas: Sequence[Area],
    plan: Callable[[Sequence[Area]], tuple[Plan, ClassPlanner]],
) -> Plan:
    """Return the best plan whose routes keep out of areas while the areas are shut.

    `plan` returns a plan and its planner, with the given areas closed like land.
    """
    open_areas, closed = list(areas), list[Area]()
    plans: list[Plan] = []
    met: dict[Area, float] = {}
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
    raise unavoidable(closed, planner.problem.voyage.departure, failure)


def unavoidable(
    closed: Sequence[Area], departure: float, failure: PlanningError | None
) -> UnreachableError:
    """Return the error if every way meets a shut area, and no way leads around the areas.

    The error gives the areas' hours from a departure (s) on.
    """
    # Many areas of a chart share a name and a needed height of tide.
    texts = {str(text): text for text in (area.text(departure) for area in closed)}
    around = Text("") if failure is None else Text("; around them: {0}", (failure.text,))
    return UnreachableError(
        "every way may meet {0}{1}. Depart at another time, so as to pass before or after, or let "
        "the area be entered",
        Text.joined("; ", list(texts.values())),
        around,
    )


def with_least_water(plan: Plan, task: Task) -> Plan:
    """Return the plan with each route's least water; unchanged without tidal depths."""
    depth = task.depth
    if depth is None:
        return plan
    late = task.request.lateness, task.request.min_lateness

    def least(route: Route) -> Route:
        points, times = _densified(route.path, route.times, _spacing(route.path, task.vessel))
        schedules = (times, *early_and_late(times, times[0], *late))
        return replace(route, least_water=depth.least_water(points, schedules))

    return replace(plan, routes=tuple(map(least, plan.routes)))
