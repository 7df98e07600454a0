"""The whole method in the paper's order: triangulation, classes, padding, path, verification."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias, Unpack

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError, check_kind, is_finite, shown
from renew.inputs.arguments import ViaPoints, as_departures, as_point, as_via, check_objects
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.options import Changes, PlanOptions, Request, Speeds
from renew.inputs.shut_areas import Area, ShutArea
from renew.inputs.tidal_depth import TidalDepth
from renew.inputs.vessel import Vessel
from renew.planner.classes import plan_classes
from renew.planner.departure_window import DepartureWindow, Progress, latest_departure
from renew.planner.departures import Sailings
from renew.planner.diagnosis import no_class_error
from renew.planner.one_class import ClassPlanner
from renew.planner.shut_areas import plan_around, with_always_shut, with_least_water
from renew.planner.speeds import departures_with_speeds, plan_with_speeds
from renew.planner.task import Task, check_current_at_endpoints, check_departures
from renew.results import Departures, Plan

_Place: TypeAlias = FloatArray | tuple[float, float]
"""A point (2,), m."""


def plan(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    start: _Place,
    goal: _Place,
    *,
    options: PlanOptions | None = None,
    departure: float = 0.0,
    arrive_by: float | None = None,
    via: ViaPoints = (),
    avoid: Sequence[ShutArea] = (),
    depth: TidalDepth | None = None,
    speed: Speeds | None = None,
    **changes: Unpack[Changes],
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
    options : PlanOptions, optional
        How to plan; by default ``PlanOptions()``.
    departure : float
        Start of the voyage (s), on the clock of a changing current.
    arrive_by : float, optional
        Latest allowed arrival (s), on the same clock. The planner picks the latest departure, not
        before `departure`, that still arrives in time. With `speed` it leaves at `departure`, and
        arrives by then with least fuel.
    via : sequence of array_like
        Points (2,), m, that the route passes in this order, each within 2 % of v/ω; a class is
        then one way to each of them and to the goal.
    avoid : sequence of ShutArea
        Areas that are shut, always or for some hours. The vessel, whether early, on time or late,
        and any hard-over turn it starts, stays out of each area while it is shut; see
        :mod:`renew.planner.shut_areas`.
    depth : TidalDepth, optional
        Areas that are shut while the tide is too low for the vessel.
    speed : (float, float), optional
        Lowest and highest speed through water (m/s), in place of the vessel's own. The vessel
        chooses a speed between them on each leg, for least fuel. Without `arrive_by` it has as much
        time as it wants, while the current is known. Land is padded, and turns are steered, for the
        highest speed. The plan then has a `trade_off` of fuel against arrival, unless areas are
        shut for some hours. With `via` only in steady currents. In a changing current the lower
        bound is loose. See :mod:`renew.planner.speeds`.
    **changes
        Options by name in place of those of `options`, such as ``risk=0.1``.

    Returns
    -------
    Plan
        Routes, least fuel first, and rejected classes with their reasons. With adaptive padding,
        hard-over turns were simulated every 0.6 v/ω along every route, to both sides, in the field
        and in the corners of its spread, and none touched the no-go zone: samples, not a proof. No
        turn is simulated around a start or goal inside the soft no-go zone.

    Raises
    ------
    ParameterError
        Arguments or options are out of range; the message names all of them.
    TypeError
        A change names no option.
    StartInNoGoError, GoalInNoGoError
        A start or goal is on land or outside the chart; the message names the nearest water.
    CurrentTooStrongError
        The current at the start or at the goal is as strong as the vessel.
    ViaInNoGoError
        A via point is on land or outside the chart; one message names all faults of start, goal and
        via points.
    UnreachableError
        No water joins start and goal, or every class was rejected; with the reason and remedies.
    ArrivalError
        No voyage that begins at `departure` arrives by `arrive_by`; with the earliest arrival.
    """
    check_objects(chart, vessel, avoid, depth)
    given = {**given_options(options, changes), "departure": departure, "arrive_by": arrive_by}
    given |= {"speed": speed}
    task = task_of(chart, current, vessel, (start, goal), via, avoid, depth, given)
    return finished(planned(task), task)


