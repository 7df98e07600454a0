"""Least fuel to be there in time, as the current changes, where the vessel chooses her speeds.

No price of time holds all the way there, so classes are looked for at one speed: that of least fuel
on the quickest way, of those that are in time all the way. Each class's path and speeds are then
improved together (:mod:`renew.paths.path_by_clock`, :mod:`renew.paths.speeds_by_clock`), and land
is padded for the hours at which she passes at these speeds.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from renew._types import FloatArray
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError, ParameterError, PlanningError
from renew.inputs.voyage import Voyage
from renew.paths.corridor import Corridor
from renew.paths.path_by_clock import path_by_clock
from renew.paths.speeds_by_clock import constant_speed, speeds_by_clock, trade_off_by_clock
from renew.route import Plan, TradeOff
from renew.search.class_planner import ClassPlanner, Found
from renew.search.growing_padding import grown
from renew.search.k_sailable_classes import Results, plan_classes
from renew.search.room_to_turn import steered_with_room
from renew.speeds.speed_search import SpeedSearch, Way, plan_at_chosen_speeds
from renew.steering.steer_in_corridor import steer_as_drawn

# Largest number of rounds in which path and speeds of a class are improved, and the share of its
# fuel that one has to save for another to follow.
_MAX_ROUNDS, _WORTH_IT = 3, 3e-4
# Number of times that padding may grow for the hours of passage, and for turns at those speeds.
_MAX_GROWTHS = 8
# How much longer than the quickest one a class may take: it is looked for at such a speed that it
# arrives before the current ends.
_LONGER = 1.25
# Rounds in which a route at one speed is looked for, and the share by which its speed may change in
# the last.
_ONE_SPEED_ROUNDS, _SAME = 4, 1e-7
# Number of paths along which the trade-off is worked out.
_CURVES = 3


def plan_by_clock(
    planner_up_to: Callable[[float], ClassPlanner], most: float, classes: int
) -> Plan:
    """Plan a voyage with a choice of speeds up to `most` (m/s), from planners for a highest speed.

    Where the current does not change, with prices of time. ArrivalError where no route arrives in
    time even at the highest speed.
    """
    voyage = planner_up_to(most).problem.voyage
    if voyage.current_change > 0 and len(voyage.via):
        raise ParameterError(
            "speeds can't be chosen on a way with via points in a current that changes; leave out "
            "speed or via, or plan from one via point to the next with an arrival at each"
        )
    if voyage.current_change == 0:
        return plan_at_chosen_speeds(planner_up_to, most, lambda one: SpeedSearch(one, classes))
    plan = plan_at_chosen_speeds(planner_up_to, most, lambda one: SpeedSearchByClock(one, classes))
    return _with_one_speed(plan, planner_up_to, voyage)


def _with_one_speed(
    plan: Plan, planner_up_to: Callable[[float], ClassPlanner], voyage: Voyage
) -> Plan:
    """The plan, or one whose best route is sailed at one speed, where that needs less fuel.

    Who never goes faster can turn in less room.
    """
    path, best = plan.best.path, plan.best
    speed = 0.0
    for _ in range(_ONE_SPEED_ROUNDS):
        before, speed = speed, constant_speed(path, voyage)
        if abs(speed - before) <= _SAME * speed:
            break
        with contextlib.suppress(PlanningError):
            (route,) = plan_classes(planner_up_to(speed), 1).routes or (best,)
            path = route.path
            if route.times[-1] <= voyage.deadline and route.fuel < best.fuel:
                best = route
    if best is plan.best:
        return plan
    routes = [best, *(route for route in plan.routes if route.homotopy != best.homotopy)]
    bound = plan.best.fuel_bound
    return replace(plan, routes=tuple(replace(route, fuel_bound=bound) for route in routes))


class SpeedSearchByClock(SpeedSearch):
    """Plans a voyage in a current that changes, whose vessel has a choice of speeds."""

    def ways(self, fastest: Found) -> tuple[Results, dict[Word, Way]]:
        """Ways of the first classes at one speed, and what else they came to."""
        problem = self.planner.problem
        planner = self.planner.for_problem(problem.at_speed(self._one_speed(fastest)))
        results = Results(planner)
        results.look_for(self.classes)
        ways = {word: self.way(self.planner, found) for word, found in results.all_found.items()}
        word, first = problem.word(fastest.path), self.way(self.planner, fastest)
        if word not in ways or first.profile.fuel < ways[word].profile.fuel:
            ways[word] = first
        return results, ways

    def _one_speed(self, fastest: Found) -> float:
        """Speed (m/s) at which classes are looked for."""
        most, (_, last) = self.voyage.vessel.speed, self.voyage.current.span
        speed = constant_speed(fastest.path, self.voyage)
        at_speed = self.voyage.at_speed(speed)
        if self.voyage.departure + _LONGER * at_speed.duration(fastest.path) > last:
            speed *= _LONGER
        return min(speed, most)

    def settled(self, way: Way) -> Way:
        """The way of a class with path and speeds improved, as long as that saves fuel."""
        best = self._improved(way)
        for _ in range(_MAX_ROUNDS - 1):
            enough = (1 - _WORTH_IT) * way.profile.fuel
            if not best.profile.fuel < enough:
                break
            way = best
            with contextlib.suppress(InfeasibleError):
                best = min(best, self._replanned(best, best.found.corridor), key=_fuel)
        self.check_arrival(best.profile)
        return best

    def _improved(self, way: Way) -> Way:
        """The way with a path of less fuel; or its own steered at its speeds, where there is none.

        It may have been found at another speed, at which it could be steered.
        """
        corridor = self._on_schedule(way, way.found.corridor)[1]
        with contextlib.suppress(InfeasibleError):
            better = self._replanned(way, corridor)
            if better.profile.fuel <= way.profile.fuel:
                return better
        return self._steered(way.planner, corridor, way.found.path)

    def verified(self, way: Way) -> Way:
        """The way with so much padding that turns touch no land when she passes at her speeds."""
        for _ in range(_MAX_GROWTHS):
            planner, corridor = self._on_schedule(way, way.found.corridor)
            path, speeds = way.profile.path, way.profile.speeds
            growth = planner.growth
            short = growth.shortfall(corridor, path) or growth.collisions(corridor, path, speeds)
            if short is None:
                return way._replace(planner=planner, found=way.found._replace(corridor=corridor))
            way = self._replanned(way, grown(corridor, short))
            self.check_arrival(way.profile)
        raise InfeasibleError(
            "its path is still not clear of hard-over turns at the speeds and hours of passage "
            f"after its padding has grown {_MAX_GROWTHS} times"
        )

    def _replanned(self, way: Way, corridor: Corridor) -> Way:
        """A way near another, in a corridor that may have more padding."""
        planner, corridor = self._on_schedule(way, corridor)
        short = planner.growth.crossed_shortfall(corridor, way.profile.path)
        if short is not None:
            corridor = grown(corridor, short)
        return self._steered(planner, corridor, path_by_clock(corridor, way.profile))

    def _steered(self, planner: ClassPlanner, corridor: Corridor, path: FloatArray) -> Way:
        """A path (n, 2) steered, with its speeds."""
        corridor, path, trajectory = steered_with_room(corridor, path)
        profile = speeds_by_clock(path, self.voyage)
        if planner.problem.word(profile.path) != corridor.channel.word:
            raise InfeasibleError("its least-fuel path slips into another class")
        if math.isfinite(profile.fuel):
            trajectory = steer_as_drawn(profile.path, corridor, profile.speeds)
        found = Found(corridor, path, trajectory, profile.fuel, profile.fuel)
        return Way(planner, found, profile)

    def _on_schedule(self, way: Way, corridor: Corridor) -> tuple[ClassPlanner, Corridor]:
        """Planner and corridor for the hours at which a way is sailed."""
        problem = self.planner.problem.scheduled(way.profile.path, way.profile.times)
        planner, voyage = self.planner.for_problem(problem), problem.voyage
        return planner, replace(corridor, voyage=voyage, polar=voyage.polar)

    def way(self, planner: ClassPlanner, found: Found) -> Way:
        """A path with its speeds."""
        return Way(planner, found, speeds_by_clock(found.path, self.voyage))

    def curve(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arrivals (m,), s, and least fuels (m,) along a path (n, 2)."""
        return trade_off_by_clock(path, self.voyage)

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Least fuel by arrival along the best paths that have been found, and the quickest."""
        return super().trade_off([*paths[: _CURVES - 1], paths[-1]])


def _fuel(way: Way) -> float:
    """Fuel of a way."""
    return way.profile.fuel
