"""Plan the best route of each departure, until no other departure can beat the best one.

All departures share water, classes and paddings. At a departure a class is planned completely only
if it may have the best route.

On the same path a vessel that leaves later never overtakes. So a later departure never arrives
earlier, over all paths too (FIFO). If the best voyage from departure t takes D, a voyage from
s > t takes at least D - (s - t).

The rate at which the current changes gives a tighter bound. On a fixed path dt/dx = σ(x, t) = 1/g,
where g is the speed over ground. So the arrival A, as a function of the departure t, obeys
dA/dt = exp ∫ ∂σ/∂t dx = exp(-∫ (∂g/∂t) / g dt) >= exp(-ρ D), where D is the time under way and ρ
bounds |∂g/∂t| / g on any course (:attr:`renew.voyage.voyage.Voyage.speed_change`). On the best path
from s, this gives A(t) <= A(s) - exp(-ρ D) (s - t). So a voyage from s takes at least
D(t) - L (s - t), with L = 1 - exp(-ρ D), between 0 and 1. Only voyages that beat the best one
matter, so D in L is at most the best duration plus s - t.

The next planned departure is the first at which this bound is below the best duration by more than
a tolerance. Each plan covers tolerance / L of the window, so window / tolerance plans are always
enough. Slowly changing currents need far fewer plans, and a steady one needs one plan.

D(t) is the duration on the path that was found, not a lower bound. So the choice is exact to within
the errors of the paths and of the current's table, and is no proof. It depends on FIFO, which fails
where the current reaches the vessel's speed. Adaptive padding depends on the hours of passage, so a
later departure may have more room. The bound therefore starts from the earliest arrival of this
departure and all later ones.

The latest departure that arrives in time is found by the same rule. The arrival usually rises as
fast as the departure. The next guess assumes that it does exactly, and is kept between a departure
known to be in time and one known to be late. With areas that
are shut for hours, the departures that have a route need not form one interval. So departures are
then first tried backwards from the last one, in even steps.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from renew import errors
from renew._types import FloatArray
from renew.classes.h_signature import name
from renew.inputs.openings import Opening
from renew.planner.classes import ClassSearch, no_class_error
from renew.planner.fit import as_drawn
from renew.planner.one_class import ClassPath, ClassPlanner, fuel_estimate
from renew.planner.plan import (
    check_start_open,
    meetings,
    planner_of,
    shut_on_the_way,
    unavoidable,
    without_meeting,
)
from renew.planner.problem import check_current_at_endpoints
from renew.request import Request
from renew.results import Departures, Plan, Rejected
from renew.voyage.voyage import Voyage

# A later departure's path is also sailed from the departure before if this arrives earlier by more
# than this share of the duration, which excludes rounding.
_OVERTAKES_BY = 1e-9


@dataclass(frozen=True)
class Sailing:
    """Outcome of a departure (s): its least-fuel path, or the reason why it has no path.

    Areas in `closed` were closed like land, because a route would have met them while shut.
    """

    departure: float
    planner: ClassPlanner
    found: ClassPath | None
    cause: errors.PlanningError | None = None
    rejected: tuple[Rejected, ...] = ()
    closed: frozenset[Opening] = frozenset()

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
    def plan(self) -> Plan:
        """Return a plan with only this path."""
        routes = () if self.found is None else (self.planner.route(self.found),)
        return Plan(routes, self.rejected, 0, self.planner.problem.overpowered_water)

    @property
    def error(self) -> errors.PlanningError:
        """Return the error with the reason why there is no path, and remedies."""
        if not self.rejected and self.cause is not None:
            return self.cause
        return no_class_error(self.rejected, self.planner)

    @property
    def is_late(self) -> bool:
        """Whether every class, also of later departures, arrives after the current's last time."""
        causes = [rejected.cause for rejected in self.rejected]
        return bool(causes) and all(isinstance(cause, errors.TooLateError) for cause in causes)


def sailing_at(request: Request, departure: float) -> Sailing:
    """Return the best route at a departure (s), around areas that it would meet while shut.

    All departures share the request's planners and what these know. Areas that a route met are
    closed like land.
    """
    closed: frozenset[Opening] = frozenset()
    first: Sailing | None = None
    try:
        check_start_open(request, departure)
    except errors.ShutStartError as error:
        return Sailing(departure, planner_of(request), None, error)
    while True:
        try:
            planner = planner_of(request, closed)
            problem = planner.problem.leaving(departure)
            sailing = best_sailing(
                planner.for_problem(problem), planner.unpadded.for_problem(problem)
            )
            first = first or sailing
        except errors.PlanningError as error:
            if first is None:
                raise
            areas = [area for area in request.areas if area in closed]
            return replace(
                first, found=None, cause=unavoidable(areas, departure, error), rejected=()
            )
        others = [area for area in request.areas if area not in closed]
        met = frozenset[Opening]()
        if sailing.found is not None and others:
            met = frozenset(meetings(sailing.planner.route(sailing.found), others, sailing.planner))
        if not met:
            return replace(sailing, closed=closed)
        closed |= met | (shut_on_the_way(request, departure, met) if not closed else frozenset())


