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

from renew._types import FloatArray
from renew.classes.h_signature import name
from renew.errors import (
    ArrivalError,
    CurrentTooStrongError,
    Moment,
    PlanningError,
    Text,
    TooLateError,
    UnreachableError,
)
from renew.inputs.openings import Opening
from renew.planner.classes import ClassSearch, no_class_error
from renew.planner.one_class import ClassPath, ClassPlanner, as_drawn, fuel_estimate
from renew.planner.plan import meetings, planner_of, unavoidable, without_meeting
from renew.planner.problem import check_current_at_endpoints
from renew.request import Request
from renew.results import Departed, Departures, Plan, Rejected
from renew.voyage.voyage import Voyage

# A later departure's path is also sailed from the departure before if this arrives earlier by more
# than this share of the duration, which excludes rounding.
_OVERTAKES_BY = 1e-9


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

    No voyage takes less than `least_duration` (s). `speed_change` (1/s) is the largest relative
    change of the speed over ground per second; if infinite, departures between planned ones have no
    bound. Departures that are added are whole multiples of `spacing` (s) after the first, unless
    it is 0.
    """

    def __init__(
        self,
        sailings: Sailings,
        departures: Sequence[float],
        least_duration: float,
        *,
        speed_change: float,
        spacing: float = 0.0,
        progress: Progress | None,
    ) -> None:
        self._planner, self._least, self._change = sailings, least_duration, speed_change
        self._first, self._spacing = departures[0], spacing
        self._progress = progress
        self.sailings: list[Sailing] = []
        for departure in departures:
            self._plan(departure)
        self.sailings = self._planner.by_arrival(self.sailings)

    @property
    def best(self) -> Sailing:
        """The shortest sailing; of equal ones, the earliest."""
        return min(self.sailings, key=lambda one: one.duration)

    @property
    def unproven(self) -> float:
        """Time (s) by which a departure that is not planned may beat the best planned one."""
        if math.isinf(self._change) or self.best.found is None:
            return math.inf
        bound = min((one.least_duration for one in self._intervals()), default=math.inf)
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
            open_ones = [
                one
                for one in self._intervals()
                if one.least_duration < goal - slack and one.end - one.begin > tolerance + slack
            ]
            if not open_ones:
                break
            one = min(open_ones, key=lambda interval: interval.least_duration)
            self._plan(self._on_grid(max(one.reach(goal), one.begin + tolerance)))
        self.sailings = self._planner.by_arrival(self.sailings)

    def refine_around_best(self) -> None:
        """Plan departures ever closer to the best one, on both sides; no bound requires them."""
        for _ in range(_FINER):
            times = [one.departure for one in self.sailings]
            at = times.index(self.best.departure)
            for begin, end in itertools.pairwise(times[max(at - 1, 0) : at + 2]):
                middle = self._on_grid((begin + end) / 2)
                if begin < middle < end:
                    self._plan(middle)
        self.sailings = self._planner.by_arrival(self.sailings)

    def plan_best(self) -> Plan:
        """Plan all classes at the best departure, and keep its best sailing."""
        plan, sailing = self._planner.plan(self.best)
        kept = [one for one in self.sailings if one.departure != sailing.departure]
        self._insert(kept, sailing)
        self.sailings = self._planner.by_arrival(self.sailings)
        return plan

    def departures(self, plan: Plan) -> Departures:
        """Return the result, with the plan of the best departure."""
        return Departures.of([one.outcome for one in self.sailings], self.unproven, plan)

    def _on_grid(self, departure: float) -> float:
        """Return the last departure (s) up to this one that may be added."""
        if not self._spacing:
            return departure
        steps = math.floor((departure - self._first) / self._spacing + _NEGLIGIBLE)
        return self._first + steps * self._spacing

    def _plan(self, departure: float) -> None:
        """Plan a further departure."""
        self._insert(self.sailings, self._planner.sailing(departure))
        if self._progress is not None:
            self._progress(len(self.sailings), self.unproven)

    def _insert(self, others: Sequence[Sailing], sailing: Sailing) -> None:
        """Insert a sailing into others, in order of departure."""
        self.sailings = sorted((*others, sailing), key=lambda one: one.departure)

    def _intervals(self) -> Iterator[_Interval]:
        """Yield the intervals between departures, with bounds on durations."""
        least_after = list(itertools.accumulate((one.arrival for one in self.sailings[::-1]), min))
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


def latest_departure(sailings: Sailings, earliest: float, arrive_by: float) -> Sailing:
    """Return nearly the latest sailing from `earliest` on that reaches the goal by a time (s).

    With areas that are shut for some hours, a later one may lie between two of `_STEPS` departures.
    Raises ArrivalError, with remedies, if the earliest departure is already too late.
    """
    best, too_late = _in_time(sailings, earliest, arrive_by)
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
        tried = sailings.sailing(guess)
        if tried.arrival <= arrive_by:
            best = tried
        else:
            too_late, late_by = guess, tried.arrival - arrive_by
    return best


def _in_time(sailings: Sailings, earliest: float, arrive_by: float) -> tuple[Sailing, float]:
    """Return a sailing that may be in time, and a later departure (s) that is too late or shut.

    Without areas that are shut for some hours it is the earliest. Otherwise it is the last one in
    time of departures in even steps, or the earliest if none of these is in time.
    """
    last = sailings.last_departure(arrive_by)
    if sailings.has_areas and last > earliest:
        step = (last - earliest) / _STEPS
        for steps in range(_STEPS):
            tried = sailings.sailing(last - steps * step)
            if tried.arrival <= arrive_by:
                return tried, tried.departure + step
    return sailings.sailing(earliest), last


def too_late_error(
    first: Sailing, arrive_by: float, faster: str = "take a vessel that makes {} m/s"
) -> ArrivalError:
    """Return the error for a deadline that can't be met, with a sufficient speed and departure.

    Both remedies are found along the sailing's path, so they are nearly exact. `faster` is the text
    of the remedy by speed.
    """
    voyage = first.planner.problem.voyage
    path = first.found.path if first.found else voyage.start[None]
    remedies = [Text("arrive later"), *_earlier(voyage, path, first.duration, arrive_by)]
    remedies += _faster(voyage, path, arrive_by, faster)
    return ArrivalError(
        "arrive_by = {0} can't be made: a departure at {1} arrives at {2} at the earliest: {3}",
        Moment(arrive_by),
        Moment(voyage.departure),
        Moment(first.arrival),
        Text.joined(", or ", remedies),
    )


def _earlier(voyage: Voyage, path: FloatArray, duration: float, arrive_by: float) -> list[Text]:
    """Return a text with the latest departure at which a path is in time, or nothing."""

    def is_in_time(earlier: float) -> bool:
        arrivals = voyage.leaving(voyage.departure - earlier).arrivals(path)
        return bool(arrivals[-1] <= arrive_by)

    most = min(voyage.departure - voyage.current.span[0], _EARLIEST * duration)
    found = _least(is_in_time, 0.0, most)
    return [] if found is None else [Text("leave before {0}", (Moment(voyage.departure - found),))]


def _faster(voyage: Voyage, path: FloatArray, arrive_by: float, text: str) -> list[Text]:
    """Return a text with the least speed at which a path is in time, or nothing."""

    def is_in_time(speed: float) -> bool:
        return bool(voyage.at_speed(speed).arrivals(path)[-1] <= arrive_by)

    speed = voyage.vessel.speed
    found = _least(is_in_time, speed, _FASTEST * speed)
    return [] if found is None else [Text(text.format(_rounded_up(found)))]


def _rounded_up(speed: float) -> str:
    """Write a speed to three digits, rounded up, so that it is still sufficient."""
    step = 10.0 ** (math.floor(math.log10(speed)) - 2)
    return f"{math.ceil(speed / step) * step:.3g}"


def _least(is_enough: Callable[[float], bool], low: float, high: float) -> float | None:
    """Return the least sufficient value, if every larger one is sufficient; else None."""
    if high <= low or not is_enough(high):
        return None
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return high
