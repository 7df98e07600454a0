"""Lead a vessel under way onto its route, out of V and round from its heading; choose the class.

The way ahead is the rest of the planned path. The vessel turns towards it on an arc by its turn
rate, and then holds a straight course to a point of the way. (Without a current: a Dubins path of
an arc and a line.)

The class that was planned is kept, unless another saves enough.
"""

import contextlib
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.h_signature import Word, name
from renew.errors import InfeasibleError
from renew.kernels.capsules import wrapped
from renew.kernels.turn_tracks import TurnsBegun
from renew.planner.classes import ClassSearch, no_class_error
from renew.planner.fit import as_drawn
from renew.planner.one_class import ClassPath, ClassPlanner, fuel_estimate
from renew.planner.plan import meetings, plan_request, planner_of
from renew.planner.problem import channel_along, check_current_at_endpoints
from renew.request import Request
from renew.results import Plan, Rejected, Route
from renew.steering.trajectory import steer
from renew.turns.contingency import crab_heading, fly_turns
from renew.voyage.voyage import Voyage, shares

# A vessel no farther off its path than this share of v/ω counts as on it.
_ON_PATH = 0.001
ON_TIME = 1e-6
"""Rounding of times, s."""
# A vessel off its path may come back to it at these distances ahead of the place abeam, in
# multiples of its distance from the path.
_BACK_AT = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)


class Abeam(NamedTuple):
    """The place on a path nearest to the vessel: a `point` (2,), m.

    `along` is its share of the path's length, `off` the vessel's distance from it, m; the vessel
    was due there at `due`, s.
    """

    point: FloatArray
    along: float
    off: float
    due: float

    def is_on_path(self, voyage: Voyage) -> bool:
        """Whether the vessel is on its path."""
        return self.off <= _ON_PATH * voyage.vessel.turning_radius

    def is_proven(self, voyage: Voyage, time: float, begun: float) -> bool:
        """Whether the plan's turns were simulated for a vessel that is here at a time (s).

        That is so on the path, if the vessel is no earlier or later than the plan allows for a
        voyage that began at `begun` (s).
        """
        late = max(voyage.lateness * (self.due - begun), voyage.min_lateness, ON_TIME)
        in_time = voyage.current.is_steady or abs(time - self.due) <= late
        return self.is_on_path(voyage) and in_time


def abeam(path: FloatArray, times: FloatArray, at: FloatArray) -> Abeam:
    """Return the place nearest to a point (2,) on a path (n, 2) passed at times (n,), s."""
    line = shapely.LineString(path)
    along = float(line.project(shapely.Point(at), normalized=True))
    off = float(line.distance(shapely.Point(at)))
    point = shapely.get_coordinates(line.interpolate(along, normalized=True))[0]
    return Abeam(point, along, off, float(np.interp(along, shares(path), times)))


def way_ahead(path: FloatArray, place: Abeam, voyage: Voyage) -> FloatArray | None:
    """Return the quickest way (n, 2) from a voyage's start back to a path (n, 2) and on along it.

    None where the vessel is off its path, and no straight leg over water leads back to it.
    """
    start, reached = voyage.start, shares(path)
    if place.is_on_path(voyage):
        return np.vstack([start, path[reached > place.along + 1e-9]])
    line = shapely.LineString(path)
    best, least = None, np.inf
    for multiple in _BACK_AT:
        along = min(place.along + multiple * place.off / line.length, 1.0)
        back = shapely.get_coordinates(line.interpolate(along, normalized=True))
        way = np.vstack([start, back, path[reached > along + 1e-9]])
        if shapely.intersects(shapely.LineString(way[:2]), voyage.chart.hard_no_go):
            continue
        duration = voyage.duration(way)
        if best is None or duration < least:
            best, least = way, duration
    return best


def track_ahead(trajectory: FloatArray, at: FloatArray, time: float) -> FloatArray:
    """Return the rest of a trajectory (m, 4) from a point (2,) on it passed at a time (s)."""
    reached = shares(trajectory[:, 1:3])
    along = shapely.LineString(trajectory[:, 1:3]).project(shapely.Point(at), normalized=True)
    due, _, _, heading = (np.interp(along, reached, column) for column in trajectory.T)
    rest = trajectory[reached > along + 1e-9] + [time - due, 0.0, 0.0, 0.0]
    return np.vstack([[time, *at, heading], rest])


