"""Plan one voyage in the mean of an ensemble of currents; how its routes do in every member.

A statistic over the members of the fuel of any one route has a lower bound, for these reasons.

For steady members with fields cₘ, weights qₘ and any one path, Σ qₘ Fₘ >= F in the field Σ qₘ cₘ:
the speed over ground along a course is concave in the current, and 1/g is convex and falls. So the
bound in the mean current holds for the mean fuel. CVaR is the largest mean over a set of weights:
the bound in the mean current by any weights of this set holds. Frank and Wolfe's rounds (1956) look
for weights with a high bound; each moves them towards the worst members for the best known path. If
members change with time, their clocks differ, and the theorem fails.

For steady and changing members there is a second bound: the statistic of the members' own bounds.
It holds because a statistic never falls when a fuel rises. The larger one counts. Proofs:
`docs/explanation/lower-bound.md`.

The members are fields that may each come true, with weights. Statistics of the fuel of classes are
taken over them.

CVaR is the mean of the worst share of the members: the largest mean over all weights that give no
member more than its own weight divided by that share (Rockafellar & Uryasev, 2000).

Whether one class is dearer than another is asked of a paired bootstrap (Efron & Tibshirani, 1993):
members are drawn again and again, and the difference is taken in each draw. It is drawn from one
member fewer than there are, so that the draws vary as much as ensembles of this size do.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Literal, NamedTuple, TypeAlias, Unpack, get_args

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.bounds.fuel_lower_bound import FuelBound, fuel_lower_bound
from renew.errors import InfeasibleError, Moment, ParameterError, as_floats, is_finite, shown
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import (
    CurrentField,
    CurrentLike,
    FunctionCurrent,
    GriddedCurrent,
    UniformCurrent,
    VaryingCurrent,
    as_field,
)
from renew.inputs.openings import OverLimit, ShutArea
from renew.inputs.options import Changes, PlanOptions, ViaPoints, check_objects
from renew.kernels.current_table import are_same, same_axes
from renew.planner.plan import finished, plan_request, planner_of
from renew.request import Place, Request
from renew.results import Plan, Route
from renew.voyage.fuel import Pieces
from renew.voyage.voyage import Voyage, Waters


class Members(NamedTuple):
    """Fields that may come true, one a member, with weights (m,) whose sum is 1, and names.

    Members that hold the same values share one field.
    """

    fields: tuple[CurrentField, ...]
    weights: FloatArray
    names: tuple[str, ...]

    @property
    def distinct(self) -> tuple[CurrentField, ...]:
        """The fields, each once."""
        return tuple({id(field): field for field in self.fields}.values())

    def mean(self, weights: FloatArray) -> CurrentField:
        """Return the mean field by weights (m,), of sum 1; the field itself, if there is one."""
        return self.fields[0] if len(self.distinct) == 1 else mean_of(self.fields, weights)


def as_members(
    currents: Sequence[CurrentLike],
    weights: FloatArray | Sequence[float] | None,
    names: Sequence[str] | None,
) -> Members:
    """Check members, their weights and names; all faults are named at once."""
    if isinstance(currents, CurrentField) or not isinstance(currents, Sequence):
        raise ParameterError(f"currents = {shown(currents)} must be fields in a row, one a member")
    count = len(currents)
    if count < 2:
        raise ParameterError(
            f"currents has {count} member{'s' * (count != 1)}; an ensemble has two or more. Plan "
            "in a single current with renew.plan"
        )
    known = [f"member {at + 1}" for at in range(count)] if names is None else list(names)
    if len(known) != count or len(set(known)) != count:
        raise ParameterError(f"names = {shown(names)} must be {count} different names")
    fields = _shared(map(as_field, currents))
    share = np.full(count, 1 / count) if weights is None else as_floats("weights", weights)
    faults = _weight_faults(share, known) + _clock_faults(fields, known)
    if faults:
        raise ParameterError("; ".join(faults))
    return Members(fields, share / share.sum(), tuple(known))


def mean_of(fields: Sequence[CurrentField], weights: FloatArray) -> CurrentField:
    """Return the mean of fields by weights (m,) whose sum is 1: on their grid, if all have one."""
    first, clock = fields[0], fields[0].slice_times
    grids = [field for field in fields if isinstance(field, GriddedCurrent)]
    if len(grids) == len(fields) and all(same_axes(grids[0].nodes, field.nodes) for field in grids):
        u, v = np.moveaxis(np.einsum("m,mjik->jik", weights, [field.uv for field in grids]), -1, 0)
        return GriddedCurrent(grids[0].x, grids[0].y, u, v)
    uniform = [(field.u, field.v) for field in fields if isinstance(field, UniformCurrent)]
    if len(uniform) == len(fields):
        return UniformCurrent(*(weights @ np.array(uniform)).tolist())
    if first.is_steady:
        return FunctionCurrent(
            lambda points: _mean_velocity([field(points) for field in fields], weights)
        )
    sliced = [one.slices for one in fields if isinstance(one, VaryingCurrent) and one.slices]
    if len(sliced) == len(fields) and all(np.array_equal(one.slice_times, clock) for one in fields):
        at_times = zip(*sliced, strict=True)
        return VaryingCurrent(clock, [mean_of(then, weights) for then in at_times])

    def velocity(points: FloatArray, times: FloatArray) -> FloatArray:
        return _mean_velocity([field.velocity(points, times) for field in fields], weights)

    return VaryingCurrent(_all_times(fields), velocity)


def _shared(fields: Iterable[CurrentField]) -> tuple[CurrentField, ...]:
    """Return the fields; each that equals an earlier one is replaced by that one."""
    shared: list[CurrentField] = []
    for member in fields:
        shared.append(next((known for known in shared if _are_equal(member, known)), member))
    return tuple(shared)


def _mean_velocity(velocities: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    """Return the mean (..., 2) of velocities, m/s, by weights (m,)."""
    return np.asarray(np.tensordot(weights, np.array(velocities), axes=1))


def _all_times(fields: Sequence[CurrentField]) -> FloatArray:
    """Return the times (nt,), s, of all fields within the span that all know."""
    begin = max(field.slice_times[0] for field in fields)
    end = min(field.slice_times[-1] for field in fields)
    times = np.unique(np.concatenate([field.slice_times for field in fields]))
    return np.asarray(times[(times >= begin) & (times <= end)])


def _weight_faults(weights: FloatArray, names: Sequence[str]) -> list[str]:
    if weights.shape != (len(names),):
        return [f"weights has shape {weights.shape}; there must be {len(names)}, one a member"]
    bad = [
        f"{name} {weight:g}"
        for name, weight in zip(names, weights.tolist(), strict=True)
        if not (np.isfinite(weight) and weight >= 0)
    ]
    if bad:
        return [f"weights must be finite, 0 or more: {', '.join(bad)}"]
    if (weights > 0).sum() > 1:
        return []
    held = [name for name, weight in zip(names, weights.tolist(), strict=True) if weight > 0]
    whose = f"only {held[0]} has" if held else "no member has"
    return [f"weights: {whose} a weight above 0; give it to two members or more"]


def _clock_faults(fields: Sequence[CurrentField], names: Sequence[str]) -> list[str]:
    """Faults of members some of which change while others don't, or of different times."""
    first = fields[0]
    for member, name in zip(fields, names, strict=True):
        if member.is_steady != first.is_steady:
            steady, changing = (name, names[0]) if member.is_steady else (names[0], name)
            fault = (
                f"{steady} is steady, and {changing} changes with time: give all as member or other"
            )
            return [fault]
    begin, end = max(member.span[0] for member in fields), min(member.span[1] for member in fields)
    if begin < end:
        return []
    late, early = max(fields, key=lambda f: f.span[0]), min(fields, key=lambda f: f.span[1])
    later, earlier = names[fields.index(late)], names[fields.index(early)]
    fault = f"{later} begins at {begin:g} s, and {earlier} has ended at {end:g} s"
    return [f"{fault}: members need times in common"]