def plan_departures(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    start: _Place,
    goal: _Place,
    departures: Sequence[float] | FloatArray,
    *,
    options: PlanOptions | None = None,
    to_within: float | None = None,
    spacing: float = 0.0,
    progress: Progress | None = None,
    with_classes: bool = True,
    via: ViaPoints = (),
    avoid: Sequence[ShutArea] = (),
    depth: TidalDepth | None = None,
    speed: Speeds | None = None,
    arrive_by: float | None = None,
    **changes: Unpack[Changes],
) -> Departures:
    """Plan the best route of each departure, and find the best departure.

    All departures share triangulation, classes, the table of the current, and known paddings. At
    each departure a class is planned completely only if it may have the best route. For the bound
    on departures between them see :mod:`renew.planner.departure_window`.

    Parameters
    ----------
    chart, current, vessel, start, goal
        As for :func:`plan`.
    departures : array_like
        Ascending times (n,), s, on the clock of the current.
    to_within : float, optional
        Also plan departures between them until, apart from the error of the found paths, none
        between the first and the last can beat the best one by more than this (s); then plan a few
        more beside the best one.
    spacing : float
        Departures planned between them are whole multiples of this (s) after the first, such as
        minutes; 0 for any time.
    progress : callable, optional
        Called after each plan with the number of plans, and the time (s) that may still be saved.
    with_classes : bool
        Whether to plan all classes at the best departure, or only its best route.
    via : sequence of array_like
        Points that the route passes, as for :func:`plan`.
    avoid : sequence of ShutArea
        Areas that are shut, as for :func:`plan`. If an area is shut for some hours only, a later
        departure may arrive earlier, and departures between planned ones have no bound.
    depth : TidalDepth, optional
        Areas that are shut while the tide is too low, as for :func:`plan`; with them, too, nothing
        is known of departures between planned ones.
    speed, arrive_by : optional
        Speeds to choose from and latest arrival, as for :func:`plan`. Each departure is planned
        with the speeds of least fuel, and the best departure needs least fuel. Departures between
        them have no bound, so `to_within` is refused. All classes are planned at each departure.
    options, **changes
        As for :func:`plan`; with ``method="optimal"``.

    Returns
    -------
    Departures
        Fuel, arrival and path by departure, and the plan at the best one.

    Raises
    ------
    ParameterError
        Arguments out of range; departures that don't ascend, or at which the current is unknown.
    PlanningError
        As for :func:`plan`, if no given departure has a route.
    """
    check_objects(chart, vessel, avoid, depth)
    if not isinstance(with_classes, bool | np.bool_):
        raise ParameterError(f"with_classes = {shown(with_classes)} must be true or false")
    if not (is_finite(spacing) and spacing >= 0):
        raise ParameterError(f"spacing = {shown(spacing)} s must be finite, 0 or more")
    times = as_departures(departures).tolist()
    given = {**given_options(options, changes), "departure": times[0], "arrive_by": arrive_by}
    given |= {"to_within": to_within, "speed": speed, "is_sweep": True}
    task = task_of(chart, current, vessel, (start, goal), via, avoid, depth, given)
    check_departures(task.current, times)
    if speed is not None:
        found = departures_with_speeds(task, times, progress)
    else:
        window = _window(task, times, spacing, progress)
        found = _best_of(window, to_within, with_classes=bool(with_classes))
    return replace(found, plan=finished(found.plan, task))


def finished(plan: Plan, task: Task) -> Plan:
    """Return the plan with its voyage, the least water under each route, and bounds as asked."""
    if task.request.gap_to > 0 and plan.routes:
        best = plan.best
        bound = replace(best.fuel_bound, enough=best.fuel / (1 + task.request.gap_to))
        plan = replace(plan, routes=tuple(replace(one, fuel_bound=bound) for one in plan.routes))
    return replace(with_least_water(plan, task), voyage=task)


def _window(
    task: Task, times: list[float], spacing: float, progress: Progress | None
) -> DepartureWindow:
    """Plan each departure (s); return them with what is known of those between."""
    sailings, voyage = Sailings(task), task.planner().problem.voyage
    return DepartureWindow(
        sailings,
        times,
        voyage.least_duration,
        speed_change=math.inf if task.areas else voyage.speed_change,
        spacing=spacing,
        progress=progress,
    )


def _best_of(window: DepartureWindow, to_within: float | None, *, with_classes: bool) -> Departures:
    """Plan departures between those of a window, and all classes of the best one, if asked for."""
    if window.best.found is None:
        raise window.sailings[0].error
    if to_within is not None:
        window.refine(to_within)
        window.refine_around_best()
    if not with_classes:
        return window.departures(window.best.plan)
    return window.departures(window.plan_best())


def given_options(options: PlanOptions | None, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return all options by name, with the changes."""
    options = PlanOptions() if options is None else options
    check_kind("options", options, PlanOptions)
    given = vars(options)
    unknown = ", ".join(map(repr, changes.keys() - given.keys()))
    if unknown:
        raise TypeError(f"a plan has no option {unknown}; it has {', '.join(given)}")
    return {**given, **changes}


def task_of(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    ends: tuple[_Place, _Place],
    via: ViaPoints,
    avoid: Sequence[ShutArea],
    depth: TidalDepth | None,
    given: Mapping[str, Any],
) -> Task:
    """Return the task; raise an error for options, times, speeds or points out of range."""
    points = as_via(via)
    request = Request(**given, has_via=len(points) > 0)
    never_open, tidal_areas = (depth.never_open, depth.tidal_areas) if depth else ((), ())
    return Task(
        with_always_shut(chart, [*avoid, *never_open]),
        as_field(current),
        vessel,
        np.vstack([as_point("start", ends[0]), points, as_point("goal", ends[1])]),
        (*(area for area in avoid if not area.is_always_shut), *tidal_areas),
        request,
        depth,
    )


def planned(task: Task) -> Plan:
    """Plan at the departure of a request, or at the latest one that arrives in time."""
    request = task.request
    if request.speed is not None:
        return plan_with_speeds(task, request.departure)
    if request.arrive_by is not None:
        sailings = Sailings(task)
        latest = latest_departure(sailings, request.departure, float(request.arrive_by))
        return sailings.plan(latest)[0]

    def plan_with(closed: Sequence[Area]) -> tuple[Plan, ClassPlanner]:
        planner = task.planner(closed)
        return _plan(planner), planner

    return plan_around(task.areas, plan_with)


def _plan(planner: ClassPlanner) -> Plan:
    """Plan at the planner's departure."""
    check_current_at_endpoints(planner.problem.voyage)
    found = plan_classes(planner, planner.options.classes)
    if not found.routes:
        raise no_class_error(found.rejected, planner)
    return found
