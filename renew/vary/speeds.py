"""Least-fuel plans that arrive by a deadline, with a choice of speed for each leg.

In a steady current, classes are planned with a price of time: the deadline's Lagrange multiplier.
At a price λ the planner searches for classes and paths with least fuel + λ time, as it otherwise
does for least time. Along a found path, the price that just meets the deadline gives the speeds of
least fuel (:mod:`renew.paths.speed_profile`). That price is used next, until it no longer changes.
The price is found for the best class first and then for each class: every class has its own.

In a changing current no single price of time holds along the whole voyage. So classes are searched
at one speed: among the speeds that arrive in time, the one with the least fuel on the fastest path.
Each class's path and speeds are then improved together (:mod:`renew.paths.speed_profile`), and
land is padded for the hours at which the vessel passes at these speeds.

Land is first padded for the highest speed allowed. If the fastest leg is much slower, the voyage
is planned again with the narrower padding for its speed: straits open, and paths get shorter. The
padding for a speed v covers all lower speeds. For a given heading and current, a turn's reach
towards an edge is the largest value over time of a function linear in v, so it is convex in v. It
is least at v = 0, where it is the drift; so it never falls as v rises. In addition, hard-over turns
are simulated at the speed at which each leg is sailed.
"""

import contextlib
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from renew._types import FloatArray
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError, Moment, ParameterError, PlanningError
from renew.inputs.chart_and_vessel import Vessel
from renew.inputs.openings import Opening
from renew.paths import speed_profile
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import path_by_clock
from renew.planner.classes import ClassSearch, no_class_error, plan_classes
from renew.planner.grow import Shortfalls, steered_with_room
from renew.planner.one_class import ClassPath, ClassPlanner, grown_until_clear
from renew.planner.plan import check_start_open, plan_around, planner_of
from renew.planner.problem import check_current_at_endpoints
from renew.request import Request
from renew.results import Departures, Plan, Route, TradeOff
from renew.steering.steer_in_corridor import steer_as_drawn
from renew.vary.departures import Progress, best_sailing, too_late_error
from renew.voyage.voyage import Voyage, shares

# Largest number of rounds to find the price of time.
_PRICE_ROUNDS = 4
# Relative change from round to round below which a price is accepted: the relative error of fuel is
# the square of that change.
_SETTLED = 0.03
# Number of rounds of growing padding for turns at the chosen speeds.
_STEADY_GROWTH_ROUNDS = 4
# Number of arrivals at which a trade-off is given.
_ARRIVALS = 65


