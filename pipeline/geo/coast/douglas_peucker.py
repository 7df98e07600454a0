"""Simplifies areas by Douglas and Peucker's algorithm; a buffer by the cut bounds the change.

Douglas and Peucker, *Algorithms for the reduction of the number of points required to represent a
digitized line or its caricature*, 1973.

Every ring is simplified by itself. The ring can be deformed into the simplified one
with no point moving by more than the cut. So a point that is further than the cut from the
simplified ring is inside it if and only if it was inside the original: a buffer outwards by the cut
covers the area, and a buffer inwards lies within it. (shapely's own simplification of polygons
drops lobes where a ring crosses itself.)
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from pipeline._types import Geometries

# Number of coordinates of the shortest ring: a closed triangle.
_MIN_RING = 4


@dataclass(frozen=True, slots=True)
class Thinned:
    """Areas (n,) of fewer vertices: valid, some of them empty or in several parts.

    `outlines` are parts of simplified rings that bound no area, because a ring crosses itself or
    collapsed to a line; `owner` has the indices of their areas. The cut is measured from them too.
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
    """Build polygons (count,) of closed lines, the shell first; empty if there are no lines."""
    areas = np.full(count, shapely.Polygon(), dtype=object)
    if len(lines):
        points, ring = shapely.get_coordinates(lines, return_index=True)
        there, polygon = np.unique(owner, return_inverse=True)
        areas[there] = shapely.polygons(shapely.linearrings(points, indices=ring), indices=polygon)
    return areas


def _open_where_collapsed(lines: Geometries) -> Geometries:
    """Turn closed lines that lead to a point and back into open lines to that point."""
    opened = lines.copy()
    collapsed = shapely.get_num_coordinates(lines) < _MIN_RING
    ends = [shapely.get_point(lines[collapsed], i) for i in (0, 1)]
    opened[collapsed] = shapely.linestrings(
        np.stack([shapely.get_coordinates(end) for end in ends], axis=1)
    )
    return opened
