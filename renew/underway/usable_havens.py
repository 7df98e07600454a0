"""Refuse limits that no route can keep, and leave out havens that no vessel can use."""

import math
from collections.abc import Sequence

import numpy as np
import shapely

from renew.errors import (
    GoalInNoGoError,
    Length,
    Moment,
    ParameterError,
    PlanningError,
    Text,
    check_kind,
    is_finite,
    shown,
)
from renew.inputs.arguments import check_objects
from renew.inputs.chart import Chart
from renew.inputs.haven import Haven
from renew.inputs.vessel import Vessel
from renew.planner.plan import planner_of
from renew.request import Request
from renew.results import Route
from renew.underway.diversions import Limits

# Share by which the time along a route may differ from its own in the current that is given.
_SAME = 0.01


def check_cover(
    route: Route,
    chart: Chart,
    vessel: Vessel,
    havens: Sequence[Haven],
    *,
    within: float | None,
    within_fuel: float | None,
    endurance: float | None,
) -> Limits:
    """Return the limits; refuse arguments out of range: the error names all faults."""
    check_kind("route", route, Route)
    check_objects(chart, vessel)
    for at, haven in enumerate(havens):
        check_kind(f"havens[{at}]", haven, Haven)
    faults = [] if havens else ["havens is empty: give one renew.Haven at least"]
    turn, rate = vessel.turn_period, vessel.fuel_rate
    least = {"within": (within, turn, "s"), "within_fuel": (within_fuel, rate * turn, "fuel units")}
    for name, (value, lowest, unit) in least.items():
        if value is not None and not (is_finite(value) and value >= lowest):
            faults.append(
                f"{name} = {shown(value)} {unit} must be at least that of one full turn, "
                f"{lowest:.4g} {unit}"
            )
    if endurance is not None and not (is_finite(endurance) and endurance >= route.fuel):
        faults.append(
            f"endurance = {shown(endurance)} fuel units must be at least the route's own fuel, "
            f"{route.fuel:.6g} fuel units"
        )
    if within is None and within_fuel is None and endurance is None:
        faults.append(
            "no limit is given: give within (s), within_fuel or endurance (fuel units); the route "
            f"itself takes {route.duration:.4g} s and {route.fuel:.4g} fuel units"
        )
    if not np.allclose(route.speeds, vessel.speed):
        faults.append(
            f"the route is sailed at {route.speeds.min():.3g} to {route.speeds.max():.3g} m/s, and "
            f"the vessel makes {vessel.speed:.3g} m/s: only routes at the vessel's own speed can "
            "be covered"
        )
    if faults:
        raise ParameterError("; ".join(faults))
    limits = (math.inf if one is None else float(one) for one in (within, within_fuel, endurance))
    return Limits(*limits)


def usable(
    havens: Sequence[Haven], request: Request, route: Route
) -> tuple[list[Haven], list[tuple[Haven, PlanningError]]]:
    """Return the havens that can be used, and the others with reasons.

    Raises ParameterError for a route of another current or vessel, GoalInNoGoError if no haven is
    left.
    """
    took = planner_of(request).problem.voyage.fuel(route.path) / request.vessel.fuel_rate
    if not abs(took - route.duration) <= _SAME * route.duration:
        raise ParameterError(
            f"along the route's path this vessel takes {took:.4g} s in this current, and the route "
            f"{route.duration:.4g} s: give vessel, current and drift that it was planned with"
        )
    good, left_out = list[Haven](), list[tuple[Haven, PlanningError]]()
    for haven in havens:
        error = _fault(haven, request)
        if error is None:
            good.append(haven)
        else:
            left_out.append((haven, error))
    if not good:
        raise GoalInNoGoError(Text.joined("; ", [error.text for _, error in left_out]))
    return good, left_out


def _fault(haven: Haven, request: Request) -> PlanningError | None:
    """Return why a haven can't be used, or None."""
    chart, here = request.chart, shapely.Point(haven.place)
    if not shapely.dwithin(chart.water, here, 4 * chart.precision):
        nearest = shapely.get_coordinates(shapely.shortest_line(here, chart.water))[-1].round(3)
        where = "in the no-go zone" if shapely.covers(chart.extent, here) else "off the chart"
        return GoalInNoGoError(
            f"haven {haven.name} {{0}} lies {where}, {{1}} from the nearest water at {{2}}",
            haven.place,
            Length(math.dist(haven.place, nearest)),
            nearest,
        )
    _, last = request.current.span
    first = float(request.departure)
    if haven.closes < first or haven.opens > last:
        return ParameterError(
            f"haven {haven.name} is open from {{0}} until {{1}}; the route departs at {{2}}, and "
            "the current is known until {3}",
            *(Moment(one) for one in (haven.opens, haven.closes, first, last)),
        )
    return None
