"""The request for a plan: checks that refuse it at once, and the class planners for it."""

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import (
    CurrentTooStrongError,
    GoalInNoGoError,
    Moment,
    ParameterError,
    PlanningError,
    StartInNoGoError,
    Text,
    ViaInNoGoError,
)
from renew.inputs.asked import Asked
from renew.inputs.current import CurrentField
from renew.inputs.shut_areas import Area, polygons_of
from renew.kernels.current_table import changes, overpowered_spells
from renew.planner.one_class import ClassPlanner
from renew.planner.problem import Problem
from renew.voyage.voyage import NO_CHOICE, SpeedChoice, Voyage, Waters

# Largest change of the current while the vessel turns by 1 rad, as a share of its speed. On a chart
# of 100 m a plan takes 1 s up to this change, and half a minute above it.
_MAX_PACE = 0.5


def check_endpoints(voyage: Voyage) -> None:
    """Refuse stops that are not in the water, all at once, and a departure without a current."""
    chart, stops = voyage.chart, voyage.stops
    names = ["start", *(f"via[{at}]" for at in range(len(voyage.via))), "goal"]
    kinds = [StartInNoGoError, *[ViaInNoGoError] * len(voyage.via), GoalInNoGoError]
    faults, places = list[str](), list[FloatArray]()
    error: type[PlanningError] | None = None
    for name, kind, point in zip(names, kinds, stops, strict=True):
        here = shapely.Point(point)
        # Water is snapped to the chart's grid: a point on its edge may lie just outside.
        if not shapely.dwithin(chart.water, here, 4 * chart.precision):
            nearest = shapely.get_coordinates(shapely.shortest_line(here, chart.water))[-1].round(3)
            where = "in the no-go zone" if shapely.covers(chart.extent, here) else "off the chart"
            faults.append(
                f"{name} {{{len(places)}}} lies {where}, {math.dist(point, nearest):.4g} m from "
                f"the nearest water at {{{len(places) + 1}}}; move it there or beyond"
            )
            places += [point, nearest]
            error = error or kind
    for (one, here), (other, after) in itertools.pairwise(zip(names, stops, strict=True)):
        if math.dist(here, after) <= chart.precision:
            faults.append(f"{one} and {other} are the same point {{{len(places)}}}; move one")
            places.append(here)
            error = error or ParameterError
    if error is not None:
        raise error("; ".join(faults), *places)
    check_departures(voyage.current, (voyage.departure,))


def check_departures(current: CurrentField, departures: Sequence[float]) -> None:
    """Refuse departures (s) outside the times for which the current is known."""
    first, last = current.span
    for departure in departures:
        if not first <= departure < last:
            raise ParameterError(
                "departure = {0} lies outside the times for which the current is known, {1} to {2}",
                *(Moment(float(one)) for one in (departure, first, last)),
            )


def check_pace(voyage: Voyage) -> None:
    """Refuse a current that changes faster than the vessel can turn.

    It would have to be followed in steps so short that a plan takes minutes, and finds nothing that
    can be steered. A single jump is let through.
    """
    vessel = voyage.vessel
    limit = _MAX_PACE * vessel.speed * vessel.turn_rate
    # The table is made for the plan anyway; most currents never change that fast.
    if voyage.current.is_steady or voyage.waters.current_change <= limit:
        return
    change = float(np.quantile(changes(voyage.table), 0.5, method="lower"))
    if change > limit:
        raise ParameterError(
            f"the current changes by {change:.3g} m/s each second; more than {limit:.3g} m/s a "
            f"second can't be followed by a vessel of "
            f"{vessel.speed:.3g} m/s that turns by {math.degrees(vessel.turn_rate):.3g}° a second. "
            f"Give the current's mean over {vessel.turn_period:.3g} s or more, or a vessel that "
            "turns faster"
        )


def check_current_at_endpoints(voyage: Voyage) -> None:
    """Refuse a departure at which the current at a stop is as strong as the vessel."""
    # In a current that changes it is not known yet when the vessel comes to the goal.
    names = ["start", *(f"via[{at}]" for at in range(len(voyage.via))), "goal"]
    ends = list(zip(names, voyage.stops, strict=True))
    ends = ends if voyage.current.is_steady else ends[:1]
    for name, point in ends:
        strength = float(np.linalg.norm(voyage.current.velocity(point, voyage.departure)))
        if strength >= voyage.vessel.speed:
            raise CurrentTooStrongError(
                f"the current at the {name} runs at {strength:.3g} m/s; the vessel makes "
                f"{voyage.vessel.speed:.3g} m/s through water{{0}}. Take a faster vessel or "
                f"another {name}",
                _until(voyage, point),
            )


def _until(voyage: Voyage, point: FloatArray) -> Text:
    """Say until when the current at a point (2,) stays as strong as the vessel; empty if always."""
    if voyage.current.is_steady:
        return Text("")
    now, speed = voyage.departure, voyage.vessel.speed
    end = overpowered_spells(voyage.table, point, speed, now, now)[:, 1].max(initial=now)
    if not now < end < math.inf:
        return Text("")
    return Text(", and the current stays so until {0}", (Moment(float(end)),))


@dataclass(frozen=True, eq=False)
class Task(Asked):
    """What is asked of a plan, with its planners: the same water is triangulated once.

    If another voyage, `like`, has the same water and current, what its planner knows is shared.
    """

    like: "Task | None" = None
    _planners: dict[object, ClassPlanner] = field(default_factory=dict)

    @cached_property
    def waters(self) -> Waters:
        """The chart and the current, with what all voyages there share."""
        if self.like:
            return self.like.waters
        members = tuple(Waters(self.chart, one) for one in self.members)
        return Waters(self.chart, self.current, members)

    @property
    def deadline(self) -> float:
        """Latest arrival (s) with a choice of speeds, at most the end of the current's data."""
        last, arrive_by = self.current.span[1], self.request.arrive_by
        return float(last if arrive_by is None else min(arrive_by, last))

    def planner(self, closed: Collection[Area] = (), most: float | None = None) -> ClassPlanner:
        """Return the planner at the first departure, for speeds up to `most` (m/s).

        Areas in `closed` are closed like land. Without a choice of speeds it uses the vessel's own.
        """
        key = frozenset(closed), most
        if key not in self._planners:
            self._planners[key] = self._new_planner(closed, most)
        return self._planners[key]

    def _new_planner(self, closed: Collection[Area], most: float | None) -> ClassPlanner:
        """Make a planner; raise an error for stops on land, or a current that changes too fast."""
        chart, vessel, request = self.chart, self.vessel, self.request
        if closed:
            polygons = polygons_of([area for area in self.areas if area in closed])
            chart = chart.without(polygons, is_land=False)
        choice = NO_CHOICE
        if request.speed is not None:
            least, highest = map(float, request.speed)
            choice = SpeedChoice(least, deadline=self.deadline)
            vessel = replace(vessel, speed=highest if most is None else most)
        voyage = Voyage(
            Waters(chart, self.current) if closed else self.waters,
            vessel,
            self.stops[0],
            self.stops[-1],
            request.drift,
            float(request.departure),
            float(request.lateness),
            float(request.min_lateness),
            self.stops[1:-1],
            choice=choice,
        )
        check_endpoints(voyage)
        check_pace(voyage)
        if self.like is not None and not closed:
            known = self.like.planner()
            return known.for_problem(known.problem.with_voyage(voyage))
        return ClassPlanner(Problem(voyage, request), request)
