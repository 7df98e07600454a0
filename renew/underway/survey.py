"""Survey a route: from which places a haven is reached within limits; proven, refuted, or neither.

Ways to havens are planned from places of the route, on its heading, for vessels that are early, on
time and late. Between two stations the vessel may carry on and turn off at the next one: its time
to the haven is then at most the time to that station plus the time of the way from there. So one
planned way covers all places before it from which this sum is within the limits. Conversely, a
vessel at x came from an earlier place a. It needs at least the least time from a to the haven, less
the time from a to x. So bounds at close samples prove all places between them uncovered.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.bounds.fuel_lower_bound import HavenBound, least_time
from renew.errors import InfeasibleError, Moment, PlanningError
from renew.inputs.openings import Haven
from renew.planner.plan import planner_of
from renew.request import Request
from renew.results import Route
from renew.underway.lead import choose
from renew.voyage.voyage import Voyage

State: TypeAlias = Literal["covered", "uncovered", "not settled"]


@dataclass(frozen=True, eq=False)
class Diversion:
    """A planned way from a place of a route to a haven.

    Attributes
    ----------
    haven : where it leads.
    time : when a vessel that is on time turns off, s, on the current's clock.
    place : where it turns off, (2,) m.
    heading : the route's heading there, rad, anticlockwise from the x-axis; the way begins on it.
    route : the planned way, for the earliest vessel that the route allows for; it is safe for every
        vessel that is early, on time or late.
    duration : time to the haven, s, for a vessel on time, with the wait until it opens.
    fuel : fuel that a vessel on time needs to the haven (fuel units).
    longest : the longest time to the haven, s, for any vessel that is early, on time or late.
    """

    haven: Haven
    time: float
    place: FloatArray
    heading: float
    route: Route
    duration: float
    fuel: float
    longest: float


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of a route in one state.

    Attributes
    ----------
    begin, end : when a vessel on time is at its ends, s, on the current's clock.
    state : "covered", if from each of its places a planned way leads to a haven within the limits,
        for a vessel that is early, on time or late; "uncovered", if it is proven that no vessel on
        time gets to any haven within the limits, by any way off the charted land; "not settled", if
        neither is shown.
    diversion : the way to take: carry on along the route to its place, no earlier than `end`, and
        turn off there. None unless covered.
    longest : the longest time to the haven, s, from any place of the stretch, with the way along
        the rest of the stretch; inf unless covered.
    least : from no place of the stretch does a vessel on time get to a haven in less than this, s.
    cause : why the last plan from a stretch that is not settled failed, or None.
    """

    begin: float
    end: float
    state: State
    diversion: Diversion | None = None
    longest: float = math.inf
    least: float = 0.0
    cause: PlanningError | None = None


@dataclass(frozen=True, eq=False)
class LastTurn:
    """The last place of a route from which a haven is found within the limits.

    Attributes
    ----------
    diversion : the way from there.
    not_after : no vessel on time that turns off after this, s, gets there within the limits.
    """

    diversion: Diversion
    not_after: float


@dataclass(frozen=True, eq=False)
class EqualPoint:
    """The place of a route from which two havens take the same time.

    Attributes
    ----------
    before : the way from there to the haven that is nearest before it.
    after : the way from there to the haven that is nearest after it.
    """

    before: Diversion
    after: Diversion

    @property
    def time(self) -> float:
        """When a vessel on time is there, s."""
        return self.after.time


@dataclass(frozen=True, eq=False)
class ClassTurn:
    """The last place of a route that was found from which to change to another class.

    Attributes
    ----------
    other : the route of that class from the start.
    diversion : the way from there to the goal, in that class; its haven has the class's name.
    fuel : fuel of the whole voyage, along the route up to that place and then along the way (fuel
        units).
    """

    other: Route
    diversion: Diversion
    fuel: float


