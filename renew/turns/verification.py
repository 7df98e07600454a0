"""Verification of a path by its hard-over turns: where one touches land, the padding is too small.

It tests samples, and proves nothing: a proof is behind the bound on fuel alone
(:mod:`renew.bounds`).
"""

from typing import TypeAlias

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray, IntArray
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentField, TabulatedCurrent
from renew.inputs.vessel import Vessel
from renew.kernels.capsules import segment_distance, segments_near, tracks_touch
from renew.turns.contingency import fly_turns, perturbations, stations
from renew.turns.reach_bound import MAX_DEVIATIONS, TurnReach
from renew.turns.soft_no_go import PaddedEdges
from renew.voyage.fuel import speeds_along
from renew.voyage.voyage import Voyage

_Touching: TypeAlias = tuple[FloatArray, IntArray, IntArray]

# Margin (share of v/ω) by which land is taken as wider, so that draws of another seed, or the field
# between two stations, don't find what the verification missed; growing adds the same again.
_MARGIN = 0.05
# Factor by which padding grows beyond what it lacks: the re-planned path meets another current.
_OVERSHOOT = 1.3
# Factor by which a perturbed current may carry a turn further off than the current of one turn's
# water suggests: a track that is carried off meets other water.
_ELSEWHERE = 2.0
# Distance between stations (share of v/ω), and the largest number of stations.
_SPACING, _MAX_STATIONS = 0.6, 1_000_000
# Number of headings of a turn, one every 15 degrees: chords leave its arc by under 1 % of v/ω.
_STEPS = 24
# Deviations in which turns are flown: the field itself, and the corners of the box from which
# contingency draws: a turn reaches furthest where the field deviates most.
_CORNERS = MAX_DEVIATIONS * np.array([[[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]], dtype=float)


def colliding_edges(
    path: FloatArray,
    voyage: Voyage,
    padded: PaddedEdges,
    reach: TurnReach,
    speeds: FloatArray | None = None,
) -> tuple[IntArray, FloatArray] | None:
    """Constrained edges that turns along a path touch, and by how much their padding must grow (m).

    None if no turn touches any. `reach` bounds how far a turn can get. Turns begun in the part of
    V around a start or goal that itself lies in V are left out: no padding there could help. They
    are flown at the vessel's speed, or at those (n - 1,) at which the legs are sailed.
    """
    if speeds is None:
        speeds = np.full(len(path) - 1, voyage.vessel.speed)
    if not len(padded.edge):
        return None
    chart, vessel = voyage.chart, voyage.vessel
    field, astray = _flown_in(voyage)
    margin = _MARGIN * vessel.turning_radius + astray
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    spacing = max(_SPACING * vessel.turning_radius, length / _MAX_STATIONS)
    points, course, times = passed_stations(path, spacing, voyage)
    speed = speeds_along(points, path, speeds)
    # Only turns within reach of land can touch it: most of a long way needs no flying.
    furthest = reach(points)
    first, near = segments_near(points, furthest + margin, padded.start, padded.end)
    close = np.flatnonzero(np.diff(first))
    close = close[~in_soft_endpoints(points[close], voyage, padded)]

    def touching(chosen: IntArray, radius: FloatArray, deviations: FloatArray) -> _Touching:
        begin = times[chosen]
        flown, at = (points[chosen], course[chosen]), speed[chosen]
        turns = fly_turns(*flown, field, vessel, deviations, begin, _STEPS, at)
        edges = np.concatenate([near[first[i] : first[i + 1]] for i in chosen])
        bounds = np.concatenate([[0], np.cumsum(np.diff(first)[chosen])])
        return turns, *tracks_touch(turns, bounds, edges, padded.start, padded.end, radius)

    if len(close):
        # Perturbed turns are not flown where the unperturbed one stays too far off for any of them.
        drift = (furthest[close] - 2 * vessel.turning_radius) / 2
        off = _max_offset(points[close], field, vessel, drift, times[close])
        turns, track, _ = touching(close, margin + off, _CORNERS[:, :1])
        close = close[np.unique(track // turns.shape[1])]
    if not len(close):
        return None
    turns, track, edge = touching(close, np.full(len(close), margin), _CORNERS)
    if not len(track):
        return None
    tracks = turns.reshape(-1, *turns.shape[2:])
    hit, back = np.unique(track, return_inverse=True)
    return padded.edge[edge], _OVERSHOOT * _depths(tracks[hit], chart)[back] + 2 * margin


def _flown_in(voyage: Voyage) -> tuple[CurrentField, float]:
    """The current that turns are flown in, and how far off their tracks that may bring them (m).

    The table if that is fine, or if its error brings them astray by little beside the margin: a
    table of many slices may not be fine for want of memory.
    """
    table, vessel = voyage.table, voyage.vessel
    astray = _ELSEWHERE * table.error * vessel.turn_period
    if table.is_fine or astray > _MARGIN / 2 * vessel.turning_radius:
        return voyage.waters.quick_current, 0.0
    return TabulatedCurrent(table), astray


def passed_stations(
    path: FloatArray, spacing: float, voyage: Voyage
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stations (n, 2) along a path, the course (n,) rad there, and times (n,), s, of passage.

    In a current that changes each is there three times: passed early, on time and late.
    """
    points, course = stations(path, spacing)
    times = voyage.reading_times(points)
    if voyage.current.is_steady:
        return points, course, times
    early, late = voyage.early_and_late(times)
    begin = np.stack([early, times, late], axis=1)
    return np.repeat(points, 3, axis=0), np.repeat(course, 3), begin.ravel()


def _max_offset(
    points: FloatArray, field: CurrentField, vessel: Vessel, drift: FloatArray, times: FloatArray
) -> FloatArray:
    """How far perturbations can carry a turn off its own track (n,), m; `drift` (n,) its own, m."""
    speed_change, direction_change = perturbations(points, field, vessel, _CORNERS[:, 1:2], times)
    return _ELSEWHERE * (vessel.turn_period * speed_change[:, 0] + drift * direction_change[:, 0])


def _depths(tracks: FloatArray, chart: Chart) -> FloatArray:
    """How deep each track (n, steps, 2) goes into the no-go zone (n,), m."""
    points = tracks.reshape(-1, 2)
    inside = shapely.contains_xy(chart.hard_no_go, points)
    depth = np.zeros(len(points))
    depth[inside] = shapely.distance(shapely.points(points[inside]), chart.hard_no_go.boundary)
    return np.asarray(depth.reshape(tracks.shape[:2]).max(axis=1))


def in_soft_endpoints(points: FloatArray, voyage: Voyage, padded: PaddedEdges) -> BoolArray:
    """Whether points (n, 2) lie in the part of V around a start or goal inside V."""
    inside = np.zeros(len(points), dtype=bool)
    for endpoint in (voyage.start, voyage.goal):
        around = padded.around(endpoint)
        if len(around.edge):
            apart = segment_distance(points[:, None], around.start, around.end)
            inside |= (apart < around.padding).any(axis=1)
    return inside