# Number of headings that are tried in a full turn.
_STEPS = 180
# The arc's turn rate as a share of the vessel's, which leaves room for rounding the last step.
_RATE = 0.99
# Least distance ahead, in v/ω, at which an arc may join the way.
_NEAREST = 2.0
# Further distances ahead that are tried, in v/ω.
_JOINED_AT = (3.0, 6.0, 12.0, 24.0)
# The current is not perturbed.
_AS_IT_IS = np.zeros((1, 1, 2))


class Arc(NamedTuple):
    """An arc: rows (m, 4) of t (s), x, y (m) and heading (rad); and the way (n, 2) from its end.

    `arrival` is when the vessel would come to the end of the way, s, by the table of the current.
    """

    rows: FloatArray
    way: FloatArray
    arrival: float


def first_arcs(heading: float, path: FloatArray, voyage: Voyage) -> list[Arc]:
    """Return arcs from a voyage's start and heading (rad) onto a path (n, 2), the quickest first.

    No arc touches land or leaves the chart. Behind each arc a straight leg leads to a point ahead.
    """
    vessel = replace(voyage.vessel, turn_rate=_RATE * voyage.vessel.turn_rate)
    tracks = _tracks(heading, replace(voyage, vessel=vessel))
    times = voyage.departure + np.arange(_STEPS + 1) * vessel.turn_period / _STEPS
    ahead, length = shares(path), float(shapely.LineString(path).length)
    radius, chart = voyage.vessel.turning_radius / length, voyage.chart
    arcs = list[Arc]()
    joints = {min(multiple * radius, 1.0) for multiple in _JOINED_AT}
    for along in sorted({*joints, min(max(ahead[1], _NEAREST * radius), 1.0)}):
        joint = np.array([np.interp(along, ahead, axis) for axis in path.T])
        rest = path[ahead > along + 1e-9]
        for side, track in zip((1.0, -1.0), tracks, strict=True):
            rows = _until_towards(joint, track, times, heading, side, voyage)
            if rows is None:
                continue
            flown = shapely.LineString(rows[:, 1:3])
            if not chart.extent.covers(flown) or shapely.intersects(flown, chart.hard_no_go):
                continue
            way = np.vstack([rows[-1, 1:3], joint, rest])
            onwards = replace(voyage, start=way[0]).leaving(float(rows[-1, 0]))
            arcs.append(Arc(rows, way, onwards.departure + onwards.duration(way)))
    return sorted(arcs, key=lambda arc: arc.arrival)


def _tracks(heading: float, voyage: Voyage) -> FloatArray:
    """Return the tracks (2, steps + 1, 2) of full turns to port and to starboard from the start."""
    vessel, begin = voyage.vessel, np.array([voyage.departure])
    start, field = voyage.start[None], voyage.waters.quick_current
    # In a current slower than the vessel, each course over ground has one heading.
    through = vessel.speed * np.array([[np.cos(heading), np.sin(heading)]])
    course = np.arctan2(*(through + field.velocity(start, begin)).T[::-1])
    begun = TurnsBegun(start, course, begin, np.array([vessel.speed]))
    return np.asarray(fly_turns(begun, field, vessel, _AS_IT_IS, _STEPS)[0])


def _until_towards(
    joint: FloatArray,
    track: FloatArray,
    times: FloatArray,
    heading: float,
    side: float,
    voyage: Voyage,
) -> FloatArray | None:
    """Return the rows (m, 4) of a turn up to where the vessel heads for a point; None if nowhere.

    The turn has a track (n, 2) and times (n,); its `side` is 1 to port, and -1 to starboard.
    """
    course = np.arctan2(*(joint - track).T[::-1])
    speeds = np.full(len(track), voyage.vessel.speed)
    headings = heading + side * np.linspace(0.0, 2 * np.pi, len(track))
    wanted = crab_heading(track, course, voyage.current, speeds, times)
    lacking = wrapped(side * (wanted - headings))
    # The difference changes sign where the vessel heads for the point; its jump at half a turn does
    # not count.
    crosses = (lacking[:-1] > 0) & (lacking[1:] <= 0) & (lacking[:-1] - lacking[1:] < np.pi)
    if not crosses.any():
        return None
    last = int(crosses.argmax())
    share = lacking[last] / (lacking[last] - lacking[last + 1])
    end = track[last] + share * (track[last + 1] - track[last])
    # A step of nearly no length is joined to the one before.
    kept = np.arange(last + 1 if share > 0.1 or last == 0 else last)
    return np.vstack(
        [
            np.column_stack([times[kept], track[kept], headings[kept]]),
            [
                times[last] + share * (times[last + 1] - times[last]),
                *end,
                headings[last] + share * (headings[last + 1] - headings[last]),
            ],
        ]
    )