def all_classes_at(request: Request, sailing: Sailing) -> tuple[Plan, Sailing]:
    """Plan all classes at a sailing's departure; return the plan and its best sailing."""
    planner, word = sailing.planner, sailing.planner.problem.word
    known = {} if sailing.found is None else {word(sailing.found.path): sailing.found}
    search = ClassSearch(planner, known)
    search.find_first(request.options.classes)
    plan, met = without_meeting(
        search.plan(request.options.classes),
        [area for area in request.areas if area not in sailing.closed],
        planner,
    )
    plan = replace(plan, shut=tuple(area for area in request.areas if area in sailing.closed))
    return plan, sailing if met else replace(sailing, found=search.best)


def best_sailing(planner: ClassPlanner, unpadded: ClassPlanner) -> Sailing:
    """Return the best route at the planner's departure; `unpadded` gives estimates of fuel."""
    voyage, options = planner.problem.voyage, planner.options
    try:
        check_current_at_endpoints(voyage)
    except errors.CurrentTooStrongError as error:
        return Sailing(voyage.departure, planner, None, error)
    search = ClassSearch(planner, fuel_estimate=lambda channel: fuel_estimate(unpadded, channel))
    search.find_best(options.classes)
    search.fit(1)
    rejected = tuple(search.rejected.values())
    cause = None
    if rejected:
        count = f"all {len(rejected)} classes were" if len(rejected) > 1 else "the only class was"
        cause = errors.UnreachableError(f"{count} rejected: {{0}}", rejected[0].text)
    return Sailing(voyage.departure, planner, search.best, cause, rejected)


def in_order_of_arrival(sailings: Sequence[Sailing]) -> list[Sailing]:
    """Return sailings improved so that, if possible, none arrives later than the next.

    On the same path the vessel that leaves earlier is ahead everywhere. So a departure takes the
    path of the next one, if this arrives earlier and turns are safe at the new hours.
    """
    result = list(sailings)
    for k in range(len(result) - 2, -1, -1):
        here, after = result[k], result[k + 1]
        if (
            here.arrival > after.arrival + _OVERTAKES_BY * after.duration
            and after.found is not None
        ):
            found = as_drawn(here.planner, after.found.path, after.found.corridor.channel)
            if found is not None and found.fuel < here.fuel:
                result[k] = replace(here, found=found)
    return result


Progress = Callable[[int, float], None]
"""Called after each plan: number of plans, and time (s) by which the best may still improve."""

# Number of rounds that plan the middles of both intervals beside the best departure.
_FINER = 3
# Lower limit of the slope, to avoid division by zero.
_FLATTEST = 1e-12
# Share of the tolerance below which a difference is a rounding error.
_NEGLIGIBLE = 1e-6


class _Interval(NamedTuple):
    """The interval between two successive departures (s).

    A voyage from `begin` takes at least `duration` (s). A voyage that departs later takes at least
    `duration` minus `slope` times the delay.
    """

    begin: float
    end: float
    duration: float
    slope: float

    @property
    def least_duration(self) -> float:
        """Lower bound (s) on the duration of all voyages that depart in the interval."""
        return self.duration - self.slope * (self.end - self.begin)

    def reach(self, goal: float) -> float:
        """Return the departure (s) before which no voyage is shorter than `goal` (s)."""
        return self.begin + (self.duration - goal) / max(self.slope, _FLATTEST)


