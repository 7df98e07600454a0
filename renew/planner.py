"""The whole method in the paper's order: triangulate, classes, padding, best path, verify."""

from __future__ import annotations

import functools
import inspect
import itertools
import math
from collections.abc import Sequence
from typing import Unpack, cast

import numpy as np

from renew._types import FloatArray
from renew.departures.around_areas import SailingsAround, plan_around, with_always_shut
from renew.departures.departure_window import DepartureWindow, Progress
from renew.departures.latest_departure import latest_departure
from renew.departures.sailings import DeparturePlanner, Sailings
from renew.errors import ParameterError
from renew.inputs.arguments import (
    DistinctBy,
    Method,
    Order,
    Padding,
    PlanOptions,
    RiskAt,
    Speeds,
    ViaPoints,
    as_departures,
    as_point,
    as_via,
    check_objects,
    check_options,
)
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.figures import shown
from renew.inputs.fuel import Drift
from renew.inputs.shut_area import ShutArea
from renew.inputs.speed_choice import NO_CHOICE, SpeedChoice
from renew.inputs.vessel import Vessel
from renew.inputs.voyage import Voyage
from renew.inputs.voyage_checks import (
    check_current_at_endpoints,
    check_departures,
    check_endpoints,
    check_pace,
)
from renew.padding.policy import PaddingPolicy
from renew.route import Departures, Plan
from renew.search.class_planner import ClassPlanner, PathMethod
from renew.search.diagnosis import no_class_error
from renew.search.harmonic_mean import chosen_class
from renew.search.k_sailable_classes import plan_classes
from renew.search.problem import Problem
from renew.speeds.speed_planner import PlannerOf, SpeedPlanner


def plan(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    start: FloatArray | tuple[float, float],
    goal: FloatArray | tuple[float, float],
    *,
    classes: int = 16,
    risk: float = 0.05,
    padding: Padding = "adaptive",
    clearance: float = 0.0,
    distinct_by: DistinctBy = 0.0,
    method: Method = "optimal",
    samples: int = 500,
    drift: Drift = "projected",
    seed: int = 0,
    order: Order = "fuel",
    risk_at: RiskAt = "route",
    departure: float = 0.0,
    lateness: float = 0.05,
    min_lateness: float = 0.0,
    arrive_by: float | None = None,
    via: ViaPoints = (),
    avoid: Sequence[ShutArea] = (),
    speed: Speeds | None = None,
) -> Plan:
    """Plan the route of least fuel that is found in each of the first k homotopy classes.

    Parameters
    ----------
    chart : Chart
        Extent and hard no-go zone (m).
    current : CurrentField or callable
        Velocity (..., 2) m/s at points (..., 2) m.
    vessel : Vessel
        Speed, turn rate and fuel law.
    start, goal : array_like
        Points (2,) in metres, in the chart's water.
    classes : int
        Number of homotopy classes to give a route for, k >= 1; fewer where fewer can be sailed.
    risk : float
        1 - σ in (0, 1): the share of drawn turns that may reach beyond the padding.
    padding : "adaptive", "none" or float
        Adaptive padding (paper), none, or the same width (m) on every constrained edge.
    clearance : float
        Floor on the padding (m).
    distinct_by : float or "auto"
        Classes that differ only by islands smaller than this (m) count as one, with its best path.
        "auto": only the few largest islands near the route tell classes apart; all other islands
        are ignored.
    method : {"optimal", "sampled"}
        Dynamic programming inside each class, or the paper's random chains.
    samples : int
        Chains a class, for ``"sampled"``.
    drift : {"projected", "crab"}
        Drift model of Eq. 4; see :mod:`renew.inputs.fuel`.
    seed : int
        Seed of all draws; the same seed gives the same plan.
    order : {"fuel", "length", "depth-first"}
        Which k classes: the cheapest or the shortest along their midlines, or the first of a
        depth-first search (paper).
    risk_at : {"route", "point"}
        Where adaptive padding meets the risk: on the way through each triangle (paper), or from
        every point of the final route as well, on its own heading.
    departure : float
        When the voyage begins (s), on the clock of a current that changes.
    lateness : float
        Share of the time since departure by which the vessel may be early or late anywhere: with
        adaptive padding it can turn away at all these times. Of no effect in a steady current.
    min_lateness : float
        Time (s) by which it may be early or late at least, but not before the departure.
    arrive_by : float, optional
        Latest allowed arrival (s), on the same clock. The planner picks the latest departure, not
        before `departure`, that still arrives in time. With `speed` it leaves at `departure`, and
        arrives by then with least fuel.
    via : sequence of array_like
        Points (2,), m, that the route passes in this order, each within 2 % of v/ω; one class is
        then one way to each of them and to the goal.
    avoid : sequence of ShutArea
        Areas that are shut, always or for some hours. The vessel, whether early, on time or late,
        and any hard-over turn it starts, stays out of each area while it is shut; see
        :mod:`renew.departures.around_areas`.
    speed : (float, float), optional
        Lowest and highest speed through water (m/s) from which the vessel may choose on each leg,
        in place of the vessel's own, so that fuel is least; without `arrive_by` it has all the
        time there is, or for which the current is known. Land is padded, and turns are steered, for
        the highest. The plan then has a `trade_off` of fuel against arrival, unless areas are shut
        for some hours. With `via` in steady currents only. See :mod:`renew.speeds.speed_search`,
        and for currents that change :mod:`renew.speeds.speed_search_by_clock`, where the lower
        bound is loose.

    Returns
    -------
    Plan
        Routes, least fuel first, and rejected classes with their reasons. With adaptive padding
        hard-over turns were flown at stations every 0.6 v/ω along every route, to both sides, in
        the field and in the corners of its spread, and none touched the no-go zone: samples, not a
        proof. None is flown around a start or goal that lies in the soft no-go zone itself.

    Raises
    ------
    ParameterError
        Arguments out of range.
    StartInNoGoError, GoalInNoGoError
        A start or goal on land or outside the chart; says by how much and where water is nearest.
    CurrentTooStrongError
        The current at the start or at the goal is as strong as the vessel.
    ViaInNoGoError
        A via point on land or outside the chart; one message names all faults of start, goal and
        via points.
    UnreachableError
        No water joins start and goal, or every class was rejected; says why, and what would help.
    ArrivalError
        No voyage begun at `departure` arrives by `arrive_by`; says the earliest arrival.
    """
    options = PlanOptions(
        classes=classes,
        risk=risk,
        padding=padding,
        clearance=clearance,
        distinct_by=distinct_by,
        method=method,
        samples=samples,
        drift=drift,
        seed=seed,
        order=order,
        risk_at=risk_at,
        lateness=lateness,
        min_lateness=min_lateness,
    )
    check_objects(chart, vessel, avoid)
    points = as_via(via)
    check_options(
        **options, departure=departure, arrive_by=arrive_by, speed=speed, has_via=len(points) > 0
    )
    chart = with_always_shut(chart, avoid)

    planner_of = _planners(current, start, goal, departure, options, points)
    if speed is not None:
        deadline = _deadline(current, arrive_by)
        given = chart, avoid, vessel, speed, deadline, classes
        return SpeedPlanner(*given, planner_of).plan(departure)
    planner_on = functools.partial(planner_of, vessel=vessel)
    if arrive_by is not None:
        sailings = SailingsAround(chart, avoid, classes, planner_on)
        return sailings.plan(latest_departure(sailings, departure, float(arrive_by)))[0]
    return plan_around(chart, avoid, lambda chart: _plan(planner_on(chart), classes))


