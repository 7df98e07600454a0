"""Least fuel to be there in time, where the vessel chooses her speed from leg to leg.

The deadline gets a Lagrange multiplier: at a price λ of time the planner looks for the classes and
paths of least fuel + λ time, as it does for those of least time, and along a path the price at
which the deadline is just met gives the speeds of least fuel (:mod:`renew.paths.speed_profile`).
That is the next price, until it stays. It is found for the best class at first, and then for each
class by itself, since each has its own.

Land is padded for the highest speed, and then once more for the highest that is sailed, if that is
much lower: straits open, and way is saved. The padding for a speed covers all lower ones: how far a
turn reaches towards an edge is, for a given heading and current, the largest over time of something
linear in v, hence convex in v; at v = 0 it is the drift, than which it is no less at any v; so it
never falls as v rises. Beside that, hard-over turns are flown at the very speeds at which each leg
is sailed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from renew._types import FloatArray
from renew.classes.h_signature import Word
from renew.departures.latest_departure import too_late_error
from renew.departures.sailings import Sailings
from renew.errors import InfeasibleError, Moment, PlanningError
from renew.inputs.voyage_checks import check_current_at_endpoints
from renew.paths.speed_profile import SpeedProfile, speed_profile, trade_off
from renew.route import Plan, Rejected, Route, TradeOff
from renew.search.class_planner import ClassPlanner, Found
from renew.search.diagnosis import no_class_error
from renew.search.growing_padding import grown
from renew.search.k_sailable_classes import Results

# Largest number of rounds in which the price is looked for, and its change, as a share of it, from
# which it counts as settled: fuel differs by the square of that.
_MAX_ROUNDS, _SETTLED = 4, 0.03
# Number of times that padding may grow for turns at the speeds that are sailed.
_MAX_GROWTHS = 4
# Share of the highest speed below which the padding for it is too wide to be left so.
_MUCH_LOWER = 0.95
# Number of arrivals at which a trade-off is given.
_ARRIVALS = 65


class Way(NamedTuple):
    """A path of a class, how it was found, and the speeds at which it is sailed."""

    planner: ClassPlanner
    found: Found
    profile: SpeedProfile

    @property
    def price(self) -> float:
        """Price of time (fuel units a second) at which the path was found."""
        return self.planner.problem.voyage.choice.price


def plan_at_chosen_speeds(
    planner_up_to: Callable[[float], ClassPlanner],
    most: float,
    search: Callable[[ClassPlanner], SpeedSearch],
) -> Plan:
    """Plan a voyage with a choice of speeds up to `most` (m/s), by a search of planners up to it.

    ArrivalError where no route arrives in time even at the highest speed.
    """
    planner = planner_up_to(most)
    check_current_at_endpoints(planner.problem.voyage)
    plan = search(planner).plan()
    highest = float(plan.best.speeds.max())
    if not planner.policy.is_adaptive or highest > _MUCH_LOWER * most:
        return plan
    try:
        slower = search(planner_up_to(highest)).plan()
    except PlanningError:
        # Water that only a faster vessel can stem.
        return plan
    if slower.best.fuel >= plan.best.fuel:
        return plan
    return _cheaper_of_each_class(plan, slower)


def _cheaper_of_each_class(plan: Plan, slower: Plan) -> Plan:
    """The cheaper route of each class of two plans; a longer way may need the higher speeds."""
    by_fuel = sorted([*slower.routes, *plan.routes], key=lambda route: route.fuel)
    cheapest = {route.homotopy: route for route in reversed(by_fuel)}
    # Proven is what holds for all speeds.
    bound = plan.best.fuel_bound
    routes = [
        replace(route, fuel_bound=bound) for route in by_fuel if cheapest[route.homotopy] is route
    ]
    rejected = {one.homotopy: one for one in (*slower.rejected, *plan.rejected)}
    return replace(
        plan,
        routes=tuple(routes[: max(len(plan.routes), len(slower.routes))]),
        rejected=tuple(one for name, one in rejected.items() if name not in cheapest),
        trade_off=_cheaper(plan.trade_off, slower.trade_off),
    )


def _cheaper(one: TradeOff | None, other: TradeOff | None) -> TradeOff | None:
    """The cheaper of two trade-offs for each arrival."""
    if one is None or other is None:
        return one or other
    arrivals = np.union1d(one.arrivals, other.arrivals)
    fuels = [np.interp(arrivals, c.arrivals, c.fuels, left=math.inf) for c in (one, other)]
    return TradeOff(arrivals, np.min(fuels, axis=0))


class SpeedSearch:
    """Plans a voyage whose vessel has a choice of speeds, from a planner at an infinite price."""

    def __init__(self, planner: ClassPlanner, classes: int) -> None:
        self.planner, self.classes = planner, classes
        self.voyage = planner.problem.voyage

    def plan(self) -> Plan:
        """Routes of least fuel that arrive in time, one per class.

        ArrivalError where none does even at the highest speed.
        """
        fastest = self._fastest()
        results, ways = self.ways(fastest)
        routes: list[tuple[Route, float]] = []
        rejected = {word: one for word, one in results.rejected.items() if word not in ways}
        for word, way in ways.items():
            try:
                settled = self.verified(self.settled(way))
            except InfeasibleError as error:
                rejected[word] = results.rejected_for(way.found.corridor.channel, error)
            else:
                profile = settled.profile if self.voyage.has_choice else None
                route = settled.planner.route(settled.found, profile)
                routes.append((route, settled.profile.price))
        if not routes:
            raise self._no_class(tuple(rejected.values()))
        routes = sorted(routes, key=lambda one: one[0].fuel)[: self.classes]
        bound = self._at(routes[0][1]).problem.fuel_bound
        found = tuple(replace(route, fuel_bound=bound) for route, _ in routes)
        paths = [*(route.path for route in found), fastest.path]
        return Plan(
            found,
            tuple(rejected.values()),
            overpowering=self.planner.problem.overpowered_water,
            trade_off=self.trade_off(paths),
        )

    def _fastest(self) -> Found:
        """Quickest path of all classes, at the highest speed; refused where it comes too late."""
        sailing = Sailings(self.planner, self.classes).sailing(self.voyage.departure)
        if sailing.found is None:
            raise sailing.error
        if sailing.arrival > self.voyage.deadline:
            raise too_late_error(sailing, self.voyage.deadline, "let speed reach {:.3g} m/s")
        return sailing.found

    def ways(self, fastest: Found) -> tuple[Results, dict[Word, Way]]:
        """Ways of the first classes at the price of the best one, and what else they came to."""
        word = self.planner.problem.word(fastest.path)
        first = self.way(self.planner, fastest)
        price = first.profile.price
        for _ in range(_MAX_ROUNDS):
            planner = self._at(price)
            results = Results(planner)
            results.look_for(self.classes)
            ways = {word: self.way(planner, found) for word, found in results.all_found.items()}
            if word not in ways or first.profile.fuel < ways[word].profile.fuel:
                ways[word] = first
            best = min(ways.values(), key=lambda way: way.profile.fuel).profile.price
            if _is_settled(best, price):
                break
            price = best
        return results, ways

    def settled(self, way: Way) -> Way:
        """The way of a class at its own price."""
        best = way
        for _ in range(_MAX_ROUNDS):
            if _is_settled(way.profile.price, way.price):
                break
            planner = self._at(way.profile.price)
            channel = best.found.corridor.channel
            found = planner.find(channel)
            if planner.problem.word(found.path) != channel.word:
                break
            way = self.way(planner, found)
            best = min(best, way, key=lambda one: one.profile.fuel)
        self.check_arrival(best.profile)
        return best

    def verified(self, way: Way) -> Way:
        """The way with so much padding that turns at its own speeds touch no land."""
        for _ in range(_MAX_GROWTHS):
            profile, growth = way.profile, way.planner.growth
            short = growth.collisions(way.found.corridor, profile.path, profile.speeds)
            if short is None:
                return way
            found = way.planner.find_in(grown(way.found.corridor, short), way.found.path)
            way = self.way(way.planner, found)
            self.check_arrival(way.profile)
        raise InfeasibleError(
            "its path is still not clear of hard-over turns at the speeds sailed after its padding "
            f"has grown {_MAX_GROWTHS} times"
        )

    def check_arrival(self, profile: SpeedProfile) -> None:
        """Refuse a way that comes too late at the highest speed."""
        if not math.isfinite(profile.fuel):
            raise InfeasibleError(
                "it would arrive at {0} at the earliest, and has to by {1}",
                Moment(profile.arrival),
                Moment(self.voyage.deadline),
            )

    def way(self, planner: ClassPlanner, found: Found) -> Way:
        """A path with its speeds."""
        return Way(planner, found, speed_profile(found.path, self.voyage))

    def _at(self, price: float) -> ClassPlanner:
        """Planner of least cost at a price of time."""
        problem = self.planner.problem.at_price(price)
        return self.planner.for_problem(problem) if problem.voyage.has_price else self.planner

    def _no_class(self, rejected: tuple[Rejected, ...]) -> PlanningError:
        """Error for a plan without a route."""
        planner = self.planner
        return no_class_error(rejected, planner.problem, planner.policy, planner.method)

    def curve(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arrivals (m,), s, and least fuels (m,) along a path (n, 2)."""
        return trade_off(path, self.voyage)

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Least fuel by arrival along the paths that have been found, one of them for each."""
        curves = [self.curve(path) for path in paths]
        earliest = min(times[0] for times, _ in curves)
        latest = min(curves, key=lambda curve: curve[1][-1])[0][-1]
        arrivals = np.unique(np.linspace(earliest, latest, _ARRIVALS))
        fuels = [np.interp(arrivals, times, fuel, left=math.inf) for times, fuel in curves]
        return TradeOff(arrivals, np.min(fuels, axis=0))


def _is_settled(price: float, before: float) -> bool:
    """Whether a price is nearly the one before; or both are infinite."""
    return price == before or abs(price - before) <= _SETTLED * before
