"""Find the islands of the catalogue (`catalog/islands.csv`) in a scene's land.

A polygon of land is an island of the catalogue on three conditions. It lies in the island's bounds
and is about as large. It contains the island's own point, or reaches as far as the island on every
side. If the region cuts the island, only the sides inside the region are compared, and there must
be two of them unless the polygon contains the point. So a continent never has an island's name, and
only one of two pieces of an island can have it.
"""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries, IndexArray
from pipeline.geo.lonlat import METRES_PER_DEGREE
from pipeline.model import PlaceName, Scene
from pipeline.scenario import catalogue

# Largest distance between a side and the catalogue's: degrees, and a share of the island's extent.
# The catalogue is drawn at 1:10m, where outlines are off by kilometres.
_OFF_DEG, _OFF_SHARE = 0.05, 0.1
# Least and largest area of a polygon, in areas of the island: the catalogue's outlines can lie far
# from the coast.
_LEAST, _MOST = 0.4, 1.6
# Least area of a piece of an island that the region cuts.
_LEAST_PIECE = 0.02
# Number of compared sides that is enough without the island's point.
_SIDES = 2
# Step of points on an island's bounds, because the sides are curved in the plane, true metres.
_FRAME_STEP_M = 50_000.0
# Signs of west, south, east and north: outwards is positive.
_OUTWARDS = np.array([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Island:
    """An island of the catalogue: a point on it, its west, south, east and north sides, area."""

    name: str
    lon: float
    lat: float
    bounds: tuple[float, float, float, float]
    area_km2: float

    def moved(self, turns: int) -> "Island":
        """Return the island with its longitudes shifted by whole turns."""
        west, south, east, north = self.bounds
        by = 360.0 * turns
        return Island(
            self.name, self.lon + by, self.lat, (west + by, south, east + by, north), self.area_km2
        )


@cache
def islands() -> tuple[Island, ...]:
    """Return the catalogue's islands."""
    with catalogue.islands().open(encoding="utf-8", newline="") as file:
        return tuple(
            Island(
                row["name"],
                float(row["lon"]),
                float(row["lat"]),
                (float(row["west"]), float(row["south"]), float(row["east"]), float(row["north"])),
                float(row["area_km2"]),
            )
            for row in csv.DictReader(file)
        )


def island_places(scene: Scene) -> tuple[PlaceName, ...]:
    """Return a place for each polygon of land that is an island of the catalogue."""
    return () if scene.is_planar or not scene.land else tuple(_Finder(scene).places())


@dataclass(frozen=True)
class _Finder:
    """Finds islands in one scene."""

    scene: Scene

    def places(self) -> Iterator[PlaceName]:
        """Yield a point and the name of each polygon that is an island."""
        found: dict[int, Island] = {}
        for island in self._in_region():
            at = self._polygon(island)
            if at is not None and self._fits_better(at, island, found.get(at)):
                found[at] = island
        for at, island in found.items():
            point = shapely.get_coordinates(shapely.point_on_surface(self._land[at]))[0]
            lon, lat = self.scene.projection.to_lonlat(point).tolist()
            area_deg2 = island.area_km2 * 1e6 / METRES_PER_DEGREE**2
            yield PlaceName(island.name, lon, lat, area_deg2)

    def _in_region(self) -> Iterator[Island]:
        """Yield the islands whose bounds meet the region's, in its longitudes."""
        west, south, east, north = self._region
        for island in islands():
            at_home = island.moved(round(((west + east) / 2 - island.lon) / 360))
            bounds = at_home.bounds
            if bounds[0] < east and bounds[2] > west and bounds[1] < north and bounds[3] > south:
                yield at_home

    def _polygon(self, island: Island) -> int | None:
        """Return the index of an island's polygon; None if there is none, or several may be it."""
        plane = self.scene.projection
        point = shapely.Point(plane.to_plane(np.array([island.lon, island.lat])))
        near = self._alike(self._tree.query(point, "intersects"), island, sides=0)
        if not len(near):
            frame = plane.geometry_to_plane(shapely.box(*island.bounds), _FRAME_STEP_M)
            near = self._alike(self._tree.query(frame, "intersects"), island, sides=_SIDES)
        return int(near[0]) if len(near) == 1 else None

    def _alike(self, near: IndexArray, island: Island, sides: int) -> IndexArray:
        """Return the polygons that can be an island by their areas and bounds.

        If `sides` is not 0, at least `sides` sides of the island must be inside the region, and
        all of these must agree with the polygon's.
        """
        expected = np.array(island.bounds)
        is_seen = _OUTWARDS * (np.array(self._region) - expected) >= 0
        if is_seen.sum() < sides:
            return near[:0]
        size = self._area_km2[near] / island.area_km2
        near = near[(size <= _MOST) & (size >= (_LEAST if is_seen.all() else _LEAST_PIECE))]
        beyond = _OUTWARDS * (self._bounds(near) - expected)
        off = _OFF_DEG + _OFF_SHARE * np.tile(expected[2:] - expected[:2], 2)
        fits = (beyond <= off).all(axis=1)
        if sides:
            fits &= (beyond[:, is_seen] >= -off[is_seen]).all(axis=1)
        return np.asarray(near[fits])

    def _fits_better(self, at: int, island: Island, than: Island | None) -> bool:
        """Whether a polygon's area is closer to an island's than to another's."""
        if than is None:
            return True
        area = float(self._area_km2[at])
        return abs(math.log(area / island.area_km2)) < abs(math.log(area / than.area_km2))

    def _bounds(self, near: IndexArray) -> FloatArray:
        """Return the west, south, east and north sides (n, 4) of polygons, degrees."""
        if not len(near):
            return np.empty((0, 4))
        # Hulls keep the outermost points and have few others, so this is quicker.
        hulls = shapely.convex_hull(self._land[near])
        points, owner = shapely.get_coordinates(hulls, return_index=True)
        lonlat = self.scene.projection.to_lonlat(points)
        first = np.searchsorted(owner, np.arange(len(near)))
        sides = (np.minimum.reduceat(lonlat, first), np.maximum.reduceat(lonlat, first))
        return np.hstack(sides)

    @cached_property
    def _area_km2(self) -> FloatArray:
        return np.asarray(shapely.area(self._land)) * self.scene.projection.scale**2 / 1e6

    @cached_property
    def _land(self) -> Geometries:
        return np.array(self.scene.land, dtype=object)

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(self._land)

    @cached_property
    def _region(self) -> tuple[float, float, float, float]:
        """The region's west, south, east and north side, degrees."""
        corners = shapely.get_coordinates(self.scene.chart.extent)
        lonlat = self.scene.projection.to_lonlat(corners)
        (west, south), (east, north) = lonlat.min(axis=0), lonlat.max(axis=0)
        return float(west), float(south), float(east), float(north)
