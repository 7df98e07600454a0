"""A current on its source's own grid, and the land mask that it is checked against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline._types import BoolArray, FloatArray
from pipeline.model import Land

# Depth above which a level counts as the surface, m: the uppermost level of ocean models is
# 0.5 to 1.5 m deep.
SURFACE_DEPTH_M = 2.0
# Number of points that are compared with the land at a time.
_POINTS_AT_A_TIME = 1_000_000


@dataclass(frozen=True, slots=True)
class Field:
    """Ascending lon (nx,) and lat (ny,) in degrees; u, v (ny, nx) in m/s, NaN where no data."""

    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray

    @property
    def gap(self) -> BoolArray:
        """Cells (ny, nx) without data."""
        return ~(np.isfinite(self.u) & np.isfinite(self.v))

    @property
    def cell_deg(self) -> tuple[float, float]:
        """Size of a cell in longitude and latitude, degrees: the median step of each axis."""
        return float(np.median(np.diff(self.lon))), float(np.median(np.diff(self.lat)))


@dataclass(frozen=True, slots=True)
class LandMask:
    """Where land is: `is_land` takes lon (n,) and lat (n,) in degrees.

    It is known inside `bounds` (west, south, east, north). A cell is land where its centre is.
    """

    is_land: Callable[[FloatArray, FloatArray], BoolArray]
    bounds: tuple[float, float, float, float]

    @classmethod
    def from_land(cls, land: Land, bounds: tuple[float, float, float, float]) -> LandMask:
        """Make a mask of land polygons, known in the region that they were fetched for."""
        import shapely

        polygons = np.array(land.polygons, dtype=object)

        def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
            found = np.zeros(lon.size, dtype=bool)
            # A tree of the points, not of the land: what is searched for is prepared.
            tree = shapely.STRtree(shapely.points(lon, lat))
            found[np.unique(tree.query(polygons, predicate="intersects")[1])] = True
            return found

        return cls(is_land, bounds)

    @classmethod
    def world(cls) -> LandMask:
        """Make a mask of OpenStreetMap's land of the whole world, a raster of about 500 m."""
        from roaring_landmask import LandmaskProvider, RoaringMask

        mask = RoaringMask.new(LandmaskProvider.Osm)

        def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
            wrapped = (lon + 180) % 360 - 180
            return np.asarray(mask.contains_many(wrapped, np.clip(lat, -90, 90)), dtype=bool)

        return cls(is_land, (-np.inf, -90.0, np.inf, 90.0))

    def on_grid(self, lon: FloatArray, lat: FloatArray) -> BoolArray:
        """Which points of the grid lon (nx,), lat (ny,) are land: (ny, nx)."""
        found = np.zeros((lat.size, lon.size), dtype=bool)
        # A few rows at a time: the coordinates of all nodes would take 60 times the mask's memory.
        rows = max(1, _POINTS_AT_A_TIME // max(lon.size, 1))
        for first in range(0, lat.size, rows):
            x, y = np.meshgrid(lon, lat[first : first + rows])
            found[first : first + rows] = self.is_land(x.ravel(), y.ravel()).reshape(x.shape)
        return found
