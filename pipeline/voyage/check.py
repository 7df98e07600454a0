"""Check a route that the user has: in the water and the current in which a plan would be made.

Its figures are the measures of a run's routes, and beside it are the least-fuel route of its own
side and the best of all. What was found is put in sentences.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.findings import text
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.findings.route_profile import closest_approach, coast_edges, cumulative, sailed
from pipeline.findings.text import planner_text, season_text
from pipeline.findings.way_names import island_places, way_names
from pipeline.model import Case, CaseResult, Note, Place, PlaceName, plan_options
from pipeline.model.case import MIN_LATENESS_S
from pipeline.run import EventHandler, prepare
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.stages.lanes import AgainstLane, against_lanes
from pipeline.stages.measure import measured
from pipeline.stages.plan_case import reason_text
from pipeline.voyage.positions import spelled
from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.route_file import GivenRoute
from renew.errors import Moment, Text

# Least true metres of a crossing that is named: a shorter one only grazes the shore.
_LEAST_M = 1.0


@dataclass(frozen=True, slots=True)
class LandCrossed:
    """Land that a route crosses: its name, if it has one, how far, and the middle of that part."""

    name: str
    length_m: float
    place: Place


@dataclass(frozen=True, eq=False)
class CheckedRoute:
    """A given route in the current of one case.

    Attributes
    ----------
    given : it, with its measures.
    same_side, best : the least-fuel routes of its side and of all sides; None if there is none.
    why_not : why there is no plan, or none on its side; or "".
    passed_s : (n,) seconds since the departure at its points.
    crossed : the land that it crosses, the longest part first.
    nearest : where land is nearest; None where it crosses land, or there is none.
    shut : sentences on the areas that it enters, or may meet while they are shut.
    against : the traffic lanes that it sails against.
    met : places from which a hard-over turn meets land.
    """

    given: RankedRoute
    same_side: RankedRoute | None
    best: RankedRoute | None
    why_not: str
    passed_s: FloatArray
    crossed: tuple[LandCrossed, ...]
    nearest: Place | None
    shut: tuple[str, ...]
    against: tuple[AgainstLane, ...]
    met: tuple[Place, ...]


def check_route(
    request: VoyageRequest,
    asked: tuple[Scenario, tuple[str, ...]],
    route: GivenRoute,
    on_event: EventHandler,
) -> tuple[RunResult, tuple[CheckedRoute, ...]]:
    """Check a route in the current of each case of a request between its ends.

    `asked` is the request's scenario, with notes on how it was read. Raises RequestError if the
    request is wrong, an end lies too far from water, or the currents end on the way; StageError if
    a source can't be used.
    """
    if request.chooses_speeds:
        raise RequestError("--speed: a route is checked at one speed; give one, such as 12kn")
    scenario, notes = asked
    turn = 360.0 * round((scenario.start[0] - route.lonlat[0, 0]) / 360)
    line, at = route.drawn
    line = line + np.array([turn, 0.0])
    far = text.distance(route.joined_m)
    said = (
        *notes,
        *([f"the first of {route.others + 1} routes of the file was checked"] * bool(route.others)),
        *(
            [f"its parts were joined by straight lines of up to {far}"]
            * (route.joined_m > _LEAST_M)
        ),
        *(f"it ends where it begins: routes beside it pass {spelled(one)}" for one in request.via),
    )
    chosen, land = prepare(
        scenario, request.output, offline=request.offline, holding=line, on_event=on_event
    )
    options, places = chosen.scenario.planner, chosen.fetched.land.places
    found = {one.name: _assessed(one, _in_plane(line, one), options) for one in chosen.cases.value}
    results, islands, class_islands = way_names(
        chosen.cases.value[0].water, [one for *_, one in found.values()], places
    )
    said += tuple(
        f"{season_text(name)} was not checked: {why}"
        for name, why in chosen.fetched.failures.items()
    )
    seasons = tuple(one for one in chosen.scenario.seasons if one.name in found)
    every = (*(Note.of("as-read", said=text) for text in said), *chosen.notes)
    run = RunResult(
        chosen.scenario.model_copy(update={"seasons": seasons}),
        replace(chosen.fetched, notes=(*every, *chosen.fetched.notes, *land.value.notes)),
        land.value,
        chosen.cases.value[0].water,
        {case.name: case for case in chosen.cases.value},
        results,
        {},
        datetime.now(UTC),
        islands,
        class_islands,
        choices=every,
    )
    checked = (
        _checked(run.case(name).routes, beside, one, (route, at))
        for name, (one, beside, _) in found.items()
    )
    return run, tuple(checked)


def _in_plane(line: FloatArray, case: Case) -> FloatArray:
    """Return a line (n, 2), degrees, in a case's plane; ends on land begin where the case does."""
    path = case.projection.to_plane(line)
    for end, stop in ((0, case.start), (-1, case.goal)):
        if case.projection.geodesic_length_m([path[end], stop]) > _LEAST_M:
            path[end] = stop
    outside = ~shapely.dwithin(case.chart.extent, shapely.points(path), case.chart.precision)
    if outside.any():
        raise RequestError(
            "FILE: the route leaves the water with currents at "
            f"{case.water.place_text(path[outside][0])}; give currents that reach further, or "
            "--currents still"
        )
    return path


