"""Choose the region of a voyage: it contains start, goal and the ways between, with a margin.

The ways are found on a coarse grid: the shortest, and the shortest on either side of each larger
island on the direct line. Currents are not known yet: if a best route comes near the region's edge,
:mod:`pipeline.stages.choosing.region` widens the region.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.sources.quality.coverage import Bounds, common_bounds
from pipeline.sources.quality.field import LandMask

LonLat = tuple[float, float]

# Margin around endpoints, ways and islands: a share of the distance between start and goal, and its
# minimum, m.
MARGIN_SHARE = 0.1
_MIN_MARGIN_M = 2_000.0
# Distance from the direct line up to which the first search looks for ways: a share of the distance
# between start and goal, and its minimum, m. The number of searches, and the factor by which each
# further search reaches further.
_REACH_SHARE, _MIN_REACH_M = 1.0, 10_000.0
_SEARCHES, _FURTHER = 4, 2.5
# Length up to which a way round an island is considered, in lengths of the shortest way.
_LONGEST_WAY = 2.5
# Number of the largest islands on the direct line for which ways on both sides are searched, at
# 0.1 s each. Smaller islands lie almost completely inside the region anyway.
_MAX_ISLANDS = 5
# Number of points on the direct line.
_DIRECT_POINTS = 1000
# Latitude beyond which a region does not reach, degrees: the pole itself has no longitude.
_MAX_LATITUDE = 89.0
Cell = tuple[int, int]

ScalarT = TypeVar("ScalarT", bound=np.generic)

# Number of cells along the longer side: fine enough for the region's margin, and a shortest way
# takes 0.1 s.
_CELLS = 300
# Distance in cells from an endpoint within which water is searched: harbours are finer than cells.
_NEAR_CELLS = 5


@dataclass(frozen=True, slots=True)
class Voyage:
    """Start and goal (lon, lat), degrees, with longitudes continuous across 180; distance in m."""

    start: LonLat
    goal: LonLat
    distance_m: float
    direct: FloatArray
    """Points (n, 2) of the geodesic from start to goal."""

    @classmethod
    def between(cls, start: LonLat, goal: LonLat) -> "Voyage":
        """Compute the geodesic from start to goal and its length."""
        import pyproj

        geod = pyproj.Geod(ellps="WGS84")
        distance_m = geod.inv(*start, *goal)[2]
        inner = np.array(geod.npts(*start, *goal, _DIRECT_POINTS)).reshape(-1, 2)
        points = np.vstack([start, inner, goal])
        points[:, 0] = np.degrees(np.unwrap(np.radians(points[:, 0])))
        points[:, 0] += 360 * round((start[0] - points[0, 0]) / 360)
        return cls(start, goal, float(distance_m), points)

    @property
    def margin_m(self) -> float:
        """The region's margin around the ways, m."""
        return max(MARGIN_SHARE * self.distance_m, _MIN_MARGIN_M)


def choose_region(voyage: Voyage, mask_of: Callable[[Bounds], LandMask], limits: Bounds) -> Bounds:
    """Return the bounds of a region for a voyage, degrees.

    Parameters
    ----------
    voyage
        Its start and goal must lie inside the limits.
    mask_of
        Returns the land inside bounds.
    limits
        Bounds of the currents, which the region does not exceed.
    """
    reach_m = max(_REACH_SHARE * voyage.distance_m, _MIN_REACH_M)
    ends = bounds_of(np.array([voyage.start, voyage.goal]))
    for _ in range(_SEARCHES):
        searched = _within(widened_by(bounds_of(voyage.direct), reach_m), limits)
        places = _places(voyage, WaterGrid.of(mask_of(searched), searched))
        if places is not None:
            boxes = np.array([ends, *places])
            hull = (*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist())
            return _within(rounded_outward(widened_by(hull, voyage.margin_m)), limits)
        reach_m *= _FURTHER
    # The coarse grid has no way, as through a canal; the planner may find one on the real coast.
    return _within(rounded_outward(widened_by(bounds_of(voyage.direct), voyage.margin_m)), limits)


def _places(voyage: Voyage, grid: "WaterGrid") -> list[Bounds] | None:
    """Return the bounds of the ways and islands that a region must contain; None without a way."""
    start, goal = grid.water_near(*voyage.start), grid.water_near(*voyage.goal)
    shortest = None if start is None or goal is None else grid.shortest_way(start, goal)
    if start is None or goal is None or shortest is None:
        return None
    places = [grid.bounds_of(shortest.cells)]
    for island, barriers in _islands_between(voyage, grid):
        ways = [grid.shortest_way(start, goal, barrier) for barrier in barriers]
        if all(_is_choice(way, shortest) for way in ways):
            places += [grid.bounds_of(way.cells) for way in ways if way is not None]
            places.append(grid.bounds_of(np.argwhere(grid.islands == island)))
    return places