# Angle (rad) by which a heading may differ from the one that is needed without an arc.
_STRAIGHT = 1e-6
# No further arc is tried once a route arrives within this share of a full turn of the quickest arc.
_LATE = 0.25


def _led_in(
    route: Route, planner: ClassPlanner, heading: float | None, *, is_proven: bool
) -> Route:
    """Return a route begun on the heading (rad) that the vessel has, if one is given.

    A vessel inside the soft no-go zone first leaves it on a short straight leg. `is_proven`: the
    plan was verified from this very place, so no leg is added. Raises InfeasibleError if there is
    no room.
    """
    exit_point = None if is_proven else _way_out(route, planner)
    exit_rows, route_after, planner_there = np.empty((0, 4)), route, planner
    if exit_point is not None:
        with contextlib.suppress(InfeasibleError):
            exit_rows, route_after, planner_there = _led_out(exit_point, route, planner, heading)
    heading = float(exit_rows[-1, 3]) if len(exit_rows) else heading
    if heading is not None and abs(wrapped(route_after.trajectory[0, 3] - heading)) > _STRAIGHT:
        arc, route_after = _turned(route_after.path, planner_there, heading)
        exit_rows = np.vstack([exit_rows[:-1], arc])
    begun = _joined(exit_rows, route_after, planner) if len(exit_rows) else route_after
    if planner.problem.word(begun.path) != planner.problem.word(route.path):
        raise InfeasibleError("from {0} the vessel can only turn into another class", route.path[0])
    return begun


def _led_out(
    exit_point: FloatArray, route: Route, planner: ClassPlanner, heading: float | None
) -> tuple[FloatArray, Route, ClassPlanner]:
    """Return rows (m, 4) to a point (2,), the class's route from there, and its planner."""
    rows = _leg_to(exit_point, planner, heading)
    there = _onwards(planner, rows[-1])
    place = abeam(route.path, route.times, exit_point)
    ahead = way_ahead(route.path, place, there.problem.voyage)
    if ahead is None:
        raise InfeasibleError("no straight leg leads from {0} back to its route", exit_point)
    return rows, there.route(follow(there, ahead)), there


def _way_out(route: Route, planner: ClassPlanner) -> FloatArray | None:
    """Return the point (2,) by which to leave the soft no-go zone, if a route stays in it long."""
    if not route.starts_in_soft_no_go:
        return None
    channel = channel_along(route.path, planner.problem)
    if channel is None or channel.parts:
        return None
    return planner.corridor(channel).way_out(route.path)


def _leg_to(point: FloatArray, planner: ClassPlanner, heading: float | None) -> FloatArray:
    """Return rows (m, 4) of a trajectory from the voyage's start straight to a point (2,)."""
    voyage = planner.problem.voyage
    leg = np.vstack([voyage.start, point])
    if heading is None:
        return steer(leg, voyage.current, voyage.vessel, voyage.departure, chart=voyage.chart)
    for arc in first_arcs(heading, leg, voyage):
        if shapely.intersects(shapely.LineString(arc.way), voyage.chart.hard_no_go):
            continue
        begun, chart = float(arc.rows[-1, 0]), voyage.chart
        rows = steer(arc.way, voyage.current, voyage.vessel, begun, chart=chart)
        return np.vstack([arc.rows[:-1], _unwound(rows, arc.rows)])
    raise InfeasibleError("from its heading at {0} there is no room to turn", voyage.start)