def _assessed(
    case: Case, path: FloatArray, options: PlannerOptions
) -> tuple[renew.AssessedPath, list[renew.Route], CaseResult]:
    """Assess a path (n, 2), and measure it and the routes beside it; the path comes first."""
    found = renew.assess(
        path, case.chart, case.current, case.vessel, via=case.via, avoid=case.areas,
        depth=case.tidal_depth, options=plan_options(options, min_lateness=MIN_LATENESS_S),
    )  # fmt: skip
    if not np.isfinite(found.fuel):
        slow = path[np.isfinite(found.times)][-1]
        raise RequestError(
            f"FILE: beyond {case.water.place_text(slow)} the current lets the vessel make no way "
            "along the route; give a faster vessel, or another departure"
        )
    if (until := case.current.span[1]) < found.times[-1]:
        ends = Text("{0}, and the route at {1}", (Moment(until), Moment(found.times[-1].item())))
        remedy = "give currents that reach further, or depart earlier"
        raise RequestError(f"FILE: the currents end at {planner_text(ends, case)}; {remedy}")
    routes = [*dict.fromkeys(filter(None, (found.route, found.same_side, found.best)))]
    result = CaseResult(case.name, renew.Plan(tuple(routes), ()), "", 0.0)
    result = replace(result, measures=measured(case, result, options))
    # Ways have the names that they have among all routes of a plan.
    every = tuple(dict.fromkeys((*routes, *found.routes)))
    return found, routes, replace(result, plan=renew.Plan(every, ()))


def _checked(
    ranked: Sequence[RankedRoute],
    routes: Sequence[renew.Route],
    found: renew.AssessedPath,
    drawn: tuple[GivenRoute, list[int]],
) -> CheckedRoute:
    """Return a given route, the first of `ranked`, with what is measured of it alone."""
    route, at = drawn
    given = ranked[0]
    case, path = given.case.case, np.asarray(given.route.path)
    is_by_legs = route.points[-1].curve is not None  # on which a course is held, not a line
    drift = "crab" if is_by_legs else given.case.scenario.planner.drift
    taken = sailed(path, np.array(at[:-1]), given.route.speeds, case, drift)
    crossed = tuple(_crossed(case, path, given.case.run.fetched.land.places))
    near = closest_approach(coast_edges(case.water.land), path, case.projection)
    turns = given.case.measures.turns[0]
    same_side, best = (
        ranked[routes.index(one)] if one else None for one in (found.same_side, found.best)
    )
    # A way over land is on no side of it.
    has_side = not (crossed and best)
    return CheckedRoute(
        given,
        same_side if has_side else None,
        best,
        reason_text(found.cause, case) if found.cause and has_side else "",
        cumulative(taken.true_s),
        crossed,
        None if crossed or near is None else case.water.place(near[0]),
        tuple(planner_text(one, case) for one in found.shut),
        tuple(against_lanes(case.projection.to_lonlat(path), given.case.run.fetched.land.zones)),
        tuple(map(case.water.place, turns.points[turns.collided])),
    )


