"""Plan one request at its departure, around areas that are shut for some hours.

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
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np
import shapely
from shapely import Polygon

from renew import errors
from renew._types import FloatArray, IntArray
from renew.inputs.chart_and_vessel import Vessel
from renew.inputs.openings import Opening, OverLimit, polygons_of
from renew.planner.classes import no_class_error, plan_classes
from renew.planner.clock_way import TimedWay, clock_way
from renew.planner.one_class import ClassPlanner
from renew.planner.problem import Problem, check_current_at_endpoints, check_endpoints, check_pace
from renew.planner.sampled_paths import chosen_class
from renew.request import Request
from renew.results import Plan, Rejected, Route
from renew.turns.verification import spacing_along
from renew.voyage.voyage import Waters, early_and_late

_T = TypeVar("_T")

# Distance between the points at which a path is tested, in v/ω.
_SPACING = 0.5
# Largest number of these points, and number of legs between them in a longer piece.
_MAX_POINTS, _PIECE = 20_000, 64

# Number of shut areas that an error names: with official levels each has its own hours.
_MOST_NAMED = 3
# Time (s) in which an area at a stop has to open: a tide that is too low for as long stays so.
_HORIZON = 30 * 86_400.0


def plan_request(request: Request) -> Plan:
    """Plan at the request's departure and at the vessel's own speed."""

    def plan_with(closed: Sequence[Opening]) -> tuple[Plan, ClassPlanner]:
        planner = planner_of(request, closed)
        check_current_at_endpoints(planner.problem.voyage)
        plan = plan_classes(planner, planner.options.classes)
        if not plan.routes:
            raise no_class_error(plan.rejected, planner)
        return plan, planner

    check_start_open(request, request.departure)
    beside = _plan_past_weather(request)
    return plan_around(request.areas, plan_with) if beside is None else beside


def or_with_shortfall(request: Request, plan: Callable[[Request], _T]) -> _T:
    """Return what is planned; where no way keeps the padding, with as much as there is room for."""
    options = request.options
    try:
        return plan(request)
    except errors.UnreachableError as error:
        is_late = error.causes and all(isinstance(one, errors.TooLateError) for one in error.causes)
        if is_late or isinstance(error, errors.ShutStartError) or not options.may_fall_short:
            raise
    return plan(replace(request, falls_short=True))


def finished(plan: Plan, request: Request) -> Plan:
    """Return the plan with its request, the least water under each route, and bounds as asked."""
    gap_to = request.options.gap_to
    if gap_to > 0 and plan.routes:
        best = plan.best
        bound = replace(best.fuel_bound, enough=best.fuel / (1 + gap_to))
        plan = replace(plan, routes=tuple(replace(one, fuel_bound=bound) for one in plan.routes))
    return replace(with_least_water(plan, request), voyage=request)


def planner_of(
    request: Request, closed: Collection[Opening] = (), most: float | None = None
) -> ClassPlanner:
    """Return the planner at a request's departure, for speeds up to `most` (m/s), made once.

    Areas in `closed` are closed like land. If no speeds are to be chosen, the planner uses the
    vessel's own.
    """
    key = frozenset(closed), most
    if key not in request.planners:
        request.planners[key] = _new_planner(request, closed, most)
    return cast("ClassPlanner", request.planners[key])


def _new_planner(request: Request, closed: Collection[Opening], most: float | None) -> ClassPlanner:
    """Make a planner; raise an error for stops on land, or a current that changes too fast."""
    waters, vessel = request.waters, request.vessel
    if closed:
        polygons = polygons_of([area for area in request.areas if area in closed])
        waters = Waters(request.chart.without(polygons, is_land=False), request.current)
    if request.speed is not None:
        vessel = replace(vessel, speed=float(request.speed[1]) if most is None else most)
    voyage = request.voyage(waters, vessel)
    check_endpoints(voyage)
    check_pace(voyage)
    # Water that a limit of time adrift shuts is open around a voyage's own ends.
    if request.like is not None and not closed and not request.options.adrift:
        known = planner_of(request.like)
        return known.for_problem(known.problem.with_voyage(voyage))
    problem = Problem(voyage, request.options)
    return ClassPlanner(problem.falling_short() if request.falls_short else problem)


def check_start_open(request: Request, departure: float) -> None:
    """Refuse a start that areas shut at a departure (s)."""
    place, opens, shut = request.stops[0], departure, list[Opening]()
    stays = request.options.min_lateness + request.vessel.turn_period
    polygons = np.array([area.polygon for area in request.areas], dtype=object)
    around = np.flatnonzero(shapely.intersects_xy(polygons, *place)).tolist()
    span = departure, departure + _HORIZON
    spells = ((*own, at) for at in around for own in request.areas[at].hours(*span).tolist())
    for begin, end, at in sorted(spells):
        if begin < opens + stays and end > opens:
            opens = end
            shut.append(request.areas[at])
    if opens <= departure:
        return
    remedy = "Depart after {2}" if opens < math.inf else "It does not open again: move it"
    if isinstance(shut[-1], OverLimit) and math.isinf(shut[-1].most):
        remedy = "No more is known: give a forecast that reaches further"
    named = _named(shut, departure)
    opening = [errors.Moment(opens)] * (opens < math.inf)
    raise errors.ShutStartError(f"the start {{0}} lies in {{1}}. {remedy}", place, named, *opening)


def meetings(
    route: Route, areas: Sequence[Opening], planner: ClassPlanner
) -> dict[Opening, errors.InfeasibleError]:
    """Return the areas that the vessel may enter on a route while they are shut, with reasons."""
    if not areas:
        return {}
    voyage = planner.problem.voyage.leaving(float(route.times[0]))
    found = dict[Opening, errors.InfeasibleError]()
    for points, passed in _lines(route, voyage.vessel):
        early, late = voyage.early_and_late(passed)
        begin, end = early[:-1], late[1:] + voyage.vessel.turn_period
        # Most of many areas, such as the cells of a wind, are open all the way.
        all_way = float(begin.min()), float(end.max())
        shut = [area for area in areas if area.is_shut_within(*all_way)]
        leg, which = _near(points, shut, planner)
        for at in np.unique(which).tolist():
            near = np.sort(leg[which == at])
            met = near[shut[at].is_shut(begin[near], end[near])]
            if len(met) and shut[at] not in found:
                found[shut[at]] = errors.InfeasibleError(
                    "near {0} the vessel, or a turn that it begins, may be in {1},{2}",
                    points[met[0]],
                    shut[at].text(voyage.departure),
                    errors.from_until(float(begin[met].min()), float(end[met].max())),
                )
    return {area: found[area] for area in areas if area in found}


def _lines(route: Route, vessel: Vessel) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield close points (n, 2), m, and times (n,), s, of a route's path and of its trajectory."""
    for line, times in (
        (route.path, route.times),
        (route.trajectory[:, 1:3], route.trajectory[:, 0]),
    ):
        yield _densified(line, times, vessel)


