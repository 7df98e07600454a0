"""Where something is known on a lon/lat grid, and how much of a path lies there."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.geo.projection import Projection

# Number of points, evenly along a path, by which its shares are measured: one in 200 m of 1,000 km,
# and a share is right to some 0.01 % for each gap that the path enters.
_SAMPLES = 5_000


@dataclass(frozen=True, slots=True)
class KnownCells:
    """Cells of a grid, each around its node: `known` (ny, nx) says which have a figure.

    `lon` (nx,) and `lat` (ny,) are the nodes, ascending, degrees; at least two of each.
    """

    lon: FloatArray
    lat: FloatArray
    known: BoolArray

    def at(self, lonlat: FloatArray) -> BoolArray:
        """Say which points (n, 2), degrees, lie in a cell with a figure; none does off the grid."""
        (column, across), (row, along) = (
            _cell(axis, lonlat[:, i]) for i, axis in enumerate((self.lon, self.lat))
        )
        return np.asarray(across & along & self.known[row, column])


def _cell(axis: FloatArray, values: FloatArray) -> tuple[IndexArray, BoolArray]:
    """Return the node nearest to each value, and whether the value is within its cell."""
    nearest = np.searchsorted((axis[1:] + axis[:-1]) / 2, values)
    low = axis[0] - (axis[1] - axis[0]) / 2
    high = axis[-1] + (axis[-1] - axis[-2]) / 2
    return nearest, (values >= low) & (values <= high)


@dataclass(frozen=True, slots=True)
class DepthCover:
    """Where a chart has depths (lon/lat degrees): in areas, and in the cells of a grid."""

    areas: tuple[shapely.Polygon, ...] = ()
    cells: KnownCells | None = None

    def at(self, lonlat: FloatArray) -> BoolArray:
        """Say at which points (n, 2), degrees, a depth is charted."""
        found = np.zeros(len(lonlat), dtype=bool) if self.cells is None else self.cells.at(lonlat)
        tree = shapely.STRtree(shapely.points(lonlat))
        found[np.unique(tree.query(np.array(self.areas, dtype=object), "intersects")[1])] = True
        return found


def share_without(
    path: FloatArray, projection: Projection, known: Callable[[FloatArray], BoolArray]
) -> float:
    """Return the share of the length of a planar path (n, 2) where something is not known."""
    line = shapely.LineString(path)
    along = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, along, normalized=True))
    lonlat = projection.to_lonlat(points)
    length = 1 / projection.point_scale(lonlat)
    return float(length[~known(lonlat)].sum() / length.sum())