def _turned(path: FloatArray, planner: ClassPlanner, heading: float) -> tuple[FloatArray, Route]:
    """Return the rows (m, 4) of the first arc from a heading, and the route from its end.

    The arc joins the path (n, 2). The quickest arcs may join it on headings that its padding does
    not cover. Then the class is planned again from the end of such an arc, and a new arc joins the
    path found there.
    """
    voyage = planner.problem.voyage
    arcs = first_arcs(heading, path, voyage)
    best = _first_of(arcs, planner)
    for arc in arcs:
        if best is not None and _arrival(best) <= arc.arrival + _LATE * voyage.vessel.turn_period:
            break
        try:
            again = follow(_onwards(planner, arc.rows[-1]), arc.way).path
        except InfeasibleError:
            continue
        again = np.vstack([voyage.start, again[1:]])
        other = _first_of(first_arcs(heading, again, voyage), planner)
        best = min((begun for begun in (best, other) if begun), key=_arrival, default=None)
        if best is not None:
            break
    if best is None:
        raise InfeasibleError("from its heading at {0} there is no room to turn", voyage.start)
    return best


def _arrival(begun: tuple[FloatArray, Route]) -> float:
    """Return when a route begun with an arc comes to the goal, s."""
    return float(begun[1].times[-1])


def _first_of(arcs: list[Arc], planner: ClassPlanner) -> tuple[FloatArray, Route] | None:
    """Return the rows (m, 4) of the arc from which a safe route arrives first, and that route."""
    best: tuple[FloatArray, Route] | None = None
    for arc in arcs:
        if best is not None and arc.arrival >= _arrival(best):
            break
        there = _onwards(planner, arc.rows[-1])
        channel = channel_along(arc.way, there.problem)
        path = None if channel is None else as_drawn(there, arc.way, channel)
        route = None if path is None else there.route(path)
        if route is not None and (best is None or route.times[-1] < _arrival(best)):
            best = arc.rows, route
    return best


def _onwards(planner: ClassPlanner, row: FloatArray) -> ClassPlanner:
    """Return the planner of the voyage from a row (4,) of a trajectory on."""
    voyage = planner.problem.voyage.leaving(float(row[0]))
    return planner.for_problem(planner.problem.with_voyage(replace(voyage, start=row[1:3].copy())))


def _unwound(rows: FloatArray, before: FloatArray) -> FloatArray:
    """Return rows (m, 4) with headings that continue those of the rows before, without a jump."""
    turned = rows.copy()
    turned[:, 3] += 2 * np.pi * np.round((before[-1, 3] - rows[0, 3]) / (2 * np.pi))
    return turned


def _joined(rows: FloatArray, route_after: Route, planner: ClassPlanner) -> Route:
    """Return the route that begins with rows (m, 4) and continues with another route.

    Fuel and times are those of its whole path by Eq. 4, as of every route.
    """
    problem = planner.problem
    voyage, lead = problem.voyage, rows[:-1]
    path = np.vstack([lead[:, 1:3], route_after.path])
    times, fuel = voyage.arrivals(path), voyage.fuel(path)
    flown = shapely.LineString(path[: len(lead) + 1])
    land = voyage.chart.hard_no_go
    near = float(shapely.distance(flown, land)) if voyage.chart.no_go else np.inf
    return replace(
        route_after,
        path=path,
        trajectory=np.vstack([lead, _unwound(route_after.trajectory, rows)]),
        fuel=fuel,
        length=voyage.chart.length(path),
        clearance=min(near, route_after.clearance),
        duration=float(times[-1] - times[0]),
        times=times,
        speeds=np.concatenate([np.full(len(lead), voyage.vessel.speed), route_after.speeds]),
        fuel_bound=problem.fuel_bound,
        homotopy=name(problem.word(path)),
        harmonic_mean=fuel,
        starts_in_soft_no_go=route_after.starts_in_soft_no_go or len(lead) > 0,
    )


# Share of the fuel that a new path has to save to replace the planned one; two searches for the
# same path differ by less.
_WORTH = 1e-4
# Ratio of a class's estimate on the roadmap to its fuel; it is hardly ever exceeded.
_ROUGH = 1.03


