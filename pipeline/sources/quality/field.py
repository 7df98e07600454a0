"""A current on its source's own grid, and the land that it is held against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from pipeline.model import Land

    FloatArray = npt.NDArray[np.float64]
    BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Field:
    """Ascending lon (nx,) and lat (ny,) in degrees; u, v (ny, nx) m/s, NaN where no water.

    `doubts` say what speaks against it, where that is not enough to refuse it.
    """

    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    doubts: tuple[str, ...] = ()

    @property
    def gap(self) -> BoolArray:
        """Cells (ny, nx) without figures."""
        return ~(np.isfinite(self.u) & np.isfinite(self.v))

    @property
    def cell(self) -> tuple[float, float]:
        """Usual step in longitude and in latitude, degrees."""
        return float(np.median(np.diff(self.lon))), float(np.median(np.diff(self.lat)))


@dataclass(frozen=True, slots=True)
class Shore:
    """Where land is: `is_land` of lon, lat (n,) in degrees.

    It is known inside `bounds` (west, south, east, north). A cell is land where its centre is.
    """

    is_land: Callable[[FloatArray, FloatArray], BoolArray]
    bounds: tuple[float, float, float, float]

    @classmethod
    def of(cls, land: Land, bounds: tuple[float, float, float, float]) -> Shore:
        """Take a land's polygons, known in the region that they were fetched for."""
        import shapely

        tree = shapely.STRtree(land.polygons)

        def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
            found = np.zeros(lon.size, dtype=bool)
            points = shapely.points(lon, lat)
            found[np.unique(tree.query(points, predicate="intersects")[0])] = True
            return found

        return cls(is_land, bounds)

    @classmethod
    def world(cls) -> Shore:
        """Take OpenStreetMap's land the world over, as a raster of some 500 m."""
        from roaring_landmask import LandmaskProvider, RoaringMask

        mask = RoaringMask.new(LandmaskProvider.Osm)

        def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
            turned = (lon + 180) % 360 - 180
            return np.asarray(mask.contains_many(turned, np.clip(lat, -90, 90)), dtype=bool)

        return cls(is_land, (-np.inf, -90.0, np.inf, 90.0))

    def cells(self, lon: FloatArray, lat: FloatArray) -> BoolArray:
        """Which points of the grid lon (nx,), lat (ny,) are land: (ny, nx)."""
        x, y = np.meshgrid(lon, lat)
        return self.is_land(x.ravel(), y.ravel()).reshape(x.shape)
