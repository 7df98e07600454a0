"""Keep only routes from all of whose places a haven is reached within limits.

Water from which no haven is in reach, by the lower bound on the time to each, lies on no covered
route. So it is closed, and the voyage is planned again: classes and the bound on fuel stay true for
covered routes. Where a route in the rest is not covered after all, because the way to a haven is
padded and begins on the route's heading, so much is taken off the limit that closes water, and the
voyage is planned again, a few times. A class without a covered route is rejected.
"""

import heapq
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from renew.bounds.fuel_bound import FuelBound
from renew.bounds.haven_bound import HavenBound
from renew.classes.h_signature import Word, name, shortened
from renew.errors import (
    ClassName,
    Duration,
    InfeasibleError,
    ParameterError,
    PlanningError,
    Text,
    UncoveredError,
)
from renew.inputs.haven import Haven
from renew.planner.classes import plan_classes
from renew.planner.one_class import ClassPlanner
from renew.planner.plan import finished
from renew.planner.problem import Problem
from renew.planner.sampled_paths import chosen_class
from renew.planner.task import Task
from renew.results import Plan, Rejected, Route
from renew.underway.coverage import Stretch
from renew.underway.diversions import Diverter, Limits
from renew.underway.replan import asked_of
from renew.underway.survey import Survey, bounds_to
from renew.underway.usable_havens import check_cover, usable
from renew.voyage.voyage import Waters

# Number of times that the voyage is planned again; shares of the limit by which it is lowered at
# least, and if no way was found; factor on what ways take longer than their bounds.
_ROUNDS, _STEP, _NO_WAY, _RESERVE = 4, 0.01, 0.05, 1.1
# Width of the seam, in cells, that covers what simplification by a cell cuts off; number of
# rejected classes whose limit that would do is found.
_OUT, _EXPLAINED = 1.01, 3
# Time up to which currents count that change, as a multiple of the best route's.
_HORIZON = 2.0
# Number of stations in the longest time to a haven; the share of a limit to which the one that
# would do is found, and largest number of places looked at.
_STATIONS, _CLOSE, _PLACES = 3, 0.02, 40


def only_covered(
    plan: Plan,
    havens: Sequence[Haven],
    *,
    within: float | None = None,
    within_fuel: float | None = None,
    endurance: float | None = None,
) -> Plan:
    """Return a plan with covered routes alone; the voyage is planned again where there are none.

    Parameters
    ----------
    plan : Plan
        From `renew.plan`, in this process. Its routes that are covered stay as they are.
    havens, within, within_fuel, endurance
        As for :func:`renew.cover`: one limit is needed.

    Returns
    -------
    Plan
        Covered routes, least fuel first. Their bound on fuel holds for all covered routes. Among
        the rejected classes are those without one, each with the place from which the way to a
        haven is longest, and the limit that would do.

    Raises
    ------
    ParameterError
        As for :func:`renew.cover`; a plan that chose speeds, knows shut areas, or was pickled.
    UnreachableError
        No route that is covered was found in any class.
    """
    task = asked_of(plan, "plan")
    if task.areas or task.request.speed is not None:
        raise ParameterError(
            "the plan chose speeds, or knows shut areas or a tide, which ways to havens do not "
            "know: plan without them"
        )
    limits = check_cover(
        plan.best,
        task.chart,
        task.vessel,
        havens,
        within=within,
        within_fuel=within_fuel,
        endurance=endurance,
    )
    search = _Search(task, tuple(usable(havens, task, plan.best)[0]), limits, plan.best)
    search.check(plan.routes)
    for _ in range(_ROUNDS):
        if not (search.is_open and search.check(search.routes_within())):
            break
    return search.result(plan)