def choose(
    request: Request,
    ahead: FloatArray | None,
    heading: float | None,
    switch_above: float,
    *,
    is_proven: bool,
    track: FloatArray | None,
) -> tuple[Plan, Route | None]:
    """Choose between the class of the way `ahead` (n, 2) that was planned, if any, and others.

    The vessel has a `heading` (rad) if one is given. `is_proven`: the plan is proven for the vessel
    at this place and time, in the same current; the way ahead is then kept as it is. `track` (m, 4)
    is the rest of the planned trajectory if the vessel is in time for it, else None.
    Returns the plan from here on, and the route in the class planned: that is the plan's best one
    if the class is kept, and None if it can't be sailed.
    Raises PlanningError if no class can be sailed.
    """
    planner = planner_of(request)
    problem = planner.problem
    check_current_at_endpoints(problem.voyage)
    word = None if ahead is None else problem.word(ahead)
    if request.areas or request.options.method == "sampled":
        whole = plan_request(request)
        routes, rejected = list(whole.routes), list(whole.rejected)
    else:
        search = _searched(planner, ahead, word, switch_above, is_proven, track)
        search.fit(planner.options.classes)
        routes = [planner.route(path) for path in search.all_found.values()]
        rejected = [failed for key, failed in search.rejected.items() if key not in search.found]
    routes.sort(key=lambda route: route.fuel)
    kept = next((route for route in routes if problem.word(route.path) == word), None)
    if kept is not None and routes[0].fuel >= (1 - switch_above) * kept.fuel:
        routes = [kept, *(route for route in routes if route is not kept)]
    for at, route in enumerate(routes):
        reason: InfeasibleError | None = None
        try:
            best = _led_in(route, planner, heading, is_proven=is_proven)
        except InfeasibleError as error:
            reason = error
        else:
            reason = next(iter(meetings(best, request.areas, planner).values()), None)
        if reason is not None:
            rejected.append(Rejected.of_route(route, reason))
            kept = None if route is kept else kept
            continue
        plan = Plan((best, *routes[at + 1 :]), tuple(rejected), 0, problem.overpowered_water)
        return plan, best if route is kept else kept
    raise no_class_error(tuple(rejected), planner)


def _searched(
    planner: ClassPlanner,
    ahead: FloatArray | None,
    word: Word | None,
    switch_above: float,
    is_proven: bool,
    track: FloatArray | None,
) -> ClassSearch:
    """Return the search with the planned class, and with classes that may save enough against it.

    All classes are planned if the planned one can't be sailed.
    """
    classes, search = planner.options.classes, ClassSearch(planner)
    kept: ClassPath | None = None
    if ahead is not None:
        try:
            kept = follow(planner, ahead, is_proven=is_proven, track=track)
        except InfeasibleError as error:
            channel = channel_along(ahead, planner.problem)
            if channel is not None:
                search.rejected[channel.word] = search.rejected_for(channel, error)
    if kept is None or word is None:
        search.find_first(classes)
        return search
    if switch_above >= 1:
        return ClassSearch(planner, {word: kept})
    enough = 1 - switch_above
    search = ClassSearch(
        planner, {word: kept}, lambda channel: fuel_estimate(planner.unpadded, channel) / enough
    )
    voyage = planner.problem.voyage
    enumerator = planner.problem.enumerator(planner.problem.likely_width)
    quickest = enumerator.channels(1)
    if quickest:
        rough = voyage.fuel(quickest[0].rough_path(voyage.start, voyage.goal))
        dearest = _ROUGH * enough * kept.fuel / rough
        if dearest > 1:
            search.plan_in_rounds(enumerator.up_to(dearest), classes, search.add)
    return search


def follow(
    planner: ClassPlanner,
    ahead: FloatArray,
    *,
    is_proven: bool = False,
    track: FloatArray | None = None,
) -> ClassPath:
    """Return the best path in the class of the way ahead (n, 2): that way itself if it is as good.

    Raises InfeasibleError if the class has no path.
    """
    channel = channel_along(ahead, planner.problem)
    if channel is None:
        raise InfeasibleError("the way that was planned leads over land from {0}", ahead[0])
    if track is not None:
        fuel = planner.problem.voyage.fuel(ahead)
        corridor = planner.growth.fitted(planner.corridor(channel), ahead)
        return ClassPath(corridor, ahead, track, fuel, fuel)
    drawn = as_drawn(planner, ahead, channel)
    if drawn is not None and is_proven:
        return drawn
    try:
        planned = planner.find(channel)
        if planner.problem.word(planned.path) != channel.word:
            raise InfeasibleError("its least-fuel path slips into another class")  # noqa: TRY301 - as if none was planned
    except InfeasibleError:
        if drawn is None:
            raise
        return drawn
    return drawn if drawn is not None and planned.fuel > (1 - _WORTH) * drawn.fuel else planned