class DepartureWindow:
    """Planned departures (n,), s, ascending; further ones are added where one may beat the best.

    Departures that are added are whole multiples of `spacing` (s) after the first, unless it is 0.
    With areas that are shut for some hours, departures between planned ones have no bound.
    """

    def __init__(
        self,
        request: Request,
        departures: Sequence[float],
        *,
        spacing: float = 0.0,
        progress: Progress | None,
    ) -> None:
        voyage = planner_of(request).problem.voyage
        self._request, self._least = request, voyage.least_duration
        # Largest relative change of the speed over ground per second; without a bound, infinite.
        self._change = math.inf if request.areas else voyage.speed_change
        self._first, self._spacing = departures[0], spacing
        self._progress = progress
        self.sailings: list[Sailing] = []
        for departure in departures:
            self._plan(departure)
        self._order_by_arrival()

    @property
    def best(self) -> Sailing:
        """The shortest sailing; of equal ones, the earliest."""
        return min(self.sailings, key=lambda sailing: sailing.duration)

    @property
    def unproven(self) -> float:
        """Time (s) by which a departure that is not planned may beat the best planned one."""
        if math.isinf(self._change) or self.best.found is None:
            return math.inf
        bound = min((i.least_duration for i in self._intervals()), default=math.inf)
        return max(0.0, self.best.duration - bound)

    def refine(self, tolerance: float) -> None:
        """Plan departures until no other can beat the best by more than `tolerance` s.

        Where durations have no bound, departures are planned one tolerance apart. The tolerance is
        at least the spacing.
        """
        tolerance = max(tolerance, self._spacing)
        while True:
            goal = self.best.duration - tolerance
            slack = _NEGLIGIBLE * tolerance
            may_hold_better = [
                interval
                for interval in self._intervals()
                if interval.least_duration < goal - slack
                and interval.end - interval.begin > tolerance + slack
            ]
            if not may_hold_better:
                break
            likeliest = min(may_hold_better, key=lambda interval: interval.least_duration)
            self._plan(self._on_grid(max(likeliest.reach(goal), likeliest.begin + tolerance)))
        self._order_by_arrival()

    def refine_around_best(self) -> None:
        """Plan departures ever closer to the best one, on both sides; no bound requires them."""
        for _ in range(_FINER):
            times = [sailing.departure for sailing in self.sailings]
            at = times.index(self.best.departure)
            for begin, end in itertools.pairwise(times[max(at - 1, 0) : at + 2]):
                middle = self._on_grid((begin + end) / 2)
                if begin < middle < end:
                    self._plan(middle)
        self._order_by_arrival()

    def plan_best(self) -> Plan:
        """Plan all classes at the best departure, and keep its best sailing."""
        plan, sailing = all_classes_at(self._request, self.best)
        others = [other for other in self.sailings if other.departure != sailing.departure]
        self._insert(others, sailing)
        self._order_by_arrival()
        return plan

    def departures(self, plan: Plan) -> Departures:
        """Return the result, with the plan of the best departure."""
        sailings = self.sailings
        paths = [None if sailing.found is None else sailing.found.path for sailing in sailings]
        times, names = list[FloatArray | None](), list[str]()
        for sailing, path in zip(sailings, paths, strict=True):
            problem = sailing.planner.problem
            times.append(None if path is None else problem.voyage.arrivals(path))
            names.append("" if path is None else name(problem.word(path)))
        return Departures(
            departures=np.array([sailing.departure for sailing in sailings]),
            arrivals=np.array([sailing.arrival for sailing in sailings]),
            fuels=np.array([sailing.fuel for sailing in sailings]),
            paths=tuple(paths),
            times=tuple(times),
            homotopies=tuple(names),
            causes=tuple(s.cause if s.found is None else None for s in sailings),
            unproven=self.unproven,
            plan=plan,
        )

    def _order_by_arrival(self) -> None:
        """Improve sailings so that, if possible, none arrives later than the next.

        With shut areas nothing changes, because the path of another departure may meet an area.
        """
        if not self._request.areas:
            self.sailings = in_order_of_arrival(self.sailings)

    def _on_grid(self, departure: float) -> float:
        """Return the last departure (s) up to this one that may be added."""
        if not self._spacing:
            return departure
        steps = math.floor((departure - self._first) / self._spacing + _NEGLIGIBLE)
        return self._first + steps * self._spacing

    def _plan(self, departure: float) -> None:
        self._insert(self.sailings, sailing_at(self._request, departure))
        if self._progress is not None:
            self._progress(len(self.sailings), self.unproven)

    def _insert(self, others: Sequence[Sailing], sailing: Sailing) -> None:
        """Insert a sailing into others, in order of departure."""
        self.sailings = sorted((*others, sailing), key=lambda other: other.departure)

    def _intervals(self) -> Iterator[_Interval]:
        """Yield the intervals between departures, with bounds on durations."""
        least_after = list(itertools.accumulate((s.arrival for s in self.sailings[::-1]), min))
        bound = -math.inf
        for (here, after), least in zip(
            itertools.pairwise(self.sailings), least_after[:0:-1], strict=True
        ):
            if here.is_late:
                bound = math.inf
            elif here.found is not None:
                bound = least
            begin, end = here.departure, after.departure
            longest = self.best.duration + end - begin
            slope = 1.0 if math.isinf(self._change) else -math.expm1(-self._change * longest)
            yield _Interval(begin, end, max(bound - begin, self._least), slope)


