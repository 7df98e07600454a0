"""What is known of ways to havens along a route: where it is covered, and where to turn off."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from renew._types import FloatArray
from renew.errors import PlanningError
from renew.inputs.openings import Haven
from renew.results import Route

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
    route : the way as it is planned and steered, for a vessel that is as early as the route allows
        for; it is safe for all that are early, on time or late.
    duration : time to the haven, s, for a vessel on time, with the wait until it opens.
    fuel : fuel for that (fuel units).
    longest : the most time to the haven, s, of all vessels that are early, on time or late.
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
    longest : the most time to the haven, s, from any place of it, the rest of the stretch included;
        inf unless covered.
    least : no vessel on time gets to a haven in less than this, s, from any place of it.
    cause : why the last plan from a stretch that is not settled failed, or None.
    """

    begin: float
    end: float
    state: State
    diversion: Diversion | None = None
    longest: float = np.inf
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
    before, after : the ways from there: to the haven that is nearer before it, and to the one that
        is nearer after it.
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
    fuel : fuel of the whole voyage: along the route up to there, and on by the way (fuel units).
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
    within: float = np.inf
    within_fuel: float = np.inf
    endurance: float = np.inf

    def share(self, state: State) -> float:
        """Share of the route's time in a state, 0 to 1."""
        times = [one.end - one.begin for one in self.stretches if one.state == state]
        return sum(times) / (self.stretches[-1].end - self.stretches[0].begin)

    @property
    def is_covered(self) -> bool:
        """Whether the whole route is covered."""
        return all(one.state == "covered" for one in self.stretches)

    def at(self, time: float) -> Stretch:
        """Return the stretch in which a vessel on time is at a time (s)."""
        ends = [one.end for one in self.stretches]
        return self.stretches[min(int(np.searchsorted(ends, time)), len(ends) - 1)]
