"""Simplify areas by Douglas and Peucker's algorithm, so that the cut can be covered or left out.

Douglas and Peucker, *Algorithms for the reduction of the number of points required to represent a
digitized line or its caricature*, 1973.

Every ring is simplified by itself. It can be moved onto the simplified ring without any of its
points moving by more than the cut, so that a point further than the cut from the simplified ring is
inside it exactly where it was inside the ring: a buffer outwards by the cut covers the area, one
inwards lies within it. (shapely's own simplification of polygons drops the lobes of a ring that
comes to cross itself.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from pipeline._types import Geometries

# Number of coordinates of the shortest ring: a triangle, closed.
_MIN_RING = 4


@dataclass(frozen=True, slots=True)
class Thinned:
    """Areas (n,) of fewer vertices: valid, some of them empty or in several parts.

    `outlines` are the parts of simplified rings that are no boundary of an area (`owner`, their
    indices), because a ring crosses itself or collapsed to a line: the cut counts from these, too.
    """

    areas: Geometries
    outlines: Geometries
    owner: npt.NDArray[np.intp]


def thinned(polygons: Geometries, cut_m: float) -> Thinned:
    """Remove vertices of polygons (n,) by moving no part of a ring further than the cut."""
    rings, owner = shapely.get_rings(polygons, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    lines = shapely.linestrings(points, indices=ring)
    lines = shapely.simplify(lines, cut_m, preserve_topology=False)
    size = shapely.get_num_coordinates(lines)
    is_shell = np.diff(owner, prepend=-1) != 0
    has_area = (size >= _MIN_RING) & (size[is_shell] >= _MIN_RING)[owner]
    areas = _from_rings(lines[has_area], owner[has_area], len(polygons))
    crossed = ~shapely.is_valid(areas)
    areas[crossed] = shapely.make_valid(areas[crossed], method="structure", keep_collapsed=False)
    lines[~has_area] = _open_where_collapsed(lines[~has_area])
    inside = has_area & crossed[owner]
    lines[inside] = shapely.difference(lines[inside], shapely.boundary(areas[owner[inside]]))
    outlined = (~has_area | inside) & ~shapely.is_empty(lines)
    return Thinned(areas, lines[outlined], owner[outlined])


def _from_rings(lines: Geometries, owner: npt.NDArray[np.intp], count: int) -> Geometries:
    """Build polygons (count,) of closed lines, the shell first; empty where there is none."""
    areas = np.full(count, shapely.Polygon(), dtype=object)
    if len(lines):
        points, ring = shapely.get_coordinates(lines, return_index=True)
        there, polygon = np.unique(owner, return_inverse=True)
        areas[there] = shapely.polygons(shapely.linearrings(points, indices=ring), indices=polygon)
    return areas


def _open_where_collapsed(lines: Geometries) -> Geometries:
    """Turn lines that lead to a point and back into lines to that point: they have ends, then."""
    opened = lines.copy()
    collapsed = shapely.get_num_coordinates(lines) < _MIN_RING
    ends = [shapely.get_point(lines[collapsed], i) for i in (0, 1)]
    opened[collapsed] = shapely.linestrings(
        np.stack([shapely.get_coordinates(end) for end in ends], axis=1)
    )
    return opened
