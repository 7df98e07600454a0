"""Find out where along a route a haven can be reached in time, and where to turn off at last.

The last place from which the vessel can change to another route's class is found by bisection:
from an earlier place the change costs no more, as the vessel may also sail on and change later.
"""

import contextlib
import math
from collections.abc import Sequence
from typing import Unpack

import numpy as np

from renew import errors
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentLike
from renew.inputs.openings import Haven
from renew.inputs.options import Changes, PlanOptions, check_objects
from renew.planner.plan import planner_of
from renew.planner.problem import off_water
from renew.request import Request
from renew.results import Route
from renew.underway.survey import (
    SAMPLES,
    ClassTurn,
    Coverage,
    Diversion,
    EqualPoint,
    LastTurn,
    Survey,
)

# Share by which the time along a route may differ from its own in the current that is given.
_SAME = 0.01


def _limit_faults(
    route: Route,
    vessel: Vessel,
    within: float | None,
    within_fuel: float | None,
    endurance: float | None,
) -> list[str]:
    """Return the faults of limits (s, fuel units), and of a route to which they can't apply."""
    faults, turn, rate = list[str](), vessel.turn_period, vessel.fuel_rate
    least = {"within": (within, turn, "s"), "within_fuel": (within_fuel, rate * turn, "fuel units")}
    for name, (value, lowest, unit) in least.items():
        if value is not None and not (errors.is_finite(value) and value >= lowest):
            faults.append(
                f"{name} = {errors.shown(value)} {unit} must be at least that of one full turn, "
                f"{lowest:.4g} {unit}"
            )
    if endurance is not None and not (errors.is_finite(endurance) and endurance >= route.fuel):
        faults.append(
            f"endurance = {errors.shown(endurance)} fuel units must be at least the route's own "
            f"fuel, {route.fuel:.6g} fuel units"
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
    return faults


def _usable(
    havens: Sequence[Haven], request: Request, route: Route
) -> tuple[list[Haven], list[tuple[Haven, errors.PlanningError]]]:
    """Return the havens that can be used, and the others with reasons.

    Raises ParameterError for a route of another current or vessel, GoalInNoGoError if no haven is
    left.
    """
    took = planner_of(request).problem.voyage.fuel(route.path) / request.vessel.fuel_rate
    if not abs(took - route.duration) <= _SAME * route.duration:
        raise errors.ParameterError(
            f"along the route's path this vessel takes {took:.4g} s in this current, and the route "
            f"{route.duration:.4g} s: give vessel, current and drift that it was planned with"
        )
    good, left_out = list[Haven](), list[tuple[Haven, errors.PlanningError]]()
    for haven in havens:
        error = _fault(haven, request)
        if error is None:
            good.append(haven)
        else:
            left_out.append((haven, error))
    if not good:
        raise errors.GoalInNoGoError(
            errors.Text.joined("; ", [error.text for _, error in left_out])
        )
    return good, left_out


def _fault(haven: Haven, request: Request) -> errors.PlanningError | None:
    """Return why a haven can't be used, or None."""
    if off := off_water(haven.place, request.chart):
        where, nearest = off[0], off[1].round(3)
        return errors.GoalInNoGoError(
            f"haven {haven.name} {{0}} lies {where}, {{1}} from the nearest water at {{2}}",
            haven.place,
            errors.Length(math.dist(haven.place, nearest)),
            nearest,
        )
    _, last = request.current.span
    first = float(request.departure)
    if haven.closes < first or haven.opens > last:
        return errors.ParameterError(
            f"haven {haven.name} is open from {{0}} until {{1}}; the route departs at {{2}}, and "
            "the current is known until {3}",
            *(errors.Moment(time) for time in (haven.opens, haven.closes, first, last)),
        )
    return None


# Number of samples up to which the last turn is narrowed.
_LAST = 6
# Largest time to a haven for which an equal point is searched, as a multiple of the limit.
_EQUAL = 1.5
# Number of times that this search is widened.
_WIDENED = 3
# Difference of the times to two havens that counts as none, in steps between samples.
_EQUAL_BY = 0.5


def abort_points(survey: Survey) -> tuple[LastTurn, ...]:
    """Return the last place for each haven that is within the limits from some place."""
    last_turns = list[LastTurn]()
    for number, least in enumerate(survey.least):
        may_be = np.flatnonzero(least[:-1] - survey.step <= survey.limit[:-1])
        if not len(may_be):
            continue
        known = survey.last_within(number)
        if known is None:
            first = int((least - survey.limit).argmin())
        else:
            first = int(np.searchsorted(survey.times, known))
        last = _last_turn(survey, number, first, int(may_be[-1]) + 1, survey.within)
        if last is not None:
            last_turns.append(last)
    return tuple(last_turns)


def _last_turn(survey: Survey, number: int, good: int, bad: int, within: float) -> LastTurn | None:
    """Return the last sample between two from which a haven is within limits, if any.

    The limits are `within` (s), and the survey's endurance.
    """
    not_after, way = float(survey.times[bad]), survey.planned(number, good)
    if way is None or survey.excess(way, within) > 0:
        return None
    end = bad
    while True:
        good, bad, way = _narrowed(survey, number, good, bad, way, within)
        # Near the last place another class may lead further.
        further = survey.planned(number, bad)
        if bad == end or further is None or survey.excess(further, within) > 0:
            break
        good, bad, way = bad, end, further
    return LastTurn(way, not_after)


def _narrowed(
    survey: Survey, number: int, good: int, bad: int, way: Diversion, within: float
) -> tuple[int, int, Diversion]:
    """Narrow two samples: from `good` the haven is within the limits, from `bad` it is not.

    Only ways near a known one are planned. Returns the new samples, at most `_LAST` apart, and the
    way from the good one; `way` is the way from the good one given.
    """
    beyond = math.inf
    while bad - good > _LAST:
        # Between two known ways the excess over the limits is nearly linear.
        spare = -survey.excess(way, within)
        share = 0.5 if math.isinf(beyond) else spare / (spare + beyond)
        wide, least = bad - good, _LAST // 2
        middle = good + min(max(round(share * wide), least), wide - least)
        further = survey.planned(number, middle, is_thorough=False)
        excess = math.inf if further is None else survey.excess(further, within)
        if further is not None and excess <= 0:
            good, way = middle, further
        else:
            bad, beyond = middle, excess
    return good, bad, way


def no_return(survey: Survey) -> LastTurn | None:
    """Return the last place from which the way back to the start is within the endurance."""
    if math.isinf(survey.endurance):
        return None
    voyage = planner_of(survey.request).problem.voyage
    places = np.array([survey.row(time)[:2] for time in survey.times.tolist()])
    quickest = voyage.vessel.speed + voyage.table.strongest
    back = np.linalg.norm(places - voyage.start, axis=1) / quickest
    left = [survey.limit_at(time, math.inf) for time in survey.times.tolist()]
    may_be = np.flatnonzero(back <= left)
    last = min(int(may_be[-1]) + 1, len(survey.times) - 1)
    for good in (last, last // 2, last // 8, last // 32):
        last_turn = _last_turn(survey, -1, good, last, math.inf) if good > 0 else None
        if last_turn is not None:
            return last_turn
    return None


def equal_points(survey: Survey) -> tuple[EqualPoint, ...]:
    """Return the places where the nearest haven changes."""
    nearest = survey.least.argmin(axis=0)
    points = list[EqualPoint]()
    for change in (np.flatnonzero(np.diff(nearest)) + 1).tolist():
        before, after = int(nearest[change - 1]), int(nearest[change])
        if survey.least[before, change] <= _EQUAL * survey.limit[change]:
            point = _equal_point(survey, before, after, change)
            points += [] if point is None else [point]
    return tuple(points)


def _equal_point(survey: Survey, before: int, after: int, change: int) -> EqualPoint | None:
    """Return the place near a sample where the nearest haven changes from one to another."""

    def point_at(sample: int) -> EqualPoint | None:
        ways = [survey.planned(haven, sample, is_thorough=False) for haven in (before, after)]
        return EqualPoint(ways[0], ways[1]) if ways[0] and ways[1] else None

    def difference(point: EqualPoint | None) -> float:
        """Return by how much (s) the way to the earlier haven is longer; NaN without both ways."""
        return math.nan if point is None else point.before.duration - point.after.duration

    last, wide = len(survey.times) - 1, SAMPLES // 24
    for _ in range(_WIDENED):
        low, high = max(change - wide, 0), min(change + wide, last)
        below, above = difference(point_at(low)), difference(point_at(high))
        if below <= 0 < above:
            break
        wide *= 2
    else:
        return None
    while high - low > 1:
        # The difference is nearly linear. The middle is kept off both ends: the interval shrinks.
        share = -below / (above - below)
        middle = low + min(max(round(share * (high - low)), 1), high - low - 1)
        longer = difference(point_at(middle))
        if abs(longer) <= _EQUAL_BY * survey.step:
            return point_at(middle)
        if longer <= 0:
            low, below = middle, longer
        elif longer > 0:
            high, above = middle, longer
        else:
            return None
    return point_at(high)


# Number of parts of the route's time to which the last place is narrowed.
_PARTS = 64


def class_turns(survey: Survey, others: Sequence[Route], dearer_by: float) -> tuple[ClassTurn, ...]:
    """Return the last places to change to other routes' classes, dearer by a share at most."""
    word = planner_of(survey.request).problem.word
    own = word(survey.route.path)
    turns = [
        _last_change(survey, other, (1 + dearer_by) * other.fuel)
        for other in others
        if word(other.path) != own
    ]
    return tuple(turn for turn in turns if turn is not None)


def _last_change(survey: Survey, other: Route, most: float) -> ClassTurn | None:
    """Return the last place to change to a class so that the voyage takes at most some fuel."""
    good, bad, last = 0, _PARTS, None
    while bad - good > 1:
        middle = (good + bad) // 2
        spent = middle / _PARTS * (survey.end - survey.begin)
        turn: ClassTurn | None = None
        with contextlib.suppress(errors.PlanningError):
            way = survey.onto(other, survey.begin + spent)
            fuel = survey.request.vessel.fuel_rate * spent + way.fuel
            turn = ClassTurn(other, way, fuel)
        if turn is None or turn.fuel > most:
            bad = middle
        else:
            good, last = middle, turn
    return last


def cover(
    route: Route,
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    havens: Sequence[Haven],
    *,
    within: float | None = None,
    within_fuel: float | None = None,
    endurance: float | None = None,
    others: Sequence[Route] = (),
    dearer_by: float = 0.02,
    options: PlanOptions | None = None,
    **changes: Unpack[Changes],
) -> Coverage:
    """Find out from which places of a route a planned way leads to a haven within limits.

    Parameters
    ----------
    route : Route
        A route at constant speed, from `renew.plan` or `renew.replan`.
    chart, current, vessel
        Those that the route was planned with.
    havens : sequence of Haven
        The user's list; nothing is added to it.
    within : float, optional
        Longest time to a haven (s).
    within_fuel : float, optional
        Most fuel to a haven (fuel units).
    endurance : float, optional
        Fuel on board at departure (fuel units): a diversion can use what is left where the vessel
        turns off.
    others : sequence of Route, optional
        Routes of other classes by the same plan, ``plan.routes``: until where can the vessel still
        change to each? Not for plans with via points.
    dearer_by : float
        Share of its fuel from the start by which the voyage may become dearer until such a change.
    options, **changes
        Those of the route's plan, such as ``drift="crab"``.

    Returns
    -------
    Coverage
        Stretches that are covered, uncovered, or not settled; abort points, the point of no return,
        equal points, and the last places to change to other classes. Ways begin on the route's
        heading; they are padded and steered as for :func:`renew.plan`, and their turns are
        simulated, from the end of the first arc on.

    Raises
    ------
    ParameterError
        No limit, or one that no route can keep; a route that chose speeds, or of another vessel or
        current; havens that can't be used, if none is left.
    """
    errors.check_kind("route", route, Route)
    check_objects(chart, vessel)
    for at, haven in enumerate(havens):
        errors.check_kind(f"havens[{at}]", haven, Haven)
    for at, other in enumerate(others):
        errors.check_kind(f"others[{at}]", other, Route)
    faults = [] if havens else ["havens is empty: give one renew.Haven at least"]
    faults += _limit_faults(route, vessel, within, within_fuel, endurance)
    if not (errors.is_finite(dearer_by) and 0 <= dearer_by <= 1):
        faults.append(f"dearer_by = {errors.shown(dearer_by)} must be a share from 0 to 1")
    if faults:
        raise errors.ParameterError("; ".join(faults))
    within, within_fuel, endurance = (
        math.inf if limit is None else float(limit) for limit in (within, within_fuel, endurance)
    )
    request = Request.of(
        chart,
        current,
        vessel,
        (route.path[0], route.path[-1]),
        options=options,
        changes=changes,
        departure=float(route.trajectory[0, 0]),
    )
    usable, left_out = _usable(havens, request, route)
    rate = vessel.fuel_rate
    survey = Survey(
        request, route, tuple(usable), min(within, within_fuel / rate), endurance / rate
    )
    # The order matters: each step uses the ways that the steps before it have planned.
    stretches = survey.stretches()
    aborts, equals = abort_points(survey), equal_points(survey)
    no_way_back = no_return(survey)
    turns = class_turns(survey, others, dearer_by)
    with_faults = [(haven, survey.fault(number)) for number, haven in enumerate(usable)]
    left_out += [(haven, fault) for haven, fault in with_faults if fault is not None]
    return Coverage(
        route=route,
        abort_points=aborts,
        no_return=no_way_back,
        equal_points=equals,
        class_turns=turns,
        havens=tuple(haven for haven, fault in with_faults if fault is None),
        left_out=tuple(left_out),
        stretches=tuple(stretches),
        diversions=survey.found,
        within=within,
        within_fuel=within_fuel,
        endurance=endurance,
    )
