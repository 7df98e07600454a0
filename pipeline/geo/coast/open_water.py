"""Keep start and goal in water, and connected, where only a margin or a tolerance covers them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.geo.coast.widest_way import widest_way

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    FloatArray = npt.NDArray[np.float64]
    Geometries = npt.NDArray[np.object_]

# Share of the distance from the original land that is cleared of what was added to it.
_CLEARED = 1 / 2
# How far around an endpoint the coast draws back, as a multiple of what was added to the land: a
# vessel there has room on all sides, and not only on its way.
_AROUND = 3.0


@dataclass(frozen=True, slots=True)
class OpenWater:
    """Land (m, planar polygons) that leaves start and goal in water, and connected.

    `narrowest` (x, y) is the narrowest place that had to be opened to connect them and `width_m`
    how wide it is between the original coasts; None and inf where nothing was.
    """

    land: Geometries
    narrowest: tuple[float, float] | None = None
    width_m: float = np.inf


def opened(
    land: Geometries, original: Geometries, extent: Polygon, endpoints: FloatArray, added_m: float
) -> OpenWater:
    """Take from land what covers the endpoints (n, 2), or parts them, without being original.

    `added_m` is how far the land extends beyond the original. An endpoint on original land stays on
    land, and endpoints that original land parts stay apart.
    """
    land = _drawn_back(land, original, endpoints, added_m)
    on_land = shapely.STRtree(original).query(shapely.points(endpoints), predicate="intersects")
    if len(endpoints) < 2 or on_land.size or are_connected(land, extent, endpoints):
        return OpenWater(land)
    way = widest_way(original, extent, endpoints[0], endpoints[1], added_m)
    if way is None:
        return OpenWater(land)
    near = np.unique(shapely.STRtree(way).query(land, predicate="intersects")[1])
    blocked = way[near]
    _, room_m = shapely.STRtree(original).query_nearest(
        blocked, return_distance=True, all_matches=False
    )
    narrowest = int(np.argmin(room_m))
    x, y = shapely.get_coordinates(shapely.centroid(blocked[narrowest]))[0].tolist()
    cleared = shapely.union_all(shapely.buffer(blocked, _CLEARED * np.minimum(room_m, added_m)))
    return OpenWater(_without(land, cleared), (x, y), 2 * float(room_m[narrowest]))


def are_connected(land: Geometries, extent: Polygon, endpoints: FloatArray) -> bool:
    """Say whether one body of water outside the land holds all endpoints (n, 2)."""
    water = shapely.difference(extent, shapely.multipolygons(land))
    bodies = shapely.get_parts(water)
    holds = shapely.intersects(bodies[:, None], shapely.points(endpoints))
    return bool(holds.all(axis=1).any())


def _drawn_back(
    land: Geometries, original: Geometries, endpoints: FloatArray, added_m: float
) -> Geometries:
    """Draw the coast back around the endpoints that it covers: to half of their distance."""
    tree = shapely.STRtree(original)
    for point in shapely.points(endpoints):
        if not shapely.intersects(land, point).any() or len(tree.query(point, "intersects")):
            continue
        around = shapely.buffer(point, _AROUND * added_m)
        near = original[tree.query(around, predicate="intersects")]
        near = shapely.intersection(near, around.envelope.buffer(added_m))
        room_m = _CLEARED * float(shapely.distance(near, point).min())
        kept = shapely.union_all(shapely.buffer(near, room_m))
        land = _without(land, shapely.difference(around, kept))
    return land


def _without(land: Geometries, cleared: BaseGeometry) -> Geometries:
    """Take an area from disjoint polygons."""
    meets = shapely.intersects(land, cleared)
    parts = shapely.get_parts(shapely.difference(land[meets], cleared))
    return np.concatenate([land[~meets], parts[~shapely.is_empty(parts)]])
