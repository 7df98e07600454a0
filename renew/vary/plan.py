"""Plan a voyage, or the best of several departures: what a caller asks of the planner."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError, is_finite, shown
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentLike
from renew.inputs.openings import ShutArea, TidalDepth
from renew.inputs.options import Changes, PlanOptions, ViaPoints, as_departures, is_one_of
from renew.planner.plan import finished, or_with_shortfall, plan_request
from renew.planner.problem import check_departures
from renew.request import Place, Request, Speeds, options_by_name
from renew.results import Departures, Plan
from renew.vary.departures import DepartureWindow, Progress, all_classes_at, latest_departure
from renew.vary.speeds import departures_with_speeds, plan_with_speeds


def plan(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    start: Place,
    goal: Place,
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
        :mod:`renew.planner.plan`.
    depth : TidalDepth, optional
        Areas that are shut while the tide is too low for the vessel.
    speed : (float, float), optional
        Lowest and highest speed through water (m/s), in place of the vessel's own. The vessel
        chooses a speed between them on each leg, for least fuel. Without `arrive_by` it has as much
        time as it wants, while the current is known. Land is padded, and turns are steered, for the
        highest speed. The plan then has a `trade_off` of fuel against arrival, unless areas are
        shut for some hours. With `via` only in steady currents. In a changing current the lower
        bound is loose. See :mod:`renew.vary.speeds`.
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
    request = Request.of(
        chart,
        current,
        vessel,
        (start, goal),
        options=options,
        changes=changes,
        departure=departure,
        arrive_by=arrive_by,
        via=via,
        avoid=avoid,
        depth=depth,
        speed=speed,
    )

    def planned(asked: Request) -> Plan:
        if speed is not None:
            result = plan_with_speeds(asked, departure)
        elif arrive_by is not None:
            latest = latest_departure(asked, departure, float(arrive_by))
            result = all_classes_at(asked, latest)[0]
        else:
            result = plan_request(asked)
        return finished(result, asked)

    return or_with_shortfall(request, planned)


def plan_departures(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    start: Place,
    goal: Place,
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
    on departures between them see :mod:`renew.vary.departures`.

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
    if not isinstance(with_classes, bool | np.bool_):
        raise ParameterError(f"with_classes = {shown(with_classes)} must be true or false")
    if not (is_finite(spacing) and spacing >= 0):
        raise ParameterError(f"spacing = {shown(spacing)} s must be finite, 0 or more")
    times = as_departures(departures).tolist()
    method = options_by_name(options, changes)["method"]
    request = Request.of(
        chart,
        current,
        vessel,
        (start, goal),
        options=options,
        changes=changes,
        departure=times[0],
        arrive_by=arrive_by,
        via=via,
        avoid=avoid,
        depth=depth,
        speed=speed,
        more_faults=_sweep_faults(method, speed, arrive_by, to_within),
    )
    check_departures(request.current, times)

    def planned(asked: Request) -> Departures:
        if speed is not None:
            result = departures_with_speeds(asked, times, progress)
        else:
            window = DepartureWindow(asked, times, spacing=spacing, progress=progress)
            if window.best.found is None:
                raise window.sailings[0].error
            if to_within is not None:
                window.refine(to_within)
                window.refine_around_best()
            result = window.departures(window.plan_best() if with_classes else window.best.plan)
        return replace(result, plan=finished(result.plan, asked))

    return or_with_shortfall(request, planned)


def _sweep_faults(method: object, speed: object, arrive_by: object, to_within: object) -> list[str]:
    faults = []
    if to_within is not None and not (is_finite(to_within) and to_within > 0):
        faults.append(f"to_within = {shown(to_within)} s must be finite and above 0")
    if not is_one_of(method, ("optimal",)):
        faults.append(f"departures are planned with method = 'optimal', not {shown(method)}")
    if speed is None and arrive_by is not None:
        faults.append(
            "with departures, arrive_by is a deadline for which speeds are chosen: give "
            "speed=(lowest, highest) (m/s), too, or leave arrive_by out"
        )
    if speed is not None and to_within is not None:
        faults.append(
            "to_within can't be proven where speeds are chosen; leave it out, or give "
            "departures that stand closer"
        )
    return faults
