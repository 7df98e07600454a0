"""Plans that keep out of areas while these are shut.

What is always shut is no-go like land. An area that is shut for some hours is first taken as open:
a route that may meet it in these hours, early, on time or late, or in a turn, falls away. Areas
that are met are then taken as land, and it is planned again, until no route meets any. Of all these
plans the one with the best route counts. So no area is entered while it is shut, whatever happens;
but nobody waits, and of the ways through an area only the least-fuel one of each class is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from renew.departures.sailings import Sailing, Sailings
from renew.errors import InfeasibleError, PlanningError, Text, UnreachableError, from_until
from renew.inputs.chart import Chart
from renew.inputs.shut_area import ShutArea, polygons_of
from renew.route import Plan, Rejected, Route
from renew.search.class_planner import ClassPlanner
from renew.search.harmonic_mean import chosen_class
from renew.turns.shut_hours import meeting


def with_always_shut(chart: Chart, areas: Sequence[ShutArea]) -> Chart:
    """Chart without the water of the areas that are always shut."""
    always = [area for area in areas if area.is_always_shut]
    return chart.without(polygons_of(always), is_land=True) if always else chart


def meets(route: Route, area: ShutArea, planner: ClassPlanner) -> InfeasibleError | None:
    """Why a route falls away: it may be in an area while that is shut. None where it isn't."""
    voyage = planner.problem.voyage.leaving(float(route.times[0]))
    policy = planner.policy
    reach = planner.problem.reach if policy.is_adaptive else policy.min_width
    for line, times in (
        (route.path, route.times),
        (route.trajectory[:, 1:3], route.trajectory[:, 0]),
    ):
        found = meeting(line, times, area, voyage, reach)
        if found is not None:
            where, begin, end = found
            return InfeasibleError(
                "near {0} the vessel, or a turn that it begins, may be in {1},{2}",
                where,
                area.text,
                from_until(begin, end),
            )
    return None


@dataclass(frozen=True)
class _Sifted:
    """A plan without the routes that meet an area, and the areas with the least fuel to them."""

    plan: Plan
    met: dict[ShutArea, float]


def sifted(plan: Plan, areas: Sequence[ShutArea], planner: ClassPlanner) -> _Sifted:
    """Take the routes that meet an area while it is shut from a plan's routes."""
    routes, rejected, met = list[Route](), list(plan.rejected), dict[ShutArea, float]()
    for route in plan.routes:
        reasons = {area: reason for area in areas if (reason := meets(route, area, planner))}
        if not reasons:
            routes.append(route)
            continue
        met |= {area: min(route.fuel, met.get(area, route.fuel)) for area in reasons}
        reason = next(iter(reasons.values()))
        rejected.append(
            Rejected(
                route.homotopy,
                str(reason),
                route.channel,
                cause=reason,
                _compute_fuel=lambda fuel=route.fuel: fuel,  # type: ignore[misc]
            )
        )
    chosen = chosen_class(routes) if routes else 0
    kept = replace(plan, routes=tuple(routes), rejected=tuple(rejected), chosen=chosen)
    return _Sifted(kept, met)


def plan_around(
    chart: Chart, areas: Sequence[ShutArea], plan: Callable[[Chart], tuple[Plan, ClassPlanner]]
) -> Plan:
    """The best plan on a chart that keeps out of areas while these are shut."""
    open_areas = [area for area in areas if not area.is_always_shut]
    closed: list[ShutArea] = []
    plans: list[Plan] = []
    met: dict[ShutArea, float] = {}
    failure: PlanningError | None = None
    while True:
        try:
            here = chart.without(polygons_of(closed), is_land=False) if closed else chart
            found, planner = plan(here)
        except PlanningError as error:
            if not closed:
                raise
            failure = error
            break
        outcome = sifted(found, open_areas, planner)
        if outcome.plan.routes:
            plans.append(outcome.plan)
        if not outcome.met:
            break
        met |= outcome.met
        closed += outcome.met
        open_areas = [area for area in open_areas if area not in outcome.met]
    if plans:
        best = min(plans, key=lambda one: one.best.harmonic_mean)
        cheaper = (area for area in areas if met.get(area, math.inf) < best.best.fuel)
        return replace(best, shut=tuple(cheaper))
    raise unavoidable(closed, failure)


def unavoidable(closed: Sequence[ShutArea], failure: PlanningError | None) -> UnreachableError:
    """Error where every way meets one of some areas while it is shut, and none leads around."""
    around = Text("") if failure is None else Text("; around them: {0}", (failure.text,))
    return UnreachableError(
        "every way may meet {0}{1}. Depart at another time, so as to pass before or after, or let "
        "the area be entered",
        Text.joined("; ", [area.text for area in closed]),
        around,
    )


class SailingsAround:
    """The best route by departure, around the areas that it would meet while they are shut.

    As :class:`Sailings`; the planner of a chart is made by `planner_on`.
    """

    def __init__(
        self,
        chart: Chart,
        areas: Sequence[ShutArea],
        classes: int,
        planner_on: Callable[[Chart], ClassPlanner],
    ) -> None:
        self._chart, self._classes, self._planner_on = chart, classes, planner_on
        self._areas = tuple(area for area in areas if not area.is_always_shut)
        self._known: dict[frozenset[ShutArea], Sailings] = {}
        self._closed_at: dict[float, frozenset[ShutArea]] = {}

    def sailing(self, departure: float) -> Sailing:
        """The best route at a departure (s)."""
        closed: frozenset[ShutArea] = frozenset()
        while True:
            try:
                sailing = self._sailings(closed).sailing(departure)
            except PlanningError as error:
                if not closed:
                    raise
                first = self._sailings(frozenset()).sailing(departure)
                reason = unavoidable(sorted(closed, key=self._areas.index), error)
                return replace(first, found=None, cause=reason, rejected=())
            met = self._met(sailing, closed)
            if not met:
                self._closed_at[departure] = closed
                return sailing
            closed |= met

    def plan(self, sailing: Sailing) -> tuple[Plan, Sailing]:
        """All classes at the departure of a sailing that has a path, and the best of these."""
        closed = self._closed_at[sailing.departure]
        found, again = self._sailings(closed).plan(sailing)
        areas = [area for area in self._areas if area not in closed]
        outcome = sifted(found, areas, sailing.planner)
        shut = tuple(area for area in self._areas if area in closed)
        return replace(outcome.plan, shut=shut), sailing if outcome.met else again

    def in_order(self, sailings: Sequence[Sailing]) -> list[Sailing]:
        """The sailings as they are: one of another departure may meet an area."""
        return list(sailings)

    def _met(self, sailing: Sailing, closed: frozenset[ShutArea]) -> frozenset[ShutArea]:
        """Areas that a sailing meets while they are shut."""
        if sailing.found is None:
            return frozenset()
        route = sailing.planner.route(sailing.found)
        others = (area for area in self._areas if area not in closed)
        return frozenset(area for area in others if meets(route, area, sailing.planner))

    def _sailings(self, closed: frozenset[ShutArea]) -> Sailings:
        """Sailings on the chart without the water of some areas."""
        if closed not in self._known:
            polygons = polygons_of([area for area in self._areas if area in closed])
            chart = self._chart.without(polygons, is_land=False) if closed else self._chart
            self._known[closed] = Sailings(self._planner_on(chart), self._classes)
        return self._known[closed]
