"""Proof of a path by its contingency turns: where one touches land, the padding there is short."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray, IntArray
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentField
from renew.inputs.vessel import Vessel
from renew.kernels.capsules import near_segments, segment_distance, tracks_touch
from renew.padding.padding_model import Hazards
from renew.turns.contingency import changes, fly_turns, stations
from renew.turns.reach_bound import MOST_DEVIATIONS, TurnReach

_Touching: TypeAlias = tuple[FloatArray, IntArray, IntArray]


# Turns are proved against land this much wider (share of v/ω), so that draws of another seed,
# or the field between two stations, don't find what these missed; growing adds as much again.
_MARGIN = 0.05
# What is short is overdone by this factor: the path that gives way meets other water.
_OVERDONE = 1.3
# Stations of the proof stand this share of v/ω apart.
_SPACING = 0.6
_MOST_STATIONS = 1_000_000
# Headings of a proof's turn, every 15 degrees: chords leave its arc by under 1 % of v/ω.
_STEPS = 24
# The field itself, and the corners of the box from which contingency draws its deviations: a
# turn reaches furthest where the field deviates most.
_CORNERS = MOST_DEVIATIONS * np.array([[[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]], dtype=float)


def padding_shortfall(
    path: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    hazards: Hazards,
    chart: Chart,
    field: CurrentField,
    reach: TurnReach,
    vessel: Vessel,
) -> tuple[IntArray, FloatArray] | None:
    """Constrained edges that turns along a path touch, and what their padding is short of (m).

    None if no turn touches any. `reach` bounds how far a turn can get. Turns begun in the part of
    V around a start or goal that itself lies in V are left out: no padding there could help.
    """
    if not len(hazards.edge):
        return None
    margin = _MARGIN * vessel.turning_radius
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    spacing = max(_SPACING * vessel.turning_radius, length / _MOST_STATIONS)
    points, course = stations(path, spacing)
    # Only turns within reach of land can touch it: most of a long way needs no flying.
    furthest = reach(points)
    first, near = near_segments(points, furthest + margin, hazards.start, hazards.end)
    close = np.flatnonzero(np.diff(first))
    close = close[~_in_soft_ends(points[close], ends, hazards)]

    def touching(chosen: IntArray, radius: FloatArray, deviations: FloatArray) -> _Touching:
        turns = fly_turns(points[chosen], course[chosen], field, vessel, deviations, steps=_STEPS)
        counts = np.diff(first)[chosen]
        own = [near[first[i] : first[i + 1]] for i in chosen]
        bounds = np.concatenate([[0], np.cumsum(counts)])
        edges = hazards.start, hazards.end
        return turns, *tracks_touch(turns, bounds, np.concatenate(own), *edges, radius)

    if len(close):
        # Nor need the field be changed where its own turns stay so far off that none gets there.
        drift = (furthest[close] - 2 * vessel.turning_radius) / 2
        off = _furthest_off(points[close], field, vessel, drift)
        turns, track, _ = touching(close, margin + off, _CORNERS[:, :1])
        close = close[np.unique(track // turns.shape[1])]
    if not len(close):
        return None
    turns, track, edge = touching(close, np.full(len(close), margin), _CORNERS)
    if not len(track):
        return None
    tracks = turns.reshape(-1, *turns.shape[2:])
    hit, back = np.unique(track, return_inverse=True)
    return hazards.edge[edge], _OVERDONE * _depths(tracks[hit], chart)[back] + 2 * margin


def _furthest_off(
    points: FloatArray, field: CurrentField, vessel: Vessel, drift: FloatArray
) -> FloatArray:
    """How far the field's changes can carry a turn off its own track (n,), m; `drift` its own, m.

    The changes of one turn's water, twice: a track that is carried off meets other water.
    """
    faster, turned = changes(points, field, vessel, _CORNERS[:, 1:2])
    return 2 * (vessel.turn_period * faster[:, 0] + drift * turned[:, 0])


def _depths(tracks: FloatArray, chart: Chart) -> FloatArray:
    """How deep each track (n, steps, 2) goes into the no-go zone (n,), m."""
    points = tracks.reshape(-1, 2)
    inside = shapely.contains_xy(chart.hard_no_go, points)
    depth = np.zeros(len(points))
    depth[inside] = shapely.distance(shapely.points(points[inside]), chart.hard_no_go.boundary)
    return np.asarray(depth.reshape(tracks.shape[:2]).max(axis=1))


def _in_soft_ends(
    points: FloatArray, ends: tuple[FloatArray, FloatArray], hazards: Hazards
) -> BoolArray:
    """Whether points (n, 2) lie in the part of V around an end inside V."""
    inside = np.zeros(len(points), dtype=bool)
    for end in ends:
        around = hazards.around(end)
        if len(around.edge):
            apart = segment_distance(points[:, None], around.start, around.end)
            inside |= (apart < around.padding).any(axis=1)
    return inside