def _crossed(case: Case, path: FloatArray, charted: Sequence[PlaceName]) -> Iterator[LandCrossed]:
    """Yield the pieces of land that a path (n, 2) crosses, the longest crossing first."""
    line, water, found = shapely.LineString(path), case.water, list[LandCrossed]()
    land = np.array(water.land, dtype=object)
    names = (*charted, *island_places(water))
    points = shapely.points(
        case.projection.to_plane(np.array([(one.lon, one.lat) for one in names]).reshape(-1, 2))
    )
    for polygon in land[shapely.STRtree(land).query(line, predicate="intersects")]:
        part = shapely.intersection(line, polygon)
        length_m = sum(
            case.projection.geodesic_length_m(shapely.get_coordinates(one))
            for one in shapely.get_parts(part)
            if one.length > 0
        )
        if length_m >= _LEAST_M:
            inside = np.flatnonzero(shapely.covers(polygon, points))
            named = max((names[at] for at in inside), key=lambda one: one.area_deg2, default=None)
            longest = max(shapely.get_parts(part), key=lambda one: one.length)
            middle = shapely.get_coordinates(longest.interpolate(0.5, normalized=True))[0]
            found.append(LandCrossed(named.name if named else "", length_m, water.place(middle)))
    yield from sorted(found, key=lambda one: -one.length_m)


# Number of places that are named in a sentence.
_FEW = 3
# Share by which fuels may differ and count as the same: two searches for one path differ by less.
_SAME = 1e-4


def checked_lines(one: CheckedRoute, route: GivenRoute) -> Iterator[str]:
    """Yield the answer for one case, in sentences."""
    row, took_s = one.given.metrics, float(one.passed_s[-1])
    # Notes call the route, and those beside it, by their numbers.
    named = f" {route.name!r}" * bool(route.name) + f" (route {one.given.rank})"
    yield (
        f"{text.season_name(one.given.season)}: {route.form}{named}, "
        f"{text.distance(row.length_m)}, {text.duration(took_s)}, fuel {text.fuel(row.fuel, row)}"
    )
    no_go = row.no_go_name
    for land in one.crossed[:_FEW]:
        far = text.distance(land.length_m)
        yield f"OVER LAND: {far} of {land.name or no_go} at {land.place.text}"
    if (more := len(one.crossed) - _FEW) > 0:
        yield f"OVER LAND at {text.count(more, 'more place', 'more places')}"
    if one.nearest is not None:
        yield f"Nearest {no_go}: {text.clearance(row.clearance_m)}, at {one.nearest.text}"
    yield from (f"SHUT: {said}" for said in one.shut[:_FEW])
    if (more := len(one.shut) - _FEW) > 0:
        yield f"SHUT at {text.count(more, 'more place', 'more places')}"
    for it in one.against:
        yield f"AGAINST the {it.zone.name}: for {text.distance(it.length_m)}, at {it.place.text}"
    if row.collisions:
        places = ", ".join(place.text for place in one.met[:_FEW])
        more = len(one.met) - _FEW
        also = f" and {text.count(more, 'more place', 'more places')}" * (more > 0)
        yield (
            f"NOT SAFE EVERYWHERE: {row.collisions:,} of {row.trials:,} hard-over turns meet "
            f"{no_go}, from {places}{also}"
        )
    else:
        yield f"All {row.trials:,} hard-over turns are clear of {no_go}"
    if math.isfinite(row.adrift_s):
        place = Place(row.adrift_lon, row.adrift_lat)
        yield (
            f"WITHOUT THRUST ashore in {text.duration(row.adrift_s)} from {place.text}; within 6 h "
            f"from {text.part(row.adrift_share)} of the way"
        )
    yield from _compared(one)


def _compared(one: CheckedRoute) -> Iterator[str]:
    """Yield how the given route compares with the routes of a plan."""
    if one.why_not:
        which = "of any side" if one.best is None else "of its side"
        yield f"No safe route {which} beside it: {one.why_not}"
    beside = {"of its side": one.same_side, "of all": one.best}
    if one.same_side is one.best:
        beside = {"of its side and of all": one.best}
    for which, other in beside.items():
        if other is not None:
            more = one.given.metrics.fuel / other.metrics.fuel - 1
            size = f"{text.percent(abs(more), 2)} {'above' if more > 0 else 'below'}"
            way = f", {other.metrics.way}" * bool(other.metrics.way)
            yield (
                f"{size if abs(more) > _SAME else 'As much fuel as'} the least-fuel route "
                f"{which} that keeps room to turn (route {other.rank}): "
                f"{text.fuel(other.metrics.fuel, other.metrics)}, "
                f"{text.distance(other.metrics.length_m)}{way}"
            )
