"""Plan in an ensemble of currents: the way in its mean, sailed in every member.

In each class the path of the mean current is sailed in every member, by the member's own clock.
The class is chosen, not the path: paths that are chosen by their figures over the members are not
cheaper in members that were held back. Another class than that of least mean fuel is chosen only
if a paired bootstrap says that it is better.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.errors import InfeasibleError, Moment, ParameterError, is_finite, shown
from renew.inputs.arguments import ViaPoints, check_objects
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentLike
from renew.inputs.members import Members, as_members
from renew.inputs.options import Changes, PlanOptions
from renew.inputs.shut_areas import ShutArea
from renew.inputs.vessel import Vessel
from renew.planner.plan import finished, plan_request, planner_of
from renew.request import Place, Request
from renew.results import Route
from renew.vary.ensemble_bound import EnsembleBound
from renew.vary.ensemble_results import EnsemblePlan, ShutInMember
from renew.vary.statistics import (
    FEWEST,
    QUANTILES,
    STATISTICS,
    Statistic,
    statistic,
    surely_dearer,
)
from renew.voyage.fuel import Pieces
from renew.voyage.voyage import Voyage


def plan_ensemble(
    chart: Chart,
    currents: Sequence[CurrentLike],
    vessel: Vessel,
    start: Place,
    goal: Place,
    *,
    weights: FloatArray | Sequence[float] | None = None,
    names: Sequence[str] | None = None,
    choose: Statistic = "mean",
    sure: float = 0.9,
    options: PlanOptions | None = None,
    departure: float = 0.0,
    via: ViaPoints = (),
    avoid: Sequence[ShutArea] = (),
    **changes: Unpack[Changes],
) -> EnsemblePlan:
    """Plan one voyage in an ensemble of currents, and say how sure its class is.

    Parameters
    ----------
    chart, vessel, start, goal, options, departure, via, **changes
        As for :func:`renew.plan`.
    currents : sequence of CurrentField or callable
        The members: two or more fields, all steady or all changing, on one clock.
    weights : array_like, optional
        How likely each member is (m,), 0 or more; their sum need not be 1. By default all are
        equally likely.
    names : sequence of str, optional
        The members' names, for messages and results; by default ``member 1`` and so on.
    choose : {"mean", "p90", "cvar90", "regret"}
        What the class is chosen by: the mean fuel over the members, the fuel that nine in ten do
        not exceed, the mean fuel of the worst tenth, or the largest fuel above the best class of
        a member.
    sure : float
        Share of a bootstrap's differences that must lie on one side for a class to count as dearer.
    avoid : sequence of ShutArea
        Areas that are always shut. Areas shut for some hours are refused, as are tides and chosen
        speeds: members pass at times of their own.

    Returns
    -------
    EnsemblePlan
        A route a class, each planned in the mean current, with its fuel in every member. Padding
        counts the currents of all members, and with adaptive padding no hard-over turn touched the
        no-go zone in the mean or in any member, by its own clock.

    Raises
    ------
    ParameterError
        Members, weights or options out of range; fewer than 5 members for p90 or cvar90.
    PlanningError
        As for :func:`renew.plan`, in the mean current.
    """
    members = as_members(currents, weights, names)
    check_objects(chart, vessel, avoid)
    _check(members, choose, sure, avoid)
    request = Request.of(
        chart,
        members.mean(members.weights),
        vessel,
        (start, goal),
        options=options,
        changes=changes,
        departure=departure,
        via=via,
        avoid=avoid,
    )
    if len(members.distinct) > 1:
        request = replace(request, members=members.distinct)
    plan = finished(plan_request(request), request)
    voyage = planner_of(request).problem.voyage
    bound = EnsembleBound(voyage, members, [one.path for one in plan.routes], plan.best.fuel_bound)
    fuels, shut = _flown(plan.routes, bound, members)
    chosen, dearer = _chosen(choose, fuels, members.weights, sure, request.options.seed)
    return EnsemblePlan(
        plan=replace(plan, chosen=chosen),
        members=members,
        fuels=fuels,
        choose=choose,
        close=tuple(np.flatnonzero(~dearer).tolist()),
        shut=shut,
        bound=bound,
    )


def _check(members: Members, choose: Statistic, sure: object, avoid: Sequence[ShutArea]) -> None:
    """Refuse what an ensemble can't be planned with."""
    if choose not in STATISTICS:
        raise ParameterError(f"choose = {shown(choose)} is not one of {', '.join(STATISTICS)}")
    if choose in QUANTILES and len(members.fields) < FEWEST:
        raise ParameterError(
            f"choose = {choose!r} needs {FEWEST} members or more, and there are "
            f"{len(members.fields)}; give more, or choose by the mean"
        )
    if not (is_finite(sure) and 0 < sure < 1):
        raise ParameterError(f"sure = {shown(sure)} must lie between 0 and 1, as in 0.9")
    for at, area in enumerate(avoid):
        if not area.is_always_shut:
            raise ParameterError(
                f"avoid[{at}] is shut for some hours only, and each member passes at hours of its "
                "own; give areas that are always shut"
            )