class PriceSearch:
    """Plans a voyage with a choice of speeds, starting from a planner at an infinite price.

    `speeds_along` gives the speeds of least fuel along a path; `trade_off_along` gives arrivals
    (m,), s, and the least fuel (m,) for each.
    """

    speeds_along = staticmethod(speed_profile.speed_profile)
    trade_off_along = staticmethod(speed_profile.trade_off)

    def __init__(self, planner: ClassPlanner) -> None:
        self.planner, self.classes = planner, planner.options.classes
        self.voyage = planner.problem.voyage
        self._at = functools.cache(self._planner_at)

    def plan(self) -> Plan:
        """Return the routes of least fuel that arrive in time, one per class.

        Raises ArrivalError if no route arrives in time even at the highest speed.
        """
        sailing = best_sailing(self.planner, self.planner.unpadded)
        fastest = sailing.found
        if fastest is None:
            raise sailing.error
        if sailing.arrival > self.voyage.deadline:
            raise too_late_error(sailing, self.voyage.deadline, "let speed reach {} m/s")
        search, paths = self.first_paths(fastest)
        routes: list[tuple[Route, float]] = []
        rejected = {
            word: rejection for word, rejection in search.rejected.items() if word not in paths
        }
        for word, class_path in paths.items():
            try:
                settled = self.verified(self.settled(class_path))
            except InfeasibleError as error:
                rejected[word] = search.rejected_for(class_path.corridor.channel, error)
            else:
                price = profile_of(settled).price
                kept = settled if self.voyage.has_choice else settled._replace(profile=None)
                routes.append((self.planner.route(kept), price))
        if not routes:
            raise no_class_error(tuple(rejected.values()), self.planner)
        routes = sorted(routes, key=lambda pair: pair[0].fuel)[: self.classes]
        bound = self._at(routes[0][1]).problem.fuel_bound
        best = tuple(replace(route, fuel_bound=bound) for route, _ in routes)
        return Plan(
            best,
            tuple(rejected.values()),
            overpowering=self.planner.problem.overpowered_water,
            trade_off=self.trade_off([*(route.path for route in best), fastest.path]),
        )

    def first_paths(self, fastest: ClassPath) -> tuple[ClassSearch, dict[Word, ClassPath]]:
        """Return the first classes' paths at the price of the best one, and their search."""
        word = self.planner.problem.word(fastest.path)
        first = self.with_speeds(fastest)
        price = profile_of(first).price
        for _ in range(_PRICE_ROUNDS):
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
        search.fit(self.classes)
        paths = {
            of_class: self.with_speeds(class_path)
            for of_class, class_path in search.all_found.items()
        }
        if word not in paths or chosen_fuel(first) < chosen_fuel(paths[word]):
            paths[word] = first
        return search, paths

    def settled(self, class_path: ClassPath) -> ClassPath:
        """Return a class's path at its own price."""
        best = class_path
        for _ in range(_PRICE_ROUNDS):
            price = profile_of(class_path).price
            if _is_settled(price, class_path.corridor.voyage.price):
                break
            planner, channel = self._at(price), best.corridor.channel
            at_price = planner.find(channel)
            if planner.problem.word(at_price.path) != channel.word:
                break
            class_path = self.with_speeds(at_price)
            best = min(best, class_path, key=chosen_fuel)
        return self.in_time(best)

    def verified(self, class_path: ClassPath) -> ClassPath:
        """Return the path with enough padding that no turn at its speeds touches land."""

        def again(corridor: Corridor, class_path: ClassPath) -> ClassPath:
            planner = self._at(corridor.voyage.price)
            return self.in_time(self.with_speeds(planner.find_in(corridor, class_path.path)))

        return grown_until_clear(
            class_path,
            self.collisions,
            again,
            _STEADY_GROWTH_ROUNDS,
            "hard-over turns at the speeds sailed",
        )

    def collisions(self, class_path: ClassPath) -> Shortfalls | None:
        """Return the shortfall of padding for turns at a path's speeds."""
        profile = profile_of(class_path)
        return self.planner.growth.collisions(class_path.corridor, profile.path, profile.speeds)

    def in_time(self, class_path: ClassPath) -> ClassPath:
        """Return the path; raise an error if it is too late at the highest speed."""
        profile = profile_of(class_path)
        if not math.isfinite(profile.fuel):
            raise InfeasibleError(
                "it would arrive at {0} at the earliest, and has to by {1}",
                Moment(profile.arrival),
                Moment(self.voyage.deadline),
            )
        return class_path

    def with_speeds(self, class_path: ClassPath) -> ClassPath:
        """Return a path with the speeds of least fuel."""
        return class_path._replace(profile=self.speeds_along(class_path.path, self.voyage))

    def _planner_at(self, price: float) -> ClassPlanner:
        """Return the planner for a price of time (fuel units a second)."""
        problem = self.planner.problem
        problem = problem.with_voyage(replace(problem.voyage, price=price))
        return self.planner.for_problem(problem) if problem.voyage.has_price else self.planner

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Return the least fuel for each arrival among the found paths."""
        curves = [self.trade_off_along(path, self.voyage) for path in paths]
        earliest = min(times[0] for times, _ in curves)
        latest = min(curves, key=lambda curve: curve[1][-1])[0][-1]
        arrivals = np.unique(np.linspace(earliest, latest, _ARRIVALS))
        fuels = [np.interp(arrivals, times, fuel, left=math.inf) for times, fuel in curves]
        return TradeOff(arrivals, np.min(fuels, axis=0))


def _is_settled(price: float, before: float) -> bool:
    """Whether a price is nearly the previous one, or both are infinite."""
    return price == before or abs(price - before) <= _SETTLED * before


def profile_of(class_path: ClassPath) -> speed_profile.SpeedProfile:
    """Return the speeds along a path; raise ValueError if speeds were not chosen."""
    if class_path.profile is None:
        raise ValueError("the path has no speeds of its own")
    return class_path.profile


def chosen_fuel(class_path: ClassPath) -> float:
    """Return a path's fuel at its chosen speeds."""
    return profile_of(class_path).fuel