def _near(
    points: FloatArray, areas: Sequence[Opening], planner: ClassPlanner
) -> tuple[IntArray, IntArray]:
    """Return the legs between points (n, 2), m, from which a turn may reach an area, with these."""
    if not areas:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    far = np.full(len(points), planner.options.min_width)
    if planner.options.is_adaptive:
        far = planner.problem.reach(points)
    tree = shapely.STRtree([area.polygon for area in areas])
    # Most long pieces are far from all areas, so that their legs are, too.
    pieces = np.arange(0, len(points) - 1, _PIECE)[:, None] + np.arange(_PIECE + 1)
    pieces = np.minimum(pieces, len(points) - 1)
    lines, reach = shapely.linestrings(points[pieces]), far[pieces].max(axis=1)
    near = np.unique(tree.query(lines, predicate="dwithin", distance=reach)[0])
    leg = np.unique(np.minimum(pieces[near, :-1], len(points) - 2))
    legs = shapely.linestrings(np.stack([points[leg], points[leg + 1]], axis=1))
    reach = np.maximum(far[leg], far[leg + 1])
    at, which = tree.query(legs, predicate="dwithin", distance=reach)
    return leg[at], which


def shut_on_the_way(
    request: Request, departure: float, met: Collection[Opening]
) -> frozenset[Opening]:
    """Return what is shut beside the way that arrives first, if weather was met; or nothing."""
    if not any(isinstance(area, OverLimit) for area in met):
        return frozenset()
    planner = planner_of(request)
    planner = planner.for_problem(planner.problem.leaving(departure))
    way = clock_way(planner, request.areas)
    return frozenset() if way is None else way.passing(request.areas, planner.problem.voyage)


