"""Plan a voyage again under way: stay in the class that was planned, or turn off to a haven."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, cast

import numpy as np
import shapely

from renew import errors
from renew._types import FloatArray
from renew.inputs.chart_and_vessel import Chart
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.openings import Haven
from renew.inputs.options import as_point
from renew.kernels.current_table import are_same
from renew.planner.plan import planner_of, with_least_water
from renew.planner.problem import check_endpoints, off_water
from renew.request import Request
from renew.results import Plan, Rejected, Route
from renew.underway.lead import ON_TIME, Abeam, abeam, choose, track_ahead, way_ahead
from renew.underway.survey import entered
from renew.voyage.voyage import Voyage, shares

Answer: TypeAlias = Literal["kept", "switched", "turn off", "no way"]


@dataclass(frozen=True, eq=False)
class TurnOff:
    """A way from where the vessel is to a haven.

    Attributes
    ----------
    haven : where it leads.
    plan : the plan of it, to be given to the next :func:`renew.replan`.
    arrival : when the vessel enters the haven, s, after the wait until it opens.
    fuel : fuel for the way and the wait (fuel units).
    """

    haven: Haven
    plan: Plan
    arrival: float
    fuel: float


def turn_offs(
    havens: Sequence[Haven], request: Request, heading: float | None
) -> tuple[tuple[TurnOff, ...], tuple[tuple[Haven, errors.PlanningError], ...]]:
    """Return ways from a request's start to havens, least fuel first, and havens without a way.

    The vessel has a `heading` (rad) if one is given.
    """
    ways, left_out = list[TurnOff](), list[tuple[Haven, errors.PlanningError]]()
    for haven in havens:
        try:
            ways.append(_turn_off(haven, request, heading))
        except errors.PlanningError as error:
            left_out.append((haven, error))
    return tuple(sorted(ways, key=lambda way: way.fuel)), tuple(left_out)


def _turn_off(haven: Haven, request: Request, heading: float | None) -> TurnOff:
    """Plan the way to a haven; raise PlanningError if there is none."""
    stops = np.vstack([request.stops[0], haven.place])
    there = replace(request, stops=stops, like=request)
    check_endpoints(planner_of(there).problem.voyage)
    plan, _ = choose(there, None, heading, 1.0, is_proven=False, track=None)
    if plan.best.ends_in_soft_no_go:
        raise errors.InfeasibleError(
            f"haven {haven.name} {{0}} lies in the soft no-go zone, where no turn is verified; "
            "move it off",
            haven.place,
        )
    reached = float(plan.best.times[-1])
    arrival = entered(haven, reached)
    fuel = plan.best.fuel + request.vessel.fuel_rate * (arrival - reached)
    return TurnOff(haven, replace(plan, voyage=there), arrival, fuel)


# Largest heading, rad: beyond a full circle it is hardly in radians.
_MOST = 2 * math.pi
# Distance off land, in v/ω, to which a position in its margin is moved.
_OFF = 0.02


@dataclass(frozen=True, eq=False)
class Replanned:
    """What to do from where the vessel is, and what it costs.

    Fuels are in fuel units: `burnt` + `fuel` = planned fuel + `by_drift` + `by_forecast` - `saved`.

    Attributes
    ----------
    answer : "kept", if the best way is of the class that was planned; "switched", if another class
        saves more than the threshold, or the planned class can't be sailed any more; "turn off",
        if no class leads to the goal, but a way to a haven of the list; "no way".
    plan : the plan from here on, to be given to the next :func:`replan`; None if there is no way.
        Its best route is the one to take, though one of another class may need a little less fuel.
        If the answer is "turn off", it leads to the haven of least fuel.
    kept : the route in the class that was planned; None if it can't be sailed.
    rejected : classes without a route, with their reasons; first the class that was planned.
    off : distance from the path that was planned, m.
    late : how much later than planned the vessel is abeam of its path, s; negative if it is early.
    moved : distance from the position given to the water in which the plan begins, m; above 0 only
        for a position in the margin around charted land.
    burnt : fuel burnt since the previous plan began.
    by_drift : fuel beyond the planned fuel, in the previous plan's current, for the way back to the
        path and on along it: the cost of being off the path, late or early; inf without such a way.
    by_forecast : further fuel that the same way needs in the new current.
    saved : fuel that the best way saves against the planned way, in the new current; negative if
        the planned way is not safe any more, or the vessel has to turn first; 0 if it turns off to
        a haven.
    cause : the error that says why there is no way to the goal, or None.
    turn_offs : if there is none, the ways to havens, least fuel first.
    havens_left_out : havens to which there is no way either, each with the reason.
    """

    answer: Answer
    plan: Plan | None
    kept: Route | None
    rejected: tuple[Rejected, ...]
    off: float
    late: float
    moved: float
    burnt: float
    by_drift: float
    by_forecast: float
    saved: float
    cause: errors.PlanningError | None = None
    turn_offs: tuple[TurnOff, ...] = ()
    havens_left_out: tuple[tuple[Haven, errors.PlanningError], ...] = ()

    @property
    def best(self) -> Route | None:
        """The route to take, or None if there is no way."""
        return None if self.plan is None else self.plan.best

    @property
    def fuel(self) -> float:
        """Fuel from here to the goal, or on the way to the haven; infinite if there is no way."""
        return math.inf if self.plan is None else self.plan.best.fuel

    @property
    def alternatives(self) -> tuple[Route, ...]:
        """Routes of the other classes that might have saved enough, least fuel first."""
        best = self.best
        return () if self.plan is None else tuple(r for r in self.plan.routes if r is not best)


def replan(
    previous: Plan,
    at: FloatArray | tuple[float, float],
    time: float,
    *,
    heading: float | None = None,
    current: CurrentLike | None = None,
    burnt: float | None = None,
    switch_above: float = 0.02,
    havens: Sequence[Haven] = (),
) -> Replanned:
    """Plan the rest of a voyage from where the vessel is.

    The class that was planned is kept, unless another one saves more than a threshold in the new
    current. So small differences between forecasts don't send the vessel to and fro.

    Parameters
    ----------
    previous : Plan
        The plan that is being sailed, by :func:`renew.plan` or from an earlier answer. The vessel
        sails its best route; ``dataclasses.replace(previous, chosen=1)`` if it sails another.
    at : array_like
        Where the vessel is (2,), m: anywhere in the water. Inside the soft no-go zone it leaves by
        the nearest way out first, unless its route leads out as planned or the goal is there.
    time : float
        When it is there (s), on the clock of the current.
    heading : float, optional
        Its heading (rad, anticlockwise from the x-axis, as in a trajectory). The route then begins
        with an arc by the vessel's turn rate. By default it begins on the heading that is best.
    current : CurrentField or callable, optional
        A newer current; by default the one of `previous`.
    burnt : float, optional
        Fuel burnt since `previous` began; by default what that time needs at constant thrust.
    switch_above : float
        Share of the fuel ahead in the planned class above which another class is worth changing to.
    havens : sequence of Haven
        Where the vessel may turn off to, if no class leads to the goal any more.

    Returns
    -------
    Replanned
        Kept, switched, turn off or no way; with the fuel of each, and what drift and the forecast
        changed. Padding grows and hard-over turns are simulated as for :func:`renew.plan`, but not
        in the first arc nor on the way out of the soft no-go zone.

    Raises
    ------
    ParameterError
        Arguments out of range; a plan that chose speeds, or was read from a pickle; a time before
        the departure or outside the current.
    StartInNoGoError
        The position is on land or outside the chart; the message names the nearest water.
    """
    asked = _asked_of(previous)
    if asked.speed is not None:
        raise errors.ParameterError(
            "previous chose speeds, and can't be planned again under way: plan from here with "
            "renew.plan(..., departure=, speed=)"
        )
    _check(previous, time, heading, burnt, switch_above)
    for number, haven in enumerate(havens):
        errors.check_kind(f"havens[{number}]", haven, Haven)
    at, moved = _in_water(as_point("at", at), asked.chart, asked.vessel.turning_radius)
    route = previous.best
    place = _abeam(route, at, asked)
    request = _request_ahead(asked, route, place, at, float(time), current)
    begun, rate = float(route.times[0]), asked.vessel.fuel_rate
    known = rate * (time - begun) if burnt is None else float(burnt)
    voyage = planner_of(request).problem.voyage
    ahead = way_ahead(route.path, place, voyage)
    old, new = _fuels_of(ahead, voyage, asked)
    is_proven = request.current is asked.current and place.is_proven(voyage, float(time), begun)
    is_in_time = voyage.current.is_steady or abs(time - place.due) <= ON_TIME
    track = track_ahead(route.trajectory, at, float(time)) if is_proven and is_in_time else None
    answer: Answer = "no way"
    plan: Plan | None = None
    kept: Route | None = None
    cause, goes_to, rejected = None, request, tuple[Rejected, ...]()
    ways, left_out = tuple[TurnOff, ...](), tuple[tuple[Haven, errors.PlanningError], ...]()
    try:
        plan, kept = choose(request, ahead, heading, switch_above, is_proven=is_proven, track=track)
    except errors.PlanningError as error:
        cause = error
        ways, left_out = turn_offs(havens, request, heading)
        if ways:
            answer, plan = "turn off", ways[0].plan
            goes_to = cast("Request", plan.voyage)
    else:
        answer, rejected = "kept" if plan.best is kept else "switched", plan.rejected
    if plan is not None:
        plan = replace(with_least_water(plan, goes_to), voyage=goes_to)
        kept = plan.best if answer == "kept" else kept
    return Replanned(
        answer=answer,
        plan=plan,
        kept=kept,
        rejected=rejected,
        off=place.off,
        late=float(time) - place.due,
        moved=moved,
        burnt=known,
        by_drift=known + old - route.fuel,
        by_forecast=_difference(new, old),
        saved=0.0 if plan is None or ways else _difference(new, plan.best.fuel),
        cause=cause,
        turn_offs=ways,
        havens_left_out=left_out,
    )


def _asked_of(previous: Plan) -> Request:
    """Return what a plan was asked; refuse one read from a pickle."""
    errors.check_kind("previous", previous, Plan)
    asked = previous.voyage
    if asked is None:
        raise errors.ParameterError(
            f"previous.voyage = {errors.shown(asked)}: a plan that was pickled has lost its current"
            "; take the voyage of a new plan, dataclasses.replace(previous, voyage=new.voyage)"
        )
    return asked


def _check(
    previous: Plan, time: object, heading: object, burnt: object, switch_above: object
) -> None:
    """Refuse figures out of range; the error names all faults."""
    faults = []
    begun = float(previous.best.times[0])
    if not errors.is_finite(time):
        faults.append(f"time = {errors.shown(time)} s must be finite")
    elif time < begun:
        faults.append(
            f"time = {time:g} s lies {begun - time:g} s before the departure, {begun:g} s"
        )
    if heading is not None and not (errors.is_finite(heading) and abs(heading) <= _MOST):
        faults.append(
            f"heading = {errors.shown(heading)} must lie between -2π and 2π rad, anticlockwise "
            "from the x-axis; a compass bearing of β degrees is math.radians(90 - β)"
        )
    if burnt is not None and not (errors.is_finite(burnt) and burnt >= 0):
        faults.append(f"burnt = {errors.shown(burnt)} fuel units must be finite and at least 0")
    if not (errors.is_finite(switch_above) and 0 <= switch_above <= 1):
        faults.append(f"switch_above = {errors.shown(switch_above)} must be a share from 0 to 1")
    if faults:
        raise errors.ParameterError("; ".join(faults))


def _in_water(at: FloatArray, chart: Chart, radius: float) -> tuple[FloatArray, float]:
    """Return a position (2,) in the water, and how far (m) it was moved: out of land's margin only.

    The vessel has a turning `radius`, v/ω (m).
    Raises StartInNoGoError on land, and outside the chart.
    """
    off = off_water(at, chart)
    if off is None:
        return at, 0.0
    where, nearest = off
    far = math.dist(at, nearest)
    if shapely.covers(chart.open_water, shapely.Point(at)):
        # From the very edge of land no track leads off it.
        clear = nearest + _OFF * radius / max(far, chart.precision) * (nearest - at)
        if chart.water.contains(shapely.Point(clear)):
            return clear, math.dist(at, clear)
        return nearest, far
    raise errors.StartInNoGoError(
        f"at {{0}} lies {where}, {{1}} from the nearest water at {{2}}",
        at,
        errors.Length(far),
        nearest,
    )


def _abeam(route: Route, at: FloatArray, asked: Request) -> Abeam:
    """Return the place on a route nearest to the vessel, with the time when it was due there."""
    place = abeam(route.path, route.times, at)
    last = max(int(np.searchsorted(shares(route.path), place.along, side="right")) - 1, 0)
    leg = np.vstack([route.path[last], place.point])
    begun = float(route.times[last])
    voyage = replace(planner_of(asked).problem.voyage, start=leg[0], via=leg[:0], departure=begun)
    if math.dist(*leg) <= asked.chart.precision:
        return place
    return place._replace(due=float(voyage.arrivals(leg)[-1]))


def _request_ahead(
    asked: Request,
    route: Route,
    place: Abeam,
    at: FloatArray,
    time: float,
    current: CurrentLike | None,
) -> Request:
    """Return the request for the way ahead, through the via points that lie ahead of the vessel."""
    line, via = shapely.LineString(route.path), asked.stops[1:-1]
    ahead = [line.project(shapely.Point(point), normalized=True) > place.along for point in via]
    request = replace(
        asked,
        current=asked.current if current is None else as_field(current),
        stops=np.vstack([at, via[np.array(ahead, dtype=bool)], asked.stops[-1]]),
        departure=time,
        arrive_by=None,
        members=(),
        like=None,
    )
    if current is None or are_same(request.waters.table, asked.waters.table):
        return replace(request, current=asked.current, like=asked.like or asked)
    return request


def _fuels_of(ahead: FloatArray | None, voyage: Voyage, asked: Request) -> tuple[float, float]:
    """Return the fuel of a way ahead (n, 2) in the current planned in, and in the new one."""
    if ahead is None:
        return math.inf, math.inf
    new = voyage.fuel(ahead)
    if voyage.current is asked.current:
        return new, new
    return replace(voyage, waters=asked.waters).fuel(ahead), new


def _difference(fuel: float, other: float) -> float:
    """Return a difference of fuels; infinite if a way can't be sailed in one of the currents."""
    return fuel - other if math.isfinite(fuel) and math.isfinite(other) else math.inf
