"""Assess a path that somebody else drew: its fuel, its times, its safety, and what a plan saves."""

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
import shapely

from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import FuelBound
from renew.classes.h_signature import name
from renew.errors import InfeasibleError, PlanningError, Text
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentLike
from renew.inputs.openings import ShutArea, TidalDepth
from renew.inputs.options import Changes, PlanOptions, ViaPoints
from renew.planner.plan import finished, meetings, plan_request, planner_of
from renew.request import Request
from renew.results import Route
from renew.turns.contingency import contingency
from renew.underway.lead import follow
from renew.voyage.fuel import as_path, passage

# Spacing of the points at which hard-over turns begin, in v/ω: nearer turns are almost the same.
_SPACING = 0.5


@dataclass(frozen=True, eq=False)
class AssessedPath:
    """What a given path costs, and how safe it is; with the routes that a plan would take.

    Attributes
    ----------
    route : the path as a route that is sailed as drawn, corners and all, without padding; fuel and
        times are infinite from where the current lets the vessel make no way.
    fuel : Eq. 4 along it (fuel units).
    times : (n,) s, when its points are passed, on the current's clock.
    land : metres of it in the hard no-go zone.
    clearance : least distance to the hard no-go zone, m; 0 where it crosses it.
    trials, collisions : hard-over turns begun every half turning radius, in the field and in draws
        of its spread; and how many of them touch the hard no-go zone.
    homotopy : the name of its class; of no meaning where it crosses land.
    shut : texts on the areas that it enters, or may meet while they are shut.
    same_side, best : the least-fuel routes of its class and of all classes; None if there is none.
    routes : those of all classes that a plan finds, least fuel first.
    cause : the error that says why there is none, or None.
    """

    route: Route
    fuel: float
    times: FloatArray
    land: float
    clearance: float
    trials: int
    collisions: int
    homotopy: str
    shut: tuple[Text, ...]
    same_side: Route | None
    best: Route | None
    routes: tuple[Route, ...]
    cause: PlanningError | None


def assess(
    path: FloatArray,
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    *,
    departure: float = 0.0,
    via: ViaPoints = (),
    avoid: Sequence[ShutArea] = (),
    depth: TidalDepth | None = None,
    options: PlanOptions | None = None,
    **changes: Unpack[Changes],
) -> AssessedPath:
    """Say what a path costs in fuel and time, and how safe it is, beside the routes of a plan.

    Parameters
    ----------
    path : array_like
        Polyline (n, 2), m, whoever drew it; it may cross land.
    chart, current, vessel, via, avoid, depth, options, **changes
        As for :func:`renew.plan`, which plans between the path's ends.
    departure : float
        When it is begun, s, on the clock of the current.

    Returns
    -------
    AssessedPath
        Its figures; the best route of all, and of the path's own side.

    Raises
    ------
    ParameterError
        Arguments out of range. A path with ends on land is assessed, but has no plan.
    """
    path = as_path(path)
    request = Request.of(
        chart, current, vessel, (path[0], path[-1]), options=options, changes=changes,
        departure=departure, via=via, avoid=avoid, depth=depth,
    )  # fmt: skip
    routes, same_side, route, cause = _beside(path, request)
    turns = contingency(
        route, chart, current, vessel, departure=departure, drift=request.options.drift,
        spacing=_SPACING * vessel.turning_radius, seed=request.options.seed,
        lateness=request.options.lateness, min_lateness=request.options.min_lateness,
    )  # fmt: skip
    return AssessedPath(
        route=route,
        fuel=route.fuel,
        times=route.times,
        land=float(shapely.intersection(shapely.LineString(path), chart.hard_no_go).length),
        clearance=route.clearance,
        trials=turns.trials,
        collisions=turns.collisions,
        homotopy=route.homotopy,
        shut=tuple(_shut_on(route, request, avoid)),
        same_side=same_side,
        best=next(iter(routes), None),
        routes=routes,
        cause=cause,
    )


def _shut_on(route: Route, request: Request, avoid: Sequence[ShutArea]) -> Iterator[Text]:
    """Say which areas a route enters, or may meet while they are shut; hours need a planner."""
    line = shapely.LineString(route.path)
    for area in avoid:
        if area.is_always_shut and line.intersects(area.polygon):
            yield Text("it enters {0}", (area.text(request.departure),))
    if request.areas:
        with contextlib.suppress(PlanningError):
            for error in meetings(route, request.areas, planner_of(request)).values():
                yield error.text


def _beside(
    path: FloatArray, request: Request
) -> tuple[tuple[Route, ...], Route | None, Route, PlanningError | None]:
    """Return the routes of all classes, that of a path's class, the path as a route, and why not.

    The path (n, 2) joins the request's ends.
    """
    try:
        plan = finished(plan_request(request), request)
        planner = planner_of(request)
    except PlanningError as error:
        return (), None, _as_drawn(path, request, FuelBound(math.nan), ""), error
    problem = planner.problem
    route = _as_drawn(path, request, plan.best.fuel_bound, name(problem.word(path)))
    same = next((one for one in plan.routes if one.homotopy == route.homotopy), None)
    if same is not None:
        return plan.routes, same, route, None
    try:
        same = planner.route(follow(planner, path))
    except InfeasibleError as error:
        return plan.routes, None, route, error
    met = meetings(same, request.areas, planner)
    return plan.routes, None if met else same, route, next(iter(met.values()), None)


def _as_drawn(path: FloatArray, request: Request, bound: FuelBound, homotopy: str) -> Route:
    """Return a path (n, 2) as a route without padding, whose corners are not rounded."""
    vessel, chart, drift = request.vessel, request.chart, request.options.drift
    begun = float(request.departure)
    passed = passage(path, request.current, vessel, drift=drift, departure=begun, chart=chart)
    times = passed.at_points
    line, steps = shapely.LineString(path), np.diff(path, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    fuel = float(vessel.fuel_rate * (times[-1] - begun))
    return Route(
        path=path,
        trajectory=np.column_stack([times, path, np.append(heading, heading[-1])]),
        fuel=fuel,
        length=chart.length(path),
        clearance=float(shapely.distance(line, chart.hard_no_go)) if chart.no_go else math.inf,
        duration=float(times[-1] - begun),
        times=times,
        speeds=np.full(len(steps), vessel.speed),
        fuel_bound=bound,
        homotopy=homotopy,
        corners=np.empty((0, 3, 2)),
        padding_used=np.empty((0, 5)),
        turn_padding=np.empty(0),
        harmonic_mean=fuel,
        starts_in_soft_no_go=False,
        ends_in_soft_no_go=False,
    )
