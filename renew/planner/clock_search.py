"""Speeds in a current that changes: no price of time holds all the way there.

So classes are looked for at one speed: of the speeds that are in time, the one of least fuel on the
quickest path. Each class's path and speeds are then improved together
(:mod:`renew.paths.path_by_clock`, :mod:`renew.paths.speeds_by_clock`), and land is padded for the
hours at which the vessel passes at these speeds.
"""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import replace

from renew._types import FloatArray
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError
from renew.paths.corridor import Corridor
from renew.paths.path_by_clock import path_by_clock
from renew.paths.speeds_by_clock import constant_speed, speeds_by_clock, trade_off_by_clock
from renew.planner.classes import ClassSearch
from renew.planner.grow import Shortfalls, grown_until_clear
from renew.planner.one_class import ClassPath
from renew.planner.price_search import PriceSearch, chosen_fuel, profile_of
from renew.planner.room_to_turn import steered_with_room
from renew.results import TradeOff
from renew.steering.steer_in_corridor import steer_as_drawn

# Largest number of rounds in which path and speeds of a class are improved, and the share of fuel
# that a round has to save for another to follow.
_MAX_ROUNDS, _WORTH_IT = 3, 3e-4
# Number of rounds of growing padding for the hours of passage, and for turns at those speeds.
_GROWTH_ROUNDS = 8
# How much longer than the quickest class another may take: the speed of the search lets it arrive
# before the current ends.
_LONGER = 1.25
# Number of paths along which the trade-off is worked out.
_CURVES = 3


class ClockSearch(PriceSearch):
    """Plans a voyage in a current that changes, whose vessel has a choice of speeds."""

    def first_paths(self, fastest: ClassPath) -> tuple[ClassSearch, dict[Word, ClassPath]]:
        """Paths of the first classes at one speed, and the search for them."""
        problem = self.planner.problem
        planner = self.planner.for_problem(problem.at_speed(self._one_speed(fastest)))
        return self.search_with(planner, problem.word(fastest.path), self.with_speeds(fastest))

    def _one_speed(self, fastest: ClassPath) -> float:
        """Speed (m/s) at which classes are looked for."""
        most, (_, last) = self.voyage.vessel.speed, self.voyage.current.span
        speed = constant_speed(fastest.path, self.voyage)
        at_speed = self.voyage.at_speed(speed)
        if self.voyage.departure + _LONGER * at_speed.duration(fastest.path) > last:
            speed *= _LONGER
        return min(speed, most)

    def settled(self, found: ClassPath) -> ClassPath:
        """The path of a class with its course and speeds improved, as long as that saves fuel."""
        best = self._improved(found)
        for _ in range(_MAX_ROUNDS - 1):
            if not chosen_fuel(best) < (1 - _WORTH_IT) * chosen_fuel(found):
                break
            found = best
            with contextlib.suppress(InfeasibleError):
                best = min(best, self._replanned(best, best.corridor), key=chosen_fuel)
        return self.in_time(best)

    def _improved(self, found: ClassPath) -> ClassPath:
        """A path of less fuel; or, where there is none, this path steered at its speeds.

        The path may have been found at another speed, at which it could be steered.
        """
        corridor = self._on_schedule(found).corridor
        with contextlib.suppress(InfeasibleError):
            better = self._replanned(found, corridor)
            if chosen_fuel(better) <= chosen_fuel(found):
                return better
        return self._steered(corridor, found.path)

    def verified(self, found: ClassPath) -> ClassPath:
        """The path with so much padding that turns touch no land at its hours and speeds."""

        def short(found: ClassPath) -> Shortfalls | None:
            path, growth = profile_of(found).path, self.planner.growth
            return growth.shortfall(found.corridor, path) or self.collisions(found)

        def again(corridor: Corridor, found: ClassPath) -> ClassPath:
            return self._on_schedule(self.in_time(self._replanned(found, corridor)))

        turns = "hard-over turns at the speeds and hours of passage"
        return grown_until_clear(self._on_schedule(found), short, again, _GROWTH_ROUNDS, turns)

    def _replanned(self, found: ClassPath, corridor: Corridor) -> ClassPath:
        """A path near another, in a corridor that may have more padding."""
        corridor = self._on_schedule(found._replace(corridor=corridor)).corridor
        profile = profile_of(found)
        fitted = self.planner.growth.fitted(corridor, profile.path)
        return self._steered(fitted, path_by_clock(fitted, profile))

    def _steered(self, corridor: Corridor, path: FloatArray) -> ClassPath:
        """A path (n, 2) steered, with its speeds."""
        corridor, path, trajectory = steered_with_room(corridor, path)
        profile = speeds_by_clock(path, self.voyage)
        if self.planner.problem.word(profile.path) != corridor.channel.word:
            raise InfeasibleError("its least-fuel path slips into another class")
        if math.isfinite(profile.fuel):
            trajectory = steer_as_drawn(profile.path, corridor, profile.speeds)
        return ClassPath(corridor, path, trajectory, profile.fuel, profile.fuel, profile)

    def _on_schedule(self, found: ClassPath) -> ClassPath:
        """The path with its corridor for the hours at which it is sailed."""
        profile = profile_of(found)
        voyage = self.voyage.scheduled(profile.path, profile.times)
        corridor = replace(found.corridor, voyage=voyage, polar=voyage.polar)
        return found._replace(corridor=corridor)

    def with_speeds(self, found: ClassPath) -> ClassPath:
        """A path with the speeds of least fuel along it."""
        return found._replace(profile=speeds_by_clock(found.path, self.voyage))

    def curve(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arrivals (m,), s, and least fuels (m,) along a path (n, 2)."""
        return trade_off_by_clock(path, self.voyage)

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Least fuel by arrival along the best paths that have been found, and the quickest."""
        return super().trade_off([*paths[: _CURVES - 1], paths[-1]])