# If no leg is faster than this share of the highest speed, narrower padding is tried.
_MUCH_LOWER = 0.95
# Largest number of rounds of the search for a route at one constant speed.
_ONE_SPEED_ROUNDS = 4
# Share by which that speed changes at most from one round to the next when the search ends earlier.
_SAME = 1e-7

_PlannerUpTo: TypeAlias = Callable[[float | None], ClassPlanner]
"""Gives the planner for speeds up to a limit (m/s); None means the highest speed allowed."""


def plan_with_speeds(request: Request, departure: float) -> Plan:
    """Plan at a departure (s) with a choice of speeds, around areas that are shut for some hours.

    ArrivalError where no route arrives in time even at the highest speed. Speeds are not changed to
    pass an area before or after it is shut: a class is rejected if its least-fuel route may enter
    the area while it is shut. Around such areas a plan has no trade-off between arrival and fuel,
    since with another arrival the vessel passes them at other times.
    """
    _check_exponent(request.vessel)

    def plan(closed: Sequence[Opening]) -> tuple[Plan, ClassPlanner]:
        @functools.cache
        def planner_up_to(most: float | None) -> ClassPlanner:
            planner = planner_of(request, closed, most)
            if planner.problem.voyage.departure == departure:
                return planner
            return planner.for_problem(planner.problem.leaving(departure))

        return _plan_up_to(planner_up_to), planner_up_to(None)

    check_start_open(request, departure)
    plan_found = plan_around(request.areas, plan)
    return replace(plan_found, trade_off=None) if request.areas else plan_found


def departures_with_speeds(
    request: Request, departures: Sequence[float], progress: Progress | None
) -> Departures:
    """Plan each of the departures (s), which ascend; an error if none of them has a route.

    The best departure is the one of least fuel, as both the current and the time left until the
    deadline depend on the departure. Nothing is known of departures between those given: the bound
    on arrivals at one speed (:mod:`renew.vary.departures`) is no bound on fuel.
    """
    _check_exponent(request.vessel)
    plans: list[Plan | PlanningError] = []
    for departure in departures:
        try:
            plans.append(plan_with_speeds(request, departure))
        except PlanningError as error:
            plans.append(error)
        if progress is not None:
            progress(len(plans), math.inf)
    best = [None if isinstance(outcome, PlanningError) else outcome.best for outcome in plans]
    fuels = np.array([math.inf if route is None else route.fuel for route in best])
    chosen = plans[int(fuels.argmin())]
    if isinstance(chosen, PlanningError):
        raise chosen
    return Departures(
        departures=np.array(departures),
        arrivals=np.array([math.inf if route is None else route.times[-1] for route in best]),
        fuels=fuels,
        paths=tuple(None if route is None else route.path for route in best),
        times=tuple(None if route is None else route.times for route in best),
        homotopies=tuple("" if route is None else route.homotopy for route in best),
        causes=tuple(outcome if isinstance(outcome, PlanningError) else None for outcome in plans),
        unproven=math.inf,
        plan=chosen,
    )


def _plan_up_to(planner_up_to: _PlannerUpTo) -> Plan:
    """Plan with a choice of speeds; `planner_up_to` gives a planner for each highest speed."""
    voyage = planner_up_to(None).problem.voyage
    if voyage.waters.current_change > 0 and len(voyage.via):
        raise ParameterError(
            "speeds can't be chosen on a way with via points in a current that changes; leave out "
            "speed or via, or plan from one via point to the next with an arrival at each"
        )
    if voyage.waters.current_change == 0:
        return _plan_and_narrow(planner_up_to, PriceSearch)
    plan = _plan_and_narrow(planner_up_to, ClockSearch)
    return _with_one_speed(plan, planner_up_to, voyage)