def _are_equal(field: CurrentField, other: CurrentField) -> bool:
    """Whether two fields are the same field, or hold the same values."""
    if field is other or (type(field) is type(other) and field == other):
        return True
    if isinstance(field, GriddedCurrent) and isinstance(other, GriddedCurrent):
        return are_same(field.nodes, other.nodes)
    if isinstance(field, VaryingCurrent) and isinstance(other, VaryingCurrent):
        return (
            len(field.slices) == len(other.slices) > 0
            and np.array_equal(field.slice_times, other.slice_times)
            and all(map(_are_equal, field.slices, other.slices))
        )
    return False


Statistic: TypeAlias = Literal["mean", "p90", "cvar90", "regret"]
STATISTICS: tuple[Statistic, ...] = get_args(Statistic)
QUANTILES = ("p90", "cvar90")
"""Statistics of the worst members: of few members they say little."""
FEWEST = 5
"""Least number of members for these."""

TAIL = 0.1
"""Share of the members, by weight, that P90 leaves out and that CVaR is the mean of."""
# Number of draws of the bootstrap.
_DRAWS = 2000
# Rounding error of sums of weights.
_ROUNDING = 1e-9


def statistic(
    name: Statistic, fuels: FloatArray, weights: FloatArray, tail: float = TAIL
) -> FloatArray:
    """Return a statistic (..., k) of fuels (k, m), by weights (..., m) whose sum is 1.

    Regret is the largest fuel above that of the member's best class. Infinite fuels count where
    they have a weight.
    """
    if name == "mean":
        return _mean(fuels, weights[..., None, :])
    if name == "regret":
        regrets = np.where(weights[..., None, :] > 0, _difference(fuels, fuels.min(axis=0)), 0.0)
        return np.asarray(regrets.max(axis=-1))
    order = np.argsort(-fuels, axis=1)
    falling, own = np.take_along_axis(fuels, order, axis=1), weights[..., order]
    beyond = np.cumsum(own, axis=-1)
    if name == "p90":
        # The smallest fuel that at most the tail of the members, by weight, exceeds.
        at = np.argmax(beyond > tail + _ROUNDING, axis=-1)
        return np.asarray(falling[np.arange(len(fuels)), at])
    return _mean(falling, np.clip(tail - (beyond - own), 0, own) / tail)