@dataclass(frozen=True, eq=False)
class Coverage:
    """Which places of a route have a planned way to a haven within the limits.

    Attributes
    ----------
    route : the route.
    havens : the havens that can be used, in the user's order.
    left_out : havens that can't be used, and those to which no way was found from any place that
        may be within the limits, each with the reason.
    stretches : the whole route in stretches, from departure to arrival, each in one state.
    diversions : all ways to havens that were planned, in the order of their times.
    abort_points : for each haven that is within the limits from some place, in the user's order,
        the last such place that was found.
    no_return : the last place from which the way back to the start is within the endurance; None
        without an endurance, or if there is none.
    equal_points : where the nearest haven changes, in order of time.
    class_turns : for each of the other routes that were given, in their order, the last place from
        which its class can be taken for little more fuel than from the start; none for a class that
        can't be sailed from any place that was tried.
    within : limit of time, s; inf if there is none.
    within_fuel : limit of fuel of a diversion (fuel units); inf if there is none.
    endurance : fuel on board at departure (fuel units); inf if it is not given.
    """

    route: Route
    havens: tuple[Haven, ...]
    left_out: tuple[tuple[Haven, PlanningError], ...]
    stretches: tuple[Stretch, ...]
    diversions: tuple[Diversion, ...]
    abort_points: tuple[LastTurn, ...] = ()
    no_return: LastTurn | None = None
    equal_points: tuple[EqualPoint, ...] = ()
    class_turns: tuple[ClassTurn, ...] = ()
    within: float = math.inf
    within_fuel: float = math.inf
    endurance: float = math.inf

    def share(self, state: State) -> float:
        """Share of the route's time in a state, 0 to 1."""
        times = [one.end - one.begin for one in self.stretches if one.state == state]
        return sum(times) / (self.stretches[-1].end - self.stretches[0].begin)

    @property
    def is_covered(self) -> bool:
        """Whether the whole route is covered."""
        return all(stretch.state == "covered" for stretch in self.stretches)

    def at(self, time: float) -> Stretch:
        """Return the stretch in which a vessel on time is at a time (s)."""
        ends = [stretch.end for stretch in self.stretches]
        return self.stretches[min(int(np.searchsorted(ends, time)), len(ends) - 1)]


# Number of classes that are planned for a way to a haven.
_CLASSES = 2
# Least number of departures between early and late at which a way is timed.
_TIMED = 9
# Time between two such departures, as a share of the way's time.
_APART = 0.01
# Largest number of such departures.
_MOST_TIMED = 129
# Factor by which the hours at the begin of a stretch are widened until they hold every vessel that
# is in time on it.
_WIDER = 1.25
# Largest number of times that they are widened.
_TRIES = 12
SAMPLES = 360
"""Number of samples in the time of a limit."""
# Largest number of samples in all.
_MOST_SAMPLES = 6_000
# Number of samples between two stations at first.
_STATIONS = 120
# Number of samples between two stations without a way up to which no place between them is tried.
_CLOSE = 4
# Multiple of a limit up to which bounds with a clock are close.
_ENOUGH = 1.5
# Least time between the places from which bounds with a clock are taken, as a share of the limit.
_PART = 1 / 24
# Number of cells of the finest grid of bounds with a clock.
_PROOF_CELLS = 128_000
# Factor on the limits up to which bounds are close.
_ABOVE = 1.02


def entered(haven: Haven, arrival: float) -> float:
    """Return when (s) a vessel enters a haven that it reaches at some time (s)."""
    if arrival > haven.closes:
        raise InfeasibleError(
            f"haven {haven.name} closes at {{0}}; the vessel arrives at {{1}}",
            Moment(haven.closes),
            Moment(arrival),
        )
    return max(arrival, haven.opens)


