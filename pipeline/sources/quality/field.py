"""A current on its source's own grid, the land mask that it is checked against, and its gaps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.model import Land, Note

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


# Number of points along each side of the region's bounds at which its water is sampled.
_SAMPLES_PER_SIDE = 300


@dataclass(frozen=True, slots=True)
class WaterWithoutData:
    """Share of a region's water that is nearer to a gap than to a value.

    `distance_m` is the largest distance of such water from the nearest value; infinite where the
    field has none.
    """

    share: float
    distance_m: float

    @property
    def note(self) -> Note:
        """What a reader should know of it."""
        return Note.of("current-lacking", share=self.share, distance_m=self.distance_m)


def water_without_data(field: Field, mask: LandMask, region: Polygon) -> WaterWithoutData | None:
    """Find the water of a region (lon/lat degrees) without data; None where the land has the gaps.

    A gap at a node on land is as it should be: it counts only next to a gap at a node in water.
    """
    if not field.gap.any():
        return None
    west, south, east, north = region.bounds
    lon, lat = _samples(west, east), _samples(south, north)
    x, y = np.meshgrid(lon, lat)
    water = ~mask.on_grid(lon, lat) & shapely.intersects_xy(region, x, y)
    nearest = np.ix_(_nearest(field.lat, lat), _nearest(field.lon, lon))
    lacking = water & field.gap[nearest]
    gap_in_water = field.gap & ~mask.on_grid(field.lon, field.lat)
    if not (lacking & gap_in_water[nearest]).any():
        return None
    distance_m = _distance_m(field, np.stack([x[lacking], y[lacking]], axis=-1))
    return WaterWithoutData(float(lacking.sum() / water.sum()), distance_m)


def _samples(low: float, high: float) -> FloatArray:
    """Return the middles of equal parts of an interval."""
    return low + (high - low) * (np.arange(_SAMPLES_PER_SIDE) + 0.5) / _SAMPLES_PER_SIDE


def _nearest(axis: FloatArray, values: FloatArray) -> IndexArray:
    """Index of an ascending axis's node that is nearest to each value."""
    return np.asarray(np.searchsorted((axis[1:] + axis[:-1]) / 2, values))


def _distance_m(field: Field, points: FloatArray) -> float:
    """Largest distance of points (n, 2) in lon/lat from the nearest node with data, m."""
    from scipy.spatial import KDTree

    if field.gap.all():
        return float("inf")
    row, column = np.nonzero(~field.gap)
    nodes = np.stack([field.lon[column], field.lat[row]], axis=-1)
    per_degree = METRES_PER_DEGREE * np.array([np.cos(np.radians(points[:, 1].mean())), 1.0])
    return float(KDTree(nodes * per_degree).query(points * per_degree)[0].max())
