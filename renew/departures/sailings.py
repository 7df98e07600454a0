"""The best route by departure, on what all departures share: water, classes, what padding is known.

At a departure only such classes are planned to the end as may be its best one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from renew._types import FloatArray
from renew.classes.channel import Channel
from renew.classes.h_signature import name
from renew.errors import (
    CurrentTooStrongError,
    InfeasibleError,
    PlanningError,
    TooLateError,
    UnreachableError,
)
from renew.inputs.voyage_checks import check_current_at_endpoints
from renew.paths.least_fuel_path import refined_path
from renew.route import Plan, Rejected
from renew.search.class_planner import ClassPlanner, Found
from renew.search.diagnosis import no_class_error
from renew.search.growing_padding import grown
from renew.search.k_sailable_classes import Results
from renew.search.path_attempts import near_first
from renew.steering.steer_in_corridor import steer_as_drawn

# Share of the time under way by which a later departure has to arrive earlier for its path to be
# tried from the departure before: rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Sailing:
    """What a departure (s) came to: its least-fuel path, or why there is none."""

    departure: float
    planner: ClassPlanner
    found: Found | None
    cause: PlanningError | None = None
    rejected: tuple[Rejected, ...] = ()

    @property
    def fuel(self) -> float:
        """Fuel of the path; infinite where there is none."""
        return math.inf if self.found is None else self.found.fuel

    @property
    def duration(self) -> float:
        """Time under way (s); infinite where there is no path."""
        return self.fuel / self.planner.problem.voyage.vessel.fuel_rate

    @property
    def arrival(self) -> float:
        """When the goal is reached (s); infinite where it is not."""
        return self.departure + self.duration

    @property
    def homotopy(self) -> str:
        """Name of the path's class; empty where there is none."""
        if self.found is None:
            return ""
        return name(self.planner.problem.word(self.found.path))

    @property
    def times(self) -> FloatArray | None:
        """When the path's points are passed (n,), s; None where there is no path."""
        return None if self.found is None else self.planner.problem.voyage.arrivals(self.found.path)

    @property
    def plan(self) -> Plan:
        """The path alone, as a plan."""
        routes = () if self.found is None else (self.planner.route(self.found),)
        return Plan(routes, self.rejected, 0, self.planner.problem.overpowered_water)

    @property
    def error(self) -> PlanningError:
        """Why there is no path, with what would help."""
        planner = self.planner
        if not self.rejected and self.cause is not None:
            return self.cause
        return no_class_error(self.rejected, planner.problem, planner.policy, planner.method)

    @property
    def is_late(self) -> bool:
        """Whether every class arrives after the last time of the current: later ones do as well."""
        causes = [one.cause for one in self.rejected]
        return bool(causes) and all(isinstance(cause, TooLateError) for cause in causes)


class DeparturePlanner(Protocol):
    """Plans the best route of each departure."""

    def sailing(self, departure: float) -> Sailing:
        """The best route at a departure (s)."""
        ...

    def plan(self, sailing: Sailing) -> tuple[Plan, Sailing]:
        """All classes at the departure of a sailing that has a path, and the best of these."""
        ...

    def in_order(self, sailings: Sequence[Sailing]) -> list[Sailing]:
        """Sailings by departure, better where one of the next departure would do."""
        ...


class Sailings:
    """Plans the best route of each departure: the best of a number of classes."""

    def __init__(self, planner: ClassPlanner, classes: int) -> None:
        self._planner, self._classes = planner, classes
        self._bare = planner
        if planner.policy.is_adaptive:
            policy = replace(planner.policy, padding="none", risk_at="route")
            self._bare = ClassPlanner(planner.problem, policy, planner.method)

    def sailing(self, departure: float) -> Sailing:
        """The best route at a departure (s)."""
        problem = self._planner.problem.leaving(departure)
        planner, bare = self._planner.for_problem(problem), self._bare.for_problem(problem)
        try:
            check_current_at_endpoints(problem.voyage)
        except CurrentTooStrongError as error:
            return Sailing(departure, planner, None, error)
        results = Results(planner, fuel_estimate=lambda channel: _fuel_estimate(bare, channel))
        results.look_for_best(self._classes)
        rejected = tuple(results.rejected.values())
        cause = None
        if rejected:
            cause = UnreachableError(
                f"all {len(rejected)} classes were rejected: {{0}}", rejected[0].text
            )
        return Sailing(departure, planner, results.best, cause, rejected)

    def plan(self, sailing: Sailing) -> tuple[Plan, Sailing]:
        """All classes at the departure of a sailing that has a path, and the best of these."""
        problem = sailing.planner.problem
        known = {} if sailing.found is None else {problem.word(sailing.found.path): sailing.found}
        results = Results(sailing.planner, known)
        results.look_for(self._classes)
        found = results.least(self._classes)
        plan = Plan(found.routes, found.rejected, 0, problem.overpowered_water)
        return plan, replace(sailing, found=results.best)

    def in_order(self, sailings: Sequence[Sailing]) -> list[Sailing]:
        """Sailings of which none arrives later than the next, as far as is safe."""
        return in_order_of_arrival(sailings)


def in_order_of_arrival(sailings: Sequence[Sailing]) -> list[Sailing]:
    """Sailings by departure, none of which arrives later than the next, as far as is safe.

    On a path the vessel that leaves earlier is the first everywhere. So where the next one's path,
    sailed from the departure before it, is better and its turns are safe then as well, it is taken.
    """
    result = list(sailings)
    for k in range(len(result) - 2, -1, -1):
        here, after = result[k], result[k + 1]
        if here.arrival > after.arrival + _ROUNDING * after.duration and after.found is not None:
            found = _sailed_from(here.planner, after.found)
            if found is not None and found.fuel < here.fuel:
                result[k] = replace(here, found=found)
    return result


def _sailed_from(planner: ClassPlanner, found: Found) -> Found | None:
    """A path of another departure, sailed at a planner's own; None where that isn't safe."""
    corridor, path = planner.corridor(found.corridor.channel), found.path
    short = planner.growth.crossed_shortfall(corridor, path)
    if short is not None:
        corridor = grown(corridor, short)
    try:
        trajectory = steer_as_drawn(path, corridor)
        planner.check_current(trajectory)
    except InfeasibleError:
        return None
    if planner.growth.shortfall(corridor, path) is not None:
        return None
    fuel = planner.problem.voyage.fuel(path)
    return Found(corridor, path, trajectory, fuel, fuel)


def _fuel_estimate(bare: ClassPlanner, channel: Channel) -> float:
    """Fuel of a channel's path with the least padding there can be, before it is steered.

    Its route needs hardly ever less. Minus infinity where no such path is found.
    """
    corridor = bare.corridor(channel)
    try:
        path = refined_path(corridor, near_first(corridor))
    except InfeasibleError:
        return -math.inf
    voyage = bare.problem.voyage
    return voyage.vessel.fuel_rate * float(voyage.reading_times(path)[-1] - voyage.departure)
