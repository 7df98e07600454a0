"""Few vertices around land, and few within it: simplified, then buffered by what was cut.

Nothing is joined but what overlaps then, and no vertex budget stands behind it: straits that are
wider than the margin and the tolerance on both sides need stay open, whatever their number.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from pipeline._types import FloatArray, Geometries
from pipeline.geo.coast.douglas_peucker import thinned

# Share of the tolerance that is cut before the buffer; the rest is cut after it, where that also
# removes what the buffer adds: of the shares that were tried, this one left the fewest vertices.
_BEFORE = 1 / 3
# Segments per quarter circle of a round corner. A mitre would take fewer, and shut straits between
# capes that it makes longer; most of the corner's vertices are removed again.
_QUADRANT_SEGMENTS = 5
# Factor on a buffer's radius, so that its corners, too, reach as far as the radius: GEOS rounds the
# number of segments of a corner, which may each be half as long again, and thins a line by about
# 1 % of the radius before it buffers it.
_REACH = 1.02 / math.cos(1.5 * math.pi / (4 * _QUADRANT_SEGMENTS))


def covering_land(
    polygons: Geometries, tolerance_m: float, margin_m: float, endpoints: FloatArray
) -> Geometries:
    """Cover polygons, and all within the margin of them, by disjoint polygons of fewer vertices.

    Their coast is no further than margin and tolerance (planar metres) from the land, or than 1.05
    times the margin where the tolerance is less than that. What they enclose becomes land but for
    water that holds one of the endpoints (n, 2); without endpoints it stays.
    """
    # The coast moves by the cuts, and by the buffer that covers them; what the buffer's factor adds
    # to the margin is taken from the tolerance.
    cut_m = max(0.0, tolerance_m - (_REACH - 1) * margin_m) / (1 + _REACH)
    radius_m = (cut_m + margin_m) * _REACH
    rough = thinned(_without_lakes(polygons, endpoints), _BEFORE * cut_m)
    grown = shapely.buffer(
        np.concatenate([rough.areas, rough.outlines]), radius_m, quad_segs=_QUADRANT_SEGMENTS
    )
    land = _without_lakes(_united(grown), endpoints)
    smooth = _united(thinned(land, (1 - _BEFORE) * cut_m).areas)
    # Where that encloses water anew, its islands are united with the land around.
    return _united(_without_lakes(smooth, endpoints))


def inner_land(polygons: Geometries, tolerance_m: float, margin_m: float) -> Geometries:
    """Return polygons of fewer vertices inside others, and off their coast by the margin at least.

    They overlap where those do. Land further from the coast than margin and twice the tolerance
    (planar metres; 5 % more) is inside, but for narrow necks.
    """
    rough = thinned(polygons, _BEFORE * tolerance_m)
    radius_m = (tolerance_m + margin_m) * _REACH
    shrunk = shapely.buffer(rough.areas, -radius_m, quad_segs=_QUADRANT_SEGMENTS)
    has_area = ~shapely.is_empty(rough.areas[rough.owner])
    owner = rough.owner[has_area]
    around = shapely.buffer(rough.outlines[has_area], radius_m, quad_segs=_QUADRANT_SEGMENTS)
    for index in np.unique(owner):
        shrunk[index] = shapely.difference(shrunk[index], shapely.union_all(around[owner == index]))
    cut_m = (1 - _BEFORE) * tolerance_m
    return _parts(thinned(_parts(shrunk), cut_m).areas)


def _united(areas: Geometries) -> Geometries:
    """Unite areas that overlap; the polygons returned are disjoint."""
    # Much faster here than the union of all: most of the land is apart from most of the other.
    return _parts(shapely.disjoint_subset_union_all(areas))


def _parts(areas: Geometries | BaseGeometry) -> Geometries:
    """Take areas apart into polygons."""
    parts = shapely.get_parts(areas)
    return np.asarray(parts[~shapely.is_empty(parts)])


def _without_lakes(polygons: Geometries, endpoints: FloatArray) -> Geometries:
    """Fill the holes of polygons that hold no endpoint; islands in them stay, and overlap."""
    rings, owner = shapely.get_rings(polygons, return_index=True)
    is_hole = np.diff(owner, prepend=-1) == 0
    if len(endpoints) == 0 or not is_hole.any():
        return polygons
    kept = ~is_hole
    lakes = shapely.polygons(rings[is_hole])
    held = shapely.STRtree(lakes).query(shapely.points(endpoints), predicate="intersects")[1]
    kept[np.flatnonzero(is_hole)[held]] = True
    return np.asarray(shapely.polygons(rings[kept], indices=owner[kept]))