def _flown(
    routes: Sequence[Route], bound: EnsembleBound, members: Members
) -> tuple[FloatArray, tuple[ShutInMember, ...]]:
    """Return the fuel (k, m) of each route in each member, and where it can't be sailed."""
    fuels, shut = np.empty((len(routes), len(members.fields))), list[ShutInMember]()
    for k, route in enumerate(routes):
        known: dict[int, tuple[float, InfeasibleError | None]] = {}
        for own in bound.voyages:
            known[id(own.current)] = _sailed(route.path, own)
        for m, (one, name) in enumerate(zip(members.fields, members.names, strict=True)):
            fuels[k, m], cause = known[id(one)]
            if cause is not None:
                shut.append(ShutInMember(route.homotopy, name, cause))
    return fuels, tuple(shut)


def _sailed(path: FloatArray, voyage: Voyage) -> tuple[float, InfeasibleError | None]:
    """Return the fuel along a path (n, 2) in a member; infinite, with a reason, if it is shut."""
    times, speed = voyage.arrivals(path), voyage.vessel.speed
    if not math.isfinite(times[-1]):
        at = path[~np.isfinite(times)][0]
        return math.inf, InfeasibleError("the current before {0} leaves it no headway", at)
    last = voyage.current.span[1]
    if times[-1] > last:
        return math.inf, InfeasibleError(
            "it would arrive at {0}, and the current is known until {1}",
            Moment(float(times[-1])),
            Moment(last),
        )
    pieces = Pieces.of(path)
    points = pieces.points.reshape(-1, 2)
    leg, along = pieces.leg, np.linalg.norm(pieces.points - path[pieces.leg][:, None], axis=-1)
    share = along / np.linalg.norm(np.diff(path, axis=0), axis=1)[leg][:, None]
    when = times[leg][:, None] + share * np.diff(times)[leg][:, None]
    strength = np.linalg.norm(voyage.current.velocity(points, when.ravel()), axis=1)
    worst = int(strength.argmax())
    if strength[worst] < speed:
        return voyage.fuel(path), None
    return math.inf, InfeasibleError(
        f"the current at {{0}} runs at {strength[worst]:.3g} m/s; the vessel makes no more than "
        f"{speed:.3g} m/s",
        points[worst],
    )


def _chosen(
    choose: Statistic, fuels: FloatArray, weights: FloatArray, sure: float, seed: int
) -> tuple[int, BoolArray]:
    """Return the class to take, and which classes (k,) are surely dearer."""
    chosen = int(statistic("mean", fuels, weights).argmin())
    other = int(statistic(choose, fuels, weights).argmin())
    dearer = surely_dearer(choose, fuels, weights, other, sure=sure, seed=seed)
    if other != chosen and not dearer[chosen]:
        dearer = surely_dearer(choose, fuels, weights, chosen, sure=sure, seed=seed)
        return chosen, dearer
    return other, dearer
