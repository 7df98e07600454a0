"""Assess a path that somebody else drew: its fuel, its times, its safety, and what a plan saves."""

import contextlib
import math
from collections.abc import Sequence
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
from renew.inputs.options import Changes, PlanOptions
from renew.planner.plan import finished, meetings, plan_request, planner_of
from renew.request import Request
from renew.results import Plan, Route
from renew.turns.contingency import Contingency, contingency
from renew.underway.lead import follow
from renew.voyage.fuel import as_path, passage

# Spacing of the points at which hard-over turns begin, in v/ω: nearer turns are almost the same.
_SPACING = 0.5


@dataclass(frozen=True, eq=False)
class Assessment:
    """What a given path costs, and how safe it is; with the routes that a plan would take.

    Attributes
    ----------
    route : the path as a route that is sailed as drawn, corners and all; times are infinite from
        where the current lets the vessel make no way. Padding and triangles are empty.
    land : metres of it in the hard no-go zone.
    turns : its hard-over turns, begun every half turning radius, in the field and in draws of it.
    shut : sentences on the areas that it enters, or may meet while they are shut.
    plan : the plan between its ends; None if there is none.
    same_side : the least-fuel route of its homotopy class; None if there is none.
    cause : the error that says why there is no plan, or no route on its side.
    """

    route: Route
    land: float
    turns: Contingency
    shut: tuple[str, ...]
    plan: Plan | None
    same_side: Route | None
    cause: PlanningError | None

    @property
    def fuel(self) -> float:
        """Fuel by Eq. 4 (fuel units)."""
        return self.route.fuel

    @property
    def times(self) -> FloatArray:
        """When its points (n,) are passed, s, on the current's clock."""
        return self.route.times

    @property
    def clearance(self) -> float:
        """Least distance to the hard no-go zone, m; 0 where it crosses it."""
        return self.route.clearance

    @property
    def trials(self) -> int:
        """Number of turns simulated."""
        return self.turns.trials

    @property
    def collisions(self) -> int:
        """Number of turns that touched the hard no-go zone."""
        return self.turns.collisions

    @property
    def homotopy(self) -> str:
        """The name of its class; of no meaning where it crosses land."""
        return self.route.homotopy

    @property
    def best(self) -> Route | None:
        """The least-fuel route of all classes between its ends; None if there is none."""
        return None if self.plan is None else self.plan.best


def assess(
    path: FloatArray,
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    *,
    departure: float = 0.0,
    avoid: Sequence[ShutArea] = (),
    depth: TidalDepth | None = None,
    options: PlanOptions | None = None,
    **changes: Unpack[Changes],
) -> Assessment:
    """Say what a path costs in fuel and time, and how safe it is, beside the routes of a plan.

    Parameters
    ----------
    path : array_like
        Polyline (n, 2), m, whoever drew it; it may cross land.
    chart, current, vessel, avoid, depth, options, **changes
        As for :func:`renew.plan`, which plans between the path's ends.
    departure : float
        When it is begun, s, on the clock of the current.

    Returns
    -------
    Assessment
        Its figures; the best route of all, and of the path's own side.

    Raises
    ------
    ParameterError
        Arguments out of range. A path with ends on land is assessed, but has no plan.
    """
    path = as_path(path)
    request = Request.of(
        chart, current, vessel, (path[0], path[-1]), options=options, changes=changes,
        departure=departure, avoid=avoid, depth=depth,
    )  # fmt: skip
    line, zone = shapely.LineString(path), chart.hard_no_go
    plan, same_side, route, cause = beside(path, request)
    turns = contingency(
        route, chart, current, vessel, departure=departure, drift=request.options.drift,
        spacing=_SPACING * vessel.turning_radius, seed=request.options.seed,
        lateness=request.options.lateness, min_lateness=request.options.min_lateness,
    )  # fmt: skip
    met = tuple(map(str, shut_on(route, request, avoid)))
    return Assessment(
        route, float(shapely.intersection(line, zone).length), turns, met, plan, same_side, cause
    )


def shut_on(route: Route, request: Request, avoid: Sequence[ShutArea]) -> tuple[Text, ...]:
    """Say which areas a route enters or may meet while they are shut; hours need a plan."""
    line = shapely.LineString(route.path)
    entered = [
        Text("it enters {0}", (area.text(request.departure),))
        for area in avoid
        if area.is_always_shut and line.intersects(area.polygon)
    ]
    with contextlib.suppress(PlanningError):
        met = meetings(route, request.areas, planner_of(request)) if request.areas else {}
        entered += [error.text for error in met.values()]
    return tuple(entered)


def beside(
    path: FloatArray, request: Request
) -> tuple[Plan | None, Route | None, Route, PlanningError | None]:
    """Return a request's plan, the best route of a path's side, the path as a route, and why not.

    The path (n, 2) joins the request's ends. The error says why there is no plan, or no route on
    that side.
    """
    try:
        plan = finished(plan_request(request), request)
        planner = planner_of(request)
    except PlanningError as error:
        return None, None, _as_drawn(path, request, FuelBound(math.nan), ""), error
    problem = planner.problem
    route = _as_drawn(path, request, plan.best.fuel_bound, name(problem.word(path)))
    same = next((one for one in plan.routes if one.homotopy == route.homotopy), None)
    if same is not None:
        return plan, same, route, None
    try:
        same = planner.route(follow(planner, path))
    except InfeasibleError as error:
        return plan, None, route, error
    met = meetings(same, request.areas, planner)
    return plan, None if met else same, route, next(iter(met.values()), None)


def _as_drawn(path: FloatArray, request: Request, bound: FuelBound, homotopy: str) -> Route:
    """Return a path (n, 2) as a route without padding, whose corners are not rounded."""
    vessel, chart, drift = request.vessel, request.chart, request.options.drift
    begun = float(request.departure)
    times = passage(path, request.current, vessel, drift=drift, departure=begun).at_points
    line, steps = shapely.LineString(path), np.diff(path, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    fuel = float(vessel.fuel_rate * (times[-1] - begun))
    return Route(
        path=path,
        trajectory=np.column_stack([times, path, np.append(heading, heading[-1])]),
        fuel=fuel,
        length=float(line.length),
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
