"""Speeds in a steady current, by a price of time.

The deadline gets a Lagrange multiplier: at a price λ of time the planner looks for the classes and
paths of least fuel + λ time, as elsewhere for those of least time; along a path the price at which
the deadline is just met gives the speeds of least fuel (:mod:`renew.paths.speed_profile`). It is
the next price, until it changes no more. The price is found for the best class first, and then for
each class by itself, since each class has its own.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from renew._types import FloatArray
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError, Moment
from renew.paths.corridor import Corridor
from renew.paths.speed_profile import SpeedProfile, speed_profile, trade_off
from renew.planner.classes import ClassSearch
from renew.planner.departures import best_sailing
from renew.planner.diagnosis import no_class_error
from renew.planner.grow import Shortfalls, grown_until_clear
from renew.planner.latest_departure import too_late_error
from renew.planner.one_class import ClassPath, ClassPlanner
from renew.results import Plan, Route, TradeOff

# Largest number of rounds in which the price is looked for, and the relative change below which it
# counts as settled: fuel differs by the square of that.
_MAX_ROUNDS, _SETTLED = 4, 0.03
# Number of rounds of growing padding for turns at the speeds that are sailed.
_GROWTH_ROUNDS = 4
# Number of arrivals at which a trade-off is given.
_ARRIVALS = 65


class PriceSearch:
    """Plans a voyage whose vessel has a choice of speeds, from a planner at an infinite price."""

    def __init__(self, planner: ClassPlanner) -> None:
        self.planner, self.classes = planner, planner.options.classes
        self.voyage = planner.problem.voyage
        self._at = functools.cache(self._planner_at)

    def plan(self) -> Plan:
        """Routes of least fuel that arrive in time, one per class.

        ArrivalError where none does even at the highest speed.
        """
        fastest = self._fastest()
        search, paths = self.first_paths(fastest)
        routes: list[tuple[Route, float]] = []
        rejected = {word: one for word, one in search.rejected.items() if word not in paths}
        for word, found in paths.items():
            try:
                settled = self.verified(self.settled(found))
            except InfeasibleError as error:
                rejected[word] = search.rejected_for(found.corridor.channel, error)
            else:
                price = profile_of(settled).price
                kept = settled if self.voyage.has_choice else settled._replace(profile=None)
                routes.append((self.planner.route(kept), price))
        if not routes:
            raise no_class_error(tuple(rejected.values()), self.planner)
        routes = sorted(routes, key=lambda one: one[0].fuel)[: self.classes]
        bound = self._at(routes[0][1]).problem.fuel_bound
        best = tuple(replace(route, fuel_bound=bound) for route, _ in routes)
        return Plan(
            best,
            tuple(rejected.values()),
            overpowering=self.planner.problem.overpowered_water,
            trade_off=self.trade_off([*(route.path for route in best), fastest.path]),
        )

    def _fastest(self) -> ClassPath:
        """Quickest path of all classes, at the highest speed; refused where it comes too late."""
        sailing = best_sailing(self.planner, self.planner.unpadded)
        if sailing.found is None:
            raise sailing.error
        if sailing.arrival > self.voyage.deadline:
            raise too_late_error(sailing, self.voyage.deadline, "let speed reach {:.3g} m/s")
        return sailing.found

    def first_paths(self, fastest: ClassPath) -> tuple[ClassSearch, dict[Word, ClassPath]]:
        """Paths of the first classes at the price of the best one, and the search for them."""
        word = self.planner.problem.word(fastest.path)
        first = self.with_speeds(fastest)
        price = profile_of(first).price
        for _ in range(_MAX_ROUNDS):
            search, paths = self.search_with(self._at(price), word, first)
            best = min(map(profile_of, paths.values()), key=lambda profile: profile.fuel).price
            if _is_settled(best, price):
                break
            price = best
        return search, paths

    def search_with(
        self, planner: ClassPlanner, word: Word, first: ClassPath
    ) -> tuple[ClassSearch, dict[Word, ClassPath]]:
        """Find the first classes by a planner; the path of one word's class is known already."""
        search = ClassSearch(planner)
        search.find_first(self.classes)
        paths = {one: self.with_speeds(found) for one, found in search.all_found.items()}
        if word not in paths or chosen_fuel(first) < chosen_fuel(paths[word]):
            paths[word] = first
        return search, paths

    def settled(self, found: ClassPath) -> ClassPath:
        """The path of a class at its own price."""
        best = found
        for _ in range(_MAX_ROUNDS):
            price = profile_of(found).price
            if _is_settled(price, found.corridor.voyage.choice.price):
                break
            planner, channel = self._at(price), best.corridor.channel
            at_price = planner.find(channel)
            if planner.problem.word(at_price.path) != channel.word:
                break
            found = self.with_speeds(at_price)
            best = min(best, found, key=chosen_fuel)
        return self.in_time(best)

    def verified(self, found: ClassPath) -> ClassPath:
        """The path with so much padding that turns at its own speeds touch no land."""

        def again(corridor: Corridor, found: ClassPath) -> ClassPath:
            planner = self._at(corridor.voyage.choice.price)
            return self.in_time(self.with_speeds(planner.find_in(corridor, found.path)))

        return grown_until_clear(
            found, self.collisions, again, _GROWTH_ROUNDS, "hard-over turns at the speeds sailed"
        )

    def collisions(self, found: ClassPath) -> Shortfalls | None:
        """Shortfall of padding for turns at the speeds of a path."""
        profile = profile_of(found)
        return self.planner.growth.collisions(found.corridor, profile.path, profile.speeds)

    def in_time(self, found: ClassPath) -> ClassPath:
        """The path; refused where it comes too late at the highest speed."""
        profile = profile_of(found)
        if not math.isfinite(profile.fuel):
            raise InfeasibleError(
                "it would arrive at {0} at the earliest, and has to by {1}",
                Moment(profile.arrival),
                Moment(self.voyage.deadline),
            )
        return found

    def with_speeds(self, found: ClassPath) -> ClassPath:
        """A path with the speeds of least fuel along it."""
        return found._replace(profile=speed_profile(found.path, self.voyage))

    def _planner_at(self, price: float) -> ClassPlanner:
        """Planner of least cost at a price of time (fuel units a second)."""
        problem = self.planner.problem.at_price(price)
        return self.planner.for_problem(problem) if problem.voyage.has_price else self.planner

    def curve(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arrivals (m,), s, and least fuels (m,) along a path (n, 2)."""
        return trade_off(path, self.voyage)

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Least fuel by arrival along the paths found, the cheapest for each arrival."""
        curves = [self.curve(path) for path in paths]
        earliest = min(times[0] for times, _ in curves)
        latest = min(curves, key=lambda curve: curve[1][-1])[0][-1]
        arrivals = np.unique(np.linspace(earliest, latest, _ARRIVALS))
        fuels = [np.interp(arrivals, times, fuel, left=math.inf) for times, fuel in curves]
        return TradeOff(arrivals, np.min(fuels, axis=0))


def _is_settled(price: float, before: float) -> bool:
    """Whether a price is nearly the price before; or both are infinite."""
    return price == before or abs(price - before) <= _SETTLED * before


def profile_of(found: ClassPath) -> SpeedProfile:
    """Speeds along a path for which speeds were chosen."""
    if found.profile is None:
        raise ValueError("the path has no speeds of its own")
    return found.profile


def chosen_fuel(found: ClassPath) -> float:
    """Fuel of a path at its chosen speeds."""
    return profile_of(found).fuel