@dataclass(eq=False)
class _Failed:
    """A route that is not covered, its survey, and a stretch that is not covered."""

    route: Route
    survey: Survey
    gap: Stretch

    @property
    def above_bound(self) -> float:
        """By how much (s) the way to a haven from the stretch takes longer than its bound."""
        survey, gap = self.survey, self.gap
        least = survey.least.min(axis=0)
        if gap.state == "uncovered":
            # A quarter of a turn, from along the edge of the water to across it.
            return survey.diverter.task.vessel.turn_period / 4
        ways = [
            one.longest - float(np.interp(one.time, survey.times, least))
            for one in survey.diverter.found
            if gap.begin - survey.step <= one.time <= gap.end + survey.step
        ]
        return min(ways, default=_NO_WAY * float(survey.limit.max()))

    def reason(self, *, is_brief: bool) -> InfeasibleError:
        """Return why the class has no covered route; with the limit that would do, if not brief."""
        survey, within = self.survey, self.survey.limits.within
        limit = "the limits" if math.isinf(within) else "{1}"
        words = f"not covered: from {{0}} no haven is reached within {limit}"
        excess, time = (0.0, self.gap.begin) if is_brief else longest_excess(survey)
        values = (survey.diverter.row(time)[:2], Duration(within))
        if is_brief:
            return InfeasibleError(words, *values)
        if math.isinf(excess):
            return InfeasibleError("not covered: no way to a haven was found from {0}", values[0])
        more = Duration(excess) if math.isinf(within) else Duration(within + excess)
        would = "fuel for {2} more" if math.isinf(within) else "{2}"
        return InfeasibleError(f"{words}; with {would} the route is covered", *values, more)


