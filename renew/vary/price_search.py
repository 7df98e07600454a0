"""Choose speeds in a steady current by a price of time.

The price is the deadline's Lagrange multiplier. At a price λ the planner searches for classes and
paths with least fuel + λ time, as it otherwise does for least time. Along a found path, the price
that just meets the deadline gives the speeds of least fuel (:mod:`renew.paths.speed_profile`). That
price is used next, until it no longer changes. The price is found for the best class first and then
for each class, because every class has its own.
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
from renew.planner.diagnosis import no_class_error
from renew.planner.grow import Shortfalls, grown_until_clear
from renew.planner.one_class import ClassPath, ClassPlanner
from renew.results import Plan, Route, TradeOff
from renew.vary.departure_window import too_late_error
from renew.vary.sailings import best_sailing

# Largest number of rounds to find the price, and relative change below which it is accepted; the
# relative error of fuel is the square of that change.
_MAX_ROUNDS, _SETTLED = 4, 0.03
# Number of rounds of growing padding for turns at the chosen speeds.
_GROWTH_ROUNDS = 4
# Number of arrivals at which a trade-off is given.
_ARRIVALS = 65


class PriceSearch:
    """Plans a voyage with a choice of speeds, starting from a planner at an infinite price."""

    def __init__(self, planner: ClassPlanner) -> None:
        self.planner, self.classes = planner, planner.options.classes
        self.voyage = planner.problem.voyage
        self._at = functools.cache(self._planner_at)

    def plan(self) -> Plan:
        """Return the routes of least fuel that arrive in time, one per class.

        Raises ArrivalError if no route arrives in time even at the highest speed.
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
        """Return the fastest path of all classes, at the highest speed; raise an error if late."""
        sailing = best_sailing(self.planner, self.planner.unpadded)
        if sailing.found is None:
            raise sailing.error
        if sailing.arrival > self.voyage.deadline:
            raise too_late_error(sailing, self.voyage.deadline, "let speed reach {} m/s")
        return sailing.found

    def first_paths(self, fastest: ClassPath) -> tuple[ClassSearch, dict[Word, ClassPath]]:
        """Return the first classes' paths at the price of the best one, and their search."""
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
        """Find the first classes with a planner; one class's path is known already."""
        search = ClassSearch(planner)
        search.find_first(self.classes)
        paths = {one: self.with_speeds(found) for one, found in search.all_found.items()}
        if word not in paths or chosen_fuel(first) < chosen_fuel(paths[word]):
            paths[word] = first
        return search, paths

    def settled(self, found: ClassPath) -> ClassPath:
        """Return a class's path at its own price."""
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
        """Return the path with enough padding that no turn at its speeds touches land."""

        def again(corridor: Corridor, found: ClassPath) -> ClassPath:
            planner = self._at(corridor.voyage.choice.price)
            return self.in_time(self.with_speeds(planner.find_in(corridor, found.path)))

        return grown_until_clear(
            found, self.collisions, again, _GROWTH_ROUNDS, "hard-over turns at the speeds sailed"
        )

    def collisions(self, found: ClassPath) -> Shortfalls | None:
        """Return the shortfall of padding for turns at a path's speeds."""
        profile = profile_of(found)
        return self.planner.growth.collisions(found.corridor, profile.path, profile.speeds)

    def in_time(self, found: ClassPath) -> ClassPath:
        """Return the path; raise an error if it is too late at the highest speed."""
        profile = profile_of(found)
        if not math.isfinite(profile.fuel):
            raise InfeasibleError(
                "it would arrive at {0} at the earliest, and has to by {1}",
                Moment(profile.arrival),
                Moment(self.voyage.deadline),
            )
        return found

    def with_speeds(self, found: ClassPath) -> ClassPath:
        """Return a path with the speeds of least fuel."""
        return found._replace(profile=speed_profile(found.path, self.voyage))

    def _planner_at(self, price: float) -> ClassPlanner:
        """Return the planner for a price of time (fuel units a second)."""
        problem = self.planner.problem
        problem = problem.with_voyage(problem.voyage.at_price(price))
        return self.planner.for_problem(problem) if problem.voyage.has_price else self.planner

    def curve(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return arrivals (m,), s, and the least fuel (m,) for each along a path (n, 2)."""
        return trade_off(path, self.voyage)

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Return the least fuel for each arrival among the found paths."""
        curves = [self.curve(path) for path in paths]
        earliest = min(times[0] for times, _ in curves)
        latest = min(curves, key=lambda curve: curve[1][-1])[0][-1]
        arrivals = np.unique(np.linspace(earliest, latest, _ARRIVALS))
        fuels = [np.interp(arrivals, times, fuel, left=math.inf) for times, fuel in curves]
        return TradeOff(arrivals, np.min(fuels, axis=0))


def _is_settled(price: float, before: float) -> bool:
    """Whether a price is nearly the previous one, or both are infinite."""
    return price == before or abs(price - before) <= _SETTLED * before


def profile_of(found: ClassPath) -> SpeedProfile:
    """Return the speeds along a path; raise ValueError if speeds were not chosen."""
    if found.profile is None:
        raise ValueError("the path has no speeds of its own")
    return found.profile


def chosen_fuel(found: ClassPath) -> float:
    """Return a path's fuel at its chosen speeds."""
    return profile_of(found).fuel
