"""Lon/lat: the earth's size, bounds of regions, and where something is known on a grid.

Exact lengths are geodesics, by pyproj.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from pipeline._types import ArrayLike, BoolArray, FloatArray, IndexArray
from pipeline.geo.projection import Projection

# Mean radius of the earth, m: (2a + b)/3 of the ellipsoid GRS 80, which is WGS 84's to 0.1 mm
# (Moritz, Geodetic Reference System 1980, Journal of Geodesy 74, 2000).
EARTH_RADIUS_M = 6_371_008.8
# Length of a degree of latitude, m: on a sphere of that radius, rounded. On the ellipsoid it is
# 110,574 m at the equator and 111,694 m at the poles, so this is off by at most 0.6 %.
METRES_PER_DEGREE = 111_195.0


def position_text(lon: float, lat: float) -> str:
    """Write a position in degrees, by its hemispheres: 119.8710 E 11.5244 N, 70.9815 W 42.3427 N.

    On a chart across 180 degrees, longitudes may exceed 180.
    """
    east = (lon + 180) % 360 - 180
    return f"{abs(east):.4f} {'W' if east < 0 else 'E'} {abs(lat):.4f} {'S' if lat < 0 else 'N'}"


Bounds = tuple[float, float, float, float]
"""West, south, east, north in degrees."""

# Cells that a source adds around the region, so that currents at its edge are interpolated.
MARGIN_CELLS = 2.5


def bounds_of(points: ArrayLike) -> Bounds:
    """Return the bounds of points (n, 2), or of several bounds (n, 4)."""
    places = np.reshape(np.asarray(points, dtype=float), (-1, 2))
    (west, south), (east, north) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    return west, south, east, north


def widened(bounds: Bounds, lon_deg: float, lat_deg: float) -> Bounds:
    """Return bounds with a margin on each side."""
    west, south, east, north = bounds
    return west - lon_deg, south - lat_deg, east + lon_deg, north + lat_deg


def cell_bounds(lon: FloatArray, lat: FloatArray, cell_deg: tuple[float, float]) -> Bounds:
    """Return outer edges of the cells around a grid's ascending nodes: half a cell beyond these."""
    nodes = (float(lon[0]), float(lat[0]), float(lon[-1]), float(lat[-1]))
    return widened(nodes, cell_deg[0] / 2, cell_deg[1] / 2)


def sides_beyond(region: Bounds, grid: Bounds) -> list[str]:
    """Name each side on which a region reaches beyond a grid, with the grid's limit there."""
    return [
        f"{side} of {limit:g} (the region reaches {reached:g})"
        for side, limit, reached, is_beyond in (
            ("west", grid[0], region[0], region[0] < grid[0]),
            ("south", grid[1], region[1], region[1] < grid[1]),
            ("east", grid[2], region[2], region[2] > grid[2]),
            ("north", grid[3], region[3], region[3] > grid[3]),
        )
        if is_beyond
    ]


def common_bounds(one: Bounds, other: Bounds) -> Bounds | None:
    """Return the intersection of two bounds; None if it is empty."""
    west, south = max(one[0], other[0]), max(one[1], other[1])
    east, north = min(one[2], other[2]), min(one[3], other[3])
    return (west, south, east, north) if west < east and south < north else None


# Number of evenly spaced points at which shares of a path are measured: every 200 m of 1,000 km.
# The error of a share is about 0.01 % per gap that the path enters.
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
        is_charted = (
            np.zeros(len(lonlat), dtype=bool) if self.cells is None else self.cells.at(lonlat)
        )
        tree = shapely.STRtree(shapely.points(lonlat))
        is_charted[np.unique(tree.query(np.array(self.areas, dtype=object), "intersects")[1])] = (
            True
        )
        return is_charted


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