def _with_one_speed(plan: Plan, planner_up_to: _PlannerUpTo, voyage: Voyage) -> Plan:
    """Return the plan, or a plan whose best route has one speed, if that needs less fuel.

    That is possible because land is then padded for that speed only, and not for a higher one.
    """
    path, best = plan.best.path, plan.best
    speed = 0.0
    for _ in range(_ONE_SPEED_ROUNDS):
        before, speed = speed, speed_profile.constant_speed(path, voyage)
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


def _plan_and_narrow(
    planner_up_to: _PlannerUpTo, search: Callable[[ClassPlanner], PriceSearch]
) -> Plan:
    """Plan with padding for the highest speed allowed, then with padding for the fastest leg.

    ArrivalError where no route arrives in time even at the highest speed.
    """
    planner = planner_up_to(None)
    check_current_at_endpoints(planner.problem.voyage)
    plan = search(planner).plan()
    highest = float(plan.best.speeds.max())
    if (
        not planner.options.is_adaptive
        or highest > _MUCH_LOWER * planner.problem.voyage.vessel.speed
    ):
        return plan
    try:
        slower = search(planner_up_to(highest)).plan()
    except PlanningError:
        # On some water only a higher speed can stem the current.
        return plan
    return plan if slower.best.fuel >= plan.best.fuel else _cheaper_of_each_class(plan, slower)


def _cheaper_of_each_class(plan: Plan, slower: Plan) -> Plan:
    """Return each class's cheaper route of two plans; longer routes may need the higher speeds."""
    by_fuel = sorted([*slower.routes, *plan.routes], key=lambda route: route.fuel)
    cheapest = {route.homotopy: route for route in reversed(by_fuel)}
    # The bound of the first plan holds for all speeds.
    bound = plan.best.fuel_bound
    routes = [replace(one, fuel_bound=bound) for one in by_fuel if cheapest[one.homotopy] is one]
    rejected = {rejection.homotopy: rejection for rejection in (*slower.rejected, *plan.rejected)}
    curves = [curve for curve in (plan.trade_off, slower.trade_off) if curve is not None]
    arrivals = functools.reduce(np.union1d, [curve.arrivals for curve in curves])
    fuels = [np.interp(arrivals, curve.arrivals, curve.fuels, left=math.inf) for curve in curves]
    return replace(
        plan,
        routes=tuple(routes[: max(len(plan.routes), len(slower.routes))]),
        rejected=tuple(rejection for name, rejection in rejected.items() if name not in cheapest),
        trade_off=TradeOff(arrivals, np.min(fuels, axis=0)),
    )


# Largest number of rounds that improve path and speeds of a class.
_IMPROVING_ROUNDS = 3
# Share of fuel that such a round must save if another is to follow.
_WORTH_IT = 3e-4
# Number of rounds of growing padding for the hours of passage, and for turns at the chosen speeds.
_CLOCK_GROWTH_ROUNDS = 8
# Largest duration of another class, in durations of the fastest class: the speed of the search
# lets such a class arrive before the current's data end.
_LONGER = 1.25
# Number of paths along which the trade-off is computed.
_CURVES = 3


