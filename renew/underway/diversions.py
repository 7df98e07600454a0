"""Plan ways from places of a route to havens: on its heading, early, on time and late."""

import math
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from renew._types import FloatArray
from renew.errors import InfeasibleError, Moment, PlanningError
from renew.inputs.openings import Haven
from renew.planner.plan import planner_of
from renew.request import Request
from renew.results import Plan, Route
from renew.underway.choice import choose
from renew.underway.coverage import Diversion
from renew.voyage.voyage import Voyage

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


@dataclass(frozen=True)
class Limits:
    """Limits of a diversion: time (s), fuel, and the fuel on board at departure (fuel units)."""

    within: float = math.inf
    within_fuel: float = math.inf
    endurance: float = math.inf


def entered(haven: Haven, arrival: float) -> float:
    """Return when (s) a vessel enters a haven that it reaches at some time (s)."""
    if arrival > haven.closes:
        raise InfeasibleError(
            f"haven {haven.name} closes at {{0}}; the vessel arrives at {{1}}",
            Moment(haven.closes),
            Moment(arrival),
        )
    return max(arrival, haven.opens)


@dataclass(frozen=True, eq=False)
class Diverter:
    """Plans diversions from a route's track; each is planned once."""

    request: Request
    route: Route
    _found: dict[tuple[int, float], Diversion | PlanningError] = field(default_factory=dict)
    _whole: set[tuple[int, float]] = field(default_factory=set)

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
        ways = [one for one in self._found.values() if isinstance(one, Diversion)]
        return tuple(sorted(ways, key=lambda one: one.time))

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
        """Return by how much (s) a vessel may be early or late for its ways; 0 if steady."""
        return 0.0 if self.request.current.is_steady else self.late(time)

    def late(self, time: float) -> float:
        """Return by how much (s) a vessel may be early or late where it should be at a time (s)."""
        options = self.request.options
        return float(max(options.lateness * (time - self.begin), options.min_lateness))

    def left(self, haven: int, limits: Limits) -> dict[float, Diversion]:
        """Return the ways that were found to a haven, by their time, within limits."""
        return {
            time: one
            for (which, time), one in self._found.items()
            if which == haven and isinstance(one, Diversion) and self.is_within(one, limits)
        }

    def fault(self, haven: int) -> PlanningError | None:
        """Return why no way to a haven was found; None if one was, or none was looked for."""
        asked = [one for (which, _), one in self._found.items() if which == haven]
        faults = [one for one in asked if isinstance(one, PlanningError)]
        return faults[-1] if faults and len(faults) == len(asked) else None

    def nearest(self, haven: int, time: float, most: float) -> Diversion | None:
        """Return the way to a haven that is nearest in time to a time (s), up to `most` (s)."""
        ways = [
            one
            for (which, _), one in self._found.items()
            if which == haven and isinstance(one, Diversion) and abs(one.time - time) <= most
        ]
        return min(ways, key=lambda one: abs(one.time - time), default=None)

    def to(
        self, number: int, haven: Haven, time: float, near: Diversion | None = None
    ) -> Diversion:
        """Return the way to a haven for a vessel that is on time at a time (s).

        It is planned in the class of a way `near`, if one is given and its class can be sailed;
        else in the first classes. Haven number -1 is the start. Raises PlanningError if there is
        none.
        """
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
        found = self._found[key]
        if isinstance(found, PlanningError):
            raise found
        return found

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
        """Plan a way to a haven."""
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
        choice = choose(request, ahead, heading, 1.0, is_proven=False, track=None)
        route = cast("Plan", choice.plan).best  # without a way, an error was raised
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
        if self.off(way.time) == 0.0:
            return way.time - time + way.longest
        voyage = planner_of(self.request).problem.voyage
        rows = self.stretch(time, way.time)
        path = np.vstack([rows[:, 1:], way.route.path[1:]])
        return self._longest(way.haven, path, voyage, self._hours(rows, voyage))

    def _hours(self, rows: FloatArray, voyage: Voyage) -> tuple[float, float]:
        """Return hours at the begin of a stretch (n, 3) that hold all vessels in time on it."""
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

    def is_within(self, way: Diversion, limits: Limits, time: float | None = None) -> bool:
        """Whether a way keeps limits from its own place, or from that passed at a time (s)."""
        return self.excess(way, limits, time) <= 0

    def excess(self, way: Diversion, limits: Limits, time: float | None = None) -> float:
        """Return by how much (s) a way exceeds limits from its place, or that passed at a time."""
        time = way.time if time is None else time
        longest = way.longest if time == way.time else self.longest_from(time, way)
        rate = self.request.vessel.fuel_rate
        # A late vessel has burnt more: all that arrive by the latest arrival keep the endurance.
        left = limits.endurance / rate - (time + self.late(time) - self.begin)
        return longest - min(limits.within, limits.within_fuel / rate, left)

    def limit(self, time: float, limits: Limits) -> float:
        """Return the limits as a time (s), for a vessel on time at a time (s)."""
        rate = self.request.vessel.fuel_rate
        return min(
            limits.within,
            limits.within_fuel / rate,
            limits.endurance / rate - (time - self.begin),
        )
