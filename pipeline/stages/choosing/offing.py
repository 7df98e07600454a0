"""The offing: the distance that a route keeps off land if the scenario gives no clearance.

It is the sum of three lengths: the chart's accuracy; the distance sailed in two minutes, until
somebody acts; and, for the turn that follows, the larger of the turning circle's diameter and the
vessel's length. With land of OpenStreetMap the offing is 0.4 nautical miles for a vessel of 7 m at
9.7 knots, and 0.9 for a ship of 200 m at 15 knots.

On a short voyage, as inside a harbour or among skerries, it is at most a two-hundredth of the
distance between start and goal. If no way is that wide, the offing is halved until one is. The
padding for hard-over turns in the current may be wider than the offing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.model import Note, Scene
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import Scenario

# Time until a danger is noticed and the helm is over, s; an assumption, as no rule gives a value.
_REACTION_S = 120.0
# Largest offing as a share of the distance between start and goal.
_DISTANCE_SHARE = 1 / 200
# Number of times that an offing is halved before it is set to zero.
_HALVINGS = 5
# Largest distance of start and goal from open water, in offings: they may lie in a harbour.
_HARBOUR = 3.0
# Segments per quarter circle of the buffers; such round corners are slightly too narrow, which does
# no harm here.
_QUADRANT_SEGMENTS = 2


@dataclass(frozen=True, slots=True)
class Offing:
    """The chosen offing and the wanted one, true metres; the wanted one may leave no way."""

    metres: float
    wanted_m: float
    scale: float

    @classmethod
    def of(cls, scene: Scene, scenario: Scenario, accuracy_m: float) -> Offing:
        """Choose the offing of a scenario, given its chart's accuracy in metres."""
        scale = scenario.scale
        distance_m = scene.projection.geodesic_length_m(scene.stops)
        wanted_m = wanted_offing_m(scenario.fastest_vessel, accuracy_m, distance_m)
        planar = min(
            passable_offing(scene.chart, start, goal, wanted_m / scale)
            for start, goal in pairwise(scene.stops)
        )
        # Rounded down to whole metres, except on the smallest charts.
        metres = planar * scale
        return cls(float(math.floor(metres)) if metres > 1 else metres, wanted_m, scale)

    @property
    def planar_m(self) -> float:
        """The offing in the planner's metres."""
        return self.metres / self.scale

    @property
    def note(self) -> Note:
        """The note on the chosen offing for the report."""
        return Note.of("offing-chosen", offing_m=self.metres, wanted_m=self.wanted_m)


def wanted_offing_m(vessel: VesselSpec, accuracy_m: float, distance_m: float) -> float:
    """Return the offing, true metres, for a vessel, a chart's accuracy, and a voyage's distance."""
    circle_m = 2 * vessel.speed_m_s / math.radians(vessel.turn_rate_deg_s)
    room_m = accuracy_m + _REACTION_S * vessel.speed_m_s + max(circle_m, vessel.length_m)
    return min(room_m, _DISTANCE_SHARE * distance_m)


def passable_offing(
    chart: renew.Chart, start: FloatArray, goal: FloatArray, wanted: float
) -> float:
    """Halve an offing until a way is left from start to goal (planar metres); 0 if none is left.

    The way may begin and end a few offings from start and goal, which may lie in harbours.
    """
    land = np.array(chart.no_go, dtype=object)
    for halvings in range(_HALVINGS + 1):
        offing = wanted / 2**halvings
        taken = shapely.union_all(shapely.buffer(land, offing, quad_segs=_QUADRANT_SEGMENTS))
        water = shapely.get_parts(shapely.difference(chart.extent, taken))
        reach = _HARBOUR * offing
        near = [shapely.dwithin(water, shapely.Point(end), reach) for end in (start, goal)]
        if (near[0] & near[1]).any():
            return float(offing)
    return 0.0
