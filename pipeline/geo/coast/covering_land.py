"""Polygons of few vertices around land, or inside it: simplified, then buffered by the cut.

Only polygons that overlap afterwards are joined, and there is no limit on vertices: every strait
stays open that is wider than twice the margin and the tolerance together.
"""

import math

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from pipeline._types import FloatArray, Geometries
from pipeline.geo.coast.douglas_peucker import thinned

# Share of the tolerance that is cut before the buffer. The rest is cut after it, which also removes
# vertices that the buffer adds. Of the shares that were tried, this left the fewest vertices.
_BEFORE = 1 / 3
# Segments per quarter circle of a round corner, most of whose vertices are removed again. A mitre
# would take fewer, but make capes longer, and so shut straits between them.
_QUADRANT_SEGMENTS = 5
# Factor on a buffer's radius, so that its corners also reach as far as the radius: GEOS rounds the
# number of segments of a corner, so that each may be half as long again, and simplifies a line by
# about 1 % of the radius before it buffers the line.
_REACH = 1.02 / math.cos(1.5 * math.pi / (4 * _QUADRANT_SEGMENTS))


def covering_land(
    polygons: Geometries, tolerance_m: float, margin_m: float, endpoints: FloatArray
) -> Geometries:
    """Cover polygons and a margin around them by disjoint polygons of fewer vertices.

    The new coast is at most margin plus tolerance (planar metres) from the land, or 1.05 times the
    margin if that is more. Enclosed water becomes land, unless it holds one of the endpoints
    (n, 2); without endpoints it stays water.
    """
    # The cuts and the buffer that covers them move the coast; the tolerance is reduced by the
    # amount that the buffer's factor adds to the margin.
    cut_m = max(0.0, tolerance_m - (_REACH - 1) * margin_m) / (1 + _REACH)
    radius_m = (cut_m + margin_m) * _REACH
    rough = thinned(_without_lakes(polygons, endpoints), _BEFORE * cut_m)
    grown = shapely.buffer(
        np.concatenate([rough.areas, rough.outlines]), radius_m, quad_segs=_QUADRANT_SEGMENTS
    )
    land = _without_lakes(_united(grown), endpoints)
    smooth = _united(thinned(land, (1 - _BEFORE) * cut_m).areas)
    # Filling may enclose other water: its islands are united with the land around.
    return _united(_without_lakes(smooth, endpoints))


def inner_land(polygons: Geometries, tolerance_m: float, margin_m: float) -> Geometries:
    """Return polygons of fewer vertices inside others, at least the margin away from their coast.

    They overlap where the given ones do. All land further from the coast than margin plus twice the
    tolerance (planar metres; 5 % more) is inside, except for narrow necks.
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
    # Much faster than one union of all: most polygons are far from each other.
    return _parts(shapely.disjoint_subset_union_all(areas))


def _parts(areas: Geometries | BaseGeometry) -> Geometries:
    """Split areas into polygons."""
    parts = shapely.get_parts(areas)
    return np.asarray(parts[~shapely.is_empty(parts)])


def _without_lakes(polygons: Geometries, endpoints: FloatArray) -> Geometries:
    """Fill holes of polygons that hold no endpoint; islands in a hole stay and overlap."""
    rings, owner = shapely.get_rings(polygons, return_index=True)
    is_hole = np.diff(owner, prepend=-1) == 0
    if len(endpoints) == 0 or not is_hole.any():
        return polygons
    kept = ~is_hole
    lakes = shapely.polygons(rings[is_hole])
    held = shapely.STRtree(lakes).query(shapely.points(endpoints), predicate="intersects")[1]
    kept[np.flatnonzero(is_hole)[held]] = True
    return np.asarray(shapely.polygons(rings[kept], indices=owner[kept]))
