"""Plan one voyage in the mean of an ensemble of currents; how its routes do in every member.

The lower bound on a statistic of the fuel of any one route over the members rests on this.

For steady members with fields cₘ, weights qₘ and any one path, Σ qₘ Fₘ >= F in the field Σ qₘ cₘ:
the speed over ground along a course is concave in the current, and 1/g is convex and falls. So the
bound in the mean current holds for the mean fuel. CVaR is the largest mean over a set of weights:
whichever of them are taken, the bound in their mean current holds. Frank and Wolfe's rounds
(1956) look for good ones, each towards the worst members of the best known path. For members that
change the clocks differ, and the theorem fails.

For all members a second bound is the same statistic of their own bounds: a statistic never falls
when a fuel rises. The larger one counts. Proofs: `docs/explanation/lower-bound.md`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple, Unpack

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.bounds.fuel_lower_bound import FuelBound, fuel_lower_bound
from renew.errors import InfeasibleError, Moment, ParameterError, is_finite, shown
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentLike
from renew.inputs.openings import ShutArea
from renew.inputs.options import Changes, PlanOptions, ViaPoints, check_objects
from renew.planner.plan import finished, plan_request, planner_of
from renew.request import Place, Request
from renew.results import Plan, Route
from renew.vary.members import (
    FEWEST,
    QUANTILES,
    STATISTICS,
    TAIL,
    Members,
    Statistic,
    as_members,
    statistic,
    surely_dearer,
    worst_weights,
)
from renew.voyage.fuel import Pieces
from renew.voyage.voyage import Voyage, Waters

# Rounds in which weights are moved towards the worst members.
_ROUNDS = 3


@dataclass(frozen=True, repr=False, eq=False)
class EnsembleBound:
    """What any one route needs at least, as a statistic over the members; found when asked for.

    `voyage` is in the mean of the members, whose bound on fuel is `in_mean`; `paths` (n, 2), m, are
    known ones.
    """

    voyage: Voyage
    members: Members
    paths: Sequence[FloatArray]
    in_mean: FuelBound
    _known: dict[float, float] = field(default_factory=dict, init=False)

    @cached_property
    def of_members(self) -> FloatArray:
        """The bound on the fuel of any route in each member (m,)."""
        return self._by_member(fuel_lower_bound)

    def of(self, name: Statistic, tail: float = TAIL) -> float:
        """Return the bound on a statistic of the fuel of any one route (fuel units).

        Regret has none: a route may be the best in every member. CVaR is the mean of the worst
        members, a share `tail` of them by weight.
        """
        if name == "regret":
            return 0.0
        by_members = float(statistic(name, self.of_members[None], self.members.weights, tail)[0])
        if not self.members.are_steady or name == "p90":
            return by_members
        return max(by_members, self.in_mean.value, self._dual(tail) if name == "cvar90" else 0.0)

    def _dual(self, tail: float) -> float:
        """Return the largest bound in a mean current by weights that CVaR may take."""
        if tail in self._known:
            return self._known[tail]
        weights, best = self.members.weights, 0.0
        # In each member, infinite where no way is made.
        fuels = np.array([self._by_member(partial(Voyage.fuel, path=path)) for path in self.paths])
        for at in range(_ROUNDS):
            # Which members are the worst hardly depends on which path that is good here it is.
            here = self._in_mean(weights)
            nearest = int(np.argmin([here.fuel(path) for path in self.paths]))
            step = 2 / (at + 2)
            worst = worst_weights(fuels[nearest], self.members.weights, tail)
            weights = (1 - step) * weights + step * worst
            best = max(best, fuel_lower_bound(self._in_mean(weights)))
        self._known[tail] = best
        return best

    def _by_member(self, figure: Callable[[Voyage], float]) -> FloatArray:
        """Return a figure (m,) of the voyage in each member, found once for each field."""
        by_field = {id(voyage.current): figure(voyage) for voyage in self.voyages}
        return np.array([by_field[id(field)] for field in self.members.fields])

    @cached_property
    def voyages(self) -> tuple[Voyage, ...]:
        """The voyage in each distinct member."""
        return self.voyage.in_members[1:] or (self.voyage,)

    def _in_mean(self, weights: FloatArray) -> Voyage:
        """Return the voyage in the mean of the members by weights (m,)."""
        return replace(self.voyage, waters=Waters(self.voyage.chart, self.members.mean(weights)))


class ShutInMember(NamedTuple):
    """A class that can't be sailed in a member: its name, the member's, and the reason."""

    homotopy: str
    member: str
    cause: InfeasibleError


@dataclass(frozen=True, repr=False, eq=False)
class EnsemblePlan:
    """A route a class, planned in the mean current, and how it does in every member.

    Attributes
    ----------
    plan : the plan in the mean current; its best route is the one to take in the ensemble.
    members : names, weights (m,) whose sum is 1, and fields.
    fuels : (k, m) fuel units, of each route in each member; inf where it can't be sailed.
    choose : the statistic by which the class was chosen.
    close : indices of the routes that are not surely dearer, with the best one.
    shut : classes that can't be sailed in a member, with the member's name and the reason.
    bound : lower bounds on the statistics of any one route, found when first asked for.
    """

    plan: Plan
    members: Members
    fuels: FloatArray
    choose: Statistic
    close: tuple[int, ...]
    shut: tuple[ShutInMember, ...]
    bound: EnsembleBound

    @property
    def routes(self) -> tuple[Route, ...]:
        """One route a class, least fuel in the mean current first."""
        return self.plan.routes

    @property
    def best(self) -> Route:
        """The route to take: of least mean, unless another is surely better by `choose`."""
        return self.plan.best

    @property
    def is_sure(self) -> bool:
        """Whether all other classes are surely dearer; if not, it is too close to call."""
        return self.close == (self.plan.chosen,)

    @cached_property
    def best_in(self) -> tuple[int, ...]:
        """Index of the route that is best in each member (m,); -1 where none can be sailed."""
        least = self.fuels.argmin(axis=0)
        return tuple(np.where(np.isfinite(self.fuels.min(axis=0)), least, -1).tolist())

    @property
    def shares(self) -> FloatArray:
        """Share (k,) of the members, by weight, in which each route is the best one."""
        at, weights = np.array(self.best_in), self.members.weights
        return np.bincount(at[at >= 0], weights[at >= 0], len(self.routes)).astype(float)

    @cached_property
    def statistics(self) -> dict[Statistic, FloatArray]:
        """Mean, P90, CVaR and largest regret (k,) of each route's fuel, fuel units."""
        weights = self.members.weights
        return {name: statistic(name, self.fuels, weights) for name in STATISTICS}

    @property
    def waiting_saves(self) -> float:
        """Mean fuel that is saved if the member is known before the class is chosen."""
        chosen = float(self.statistics["mean"][self.plan.chosen])
        return chosen - float(self.fuels.min(axis=0) @ self.members.weights)

    def gap(self, name: Statistic) -> float:
        """Share by which a statistic of the best route is above its bound; inf without a bound."""
        bound, value = self.bound.of(name), float(self.statistics[name][self.plan.chosen])
        return max(0.0, value / bound - 1) if bound > 0 else math.inf


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
    bound = EnsembleBound(
        voyage, members, [route.path for route in plan.routes], plan.best.fuel_bound
    )
    fuels, shut = _sailed_in_members(plan.routes, bound, members)
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


def _sailed_in_members(
    routes: Sequence[Route], bound: EnsembleBound, members: Members
) -> tuple[FloatArray, tuple[ShutInMember, ...]]:
    """Return the fuel (k, m) of each route in each member, and where it can't be sailed."""
    fuels, shut = np.empty((len(routes), len(members.fields))), list[ShutInMember]()
    for k, route in enumerate(routes):
        by_field = {id(own.current): _sailed(route.path, own) for own in bound.voyages}
        for m, (current, name) in enumerate(zip(members.fields, members.names, strict=True)):
            fuels[k, m], cause = by_field[id(current)]
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
