"""Choose speeds in a changing current, where no single price of time holds along the whole voyage.

So classes are searched at one speed: among the speeds that arrive in time, the one with the least
fuel on the fastest path. Each class's path and speeds are then improved together
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

# Largest number of rounds that improve path and speeds of a class, and the share of fuel that a
# round must save if another is to follow.
_MAX_ROUNDS, _WORTH_IT = 3, 3e-4
# Number of rounds of growing padding for the hours of passage, and for turns at the chosen speeds.
_GROWTH_ROUNDS = 8
# Largest duration of another class, in durations of the fastest class: the speed of the search
# lets such a class arrive before the current's data end.
_LONGER = 1.25
# Number of paths along which the trade-off is computed.
_CURVES = 3


class ClockSearch(PriceSearch):
    """Plans a voyage in a changing current for a vessel that chooses its speeds."""

    def first_paths(self, fastest: ClassPath) -> tuple[ClassSearch, dict[Word, ClassPath]]:
        """Return the first classes' paths at one speed, and the search that found them."""
        problem = self.planner.problem
        planner = self.planner.for_problem(problem.at_speed(self._one_speed(fastest)))
        return self.search_with(planner, problem.word(fastest.path), self.with_speeds(fastest))

    def _one_speed(self, fastest: ClassPath) -> float:
        """Return the speed (m/s) at which classes are searched."""
        most, (_, last) = self.voyage.vessel.speed, self.voyage.current.span
        speed = constant_speed(fastest.path, self.voyage)
        at_speed = self.voyage.at_speed(speed)
        if self.voyage.departure + _LONGER * at_speed.duration(fastest.path) > last:
            speed *= _LONGER
        return min(speed, most)

    def settled(self, found: ClassPath) -> ClassPath:
        """Return a class's path after improving course and speeds as long as that saves fuel."""
        best = self._improved(found)
        for _ in range(_MAX_ROUNDS - 1):
            if not chosen_fuel(best) < (1 - _WORTH_IT) * chosen_fuel(found):
                break
            found = best
            with contextlib.suppress(InfeasibleError):
                best = min(best, self._replanned(best, best.corridor), key=chosen_fuel)
        return self.in_time(best)

    def _improved(self, found: ClassPath) -> ClassPath:
        """Return a path with less fuel; if there is none, the given path steered at its speeds.

        The given path may have been found, and been steerable, at another speed.
        """
        corridor = self._on_schedule(found).corridor
        with contextlib.suppress(InfeasibleError):
            better = self._replanned(found, corridor)
            if chosen_fuel(better) <= chosen_fuel(found):
                return better
        return self._steered(corridor, found.path)

    def verified(self, found: ClassPath) -> ClassPath:
        """Return the path with enough padding that no turn at its hours and speeds touches land."""

        def short(found: ClassPath) -> Shortfalls | None:
            path, growth = profile_of(found).path, self.planner.growth
            return growth.shortfall(found.corridor, path) or self.collisions(found)

        def again(corridor: Corridor, found: ClassPath) -> ClassPath:
            return self._on_schedule(self.in_time(self._replanned(found, corridor)))

        turns = "hard-over turns at the speeds and hours of passage"
        return grown_until_clear(self._on_schedule(found), short, again, _GROWTH_ROUNDS, turns)

    def _replanned(self, found: ClassPath, corridor: Corridor) -> ClassPath:
        """Return a path near another one, in a corridor that may have more padding."""
        corridor = self._on_schedule(found._replace(corridor=corridor)).corridor
        profile = profile_of(found)
        fitted = self.planner.growth.fitted(corridor, profile.path)
        return self._steered(fitted, path_by_clock(fitted, profile))

    def _steered(self, corridor: Corridor, path: FloatArray) -> ClassPath:
        """Return a path (n, 2) after steering, with its speeds."""
        corridor, path, trajectory = steered_with_room(corridor, path)
        profile = speeds_by_clock(path, self.voyage)
        if self.planner.problem.word(profile.path) != corridor.channel.word:
            raise InfeasibleError("its least-fuel path slips into another class")
        if math.isfinite(profile.fuel):
            trajectory = steer_as_drawn(profile.path, corridor, profile.speeds)
        return ClassPath(corridor, path, trajectory, profile.fuel, profile.fuel, profile)

    def _on_schedule(self, found: ClassPath) -> ClassPath:
        """Return the path with its corridor for the hours of its passage."""
        profile = profile_of(found)
        voyage = self.voyage.scheduled(profile.path, profile.times)
        corridor = replace(found.corridor, voyage=voyage, polar=voyage.polar)
        return found._replace(corridor=corridor)

    def with_speeds(self, found: ClassPath) -> ClassPath:
        """Return a path with the speeds of least fuel."""
        return found._replace(profile=speeds_by_clock(found.path, self.voyage))

    def curve(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return arrivals (m,), s, and the least fuel (m,) for each along a path (n, 2)."""
        return trade_off_by_clock(path, self.voyage)

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Return the least fuel by arrival along the best paths and the fastest path."""
        return super().trade_off([*paths[: _CURVES - 1], paths[-1]])