def _plan(planner: ClassPlanner, classes: int) -> tuple[Plan, ClassPlanner]:
    """Plan at the planner's departure."""
    problem = planner.problem
    check_current_at_endpoints(problem.voyage)
    found = plan_classes(planner, classes)
    if not found.routes:
        raise no_class_error(found.rejected, problem, planner.policy, planner.method)
    chosen = chosen_class(found.routes)
    return Plan(found.routes, found.rejected, chosen, problem.overpowered_water), planner


def _deadline(current: CurrentLike, arrive_by: float | None) -> float:
    """When a vessel with a choice of speeds has to be there (s): before a changing current ends."""
    return float(min(math.inf if arrive_by is None else arrive_by, as_field(current).span[1]))


_DEFAULTS = {
    name: inspect.signature(plan).parameters[name].default for name in PlanOptions.__annotations__
}


def plan_departures(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    start: FloatArray | tuple[float, float],
    goal: FloatArray | tuple[float, float],
    departures: Sequence[float] | FloatArray,
    *,
    to_within: float | None = None,
    progress: Progress | None = None,
    with_classes: bool = True,
    via: ViaPoints = (),
    avoid: Sequence[ShutArea] = (),
    speed: Speeds | None = None,
    arrive_by: float | None = None,
    **plan_options: Unpack[PlanOptions],
) -> Departures:
    """Plan the best route of each of some departures, and find the best time to leave.

    All departures share triangulation, classes, the table of the current, and what is known of
    padding; at each departure a class is planned completely only if it can still be the best. For
    the bound on departures between them see :mod:`renew.departures.departure_window`.

    Parameters
    ----------
    chart, current, vessel, start, goal
        As for :func:`plan`.
    departures : array_like
        Ascending times (n,), s, on the clock of the current.
    to_within : float, optional
        Plan as many departures between them as it takes to know, to within the error of the paths
        found, that none between the first and the last beats the best one by more than this (s),
        and a few more beside that one.
    progress : callable, optional
        Told after each plan how many there are, and by how much (s) the best may still be beaten.
    with_classes : bool
        Whether all classes are planned at the best departure, or the plan holds its best route.
    via : sequence of array_like
        Points that the route passes, as for :func:`plan`.
    avoid : sequence of ShutArea
        Areas that are shut, as for :func:`plan`. Where one is shut for some hours only, a later
        departure may arrive earlier, and nothing is known of departures between those planned.
    speed, arrive_by : optional
        Speeds to choose from and when to be there, as for :func:`plan`: each departure is planned
        with the speeds of least fuel, and the best one needs least. Nothing is known of departures
        between them, and `to_within` is refused. All classes are planned at each.
    **plan_options
        As for :func:`plan`; with ``method="optimal"``.

    Returns
    -------
    Departures
        Fuel, arrival and path by departure, and the plan at the best one.

    Raises
    ------
    ParameterError
        Arguments out of range, departures that don't ascend or at which the current isn't known.
    PlanningError
        As for :func:`plan`, where none of the departures asked for leaves a route.
    """
    unknown = ", ".join(map(repr, plan_options.keys() - PlanOptions.__annotations__.keys()))
    if unknown:
        raise TypeError(f"plan_departures() has no option {unknown}")
    options = cast("PlanOptions", {**_DEFAULTS, **plan_options})
    if not isinstance(with_classes, bool | np.bool_):
        raise ParameterError(f"with_classes = {shown(with_classes)} must be true or false")
    check_objects(chart, vessel, avoid)
    times, points = as_departures(departures), as_via(via)
    check_options(
        **options,
        departure=float(times[0]),
        arrive_by=arrive_by,
        to_within=to_within,
        speed=speed,
        has_via=len(points) > 0,
        is_sweep=True,
    )
    chart, first = with_always_shut(chart, avoid), float(times[0])

    planner_of = _planners(current, start, goal, first, options, points)
    if speed is not None:
        check_departures(as_field(current), times.tolist())
        deadline = _deadline(current, arrive_by)
        given = chart, avoid, vessel, speed, deadline, options["classes"]
        return SpeedPlanner(*given, planner_of).departures(times.tolist(), progress)
    planner_on = functools.partial(planner_of, vessel=vessel)
    planner = planner_on(chart)
    voyage = planner.problem.voyage
    check_departures(voyage.current, times.tolist())
    strongest = voyage.table.strongest
    has_hours = any(not area.is_always_shut for area in avoid)
    sailings: DeparturePlanner = Sailings(planner, options["classes"])
    if has_hours:
        sailings = SailingsAround(chart, avoid, options["classes"], planner_on)
    window = DepartureWindow(
        sailings,
        times.tolist(),
        sum(itertools.starmap(math.dist, itertools.pairwise(voyage.stops)))
        / (vessel.speed + strongest),
        speed_change=math.inf if has_hours else voyage.speed_change,
        progress=progress,
    )
    if window.best.found is None:
        raise window.sailings[0].error
    if to_within is not None:
        window.refine(to_within)
        window.look_closer()
    if not with_classes:
        return window.departures(window.best.plan)
    best, sailing = sailings.plan(window.best)
    window.replace(sailing)
    return window.departures(best)


def _planners(
    current: CurrentLike,
    start: FloatArray | tuple[float, float],
    goal: FloatArray | tuple[float, float],
    departure: float,
    options: PlanOptions,
    via: FloatArray,
) -> PlannerOf:
    """Return a factory (chart, vessel, speed choice) -> ClassPlanner, of valid options."""
    field, stops = as_field(current), (as_point("start", start), as_point("goal", goal))

    def planner_of(chart: Chart, vessel: Vessel, choice: SpeedChoice = NO_CHOICE) -> ClassPlanner:
        voyage = Voyage(
            chart,
            field,
            vessel,
            *stops,
            options["drift"],
            float(departure),
            float(options["lateness"]),
            float(options["min_lateness"]),
            via,
            choice=choice,
        )
        check_endpoints(voyage)
        check_pace(voyage)
        policy = PaddingPolicy(
            options["padding"],
            options["clearance"],
            options["risk"],
            options["seed"],
            options["risk_at"],
        )
        width = policy.likely_width(vessel.turning_radius)
        classes = options["classes"]
        problem = Problem(voyage, options["distinct_by"], options["order"], classes, width)
        method = PathMethod(options["method"], options["samples"], options["seed"])
        return ClassPlanner(problem, policy, method)

    return planner_of