class ClockSearch(PriceSearch):
    """Plans a voyage in a changing current for a vessel that chooses its speeds."""

    speeds_along = staticmethod(speed_profile.speeds_by_clock)
    trade_off_along = staticmethod(speed_profile.trade_off_by_clock)

    def first_paths(self, fastest: ClassPath) -> tuple[ClassSearch, dict[Word, ClassPath]]:
        """Return the first classes' paths at one speed, and the search that found them."""
        problem, (_, last) = self.planner.problem, self.voyage.current.span
        speed = speed_profile.constant_speed(fastest.path, self.voyage)
        at_speed = self.voyage.at_speed(speed)
        if self.voyage.departure + _LONGER * at_speed.duration(fastest.path) > last:
            speed *= _LONGER
        voyage = problem.voyage.at_speed(min(speed, self.voyage.vessel.speed))
        planner = self.planner.for_problem(problem.with_voyage(voyage))
        return self.search_with(planner, problem.word(fastest.path), self.with_speeds(fastest))

    def settled(self, class_path: ClassPath) -> ClassPath:
        """Return a class's path after improving course and speeds as long as that saves fuel."""
        corridor, best = self._on_schedule(class_path).corridor, None
        with contextlib.suppress(InfeasibleError):
            best = self._replanned(class_path, corridor)
        if best is None or chosen_fuel(best) > chosen_fuel(class_path):
            # The given path may have been found, and been steerable, at another speed.
            best = self._steered(corridor, class_path.path)
        for _ in range(_IMPROVING_ROUNDS - 1):
            if not chosen_fuel(best) < (1 - _WORTH_IT) * chosen_fuel(class_path):
                break
            class_path = best
            with contextlib.suppress(InfeasibleError):
                best = min(best, self._replanned(best, best.corridor), key=chosen_fuel)
        return self.in_time(best)

    def verified(self, class_path: ClassPath) -> ClassPath:
        """Return the path with enough padding that no turn at its hours and speeds touches land."""

        def short(class_path: ClassPath) -> Shortfalls | None:
            path, growth = profile_of(class_path).path, self.planner.growth
            return growth.shortfall(class_path.corridor, path) or self.collisions(class_path)

        def again(corridor: Corridor, class_path: ClassPath) -> ClassPath:
            return self._on_schedule(self.in_time(self._replanned(class_path, corridor)))

        turns = "hard-over turns at the speeds and hours of passage"
        return grown_until_clear(
            self._on_schedule(class_path), short, again, _CLOCK_GROWTH_ROUNDS, turns
        )

    def _replanned(self, class_path: ClassPath, corridor: Corridor) -> ClassPath:
        """Return a path near another one, in a corridor that may have more padding."""
        corridor = self._on_schedule(class_path._replace(corridor=corridor)).corridor
        profile = profile_of(class_path)
        fitted = self.planner.growth.fitted(corridor, profile.path)
        return self._steered(fitted, path_by_clock(fitted, profile))

    def _steered(self, corridor: Corridor, path: FloatArray) -> ClassPath:
        """Return a path (n, 2) after steering, with its speeds."""
        corridor, path, trajectory = steered_with_room(corridor, path)
        profile = speed_profile.speeds_by_clock(path, self.voyage)
        if self.planner.problem.word(profile.path) != corridor.channel.word:
            raise InfeasibleError("its least-fuel path slips into another class")
        if math.isfinite(profile.fuel):
            trajectory = steer_as_drawn(profile.path, corridor, profile.speeds)
        return ClassPath(corridor, path, trajectory, profile.fuel, profile.fuel, profile)

    def _on_schedule(self, class_path: ClassPath) -> ClassPath:
        """Return the path with its corridor for the hours of its passage."""
        profile = profile_of(class_path)
        voyage = replace(
            self.voyage, schedule=np.column_stack([shares(profile.path), profile.times])
        )
        corridor = replace(class_path.corridor, voyage=voyage, polar=voyage.polar)
        return class_path._replace(corridor=corridor)

    def trade_off(self, paths: Sequence[FloatArray]) -> TradeOff:
        """Return the least fuel by arrival along the best paths and the fastest path."""
        return super().trade_off([*paths[: _CURVES - 1], paths[-1]])


def _check_exponent(vessel: Vessel) -> None:
    """Refuse a choice of speeds for a vessel with which it can't be planned."""
    if vessel.power is None and vessel.fuel_exponent < 1:
        raise ParameterError(
            f"speed needs a fuel_exponent of at least 1, not {vessel.fuel_exponent:g}: below that "
            "the highest speed is always best"
        )
