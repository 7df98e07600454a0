"""The offing: the distance that a route keeps off land if the scenario gives no clearance.

It is the sum of three lengths: the chart's accuracy; the distance sailed in two minutes, until
somebody acts; and, for the turn that follows, the larger of the turning circle's diameter and the
vessel's length. With land of OpenStreetMap the offing is 0.4 nautical miles for a vessel of 7 m at
9.7 knots, and 0.9 for a ship of 200 m at 15 knots.

On a short voyage, as inside a harbour or among skerries, it is at most a two-hundredth of the
distance between start and goal. In narrows it yields to a share of a passage's half-width. The
padding for hard-over turns in the current may be wider than the offing, and never yields.
"""

import math
from collections.abc import Sequence

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.model import Note, Scene, SeasonPlan
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import PlannerOptions, Scenario

# Time until a danger is noticed and the helm is over, s; an assumption, as no rule gives a value.
_REACTION_S = 120.0
# Largest offing as a share of the distance between start and goal.
_DISTANCE_SHARE = 1 / 200
# In narrows, the share of the passage's half-width that its shores keep instead of the offing.
_NARROW_SHARE = 0.5
# Spacing of the places of a route whose distance from land is measured, in offings.
_SPACING = 0.1
# Share of the offing below which a route counts as closer; the rest is left for rounding.
_CLOSER = 0.99


def with_offing(scenario: Scenario, scene: Scene, accuracy_m: float) -> PlannerOptions:
    """Return a scenario's options; without a clearance on a chart, the clearance is the offing."""
    options = scenario.planner
    if options.clearance is not None or scenario.is_planar:
        return options
    distance_m = scene.projection.geodesic_length_m(scene.stops)
    metres = offing_m(scenario.fastest_vessel, accuracy_m, distance_m)
    # In whole metres, except on the smallest charts.
    kept = float(math.floor(metres)) if metres > 1 else metres
    chosen = {
        "clearance": kept / scenario.scale,
        "narrow_share": min(options.narrow_share, _NARROW_SHARE),
    }
    return options.model_copy(update=chosen)


def offing_m(vessel: VesselSpec, accuracy_m: float, distance_m: float) -> float:
    """Return the offing, true metres, for a vessel, a chart's accuracy, and a voyage's distance."""
    circle_m = 2 * vessel.speed_m_s / math.radians(vessel.turn_rate_deg_s)
    room_m = accuracy_m + _REACTION_S * vessel.speed_m_s + max(circle_m, vessel.length_m)
    return min(room_m, _DISTANCE_SHARE * distance_m)


def narrows_notes(
    scene: Scene, plans: Sequence[SeasonPlan], options: PlannerOptions
) -> tuple[Note, ...]:
    """Return a note for each season whose best route is closer to land than the offing."""
    if not options.clearance or options.narrow_share == 1.0:
        return ()
    notes = (
        (plan.season, _narrows(scene, np.asarray(plan.ranked_routes[0].path), options.clearance))
        for plan in plans
        if plan.ranked_routes and plan.ranked_routes[0].clearance < _CLOSER * options.clearance
    )
    return tuple(note.about(season) for season, note in notes if note is not None)


def _narrows(scene: Scene, path: FloatArray, offing: float) -> Note | None:
    """Return a note on how far and where a path (n, 2) is closer to land than the offing."""
    land = np.array(scene.chart.no_go, dtype=object)
    if not len(land):
        return None
    places = shapely.get_coordinates(
        shapely.segmentize(shapely.LineString(path), _SPACING * offing)
    )
    middles = (places[1:] + places[:-1]) / 2
    _, apart = shapely.STRtree(land).query_nearest(
        shapely.points(middles), return_distance=True, all_matches=False
    )
    closer, nearest, scale = apart < _CLOSER * offing, int(apart.argmin()), scene.projection.scale
    if not closer.any():
        return None
    length = np.linalg.norm(np.diff(places, axis=0), axis=1)[closer].sum()
    return Note.of(
        "offing-yields",
        offing_m=offing * scale,
        length_m=float(length) * scale,
        least_m=float(apart[nearest]) * scale,
        place=scene.place(middles[nearest]),
    )