@dataclass(eq=False)
class Survey:
    """Ways from a route's track to havens, each planned once, and the route at close samples.

    A way is within the limits if it takes at most `within` (s), and leaves by the `endurance`: the
    time (s) from departure on for which the fuel on board lasts.
    `times` (n,), s, are those of the samples, `limit` (n,), s, the limits there, and `least` (m, n)
    bounds on the time to each haven (s).
    """

    request: Request
    route: Route
    havens: tuple[Haven, ...]
    within: float
    endurance: float
    times: FloatArray = field(init=False)
    limit: FloatArray = field(init=False)
    least: FloatArray = field(init=False)
    cause: PlanningError | None = None
    _found: dict[tuple[int, float], Diversion | PlanningError] = field(default_factory=dict)
    _whole: set[tuple[int, float]] = field(default_factory=set)
    _known: dict[int, list[Diversion]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Take samples, and the bound from each to each haven."""
        begin, end = self.begin, self.end
        tightest = min(self.limit_at(begin, self.within), end - begin)
        step = max(tightest / SAMPLES, (end - begin) / _MOST_SAMPLES)
        self.times = np.linspace(begin, end, max(2, math.ceil((end - begin) / step) + 1))
        self.limit = np.array([self.limit_at(time, self.within) for time in self.times])
        places = np.array([self.row(time)[:2] for time in self.times.tolist()])
        # Bounds are close up to the limits only, and hold until the latest vessel has arrived.
        voyage, most = planner_of(self.request).problem.voyage, _ABOVE * float(self.limit.max())
        last = end + self.off(end)
        bounds = [
            HavenBound.of(replace(voyage, goal=haven.place), most, last + most)
            for haven in self.havens
        ]
        self.least = np.array([bound.at(places) for bound in bounds])
        if not self.request.current.is_steady:
            self._raise_with_clock()

    @property
    def begin(self) -> float:
        """When a vessel on time departs, s."""
        return float(self.route.trajectory[0, 0])

    @property
    def end(self) -> float:
        """When a vessel on time arrives, s."""
        return float(self.route.trajectory[-1, 0])

    @property
    def found(self) -> tuple[Diversion, ...]:
        """All ways that were found, in the order of their times."""
        ways = [way for way in self._found.values() if isinstance(way, Diversion)]
        return tuple(sorted(ways, key=lambda way: way.time))

    def row(self, time: float) -> FloatArray:
        """Return place (m) and heading (rad) of a vessel that is on time (3,)."""
        track = self.route.trajectory
        return np.array([np.interp(time, track[:, 0], column) for column in track.T[1:]])

    def stretch(self, begin: float, end: float) -> FloatArray:
        """Return rows (n, 3) of t (s), x and y (m) of the track between two times (s)."""
        track = self.route.trajectory
        inside = track[(track[:, 0] > begin) & (track[:, 0] < end), :3]
        ends = [[time, *self.row(time)[:2]] for time in (begin, end)]
        return np.vstack([ends[0], inside, ends[1]])

    def off(self, time: float) -> float:
        """Return `late`; 0 in a steady current, where it does not matter when a way begins."""
        return 0.0 if self.request.current.is_steady else self.late(time)

    def late(self, time: float) -> float:
        """Return by how much (s) a vessel may be early or late where it should be at a time (s)."""
        options = self.request.options
        return float(max(options.lateness * (time - self.begin), options.min_lateness))

    def last_within(self, haven: int) -> float | None:
        """Return the last time (s) from which a way within the limits was found to a haven."""
        ways = [way for (which, _), way in self._found.items() if which == haven]
        within = [way.time for way in ways if isinstance(way, Diversion) and self.is_within(way)]
        return max(within, default=None)

    def fault(self, haven: int) -> PlanningError | None:
        """Return why no way to a haven was found; None if one was, or none was looked for."""
        asked = [outcome for (which, _), outcome in self._found.items() if which == haven]
        faults = [outcome for outcome in asked if isinstance(outcome, PlanningError)]
        return faults[-1] if faults and len(faults) == len(asked) else None

    def _nearest(self, haven: int, time: float, most: float) -> Diversion | None:
        """Return the way to a haven that is nearest in time to a time (s), up to `most` (s)."""
        ways = [
            way
            for (which, _), way in self._found.items()
            if which == haven and isinstance(way, Diversion) and abs(way.time - time) <= most
        ]
        return min(ways, key=lambda way: abs(way.time - time), default=None)

    def _to(self, number: int, time: float, near: Diversion | None) -> Diversion:
        """Return the way to a haven for a vessel that is on time at a time (s).

        It is planned in the class of a way `near`, if one is given and its class can be sailed;
        else in the first classes. Haven number -1 is the start. Raises PlanningError if there is
        none.
        """
        haven = self.havens[number] if number >= 0 else Haven("start", self.route.path[0])
        key = number, time
        if key not in self._found or (near is None and key not in self._whole):
            known = self._found.get(key)
            try:
                way = self._planned(haven, time, near, is_start=number < 0)
            except PlanningError as error:
                self._found.setdefault(key, error)
            else:
                if not (isinstance(known, Diversion) and known.longest <= way.longest):
                    self._found[key] = way
            if near is None:
                self._whole.add(key)
        outcome = self._found[key]
        if isinstance(outcome, PlanningError):
            raise outcome
        return outcome

    def onto(self, other: Route, time: float) -> Diversion:
        """Return the way to the goal in the class of another route, from the place at a time (s).

        Raises PlanningError if there is none in that class.
        """
        goal, word = Haven(other.homotopy, other.path[-1]), planner_of(self.request).problem.word
        whole = Diversion(
            goal, self.begin, other.path[0], math.nan, other, other.duration, other.fuel, math.nan
        )
        way = self._planned(goal, time, whole, is_start=True)
        back = self.stretch(self.begin, time)[::-1, 1:]
        if word(way.route.path) != word(np.vstack([back, other.path[1:]])):
            raise InfeasibleError("no way leads on from {0} in the other class", way.place)
        return way

    def _planned(
        self, haven: Haven, time: float, near: Diversion | None, *, is_start: bool
    ) -> Diversion:
        off, (x, y, heading) = self.off(time), self.row(time)
        place = np.array([x, y])
        early = max(time - off, self.begin)
        options = self.request.options
        request = replace(
            self.request,
            stops=np.vstack([place, haven.place]),
            like=self.request,
            options=replace(
                options,
                classes=min(_CLASSES, options.classes),
                min_lateness=max(options.min_lateness, time + off - early),
            ),
            departure=early,
        )
        ahead = None
        if near is not None:
            between = self.stretch(*sorted((time, near.time)))[:: 1 if time < near.time else -1]
            ahead = np.vstack([between[:, 1:], near.route.path[1:]])
        plan, _ = choose(request, ahead, heading, 1.0, is_proven=False, track=None)
        route = plan.best
        if route.ends_in_soft_no_go and not is_start:
            raise InfeasibleError(
                f"haven {haven.name} {{0}} lies in the soft no-go zone, where no turn is verified; "
                "move it off",
                haven.place,
            )
        voyage = planner_of(request).problem.voyage
        rate = self.request.vessel.fuel_rate
        if off == 0.0:
            late, took = self.late(time), route.duration
            duration = entered(haven, time + took) - time
            leaving = (max(time - late, self.begin), time, time + late)
            longest = max(entered(haven, at + took) - at for at in leaving)
        else:
            duration = entered(haven, float(voyage.leaving(time).arrivals(route.path)[-1]))
            duration -= time
            longest = self._longest(haven, route.path, voyage, (early, time + off))
        return Diversion(haven, time, place, heading, route, duration, rate * duration, longest)

    def _longest(
        self, haven: Haven, path: FloatArray, voyage: Voyage, hours: tuple[float, float]
    ) -> float:
        """Return the most time (s) along a path (n, 2) to a haven, for departures between two.

        On one path no vessel overtakes: one that leaves between two others arrives no later than
        the second.
        """
        apart = _APART * float(np.diff(voyage.leaving(hours[1]).arrivals(path)[[0, -1]])[0])
        count = math.ceil((hours[1] - hours[0]) / apart) + 1
        leaving = np.linspace(*hours, min(max(count, _TIMED), _MOST_TIMED))
        arrivals = [float(voyage.leaving(at).arrivals(path)[-1]) for at in leaving.tolist()]
        waited = np.array([entered(haven, at) for at in arrivals])
        return float((waited[1:] - leaving[:-1]).max())

    def longest_from(self, time: float, way: Diversion) -> float:
        """Return the most time (s) to a haven from any place between a time (s) and a way's time.

        The vessel carries on to the way's place, early, on time or late, and turns off there.
        """
        if time == way.time:
            return way.longest
        if self.off(way.time) == 0.0:
            return way.time - time + way.longest
        voyage = planner_of(self.request).problem.voyage
        rows = self.stretch(time, way.time)
        path = np.vstack([rows[:, 1:], way.route.path[1:]])
        return self._longest(way.haven, path, voyage, self._hours(rows, voyage))

    def _hours(self, rows: FloatArray, voyage: Voyage) -> tuple[float, float]:
        """Return the first and last time (s) at which a vessel in time begins a stretch (n, 3)."""
        times, path = rows[:, 0], rows[:, 1:]
        off = np.array([self.off(time) for time in times.tolist()])
        wide = float(off.max())
        for _ in range(_TRIES):
            early, late = max(times[0] - wide, self.begin), times[0] + wide
            first, last = (voyage.leaving(at).arrivals(path) for at in (early, late))
            is_early = early == self.begin or (first <= times - off).all()
            if is_early and (last >= times + off).all():
                break
            wide *= _WIDER
        else:
            return times[0], math.inf
        return early, late

    def is_within(self, way: Diversion, time: float | None = None) -> bool:
        """Whether a way keeps the limits from its own place, or from that passed at a time (s)."""
        return self.excess(way, self.within, time) <= 0

    def excess(self, way: Diversion, within: float, time: float | None = None) -> float:
        """Return by how much (s) a way takes more than `within` (s), or than the endurance leaves.

        The way begins at its own place, or at the place that is passed at an earlier time (s).
        """
        time = way.time if time is None else time
        # A late vessel has burnt more: all that arrive by the latest arrival keep the endurance.
        left = self.endurance - (time + self.late(time) - self.begin)
        return self.longest_from(time, way) - min(within, left)

    def limit_at(self, time: float, within: float) -> float:
        """Return the limits as a time (s), for a vessel on time at a time (s)."""
        return min(within, self.endurance - (time - self.begin))

    def _raise_with_clock(self) -> None:
        """Raise the bounds: compute them again from places of the route, with the clock running.

        In a current that changes these are closer than the bounds from the havens.
        """
        at, last = 0, len(self.times) - 1
        while at < last:
            if self.is_out[at]:
                at += 1
                continue
            limit = float(self.limit[at])
            least = self._least_from(at, _ENOUGH * limit)
            ahead = self.times[at:] - self.times[at]
            self.least[:, at:] = np.maximum(self.least[:, at:], least - ahead)
            # Where a haven is near, it is so for a while.
            at += max(1, int(max(_PART * limit, abs(least - limit) / 2) / self.step))

    def _least_from(self, sample: int, enough: float) -> float:
        """Return a bound on the time (s) to any haven from a sample, close up to `enough` (s)."""
        voyage, least = planner_of(self.request).problem.voyage, math.inf
        time = float(self.times[sample])
        for haven, known in zip(self.havens, self.least[:, sample].tolist(), strict=True):
            bound = known
            if bound < min(enough, least):
                ahead = replace(voyage, start=self.row(time)[:2], goal=haven.place)
                bound = max(bound, least_time(ahead.leaving(time), _PROOF_CELLS, enough))
            least = min(least, bound)
        return least

    @property
    def step(self) -> float:
        """Time (s) between two samples."""
        return float(self.times[1] - self.times[0])

    @property
    def is_out(self) -> BoolArray:
        """From which samples to the next (n - 1,) nobody gets to a haven within the limits."""
        return np.asarray(self.least.min(axis=0)[:-1] - self.step > self.limit[:-1])

    def stretches(self) -> list[Stretch]:
        """Return the whole route in stretches."""
        return _joined(list(self._backwards())[::-1])

    def _backwards(self) -> Iterator[Stretch]:
        """Yield stretches from the end backwards: each way helps to plan the one before it."""
        is_out = self.is_out
        edges = [0, *(np.flatnonzero(np.diff(is_out)) + 1).tolist(), len(is_out)]
        for first, last in reversed(list(itertools.pairwise(edges))):
            if is_out[first]:
                yield self._stretch(first, last, "uncovered")
                continue
            count = max(1, math.ceil((last - first) / _STATIONS))
            stations = np.linspace(first, last, count + 1).round().astype(int).tolist()
            for a, b in reversed(list(itertools.pairwise(stations))):
                yield from self._with_fewer_ways(list(self._settled(a, b)))

    def _with_fewer_ways(self, stretches: Sequence[Stretch]) -> Iterator[Stretch]:
        """Yield stretches between two stations, the last first, with as few ways as possible."""
        way: Diversion | None = None
        for stretch in stretches:
            if stretch.diversion and way and self.is_within(way, stretch.begin):
                longest = self.longest_from(stretch.begin, way)
                yield replace(stretch, diversion=way, longest=longest)
                continue
            way = stretch.diversion
            yield stretch

    def _settled(self, first: int, last: int) -> Iterator[Stretch]:
        """Yield the stretches between two samples, the last first."""
        before = float(self.times[first])
        ways = [way for way in self._ways(last) if self.is_within(way, before)]
        if ways:
            way = min(ways, key=lambda way: way.longest)
            stretch = self._stretch(first, last, "covered")
            yield replace(stretch, diversion=way, longest=self.longest_from(before, way))
        elif last - first == 1 or (
            last - first <= _CLOSE and not self._ways(first) and not self._ways(last)
        ):
            yield replace(self._stretch(first, last, "not settled"), cause=self.cause)
        else:
            middle = (first + last) // 2
            yield from self._settled(middle, last)
            yield from self._settled(first, middle)

    def _stretch(self, first: int, last: int, state: State) -> Stretch:
        least = float(self.least[:, first : last + 1].min()) - self.step
        return Stretch(
            float(self.times[first]), float(self.times[last]), state, least=max(least, 0.0)
        )

    def _ways(self, sample: int) -> list[Diversion]:
        """Return ways from a sample within the limits: the nearest haven's among them."""
        if sample not in self._known:
            self._known[sample] = self._planned_at(sample)
        return self._known[sample]

    def _planned_at(self, sample: int) -> list[Diversion]:
        """Plan ways from a sample, until no other haven can be nearer."""
        ways, time = list[Diversion](), float(self.times[sample])
        for number in np.argsort(self.least[:, sample], kind="stable").tolist():
            least = self.least[number, sample]
            if least > self.limit[sample] or any(known.duration <= least for known in ways):
                break
            way = self.planned(number, sample)
            if way is not None and self.is_within(way, time):
                ways.append(way)
        return ways

    def planned(self, number: int, sample: int, *, is_thorough: bool = True) -> Diversion | None:
        """Return the way to a haven from a sample; None if none is found.

        It is first planned near a known way. If it is then not within the limits, a thorough search
        plans it in all classes, too.
        """
        time = float(self.times[sample])
        near = self._nearest(number, time, self.step * _STATIONS)
        for start in (near, None) if near else (None,):
            try:
                way = self._to(number, time, start)
            except PlanningError as error:
                self.cause = error
                continue
            if start is None or not is_thorough or self.is_within(way, time):
                return way
        return None


def _joined(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Return stretches in order; neighbours with the same way, or both without one, are joined."""
    joined = list[Stretch]()
    for stretch in stretches:
        last = joined[-1] if joined else None
        if last is None or last.state != stretch.state or last.diversion is not stretch.diversion:
            joined.append(stretch)
            continue
        joined[-1] = replace(last, end=stretch.end, least=min(last.least, stretch.least))
    return joined