# Largest early arrival of the latest departure, as a share of the time under way.
_EARLY = 1e-3
# Largest number of departures that are planned to find it.
_MAX_PLANS = 40
# Number of even steps in which departures are looked through where areas are shut for some hours.
_STEPS = 48
# Number of halvings by which a remedy, a speed or a departure, is narrowed.
_HALVINGS = 12
# Highest speed that is named as a remedy, in multiples of the vessel's.
_FASTEST = 4.0
# Largest advance of the departure that is named as a remedy, in durations of the voyage.
_EARLIEST = 4.0


def latest_departure(request: Request, earliest: float, arrive_by: float) -> Sailing:
    """Return nearly the latest sailing from `earliest` on that reaches the goal by a time (s).

    With areas that are shut for some hours, a later one may lie between two of `_STEPS` departures.
    Raises ArrivalError, with remedies, if the earliest departure is already too late.
    """
    best, too_late = _in_time(request, earliest, arrive_by)
    if best.found is None:
        raise best.error
    if best.arrival > arrive_by:
        raise too_late_error(best, arrive_by)
    late_by = math.inf
    for _ in range(_MAX_PLANS):
        early_by, tolerance = arrive_by - best.arrival, _EARLY * best.duration
        room = too_late - best.departure
        if early_by <= tolerance or room <= tolerance:
            break
        guess = best.departure + early_by - tolerance / 2
        if guess >= too_late:
            # Between the two, as if the arrival rose linearly; or halfway.
            share = early_by / (early_by + late_by) if late_by < math.inf else 0.5
            guess = best.departure + min(max(share, 0.1), 0.9) * room
        tried = sailing_at(request, guess)
        if tried.arrival <= arrive_by:
            best = tried
        else:
            too_late, late_by = guess, tried.arrival - arrive_by
    return best


def _in_time(request: Request, earliest: float, arrive_by: float) -> tuple[Sailing, float]:
    """Return a sailing that may be in time, and a later departure (s) that is too late or shut.

    Without areas that are shut for some hours it is the earliest. Otherwise it is the last one in
    time of departures in even steps, or the earliest if none of these is in time.
    """
    # No voyage that departs later arrives in time.
    least_duration = planner_of(request).problem.voyage.least_duration
    last = min(arrive_by - least_duration, request.current.span[1])
    if request.areas and last > earliest:
        step = (last - earliest) / _STEPS
        for steps in range(_STEPS):
            tried = sailing_at(request, last - steps * step)
            if tried.arrival <= arrive_by:
                return tried, tried.departure + step
    return sailing_at(request, earliest), last


def too_late_error(
    first: Sailing, arrive_by: float, faster: str = "take a vessel that makes {} m/s"
) -> errors.ArrivalError:
    """Return the error for a deadline that can't be met, with a sufficient speed and departure.

    Both remedies are found along the sailing's path, so they are nearly exact. `faster` is the text
    of the remedy by speed.
    """
    voyage = first.planner.problem.voyage
    path = first.found.path if first.found else voyage.start[None]
    speed = voyage.vessel.speed

    def is_in_time(other: Voyage) -> bool:
        return bool(other.arrivals(path)[-1] <= arrive_by)

    remedies = [errors.Text("arrive later")]
    most = min(voyage.departure - voyage.current.span[0], _EARLIEST * first.duration)
    earlier = _least(lambda by: is_in_time(voyage.leaving(voyage.departure - by)), 0.0, most)
    if earlier is not None:
        remedies.append(
            errors.Text("leave before {0}", (errors.Moment(voyage.departure - earlier),))
        )
    enough = _least(lambda higher: is_in_time(voyage.at_speed(higher)), speed, _FASTEST * speed)
    if enough is not None:
        # To three digits, rounded up, so that it is still sufficient.
        step = 10.0 ** (math.floor(math.log10(enough)) - 2)
        remedies.append(errors.Text(faster.format(f"{math.ceil(enough / step) * step:.3g}")))
    return errors.ArrivalError(
        "arrive_by = {0} can't be made: a departure at {1} arrives at {2} at the earliest: {3}",
        errors.Moment(arrive_by),
        errors.Moment(voyage.departure),
        errors.Moment(first.arrival),
        errors.Text.joined(", or ", remedies),
    )


def _least(is_enough: Callable[[float], bool], low: float, high: float) -> float | None:
    """Return the least sufficient value, if every larger one is sufficient; else None."""
    if high <= low or not is_enough(high):
        return None
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return high
