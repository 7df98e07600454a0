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
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from renew._types import FloatArray
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError, PlanningError
from renew.inputs.arguments import check_current_at_endpoints
from renew.paths.speed_profile import SpeedProfile, speed_profile, trade_off
from renew.route import Plan, Rejected, Route, TradeOff
from renew.search.class_planner import ClassPlanner, Found
from renew.search.diagnosis import no_class_error
from renew.search.growing_padding import grown
from renew.search.k_sailable_classes import Results
from renew.search.latest_departure import too_late_error
from renew.search.sailings import Sailings

# Largest number of rounds in which the price is looked for, and its change, as a share of it, from
# which it counts as settled: fuel differs by the square of that.
_MAX_ROUNDS, _SETTLED = 4, 0.03
# Number of times that padding may grow for turns at the speeds that are sailed.
_MAX_GROWTHS = 4
# Share of the highest speed below which the padding for it is too wide to be left so.
_MUCH_LOWER = 0.95
# Number of arrivals at which a trade-off is given.
_ARRIVALS = 65


class _Way(NamedTuple):
    """A path of a class, how it was found, and the speeds at which it is sailed."""

    planner: ClassPlanner
    found: Found
    profile: SpeedProfile

    @property
    def price(self) -> float:
        """Price of time (fuel units a second) at which the path was found."""
        return self.planner.problem.voyage.choice.price


def plan_at_chosen_speeds(
    planner_up_to: Callable[[float], ClassPlanner], most: float, classes: int
) -> Plan:
    """Plan a voyage with a choice of speeds up to `most` (m/s), from planners for a highest speed.

    ArrivalError where no route arrives in time even at the highest speed.
    """
    planner = planner_up_to(most)
    check_current_at_endpoints(planner.problem.voyage)
    plan = SpeedSearch(planner, classes).plan()
    highest = float(plan.best.speeds.max())
    if not planner.policy.is_adaptive or highest > _MUCH_LOWER * most:
        return plan
    try:
        slower = SpeedSearch(planner_up_to(highest), classes).plan()
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
        self._planner, self._classes = planner, classes
        self._voyage = planner.problem.voyage

    def plan(self) -> Plan:
        """Routes of least fuel that arrive in time, one per class.

        ArrivalError where none does even at the highest speed.
        """
        fastest = self._fastest()
        results, ways = self._classes_of_least_cost(fastest)
        routes: list[tuple[Route, float]] = []
        rejected = {word: one for word, one in results.rejected.items() if word not in ways}
        for word, way in ways.items():
            try:
                settled = self._verified(self._settled(way))
            except InfeasibleError as error:
                rejected[word] = results.rejected_for(way.found.corridor.channel, error)
            else:
                profile = settled.profile if self._voyage.has_choice else None
                route = settled.planner.route(settled.found, profile)
                routes.append((route, settled.profile.price))
        if not routes:
            raise self._no_class(tuple(rejected.values()))
        routes = sorted(routes, key=lambda one: one[0].fuel)[: self._classes]
        bound = self._at(routes[0][1]).problem.fuel_bound
        found = tuple(replace(route, fuel_bound=bound) for route, _ in routes)
        paths = [fastest.path, *(route.path for route in found)]
        return Plan(
            found,
            tuple(rejected.values()),
            overpowering=self._planner.problem.overpowered_water,
            trade_off=self._trade_off(paths),
        )

    def _fastest(self) -> Found:
        """Quickest path of all classes, at the highest speed; refused where it comes too late."""
        sailing = Sailings(self._planner, self._classes).sailing(self._voyage.departure)
        if sailing.found is None:
            raise sailing.error
        if sailing.arrival > self._voyage.deadline:
            raise too_late_error(sailing, self._voyage.deadline, "let speed reach {:.3g} m/s")
        return sailing.found

    def _classes_of_least_cost(self, fastest: Found) -> tuple[Results, dict[Word, _Way]]:
        """Ways of the first classes at the price of the best one, and what else they came to."""
        word = self._planner.problem.rays.word(fastest.path)
        first = self._way(self._planner, fastest)
        price = first.profile.price
        for _ in range(_MAX_ROUNDS):
            planner = self._at(price)
            results = Results(planner)
            results.look_for(self._classes)
            ways = {word: self._way(planner, found) for word, found in results.all_found.items()}
            if word not in ways or first.profile.fuel < ways[word].profile.fuel:
                ways[word] = first
            best = min(ways.values(), key=lambda way: way.profile.fuel).profile.price
            if _is_settled(best, price):
                break
            price = best
        return results, ways

    def _settled(self, way: _Way) -> _Way:
        """The way of a class at its own price."""
        best = way
        for _ in range(_MAX_ROUNDS):
            if _is_settled(way.profile.price, way.price):
                break
            planner = self._at(way.profile.price)
            channel = best.found.corridor.channel
            found = planner.find(channel)
            if planner.problem.rays.word(found.path) != channel.word:
                break
            way = self._way(planner, found)
            best = min(best, way, key=lambda one: one.profile.fuel)
        self._check_arrival(best.profile)
        return best

    def _verified(self, way: _Way) -> _Way:
        """The way with so much padding that turns at its own speeds touch no land."""
        for _ in range(_MAX_GROWTHS):
            profile, growth = way.profile, way.planner.growth
            short = growth.collisions(way.found.corridor, profile.path, profile.speeds)
            if short is None:
                return way
            found = way.planner.find_in(grown(way.found.corridor, short), way.found.path)
            way = self._way(way.planner, found)
            self._check_arrival(way.profile)
        raise InfeasibleError(
            "its path is still not clear of hard-over turns at the speeds sailed after its padding "
            f"has grown {_MAX_GROWTHS} times"
        )

    def _check_arrival(self, profile: SpeedProfile) -> None:
        """Refuse a way that comes too late at the highest speed."""
        if not math.isfinite(profile.fuel):
            raise InfeasibleError(
                f"it would arrive at {profile.arrival:.6g} s at the earliest, and has to by "
                f"{self._voyage.deadline:.6g} s"
            )

    def _way(self, planner: ClassPlanner, found: Found) -> _Way:
        """A path with its speeds."""
        return _Way(planner, found, speed_profile(found.path, self._voyage))

    def _at(self, price: float) -> ClassPlanner:
        """Planner of least cost at a price of time."""
        problem = self._planner.problem.at_price(price)
        return self._planner.for_problem(problem) if problem.voyage.has_price else self._planner

    def _no_class(self, rejected: tuple[Rejected, ...]) -> PlanningError:
        """Error for a plan without a route."""
        planner = self._planner
        return no_class_error(rejected, planner.problem, planner.policy, planner.method)

    def _trade_off(self, paths: Iterable[FloatArray]) -> TradeOff:
        """Least fuel by arrival along the paths that have been found, one of them for each."""
        curves = [trade_off(path, self._voyage) for path in paths]
        earliest = min(times[0] for times, _ in curves)
        latest = min(curves, key=lambda curve: curve[1][-1])[0][-1]
        arrivals = np.unique(np.linspace(earliest, latest, _ARRIVALS))
        fuels = [np.interp(arrivals, times, fuel, left=math.inf) for times, fuel in curves]
        return TradeOff(arrivals, np.min(fuels, axis=0))


def _is_settled(price: float, before: float) -> bool:
    """Whether a price is nearly the one before; or both are infinite."""
    return price == before or abs(price - before) <= _SETTLED * before
