"""Water of a region for which a field of currents has no data, wherever it lies."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon

from pipeline._types import FloatArray, IndexArray
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.model.notes import Note
from pipeline.sources.quality.field import Field, LandMask

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