def worst_weights(fuels: FloatArray, weights: FloatArray, tail: float = TAIL) -> FloatArray:
    """Return the weights (m,) by which the mean of fuels (m,) is their CVaR."""
    order = np.argsort(-fuels)
    own = weights[order]
    worst = np.empty(len(weights))
    worst[order] = np.clip(tail - (np.cumsum(own) - own), 0, own) / tail
    return worst


def surely_dearer(
    name: Statistic, fuels: FloatArray, weights: FloatArray, best: int, *, sure: float, seed: int
) -> BoolArray:
    """Whether each class (k,) is dearer than the `best` one by more than chance.

    Chance is which members the ensemble happens to have: an interval that holds the share `sure` of
    the bootstrap's differences has to lie above 0.
    """
    rng = np.random.default_rng(seed)
    count = len(weights) - 1
    drawn = rng.multinomial(count, weights, size=_DRAWS) / count
    values = statistic(name, fuels, drawn)
    more = _difference(values, values[:, [best]])
    return np.asarray((more > 0).mean(axis=0) >= (1 + sure) / 2)


def _mean(fuels: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the sums (..., k) of fuels (k, m) by weights (..., 1 or k, m)."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(weights > 0, weights * fuels, 0.0).sum(axis=-1))


def _difference(fuels: FloatArray, other: FloatArray) -> FloatArray:
    """Return fuels less other fuels; 0 where both are infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(fuels) & np.isinf(other), 0.0, fuels - other)


# Rounds in which weights are moved towards the worst members.
_ROUNDS = 3


@dataclass(frozen=True, repr=False, eq=False)
class EnsembleBound:
    """What any one route needs at least, as a statistic over the members; found when asked for.

    `voyage` is in the mean of the members; its bound on fuel is `in_mean`. `paths` (n, 2), m, are
    known paths.
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
        if not self.members.fields[0].is_steady or name == "p90":
            return by_members
        return max(by_members, self.in_mean.value, self._dual(tail) if name == "cvar90" else 0.0)

    def _dual(self, tail: float) -> float:
        """Return the largest bound in a mean current by weights that CVaR may take."""
        if tail in self._known:
            return self._known[tail]
        weights, best = self.members.weights, 0.0
        # Fuel of each path in each member; infinite where the vessel makes no way.
        fuels = np.array([self._by_member(partial(Voyage.fuel, path=path)) for path in self.paths])
        for at in range(_ROUNDS):
            # Any path that is good in this mean would do: all have nearly the same worst members.
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
    """One route for each class, planned in the mean current, and how it does in every member.

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
        excess = _difference(self.fuels[self.plan.chosen], self.fuels.min(axis=0))
        return float(_mean(excess, self.members.weights))

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
        not exceed, the mean fuel of the worst tenth, or the most fuel, in any member,
        above that of the member's best class.
    sure : float
        Share of a bootstrap's differences that must lie on one side for a class to count as dearer.
    avoid : sequence of ShutArea
        Areas that are always shut, and water over a limit, which is kept in the mean current. Other
        hours are refused, as are tides and chosen speeds: members pass at times of their own.

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
        if not (area.is_always_shut or isinstance(area, OverLimit)):
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