def longest_excess(survey: Survey) -> tuple[float, float]:
    """Return the excess (s) over the limits with which a route is covered, and where, as a time.

    It is found nearly as small as it is; inf if no way leads to a haven from the end.
    """
    times = survey.times
    farthest = min(float(survey.least.min(axis=0).max()), times[-1] - times[0])
    count = min(math.ceil(_STATIONS * (times[-1] - times[0]) / farthest), _PLACES // 2)
    stations = np.unique(np.linspace(0, len(times) - 1, count + 1).round().astype(int)).tolist()
    ways = {at: way for at in stations if (way := survey.quickest(at)) is not None}
    if stations[-1] not in ways:
        return math.inf, float(times[-1])
    ends = [0, *ways]

    def interval(first: int, last: int) -> tuple[float, int, int]:
        way = ways[last]
        return -survey.diverter.excess(way, survey.limits, float(times[first])), first, last

    heap = [interval(*both) for both in itertools.pairwise(ends)]
    heapq.heapify(heap)
    for _ in range(_PLACES):
        excess, first, last = heap[0]
        limit = float(survey.limit[first]) - excess
        middle = (first + last) // 2
        if times[last] - times[first] <= _CLOSE * limit or middle == first:
            break
        way = survey.quickest(middle)
        if way is None:
            break
        ways[middle] = way
        heapq.heapreplace(heap, interval(first, middle))
        heapq.heappush(heap, interval(middle, last))
    return -heap[0][0], float(times[heap[0][1]])


@dataclass(eq=False)
class _Search:
    """Covered routes by class, and the first route of each class that is not covered.

    `level` is the limit (s) that closes water, and `bound` the one of all covered routes.
    """

    task: Task
    havens: tuple[Haven, ...]
    limits: Limits
    best: Route
    covered: dict[Word, Route] = field(default_factory=dict)
    failed: dict[Word, _Failed] = field(default_factory=dict)
    above_bound: float = 0.0
    level: float = math.inf
    bound: FuelBound | None = None
    bounds: tuple[HavenBound, ...] = field(init=False)
    limit: float = field(init=False)

    def __post_init__(self) -> None:
        """Bound the time to havens for all routes that are not much longer than the best one."""
        diverter = self._diverter(self.best)
        self.limit = diverter.limit(diverter.begin, self.limits)
        self.bounds = bounds_to(self.havens, diverter, self.limit, self.horizon)

    @property
    def horizon(self) -> float:
        """Time (s) until which bounds on the time to havens hold in a changing current."""
        begin = float(self.best.times[0])
        return begin + _HORIZON * self.best.duration

    @property
    def problem(self) -> Problem:
        """The problem in all of the water."""
        return self.task.planner().problem

    @property
    def is_open(self) -> bool:
        """Whether a class has no covered route yet."""
        return bool(self.failed.keys() - self.covered.keys())

    def check(self, routes: Sequence[Route]) -> bool:
        """Sort routes into covered ones and others; return whether any are of open classes."""
        self.above_bound, seen = 0.0, False
        for route in routes:
            word = self.problem.word(route.path)
            if word in self.covered:
                continue
            seen = True
            survey = Survey(self._diverter(route), self.havens, self.limits, self.bounds)
            gap = survey.first_gap()
            if gap is None:
                self.covered[word] = route
                continue
            failed = _Failed(route, survey, gap)
            self.failed.setdefault(word, failed)
            self.above_bound = max(self.above_bound, failed.above_bound)
        return seen

    def _diverter(self, route: Route) -> Diverter:
        """Return what plans ways from a route."""
        task, begin = self.task, float(route.trajectory[0, 0])
        request = replace(task.request, departure=begin, arrive_by=None, is_sweep=False)
        ends = np.vstack([route.path[0], route.path[-1]])
        like = task.like or task
        own = Task(task.chart, task.current, task.vessel, ends, (), request, like=like)
        return Diverter(own, route)

    def routes_within(self) -> tuple[Route, ...]:
        """Return routes in water from which a haven may be in reach, if there are any.

        The first time that is all such water; later less, by what ways took above their bounds.
        """
        is_first = math.isinf(self.level)
        tighter = self.limit - _RESERVE * self.above_bound
        self.level = self.limit if is_first else min(self.level - _STEP * self.limit, tighter)
        near = self._near(is_whole=is_first) if self.level > 0 else shapely.MultiPolygon()
        chart, voyage = self.task.chart, self.problem.voyage.leaving(float(self.best.times[0]))
        if not shapely.covers(near, shapely.multipoints(voyage.stops)):
            return ()
        water = shapely.intersection(chart.open_water, near, grid_size=chart.precision)
        waters = Waters(chart.with_open_water(water), voyage.current, voyage.waters.members)
        closed = chart.less(chart.water, near)
        problem = Problem(
            replace(voyage, waters=waters), self.task.request, closed=closed, whole=self.problem
        )
        if is_first:
            self.bound = problem.fuel_bound
        planner = ClassPlanner(problem, self.task.request)
        try:
            return plan_classes(planner, planner.options.classes).routes
        except PlanningError:
            return ()

    def _near(self, *, is_whole: bool) -> shapely.Geometry:
        """Return the water (m) from which a haven may be in reach within the level; all, or most.

        Its outline is simplified outwards if it is to be whole.
        """
        near = shapely.union_all([one.water_within(self.level) for one in self.bounds])
        cell = max(one.cell for one in self.bounds)
        if is_whole:
            near = shapely.buffer(near, _OUT * cell, join_style="mitre")
        return shapely.simplify(near, cell)

    def result(self, plan: Plan) -> Plan:
        """Return the plan with covered routes; raise UnreachableError if there are none."""
        left = [one for word, one in self.failed.items() if word not in self.covered]
        left.sort(key=lambda one: one.route.fuel)
        rejected = [_rejected(one, is_brief=at >= _EXPLAINED) for at, one in enumerate(left)]
        if not self.covered:
            raise _none_covered(rejected)
        routes = sorted(self.covered.values(), key=lambda one: one.fuel)
        if routes[0] is not plan.best:
            routes = [replace(one, fuel_bound=self._bound(plan, routes[0])) for one in routes]
        names = {word: name(word) for word in self.covered}
        routes = [
            one if one in plan.routes else replace(one, homotopy=names[self.problem.word(one.path)])
            for one in routes
        ]
        known = [one for one in plan.rejected if one.homotopy not in names.values()]
        found = replace(
            plan,
            routes=tuple(routes),
            rejected=(*rejected, *known),
            chosen=chosen_class(routes),
        )
        return finished(found, self.task)

    def _bound(self, plan: Plan, best: Route) -> FuelBound:
        """Return the bound on the fuel of all covered routes, of which the best one is known."""
        is_known = self.task.current.is_steady or best.times[-1] <= self.horizon
        return self.bound if self.bound is not None and is_known else plan.best.fuel_bound


def _rejected(failed: _Failed, *, is_brief: bool) -> Rejected:
    """Return the class of a route that is not covered."""
    route, error = failed.route, failed.reason(is_brief=is_brief)
    return Rejected(route.homotopy, str(error), route.channel, cause=error, fuel_source=route.fuel)


def _none_covered(rejected: Sequence[Rejected]) -> UncoveredError:
    """Return the error if no class has a covered route."""
    reasons = [
        Text("class {0} is {1}", (ClassName(shortened(one.homotopy)), one.text))
        for one in rejected[:_EXPLAINED]
    ]
    left = len(rejected) - len(reasons)
    more = f" (and {left} more class{'es' * (left > 1)})" if left > 0 else ""
    error = UncoveredError(
        f"no route is covered: {{0}}{more}. Give more time or fuel, or havens nearer to the way",
        Text.joined("; ", reasons),
    )
    error.causes = tuple(one.cause for one in rejected if one.cause is not None)
    return error
