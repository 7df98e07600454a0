"""The whole method in the paper's order: triangulate, classes, padding, best path, prove it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np
import shapely

from renew.channels import Channel, ChannelSearch, Move, Order
from renew.corridor import Corridor, least_fuel_path, sampled_paths
from renew.current import CurrentField, CurrentLike, as_field
from renew.errors import (
    InfeasibleError,
    ParameterError,
    UnreachableError,
)
from renew.fuel import Drift, check_drift, passage_times
from renew.homotopy import Rays
from renew.kinematics import steer, steerable
from renew.padding import LAYERS, Padder, Padding, check_padding
from renew.proof import padding_shortfall
from renew.request import as_point, check_counts, check_ends
from renew.route import LeastFuel, Plan, Rejected, Route
from renew.steering import steer_inside
from renew.triangulation import Triangulation, triangulate

if TYPE_CHECKING:
    from renew._types import FloatArray
    from renew.chart import Chart
    from renew.homotopy import Word
    from renew.vessel import Vessel

Method: TypeAlias = Literal["optimal", "sampled"]

# Rounds in which colliding turns may push the padding out before a class is given up.
_MOST_REPAIRS = 8
# Risks tried, where no class is left, to say which would leave one.
_RISKS_TO_ADVISE = (0.1, 0.2, 0.3, 0.5)
# Rounds of the search for ways around places found shut.
_MOST_ROUNDS = 64


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
    distinct_by: float = 0.0,
    method: Method = "optimal",
    samples: int = 500,
    drift: Drift = "projected",
    seed: int = 0,
    order: Order = "fuel",
) -> Plan:
    """Plan the least-fuel safe route in each of the first k homotopy classes.

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
        Of how many homotopy classes to give the route, k >= 1; fewer where fewer can be sailed.
    risk : float
        1 - σ in (0, 1): the share of drawn turns that may reach beyond the padding.
    padding : "adaptive", "none" or float
        Adaptive padding (paper), none, or the same width (m) on every constrained edge.
    clearance : float
        Floor on the padding (m).
    distinct_by : float
        Classes that part only around islands smaller than this (m) count as one.
    method : {"optimal", "sampled"}
        Dynamic programming inside each class, or the paper's random chains.
    samples : int
        Chains a class, for ``"sampled"``.
    drift : {"projected", "crab"}
        Drift model of Eq. 4; see :mod:`renew.fuel`.
    seed : int
        Seed of all draws; the same seed gives the same plan.
    order : {"fuel", "length", "depth-first"}
        Which k classes: the cheapest or the shortest along their midlines, or the first of a
        depth-first search (paper).

    Returns
    -------
    Plan
        Routes, least fuel first, and rejected classes with their reasons. With adaptive padding
        every route's hard-over turns were flown and none touched the no-go zone, but around a
        start or goal that lies in the soft no-go zone itself.

    Raises
    ------
    ParameterError
        Arguments out of range.
    StartInNoGoError, GoalInNoGoError
        An end on land or outside the chart; says by how much and where water is nearest.
    CurrentTooStrongError
        The current at the start outruns the vessel.
    UnreachableError
        No water joins start and goal, or every class fell away; says why.
    """
    if method not in get_args(Method):
        raise ParameterError(f"method = {method!r} is not one of {', '.join(get_args(Method))}")
    check_counts(classes, samples, seed, distinct_by)
    check_drift(drift)
    check_padding(padding, clearance, risk)
    field = as_field(current)
    start, goal = as_point("start", start), as_point("goal", goal)
    check_ends(chart, field, vessel, start, goal)
    triangulation = triangulate(chart)
    statistics = field.statistics(triangulation.corners)
    padder = partial(
        Padder, triangulation, statistics, vessel, padding=padding, clearance=clearance, seed=seed
    )
    rays = Rays.of(chart, distinct_by)
    search = _Search(
        chart=chart,
        field=field,
        vessel=vessel,
        start=start,
        goal=goal,
        triangulation=triangulation,
        padder=padder(risk=risk),
        rays=rays,
        method=method,
        samples=samples,
        drift=drift,
        seed=seed,
        proves=padding == "adaptive",
        least=LeastFuel(chart, field, vessel, start, goal, drift),
    )
    drifting = statistics.mean / vessel.speed
    finder = ChannelSearch(triangulation, rays, start, goal, order, drifting)
    outcomes = _examine(finder, search, classes)
    routes = sorted((o for o in outcomes if isinstance(o, Route)), key=lambda route: route.fuel)
    del routes[classes:]  # the rounds may have found more
    rejected = tuple(o for o in outcomes if isinstance(o, Rejected))
    if not routes:
        advice = [f"the widest way through has a gap of {finder.widest_gap():.2f} m"]
        if padding == "adaptive":
            for larger in (r for r in _RISKS_TO_ADVISE if r > risk):
                eased = replace(search, padder=padder(risk=larger))
                if any(isinstance(o, Route) for o in _examine(finder, eased, classes)):
                    advice.append(f"a risk of {larger:g} would leave a route")
                    break
            else:
                advice.append("no larger risk would leave a route")
        raise UnreachableError(_no_class(rejected, advice))
    chosen = min(range(len(routes)), key=lambda i: routes[i].harmonic_mean)
    return Plan(tuple(routes), rejected, chosen)


def _examine(finder: ChannelSearch, search: _Search, classes: int) -> list[Route | Rejected]:
    """Outcomes of the first k classes, and of those that take the place of fallen ones.

    A channel that is shut at some place is looked for again around all places found shut, in
    rounds, until a round finds none shut. What a strait's padding shuts to one class it mostly
    shuts to all, so that the rounds soon hold k classes that can be sailed. A class falls away,
    with its first reason, when no channel of it is left.
    """
    outcomes: dict[Word, Route | Rejected] = {}
    fell: dict[Word, Rejected] = {}
    shut: set[Move] = set()
    for _ in range(_MOST_ROUNDS):
        known = len(shut)
        for channel in itertools.islice(finder.channels(shut), classes):
            if channel.word in outcomes:
                continue
            try:
                outcomes[channel.word] = search.route(channel)
            except InfeasibleError as error:
                corners = search.triangulation.corners[channel.triangles]
                rejected = Rejected(channel.name, str(error), corners)
                if error.move is None:
                    outcomes[channel.word] = rejected
                else:
                    shut.add(error.move)
                    fell.setdefault(channel.word, rejected)
        if len(shut) == known:
            break
    return [*outcomes.values(), *(r for word, r in fell.items() if word not in outcomes)]


@dataclass(frozen=True)
class _Search:
    """Everything that the search for a class's best path needs to know."""

    chart: Chart
    field: CurrentField
    vessel: Vessel
    start: FloatArray
    goal: FloatArray
    triangulation: Triangulation
    padder: Padder
    rays: Rays
    method: Method
    samples: int
    drift: Drift
    seed: int
    proves: bool
    least: LeastFuel

    def route(self, channel: Channel) -> Route:
        """Best route of a class; its padding grows until every hard-over turn is clear.

        InfeasibleError says why there is none.
        """
        mesh = self.triangulation
        row = channel.triangles.tolist()
        region = np.array(list(mesh.surroundings(row, LAYERS)))
        corridor = Corridor(
            channel,
            mesh.corners[region],
            mesh.open_outline(region),
            self.padder.hazards(channel, self.start, self.goal),
            self.field,
            self.vessel,
            self.start,
            self.goal,
            self.drift,
        )
        ends = self.start, self.goal
        for _ in range(_MOST_REPAIRS):
            path, trajectory, harmonic_mean = self._best_path(corridor)
            shortfall = (
                padding_shortfall(path, ends, corridor.hazards, self.chart, self.field, self.vessel)
                if self.proves
                else None
            )
            if shortfall is None:
                return self._finished(corridor, path, trajectory, harmonic_mean)
            corridor = replace(corridor, hazards=corridor.hazards.grown(*shortfall))
        raise InfeasibleError(
            f"hard-over turns still touch land after {_MOST_REPAIRS} widenings of V"
        )

    def _best_path(self, corridor: Corridor) -> tuple[FloatArray, FloatArray, float]:
        """Least-fuel path of a corridor, its trajectory, and the figure that chooses its class."""
        if self.method == "sampled":
            return self._best_sample(corridor)
        # Eq. 4 as published rewards tacking against currents above v/2, where v + c·T is no convex
        # speed polar: such paths can't be steered. The crab model's path then can.
        attempts = dict.fromkeys((self.drift, "crab"))
        first: InfeasibleError | None = None
        for drift, bulging in itertools.product(attempts, (True, False)):
            attempt = replace(corridor, drift=drift)
            try:
                path = least_fuel_path(attempt, bulging=bulging)
                if self.rays.word(path) != corridor.channel.word:
                    continue
                path, trajectory = steer_inside(path, attempt)
                if self.rays.word(path) != corridor.channel.word:
                    continue
            except InfeasibleError as error:
                if error.move is not None:
                    raise
                first = first or error
                continue
            return path, trajectory, self._fuel(path)
        raise first or InfeasibleError("its least-fuel path slips into another class")

    def _best_sample(self, corridor: Corridor) -> tuple[FloatArray, FloatArray, float]:
        """Least-fuel chain of the paper's sampling, with the harmonic mean over its class."""
        rng = np.random.default_rng([self.seed, *corridor.channel.triangles.tolist()])
        chains = sampled_paths(corridor, self.samples, rng)
        chains = chains[steerable(chains, self.field, self.vessel)]
        if not len(chains):
            raise InfeasibleError(
                f"none of {self.samples} sampled chains can be steered at a turn rate of "
                f"{math.degrees(self.vessel.turn_rate):g} degrees a second; method='optimal' may"
            )
        # Water that outruns the vessel is no-go for it, whichever way it flows.
        drifts = np.linalg.norm(self.field((chains[:, 1:] + chains[:, :-1]) / 2), axis=-1)
        chains = chains[(drifts < self.vessel.speed).all(axis=1)]
        fuels = np.array([self._fuel(chain) for chain in chains])
        if not np.isfinite(fuels).any():
            raise InfeasibleError("the current outruns the vessel on every sampled chain")
        path = chains[fuels.argmin()]
        trajectory = steer(path, self.field, self.vessel)
        return path, trajectory, float(len(fuels) / (1 / fuels).sum())

    def _fuel(self, path: FloatArray) -> float:
        """Eq. 4 along a path."""
        times = passage_times(path, self.field, self.vessel, drift=self.drift)
        return float(self.vessel.fuel_rate * times.sum())

    def _finished(
        self,
        corridor: Corridor,
        path: FloatArray,
        trajectory: FloatArray,
        harmonic_mean: float,
    ) -> Route:
        """Route with all its figures."""
        hazards = corridor.hazards
        line = shapely.LineString(path)
        track = shapely.LineString(trajectory[:, 1:3])
        times = passage_times(path, self.field, self.vessel, drift=self.drift)
        apart = (
            min(shapely.distance([line, track], self.chart.hard_no_go))
            if self.chart.no_go
            else math.inf
        )
        return Route(
            path=path,
            trajectory=trajectory,
            fuel=self._fuel(path),
            length=float(line.length),
            clearance=float(apart),
            duration=float(times.sum()),
            least=self.least,
            homotopy=corridor.channel.name,
            channel=_crossed(corridor.corners, line),
            soft_no_go=hazards.zone(),
            padding_used=np.column_stack([hazards.start, hazards.end, hazards.padding]),
            harmonic_mean=harmonic_mean,
            starts_in_soft_no_go=len(hazards.around(self.start).edge) > 0,
            ends_in_soft_no_go=len(hazards.around(self.goal).edge) > 0,
        )


def _crossed(corners: FloatArray, line: shapely.LineString) -> FloatArray:
    """Those of the triangles (t, 3, 2) that a line crosses, in its order."""
    triangles = shapely.polygons(corners)
    inside = shapely.intersection(triangles, line)
    crossed = np.flatnonzero(shapely.length(inside) > 0)
    order = shapely.line_locate_point(line, shapely.centroid(inside[crossed])).argsort()
    return np.asarray(corners[crossed[order]])


def _no_class(rejected: tuple[Rejected, ...], advice: list[str]) -> str:
    """Message for a plan in which every class fell away."""
    reasons = "; ".join(f"class {r.homotopy}: {r.reason}" for r in rejected[:3])
    more = f" (and {len(rejected) - 3} more)" if len(rejected) > 3 else ""
    return (
        f"all {len(rejected)} classes fell away: {reasons}{more}. To find a route: "
        f"{'; '.join(advice)}; or allow a smaller padding or clearance, or more classes"
    )
