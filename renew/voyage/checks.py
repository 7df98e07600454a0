"""Voyages that can't be made, refused before anything is planned."""

import itertools
import math
from collections.abc import Sequence

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
from renew.inputs.current import CurrentField
from renew.kernels.current_table import changes
from renew.kernels.overpowered_spells import overpowered_spells
from renew.voyage.voyage import Voyage

# Largest change of the current while the vessel turns by 1 rad, as a share of its speed. On a chart
# of 100 m a plan takes 1 s up to there, and half a minute beyond.
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
    # The table is made for the plan anyway; most never change as fast anywhere.
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
    """Until when the current stays as strong as the vessel at a point (2,), if it ever falls."""
    if voyage.current.is_steady:
        return Text("")
    now, speed = voyage.departure, voyage.vessel.speed
    end = overpowered_spells(voyage.table, point, speed, now, now)[:, 1].max(initial=now)
    if not now < end < math.inf:
        return Text("")
    return Text(", and the current stays so until {0}", (Moment(float(end)),))
