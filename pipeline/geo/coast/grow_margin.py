"""Grow land by a margin, with few vertices, and without covering start and goal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import shapely

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    FloatArray = npt.NDArray[np.float64]
    Geometries = npt.NDArray[np.object_]

# Maximum length of a mitred corner, as a multiple of the margin: mitres need one vertex where a
# round corner needs an arc, and lie outside of it.
_MITRE_LIMIT = 1.3
# Factor on the margin: GEOS thins a line by about 1 % of the radius before it buffers it.
_RADIUS_FACTOR = 1.02


def grow_margin(
    polygons: Geometries, margin_m: float, thinning_m: float, endpoints: FloatArray
) -> BaseGeometry:
    """Grow land by a margin (planar metres); it is thinned by up to `thinning_m`, also covered.

    Where the margin would cover one of the endpoints (n, 2), it shrinks to half of that point's
    distance from land.
    """
    # Half of the thinning comes before the buffer, which is then faster, and half after it.
    radius = (margin_m + thinning_m) * _RADIUS_FACTOR
    thin = shapely.simplify(polygons, thinning_m / 2)
    land = shapely.disjoint_subset_union_all(
        shapely.buffer(thin, radius, join_style="mitre", mitre_limit=_MITRE_LIMIT)
    )
    if thinning_m > 0:
        thin = shapely.get_parts(shapely.simplify(land, thinning_m / 2))
        land = shapely.disjoint_subset_union_all(thin)
    tree = shapely.STRtree(polygons)
    for point in shapely.points(endpoints):
        if not shapely.intersects(land, point):
            continue
        around = shapely.buffer(point, 3 * radius)
        near = polygons[tree.query(around, predicate="intersects")]
        shrunk_m = shapely.distance(near, point).min() / 2
        shrunk = shapely.union_all(shapely.buffer(shapely.intersection(near, around), shrunk_m))
        land = shapely.union(shapely.difference(land, around), shapely.intersection(shrunk, around))
    return land


def are_connected(land: BaseGeometry, extent: Polygon, endpoints: FloatArray) -> bool:
    """Say whether one body of water outside the land holds all endpoints (n, 2)."""
    bodies = shapely.get_parts(shapely.difference(extent, land))
    holds = shapely.intersects(bodies[:, None], shapely.points(endpoints))
    return bool(len(endpoints) < 2 or holds.all(axis=1).any())
