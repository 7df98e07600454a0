"""Plan the best route of each departure; all departures share water, classes and paddings.

At a departure a class is planned completely only if it may have the best route.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from renew.classes.h_signature import name
from renew.errors import (
    CurrentTooStrongError,
    PlanningError,
    TooLateError,
    UnreachableError,
)
from renew.inputs.shut_areas import Opening
from renew.planner.classes import ClassSearch
from renew.planner.diagnosis import no_class_error
from renew.planner.one_class import ClassPath, ClassPlanner, as_drawn, fuel_estimate
from renew.planner.plan import meetings, planner_of, unavoidable, without_meeting
from renew.planner.problem import check_current_at_endpoints
from renew.request import Request
from renew.results import Departed, Plan, Rejected

# A later departure's path is also sailed from the departure before if this arrives earlier by more
# than this share of the duration, which excludes rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Sailing:
    """Outcome of a departure (s): its least-fuel path, or the reason why it has no path."""

    departure: float
    planner: ClassPlanner
    found: ClassPath | None
    cause: PlanningError | None = None
    rejected: tuple[Rejected, ...] = ()

    @property
    def fuel(self) -> float:
        """Fuel of the path; infinite without a path."""
        return math.inf if self.found is None else self.found.fuel

    @property
    def duration(self) -> float:
        """Time under way (s); infinite without a path."""
        return self.fuel / self.planner.problem.voyage.vessel.fuel_rate

    @property
    def arrival(self) -> float:
        """Time of arrival at the goal (s); infinite without a path."""
        return self.departure + self.duration

    @property
    def outcome(self) -> Departed:
        """The path's figures, or the reason why there is no path."""
        if self.found is None:
            return Departed(self.departure, cause=self.cause)
        problem, path = self.planner.problem, self.found.path
        times = problem.voyage.arrivals(path)
        homotopy = name(problem.word(path))
        return Departed(self.departure, self.arrival, self.fuel, path, times, homotopy)

    @property
    def plan(self) -> Plan:
        """Return a plan with only this path."""
        routes = () if self.found is None else (self.planner.route(self.found),)
        return Plan(routes, self.rejected, 0, self.planner.problem.overpowered_water)

    @property
    def error(self) -> PlanningError:
        """Return the error with the reason why there is no path, and remedies."""
        if not self.rejected and self.cause is not None:
            return self.cause
        return no_class_error(self.rejected, self.planner)

    @property
    def is_late(self) -> bool:
        """Whether every class, also of later departures, arrives after the current's last time."""
        causes = [one.cause for one in self.rejected]
        return bool(causes) and all(isinstance(cause, TooLateError) for cause in causes)


class Sailings:
    """Plans the best route of each departure, around areas that it would meet while they are shut.

    All departures share the planners and what these know. Areas that a route met are closed like
    land.
    """

    def __init__(self, request: Request) -> None:
        self._request = request
        self._closed_at: dict[float, frozenset[Opening]] = {}

    @property
    def has_areas(self) -> bool:
        """Whether some areas are shut for some hours."""
        return bool(self._request.areas)

    def last_departure(self, arrive_by: float) -> float:
        """Time (s) after which no voyage departs that arrives by a time (s)."""
        least_duration = planner_of(self._request).problem.voyage.least_duration
        return min(arrive_by - least_duration, self._request.current.span[1])

    def sailing(self, departure: float) -> Sailing:
        """Return the best route at a departure (s)."""
        closed: frozenset[Opening] = frozenset()
        first: Sailing | None = None
        while True:
            try:
                sailing = self._sailing(departure, closed)
                first = first or sailing
            except PlanningError as error:
                if first is None:
                    raise
                areas = [area for area in self._request.areas if area in closed]
                return replace(
                    first, found=None, cause=unavoidable(areas, departure, error), rejected=()
                )
            met = self._met(sailing, closed)
            if not met:
                self._closed_at[departure] = closed
                return sailing
            closed |= met

    def plan(self, sailing: Sailing) -> tuple[Plan, Sailing]:
        """Plan all classes at a sailing's departure; return the plan and its best sailing."""
        closed, planner = self._closed_at[sailing.departure], sailing.planner
        word, classes = planner.problem.word, self._request.options.classes
        known = {} if sailing.found is None else {word(sailing.found.path): sailing.found}
        search = ClassSearch(planner, known)
        search.find_first(classes)
        areas = self._request.areas
        plan, met = without_meeting(
            search.plan(classes), [area for area in areas if area not in closed], planner
        )
        plan = replace(plan, shut=tuple(area for area in areas if area in closed))
        return plan, sailing if met else replace(sailing, found=search.best)

    def by_arrival(self, sailings: Sequence[Sailing]) -> list[Sailing]:
        """Return sailings improved so that, if possible, none arrives later than the next.

        With shut areas nothing changes, because the path of another departure may meet an area.
        """
        return list(sailings) if self._request.areas else in_order_of_arrival(sailings)

    def _sailing(self, departure: float, closed: frozenset[Opening]) -> Sailing:
        """Return the best route at a departure (s), with some areas closed like land."""
        first = planner_of(self._request, closed)
        problem = first.problem.leaving(departure)
        return best_sailing(first.for_problem(problem), first.unpadded.for_problem(problem))

    def _met(self, sailing: Sailing, closed: frozenset[Opening]) -> frozenset[Opening]:
        """Return the areas that a sailing meets while they are shut."""
        others = [area for area in self._request.areas if area not in closed]
        if sailing.found is None or not others:
            return frozenset()
        route = sailing.planner.route(sailing.found)
        return frozenset(meetings(route, others, sailing.planner))


def best_sailing(planner: ClassPlanner, unpadded: ClassPlanner) -> Sailing:
    """Return the best route at the planner's departure; `unpadded` gives estimates of fuel."""
    voyage, options = planner.problem.voyage, planner.options
    try:
        check_current_at_endpoints(voyage)
    except CurrentTooStrongError as error:
        return Sailing(voyage.departure, planner, None, error)
    search = ClassSearch(planner, fuel_estimate=lambda channel: fuel_estimate(unpadded, channel))
    search.find_best(options.classes)
    rejected = tuple(search.rejected.values())
    cause = None
    if rejected:
        cause = UnreachableError(
            f"all {len(rejected)} classes were rejected: {{0}}", rejected[0].text
        )
    return Sailing(voyage.departure, planner, search.best, cause, rejected)


def in_order_of_arrival(sailings: Sequence[Sailing]) -> list[Sailing]:
    """Return sailings improved so that, if possible, none arrives later than the next.

    On the same path the vessel that leaves earlier is ahead everywhere. So a departure takes the
    path of the next one, if this arrives earlier and turns are safe at the new hours.
    """
    result = list(sailings)
    for k in range(len(result) - 2, -1, -1):
        here, after = result[k], result[k + 1]
        if here.arrival > after.arrival + _ROUNDING * after.duration and after.found is not None:
            found = as_drawn(here.planner, after.found.path, after.found.corridor.channel)
            if found is not None and found.fuel < here.fuel:
                result[k] = replace(here, found=found)
    return result