def is_hindered(request: Request) -> bool:
    """Whether the best route, as if all areas were open, meets one of them while it is shut."""
    if "hindered" not in request.planners:
        planner = planner_of(request)
        check_current_at_endpoints(planner.problem.voyage)
        routes = plan_classes(planner, 1).routes if request.areas else ()
        met = bool(routes) and bool(meetings(routes[0], request.areas, planner))
        request.planners["hindered"] = met
    return bool(request.planners["hindered"])


def _plan_past_weather(request: Request) -> Plan | None:
    """Return a plan past wind and waves over a limit, without a wait; None if none is found so.

    Cells of a storm are many, and shut at other hours each: closed for good, one after the other,
    they would shut much that is open when the vessel comes there.
    """
    if not any(isinstance(area, OverLimit) for area in request.areas):
        return None
    planner = planner_of(request)
    if is_hindered(request):
        way = clock_way(planner, request.areas)
        beside = None if way is None else plan_beside(request, way)
        if beside is not None:
            return _with_other_classes(beside, request)
    plan = plan_classes(planner, planner.options.classes)
    kept, met = without_meeting(plan, request.areas, planner)
    if kept.routes:
        cheaper = (area for area in request.areas if met.get(area, math.inf) < kept.best.fuel)
        return replace(kept, shut=tuple(cheaper))
    if met:
        raise unavoidable(tuple(met), request.departure, None)
    return None


def _with_other_classes(beside: Plan, request: Request) -> Plan:
    """Return a plan with the routes of all classes around the areas that are closed in it."""
    closed, each = frozenset(beside.shut), dict[str, Route]()
    planner = planner_of(request, closed)
    others = [area for area in request.areas if area not in closed]
    kept, _ = without_meeting(plan_classes(planner, planner.options.classes), others, planner)
    best = replace(beside.best, fuel_bound=(kept if kept.routes else beside).best.fuel_bound)
    for route in sorted((best, *kept.routes), key=lambda one: one.fuel):
        each.setdefault(route.homotopy, route)
    return replace(kept, routes=tuple(each.values()), chosen=0, shut=beside.shut)


# Largest number of plans beside a way: each closes what the one before met, or what is shut beside
# its own route. The gain (s) in arrival from which there is another.
_ROUNDS = 5
_GAIN = 1.0


def plan_beside(request: Request, way: TimedWay) -> Plan | None:
    """Plan beside a way that leads past areas with hours; None without a route.

    Where the plan arrives later than the way, it is made again in the water close to the way alone:
    a path that leaves the way is elsewhere at other hours.
    """
    found = _plan_along(request, way)
    if found is not None and found.best.times[-1] <= way.times[-1]:
        return found
    outside = request.chart.extent.difference(way.tube(request.chart))
    polygons = [part for part in shapely.get_parts(outside) if isinstance(part, Polygon)]
    chart = request.chart.without(polygons, is_land=False)
    close = _plan_along(replace(request, chart=chart, like=None), way)
    if close is None or (found is not None and found.best.times[-1] <= close.best.times[-1]):
        return found
    return close


def _plan_along(request: Request, way: TimedWay) -> Plan | None:
    """Plan with the areas closed that are shut when a way passes beside them; None without a route.

    The route found is then taken as the way, as it passes at better known hours.
    """
    best: Plan | None = None
    closed = way.passing(request.areas, planner_of(request).problem.voyage)
    tried = set[frozenset[Opening]]()
    while closed not in tried and len(tried) < _ROUNDS:
        tried.add(closed)
        try:
            planner = planner_of(request, closed)
            plan = plan_classes(planner, 1)
        except errors.PlanningError:
            break
        if not plan.routes:
            break
        others = [area for area in request.areas if area not in closed]
        kept, met = without_meeting(plan, others, planner)
        best = _earlier(best, kept, closed, request)
        if kept.routes and kept.best.times[-1] <= plan.best.times[-1] + _GAIN:
            way = TimedWay(kept.best.path, kept.best.times)
            closed = way.passing(request.areas, planner.problem.voyage)
        else:
            closed |= frozenset(met)
    return best