def _is_choice(way: "Way | None", shortest: "Way") -> bool:
    """Whether a way exists and is at most _LONGEST_WAY times as long as the shortest."""
    return way is not None and way.length_m <= _LONGEST_WAY * shortest.length_m


def _islands_between(voyage: Voyage, grid: "WaterGrid") -> Iterator[tuple[int, list[IndexArray]]]:
    """Yield the largest islands on the direct line, with a barrier on the left and on the right.

    A barrier leads from the island to the grid's edge, perpendicular to the direct line. A way that
    does not cross the barrier passes the island on the other side.
    """
    cells = grid.cells(voyage.direct)
    met = grid.islands[cells[:, 0], cells[:, 1]]
    numbers, size = np.unique(grid.islands[grid.islands > 0], return_counts=True)
    on_way = [(n, -count) for n, count in zip(numbers, size, strict=True) if n in set(met)]
    inner = [int(n) for n, _ in sorted(on_way, key=lambda it: it[1]) if not grid.leaves(int(n))]
    for island in inner[:_MAX_ISLANDS]:
        middle = cells[np.flatnonzero(met == island)]
        yield island, list(_barriers(grid, middle[len(middle) // 2], cells))


def _barriers(grid: "WaterGrid", middle: IndexArray, line: IndexArray) -> Iterator[IndexArray]:
    """Yield the cells of both perpendiculars to a line of cells, from a cell to the grid's edge."""
    along = (line[-1] - line[0]).astype(float)
    along /= max(float(np.hypot(*along)), 1e-9)
    across = np.array([-along[1], along[0]])
    shape = np.array(grid.is_water.shape)
    # Half steps, so that no cell on the ray is left out.
    steps = np.arange(0, 2 * shape.sum()) / 2
    for side in (across, -across):
        ray = np.rint(middle + steps[:, None] * side).astype(np.intp)
        inside = ((ray >= 0) & (ray < shape)).all(axis=1)
        yield ray[: int(inside.argmin()) if not inside.all() else None]


def bounds_of(lonlat: FloatArray) -> Bounds:
    """Return the bounds of points (n, 2)."""
    west, south = lonlat.min(axis=0).tolist()
    east, north = lonlat.max(axis=0).tolist()
    return west, south, east, north


def widened_by(bounds: Bounds, metres: float) -> Bounds:
    """Return bounds with a margin in metres, without the poles."""
    west, south, east, north = bounds
    up = metres / METRES_PER_DEGREE
    south, north = max(south - up, -_MAX_LATITUDE), min(north + up, _MAX_LATITUDE)
    aside = up / math.cos(math.radians(max(abs(south), abs(north))))
    return west - aside, south, east + aside, north


def rounded_outward(bounds: Bounds) -> Bounds:
    """Round bounds outward to tenths, hundredths ... of a degree, according to their size."""
    west, south, east, north = bounds
    decimals = max(1, 2 - math.floor(math.log10(max(east - west, north - south))))
    unit = 10.0**decimals
    low = [math.floor(round(bound * unit, 6)) / unit for bound in (west, south)]
    high = [math.ceil(round(bound * unit, 6)) / unit for bound in (east, north)]
    return low[0], low[1], high[0], high[1]


def _within(bounds: Bounds, limits: Bounds) -> Bounds:
    """Return the intersection of bounds with limits; raise ValueError if it is empty."""
    common = common_bounds(bounds, limits)
    if common is None:
        raise ValueError(f"{bounds} lies outside {limits}")
    return common


@dataclass(frozen=True)
class Way:
    """A way through water: cells (n, 2) of row and column, and its length in metres."""

    cells: IndexArray
    length_m: float


@dataclass(frozen=True)
class WaterGrid:
    """Cells of a grid over some bounds: lon (nx,), lat (ny,) in degrees, is_water (ny, nx)."""

    lon: FloatArray
    lat: FloatArray
    is_water: BoolArray

    @classmethod
    def of(cls, mask: LandMask, bounds: Bounds) -> "WaterGrid":
        """Sample a land mask at the centres of nearly square cells."""
        west, south, east, north = bounds
        cosine = float(np.cos(np.radians((south + north) / 2)))
        step = max((east - west) * cosine, north - south) / _CELLS
        nx = max(2, round((east - west) * cosine / step))
        ny = max(2, round((north - south) / step))
        lon = west + (east - west) * (np.arange(nx) + 0.5) / nx
        lat = south + (north - south) * (np.arange(ny) + 0.5) / ny
        return cls(lon, lat, ~mask.on_grid(lon, lat))

    def cells(self, lonlat: FloatArray) -> IndexArray:
        """Return rows and columns (n, 2) of the cells nearest to points (n, 2), degrees."""
        nearest = [
            np.abs(axis[None, :] - lonlat[:, [i]]).argmin(axis=1)
            for i, axis in ((1, self.lat), (0, self.lon))
        ]
        return np.stack(nearest, axis=1)

    def water_near(self, lon: float, lat: float) -> Cell | None:
        """Return the nearest cell of water within _NEAR_CELLS of a position, or None."""
        row, column = self.cells(np.array([[lon, lat]]))[0]
        wet = np.argwhere(self.is_water)
        steps = np.abs(wet - [row, column])
        near = steps.max(axis=1) <= _NEAR_CELLS
        if not near.any():
            return None
        best = wet[near][(steps[near] ** 2).sum(axis=1).argmin()]
        return int(best[0]), int(best[1])

    def bounds_of(self, cells: IndexArray) -> Bounds:
        """Return the bounds of the centres of cells (n, 2), degrees."""
        lat, lon = self.lat[cells[:, 0]], self.lon[cells[:, 1]]
        return float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())

    @cached_property
    def islands(self) -> npt.NDArray[np.int32]:
        """Number of the island that each cell (ny, nx) belongs to; 0 for water."""
        from scipy.ndimage import label

        return np.asarray(label(~self.is_water, structure=np.ones((3, 3)))[0], dtype=np.int32)

    def leaves(self, island: int) -> bool:
        """Whether an island reaches the grid's edge, so that it may be part of a continent."""
        is_land = self.islands == island
        edges = (is_land[0], is_land[-1], is_land[:, 0], is_land[:, -1])
        return any(bool(edge.any()) for edge in edges)

    def shortest_way(
        self, start: Cell, goal: Cell, barrier: IndexArray | None = None
    ) -> Way | None:
        """Return the shortest way through water that avoids a barrier's cells (n, 2), or None.

        Steps go to the eight neighbours. A diagonal step needs water in both cells beside it, so
        that no way passes between cells of land or a barrier that touch at a corner.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import dijkstra

        open_water = self.is_water.copy()
        if barrier is not None:
            open_water[barrier[:, 0], barrier[:, 1]] = False
        open_water[start] = open_water[goal] = True
        number = np.arange(open_water.size).reshape(open_water.shape)
        up = float(self.lat[1] - self.lat[0]) * METRES_PER_DEGREE
        across = float(self.lon[1] - self.lon[0]) * np.cos(np.radians(self.lat)) * METRES_PER_DEGREE
        across = np.broadcast_to(across[:, None], open_water.shape)
        here, there, length = [], [], []
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            first, second = _shifted(open_water, down, right)
            passable = first & second
            if down and right:
                passable &= _corner(open_water, right)
            one, other = _shifted(number, down, right)
            steps = np.hypot(down * up, right * _shifted(across, down, right)[0])
            here.append(one[passable])
            there.append(other[passable])
            length.append(np.broadcast_to(steps, passable.shape)[passable])
        graph = coo_array(
            (np.concatenate(length), (np.concatenate(here), np.concatenate(there))),
            shape=(open_water.size, open_water.size),
        ).tocsr()
        origin, target = int(number[start]), int(number[goal])
        distance, before = dijkstra(graph, directed=False, indices=origin, return_predecessors=True)
        if not np.isfinite(distance[target]):
            return None
        cells = [target]
        while cells[-1] != origin:
            cells.append(int(before[cells[-1]]))
        found = np.stack(np.divmod(np.array(cells[::-1]), open_water.shape[1]), axis=1)
        return Way(found, float(distance[target]))


def _shifted(
    values: npt.NDArray[ScalarT], down: int, right: int
) -> tuple[npt.NDArray[ScalarT], npt.NDArray[ScalarT]]:
    """Return the values of cells and of their neighbours `down` (0, 1) and `right` (-1, 0, 1)."""
    rows = values.shape[0] - down
    if right >= 0:
        columns = values.shape[1] - right
        return values[:rows, :columns], values[down:, right:]
    return values[:rows, 1:], values[down:, :-1]


def _corner(is_water: BoolArray, right: int) -> BoolArray:
    """Whether both cells beside a diagonal step down and right (-1 or 1) are water."""
    upper, lower = is_water[:-1], is_water[1:]
    if right > 0:
        return np.asarray(upper[:, 1:] & lower[:, :-1])
    return np.asarray(upper[:, :-1] & lower[:, 1:])
