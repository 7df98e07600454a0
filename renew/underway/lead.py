"""Lead a vessel under way onto its route: out of the soft no-go zone, round from its heading."""

import contextlib
from dataclasses import replace
from typing import Protocol

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.h_signature import name
from renew.errors import InfeasibleError
from renew.kernels.capsules import wrapped
from renew.planner.one_class import ClassPath, ClassPlanner, as_drawn
from renew.results import Route
from renew.steering.trajectory import steer
from renew.underway.first_arc import Arc, first_arcs
from renew.underway.way_ahead import abeam, channel_along, way_ahead

# Angle (rad) by which a heading may differ from the one that is needed without an arc.
_STRAIGHT = 1e-6
# A route is good enough if it is later than the quickest arc by at most this share of a full turn.
_LATE = 0.25


class Follow(Protocol):
    """Finds the best path of the class of a way ahead (n, 2)."""

    def __call__(self, planner: ClassPlanner, ahead: FloatArray) -> ClassPath:
        """Return the path; raise InfeasibleError if there is none."""
        ...


def led_in(
    route: Route,
    planner: ClassPlanner,
    heading: float | None,
    *,
    follow: Follow,
    is_proven: bool,
) -> Route:
    """Return a route begun on the heading (rad) that the vessel has, if one is given.

    If the vessel is in the soft no-go zone, the route first leaves it by a short straight leg,
    unless the plan `is_proven` for the vessel there. Raises InfeasibleError if there is no room.
    """
    out = None if is_proven else _way_out(route, planner)
    rows, tail, now = np.empty((0, 4)), route, planner
    if out is not None:
        with contextlib.suppress(InfeasibleError):
            rows, tail, now = _led_out(out, route, planner, heading, follow)
    heading = float(rows[-1, 3]) if len(rows) else heading
    if heading is not None and abs(wrapped(tail.trajectory[0, 3] - heading)) > _STRAIGHT:
        arc, tail = _turned(tail.path, now, heading, follow)
        rows = np.vstack([rows[:-1], arc])
    begun = _joined(rows, tail, planner) if len(rows) else tail
    if planner.problem.word(begun.path) != planner.problem.word(route.path):
        raise InfeasibleError("from {0} the vessel can only turn into another class", route.path[0])
    return begun


def _led_out(
    out: FloatArray, route: Route, planner: ClassPlanner, heading: float | None, follow: Follow
) -> tuple[FloatArray, Route, ClassPlanner]:
    """Return rows (m, 4) to a point (2,), the class's route from there, and its planner."""
    rows = _leg_to(out, planner, heading)
    now = _onwards(planner, rows[-1])
    ahead = way_ahead(route.path, abeam(route.path, route.times, out), now.problem.voyage)
    if ahead is None:
        raise InfeasibleError("no straight leg leads from {0} back to its route", out)
    return rows, now.route(follow(now, ahead)), now


def _way_out(route: Route, planner: ClassPlanner) -> FloatArray | None:
    """Return the point (2,) by which to leave the soft no-go zone, if a route stays in it long."""
    if not route.starts_in_soft_no_go:
        return None
    channel = channel_along(route.path, planner.problem)
    if channel is None or channel.parts:
        return None
    return planner.corridor(channel).way_out(route.path)


def _leg_to(out: FloatArray, planner: ClassPlanner, heading: float | None) -> FloatArray:
    """Return rows (m, 4) of a trajectory from the voyage's start straight to a point (2,)."""
    voyage = planner.problem.voyage
    leg, clock = np.vstack([voyage.start, out]), voyage.departure
    if heading is None:
        return steer(leg, voyage.current, voyage.vessel, clock)
    for arc in first_arcs(heading, leg, voyage):
        if shapely.intersects(shapely.LineString(arc.way), voyage.chart.hard_no_go):
            continue
        rows = steer(arc.way, voyage.current, voyage.vessel, float(arc.rows[-1, 0]))
        return np.vstack([arc.rows[:-1], _unwound(rows, arc.rows)])
    raise InfeasibleError("from its heading at {0} there is no room to turn", voyage.start)


def _turned(
    path: FloatArray, planner: ClassPlanner, heading: float, follow: Follow
) -> tuple[FloatArray, Route]:
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
        best = min((one for one in (best, other) if one), key=_arrival, default=None)
        if best is not None:
            break
    if best is None:
        raise InfeasibleError("from its heading at {0} there is no room to turn", voyage.start)
    return best


def _arrival(found: tuple[FloatArray, Route]) -> float:
    """Return when a route begun with an arc comes to the goal, s."""
    return float(found[1].times[-1])


def _first_of(arcs: list[Arc], planner: ClassPlanner) -> tuple[FloatArray, Route] | None:
    """Return the rows (m, 4) of the arc from which a safe route arrives first, and that route."""
    best: tuple[FloatArray, Route] | None = None
    for arc in arcs:
        if best is not None and arc.arrival >= _arrival(best):
            break
        found = _drawn(arc, planner)
        if found is not None and (best is None or found.times[-1] < _arrival(best)):
            best = arc.rows, found
    return best


def _drawn(arc: Arc, planner: ClassPlanner) -> Route | None:
    """Return the route that follows an arc's way from the arc's end, or None if it is not safe."""
    after = _onwards(planner, arc.rows[-1])
    channel = channel_along(arc.way, after.problem)
    found = None if channel is None else as_drawn(after, arc.way, channel)
    return None if found is None else after.route(found)


def _onwards(planner: ClassPlanner, row: FloatArray) -> ClassPlanner:
    """Return the planner of the voyage from a row (4,) of a trajectory on."""
    voyage = planner.problem.voyage.leaving(float(row[0]))
    return planner.for_problem(planner.problem.with_voyage(replace(voyage, start=row[1:3].copy())))


def _unwound(rows: FloatArray, before: FloatArray) -> FloatArray:
    """Return rows (m, 4) with headings that continue those of the rows before, without a jump."""
    turned = rows.copy()
    turned[:, 3] += 2 * np.pi * np.round((before[-1, 3] - rows[0, 3]) / (2 * np.pi))
    return turned


def _joined(rows: FloatArray, tail: Route, planner: ClassPlanner) -> Route:
    """Return the route that begins with rows (m, 4) and continues with another route, the tail.

    Fuel and times are those of its whole path by Eq. 4, as of every route.
    """
    problem = planner.problem
    voyage, lead = problem.voyage, rows[:-1]
    path = np.vstack([lead[:, 1:3], tail.path])
    times, fuel = voyage.arrivals(path), voyage.fuel(path)
    flown = shapely.LineString(path[: len(lead) + 1])
    land = voyage.chart.hard_no_go
    near = float(shapely.distance(flown, land)) if voyage.chart.no_go else np.inf
    return replace(
        tail,
        path=path,
        trajectory=np.vstack([lead, _unwound(tail.trajectory, rows)]),
        fuel=fuel,
        length=float(shapely.LineString(path).length),
        clearance=min(near, tail.clearance),
        duration=float(times[-1] - times[0]),
        times=times,
        speeds=np.concatenate([np.full(len(lead), voyage.vessel.speed), tail.speeds]),
        fuel_bound=problem.fuel_bound,
        homotopy=name(problem.word(path)),
        harmonic_mean=fuel,
        starts_in_soft_no_go=tail.starts_in_soft_no_go or len(lead) > 0,
    )