def _earlier(
    best: Plan | None, plan: Plan, closed: Collection[Opening], request: Request
) -> Plan | None:
    """Return the plan that arrives earlier; the new one with what was closed in it."""
    if not plan.routes:
        return best
    if best is not None and best.best.times[-1] <= plan.best.times[-1]:
        return best
    return replace(plan, shut=tuple(area for area in request.areas if area in closed))


def _densified(
    line: FloatArray, times: FloatArray, vessel: Vessel
) -> tuple[FloatArray, FloatArray]:
    """Return points (m, 2) on a line, close together for the test, with their times (m,), s."""
    spacing = spacing_along(line, _SPACING * vessel.turning_radius, _MAX_POINTS)
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(lengths / spacing)).astype(int)
    leg = np.repeat(np.arange(len(lengths)), pieces)
    share = (np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[leg]
    points = line[leg] + share[:, None] * (line[leg + 1] - line[leg])
    passed = times[leg] + share * (times[leg + 1] - times[leg])
    return np.vstack([points, line[-1:]]), np.append(passed, times[-1:])


def without_meeting(
    plan: Plan, areas: Sequence[Opening], planner: ClassPlanner
) -> tuple[Plan, dict[Opening, float]]:
    """Return the plan without routes that meet areas, and the least fuel of these, by area."""
    routes, rejected, met = list[Route](), list(plan.rejected), dict[Opening, float]()
    for route in plan.routes:
        reasons = meetings(route, areas, planner)
        if not reasons:
            routes.append(route)
            continue
        met |= {area: min(route.fuel, met.get(area, route.fuel)) for area in reasons}
        rejected.append(Rejected.of_route(route, next(iter(reasons.values()))))
    chosen = chosen_class(routes) if routes else 0
    return replace(plan, routes=tuple(routes), rejected=tuple(rejected), chosen=chosen), met


def plan_around(
    areas: Sequence[Opening], plan: Callable[[Sequence[Opening]], tuple[Plan, ClassPlanner]]
) -> Plan:
    """Return the best plan whose routes keep out of areas while the areas are shut.

    `plan` returns a plan and its planner, with the given areas closed like land.
    """
    open_areas, closed = list(areas), list[Opening]()
    plans: list[Plan] = []
    met: dict[Opening, float] = {}
    failure: errors.PlanningError | None = None
    while True:
        try:
            found, planner = plan(closed)
        except errors.PlanningError as error:
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
    closed: Sequence[Opening], departure: float, failure: errors.PlanningError | None
) -> errors.UnreachableError:
    """Return the error if every way meets a shut area, and no way leads around the areas.

    The error gives the areas' hours from a departure (s) on.
    """
    # Of the reasons of many classes one is enough; an end inside an area is told with the area.
    causes = failure.causes if isinstance(failure, errors.UnreachableError) else ()
    around = errors.Text("")
    if failure is not None and not isinstance(
        failure, (errors.StartInNoGoError, errors.GoalInNoGoError)
    ):
        around = errors.Text("; around them: {0}", ((causes[0] if causes else failure).text,))
    is_weather = any(isinstance(area, OverLimit) for area in closed)
    otherwise = "" if is_weather else ", or let the area be entered"
    return errors.UnreachableError(
        "every way may meet {0}{1}. Depart at another time, so as to pass before or after"
        f"{otherwise}",
        _named(closed, departure),
        around,
    )


def _named(areas: Sequence[Opening], departure: float) -> errors.Text:
    """Name the first of some areas with their hours from a departure (s) on."""
    # Many areas of a chart share a name and a needed height of tide.
    each = {str(text): text for text in (area.text(departure) for area in areas)}
    return errors.Text.joined("; ", list(each.values())[:_MOST_NAMED])


def with_least_water(plan: Plan, request: Request) -> Plan:
    """Return the plan with each route's least water; unchanged without tidal depths."""
    depth = request.depth
    if depth is None:
        return plan
    late = request.options.lateness, request.options.min_lateness

    def least(route: Route) -> Route:
        points, times = _densified(route.path, route.times, request.vessel)
        schedules = (times, *early_and_late(times, times[0], *late))
        return replace(route, least_water=depth.least_water(points, schedules))

    return replace(plan, routes=tuple(map(least, plan.routes)))
