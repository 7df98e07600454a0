"""A current on its source's own grid, the land mask that it is checked against, gaps and shifts.

A field may be shifted against the land. So its gaps are compared with the land, in place and at
trial offsets. In many fields the gaps reach a little beyond the land, ice and lakes add more gaps,
and coarse cells blur the coast. But none of this puts data on dry land. So a field counts as
shifted if cells entirely on land have data, and lose them at an offset at which the gaps match the
land better.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import shapely

from pipeline._types import BoolArray, FloatArray, Geometries
from pipeline.geo.projection import METRES_PER_DEGREE, nearest_node
from pipeline.model import Note

# Number of points that are compared with the land at a time.
_POINTS_AT_A_TIME = 1_000_000


@dataclass(frozen=True, slots=True)
class Field:
    """A current on a grid at one time, or at several that have the same gaps.

    Ascending lon (nx,) and lat (ny,) in degrees; u, v (ny, nx) or (nt, ny, nx) in m/s, NaN where
    there are no data. `outside` (ny, nx) are nodes that the source does not reach: land or water.
    """

    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    outside: BoolArray | None = None

    @property
    def gap(self) -> BoolArray:
        """Cells without data, in the shape of u."""
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
    def of(
        cls,
        polygons: Geometries | Sequence[shapely.Polygon],
        bounds: tuple[float, float, float, float],
    ) -> "LandMask":
        """Make a mask of land polygons (n,), known in the bounds that they were read for."""
        land = np.asarray(polygons, dtype=object)

        def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
            is_in_land = np.zeros(lon.size, dtype=bool)
            # A tree of the points, not of the land: the geometries searched for are prepared.
            tree = shapely.STRtree(shapely.points(lon, lat))
            is_in_land[np.unique(tree.query(land, predicate="intersects")[1])] = True
            return is_in_land

        return cls(is_land, bounds)

    @classmethod
    def world(cls) -> "LandMask":
        """Make a mask of OpenStreetMap's land of the whole world, a raster of about 500 m.

        It takes 300 MB, and a second to load, once in each block of `land_freed_at_end`.
        """
        mask = _raster_of_the_world()

        def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
            wrapped = (lon + 180) % 360 - 180
            return np.asarray(mask.contains_many(wrapped, np.clip(lat, -90, 90)), dtype=bool)

        return cls(is_land, (-np.inf, -90.0, np.inf, 90.0))

    def on_grid(self, lon: FloatArray, lat: FloatArray) -> BoolArray:
        """Return which points of the grid lon (nx,), lat (ny,) are land: (ny, nx)."""
        is_land = np.zeros((lat.size, lon.size), dtype=bool)
        # A few rows at a time: the coordinates of all nodes would take 60 times the mask's memory.
        rows = max(1, _POINTS_AT_A_TIME // max(lon.size, 1))
        for first in range(0, lat.size, rows):
            x, y = np.meshgrid(lon, lat[first : first + rows])
            is_land[first : first + rows] = self.is_land(x.ravel(), y.ravel()).reshape(x.shape)
        return is_land


@cache
def _raster_of_the_world() -> Any:  # noqa: ANN401 - the package has no types
    from roaring_landmask import LandmaskProvider, RoaringMask

    return RoaringMask.new(LandmaskProvider.Osm)


@contextlib.contextmanager
def land_freed_at_end() -> Iterator[None]:
    """Free the land of the world, which may have been loaded inside the block."""
    try:
        yield
    finally:
        _raster_of_the_world.cache_clear()


# Number of points along each side of the region's bounds at which its water is sampled.
_SAMPLES_PER_SIDE = 300


def water_without_data(field: Field, mask: LandMask, region: shapely.Polygon) -> tuple[Note, ...]:
    """Note the water of a region (lon/lat degrees) without data; nothing if all gaps are on land.

    The note has the share of the water that is nearer to a gap than to a value, and the largest
    distance of such water from the nearest value, infinite where the field has none. Gaps at nodes
    on land are right: there is no note unless some water is nearest to a gap at a node in water.
    """
    if not field.gap.any():
        return ()
    west, south, east, north = region.bounds
    lon, lat = _samples(west, east), _samples(south, north)
    x, y = np.meshgrid(lon, lat)
    water = ~mask.on_grid(lon, lat) & shapely.intersects_xy(region, x, y)
    nearest = np.ix_(nearest_node(field.lat, lat), nearest_node(field.lon, lon))
    lacking = water & field.gap[nearest]
    gap_in_water = field.gap & ~mask.on_grid(field.lon, field.lat)
    if not (lacking & gap_in_water[nearest]).any():
        return ()
    distance_m = _distance_m(field, np.stack([x[lacking], y[lacking]], axis=-1))
    share = float(lacking.sum() / water.sum())
    return (Note.of("current-lacking", share=share, distance_m=distance_m),)


def _samples(low: float, high: float) -> FloatArray:
    """Return the middles of equal parts of an interval."""
    return low + (high - low) * (np.arange(_SAMPLES_PER_SIDE) + 0.5) / _SAMPLES_PER_SIDE


def _distance_m(field: Field, points: FloatArray) -> float:
    """Return largest distance of points (n, 2) in lon/lat from the nearest node with data, m."""
    from scipy.spatial import KDTree

    if field.gap.all():
        return float("inf")
    row, column = np.nonzero(~field.gap)
    nodes = np.stack([field.lon[column], field.lat[row]], axis=-1)
    per_degree = METRES_PER_DEGREE * np.array([np.cos(np.radians(points[:, 1].mean())), 1.0])
    return float(KDTree(nodes * per_degree).query(points * per_degree)[0].max())


# Raster points of the land per cell and side; offsets are whole numbers of them.
_POINTS_PER_CELL = 4
# Largest trial offset, degrees.
_MAX_OFFSET_DEG = 1.5
# Least value of the largest trial offset, cells: a coarse cell may be larger than 1.5 degrees.
_MIN_OFFSET_CELLS = 2
# Largest trial offset, cells: a wider raster around fine cells would not fit in memory.
_MAX_OFFSET_CELLS = 60
# Number of trial offsets to each side.
_TRIALS_PER_SIDE = 8
# Largest trial offset as a share of the region, where the land beyond the region is unknown.
_MAX_OFFSET_SHARE = 1 / 6
# Share of land from which a cell counts as entirely land.
_LAND_SHARE = 0.95
# Share of land up to which a cell counts as entirely water.
_WATER_SHARE = 0.05
# Relative variation of an axis's steps up to which an offset is a whole number of raster points.
_MAX_STEP_VARIATION = 0.02


def find_shift(field: Field, mask: LandMask) -> tuple[float, float, int, int] | None:
    """Find by how much a field was moved from its place: where its gaps match the land best.

    Returns the move to east and to north, degrees; how many cells of land have data here and lose
    them when the move is undone; and to how many cells of land such a move would bring data. None
    where the field is in its place.
    """
    window = _testable_window(field, mask)
    if window is None:
        return None
    rows, columns, reach = window
    lon, lat, gap = field.lon[columns], field.lat[rows], field.gap[rows, columns]
    known_gap = gap if field.outside is None else gap & ~field.outside[rows, columns]
    if gap.all() or not known_gap.any():
        return None
    entirely = _land_shares(lon, lat, field.cell_deg, mask, reach)
    land, water = entirely(0, 0)
    fewest_mismatches, best = int((land & ~gap).sum() + (water & known_gap).sum()), None
    stride = max(1, max(reach) // _TRIALS_PER_SIDE)
    trials = [range(-most + most % stride, most + 1, stride) for most in reach]
    for east in trials[0]:
        for north in trials[1]:
            moved_land, moved_water = entirely(east, north)
            mismatches = int((moved_land & ~gap).sum() + (moved_water & known_gap).sum())
            if mismatches < fewest_mismatches:
                fewest_mismatches = mismatches
                explained = int((land & ~gap).sum() - (moved_land & ~gap).sum())
                best = (east, north, explained, int((land & ~moved_land).sum()))
    if best is None:
        return None
    east, north, explained, land_cells = best
    # The land matches at this offset, so the field itself was moved the other way.
    return (
        -east / _POINTS_PER_CELL * field.cell_deg[0],
        -north / _POINTS_PER_CELL * field.cell_deg[1],
        explained,
        land_cells,
    )


def _testable_window(field: Field, mask: LandMask) -> tuple[slice, slice, tuple[int, int]] | None:
    """Return the rows and columns that can be tested, and the reach of trial offsets there.

    The reach is in raster points, to the east and to the north: up to it the land around these
    cells is known. None where no cells can be tested.
    """
    slices, reaches = [], []
    limits = (mask.bounds[0::2], mask.bounds[1::2])
    axes = zip((field.lon, field.lat), field.cell_deg, limits, strict=True)
    for axis, cell, (low, high) in axes:
        if np.abs(np.diff(axis) - cell).max() > _MAX_STEP_VARIATION * cell:
            return None
        span = min(float(axis[-1]), high) - max(float(axis[0]), low)
        furthest = max(min(_MAX_OFFSET_DEG, _MAX_OFFSET_CELLS * cell), _MIN_OFFSET_CELLS * cell)
        if np.isfinite(high - low):
            furthest = min(furthest, _MAX_OFFSET_SHARE * span)
        cells = int(furthest / cell)
        margin = (cells + 0.5) * cell
        inside = np.flatnonzero((axis - margin >= low) & (axis + margin <= high))
        if cells < 1 or inside.size < 2:
            return None
        slices.append(slice(int(inside[0]), int(inside[-1]) + 1))
        reaches.append(cells * _POINTS_PER_CELL)
    return slices[1], slices[0], (reaches[0], reaches[1])


def _land_shares(
    lon: FloatArray,
    lat: FloatArray,
    cell: tuple[float, float],
    mask: LandMask,
    reach: tuple[int, int],
) -> Callable[[int, int], tuple[BoolArray, BoolArray]]:
    """Sample the land in a grid's cells and `reach` raster points beyond them.

    The function returned gives the cells (ny, nx) that are entirely land, and entirely water, once
    the grid is moved east and north by some raster points; from a summed-area table of the raster.
    """
    fine = [
        axis[0]
        - step / 2
        + step
        / _POINTS_PER_CELL
        * (np.arange(axis.size * _POINTS_PER_CELL + 2 * beyond) - beyond + 0.5)
        for axis, step, beyond in zip((lon, lat), cell, reach, strict=True)
    ]
    land = mask.on_grid(fine[0], fine[1])
    table = np.zeros((land.shape[0] + 1, land.shape[1] + 1))
    table[1:, 1:] = land.cumsum(axis=0).cumsum(axis=1)
    size = _POINTS_PER_CELL

    def entirely(east: int, north: int) -> tuple[BoolArray, BoolArray]:
        row, column = reach[1] + north, reach[0] + east
        share = np.zeros((lat.size, lon.size))
        for up, right, sign in ((size, size, 1), (0, 0, 1), (0, size, -1), (size, 0, -1)):
            first_row, first_column = row + up, column + right
            rows = slice(first_row, first_row + size * lat.size, size)
            columns = slice(first_column, first_column + size * lon.size, size)
            share += sign * table[rows, columns]
        share /= size**2
        return share >= _LAND_SHARE, share <= _WATER_SHARE

    return entirely
