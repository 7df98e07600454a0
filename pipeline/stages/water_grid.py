"""The region that holds start, goal and the ways between, found on a coarse grid of water and land.

The ways are the shortest, and the shortest on either side of each larger island that lies on the
direct line, or that the region would not hold. Ways that are much longer than the shortest are left
out. Currents are not known yet: if a best route comes near the region's edge,
:mod:`pipeline.stages.region` widens it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.geo.projection import METRES_PER_DEGREE, Bounds, bounds_of, common_bounds
from pipeline.sources.current_field import LandMask

Cell = tuple[int, int]
LonLat = tuple[float, float]
ScalarT = TypeVar("ScalarT", bound=np.generic)
# Number of cells along the longer side: fine enough for the region's margin; a search takes 0.1 s.
_CELLS = 300
# Distance in cells from an endpoint within which water is searched: harbours are finer than cells.
_NEAR_CELLS = 5
# Number of cells below which an island may be cut or left out by the region.
_MIN_CELLS = 10
# Number of cells below which an island is not looked at.
_FEW_CELLS = 3


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
        return bounds_of(np.stack([self.lon[cells[:, 1]], self.lat[cells[:, 0]]], axis=-1))

    @cached_property
    def islands(self) -> npt.NDArray[np.int32]:
        """Number of the island that each cell (ny, nx) belongs to; 0 for water."""
        from scipy.ndimage import label

        return np.asarray(label(~self.is_water, structure=np.ones((3, 3)))[0], dtype=np.int32)

    def leaves(self, island: int) -> bool:
        """Whether an island reaches the grid's edge and so may be part of a continent."""
        is_land = self.islands == island
        edges = (is_land[0], is_land[-1], is_land[:, 0], is_land[:, -1])
        return any(bool(edge.any()) for edge in edges)

    @cached_property
    def _size(self) -> IndexArray:
        """Number of cells of each island."""
        return np.bincount(self.islands.ravel())

    @cached_property
    def large_islands(self) -> list[int]:
        """Islands of more than a few cells that do not leave the grid, the largest first."""
        largest_first = np.argsort(-self._size[1:], kind="stable") + 1
        large = (int(one) for one in largest_first if self._size[one] >= _FEW_CELLS)
        return [one for one in large if not self.leaves(one)]

    def islands_beyond(self, bounds: Bounds) -> list[int]:
        """Return the large islands that lie outside bounds, in whole or in part."""
        west, south, east, north = bounds
        is_outside = np.ones_like(self.is_water)
        rows, columns = (
            (self.lat >= south) & (self.lat <= north),
            (self.lon >= west) & (self.lon <= east),
        )
        is_outside[np.ix_(rows, columns)] = False
        beyond = set(self.islands[is_outside].tolist())
        large = (one for one in self.large_islands if self._size[one] >= _MIN_CELLS)
        return [one for one in large if one in beyond]

    def shortest_paths(
        self, start: Cell, goal: Cell, island: int = 0
    ) -> list[tuple[float, IndexArray]]:
        """Return the shortest path between two cells of water; with an island, on either side.

        Steps go to the eight neighbours. A diagonal step needs water in both cells beside it, so
        that no path passes between cells of land that touch at a corner. Each path is its length,
        m, and its cells (n, 2) of row and column.

        With an island there are up to two paths, the shorter one first. A ray leads from the island
        to the east. Paths that cross it an even number of times pass the island on one side, the
        others on the other. So the search is on two copies of the cells, and a step across the ray
        leads from one copy to the other.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import dijkstra

        size, width = self.is_water.size, len(self.lon)
        here, there, length = self._two_copies(island) if island else self._steps
        nodes = 2 * size if island else size
        graph = coo_array((length, (here, there)), shape=(nodes, nodes)).tocsr()
        origin, target = (row * width + column for row, column in (start, goal))
        reached, before = dijkstra(graph, directed=False, indices=origin, return_predecessors=True)
        found = []
        for end in range(target, nodes, size):
            if not np.isfinite(reached[end]):
                continue
            cells = [end]
            while cells[-1] != origin:
                cells.append(int(before[cells[-1]]))
            places = np.array(cells[::-1]) % size
            found.append((float(reached[end]), np.stack(np.divmod(places, width), axis=1)))
        return sorted(found, key=itemgetter(0))

    def _two_copies(self, island: int) -> tuple[IndexArray, IndexArray, FloatArray]:
        """Return the steps on two copies of the cells, and between them across an island's ray."""
        (here, there, length), (size, width) = self._steps, (self.is_water.size, len(self.lon))
        cells = np.argwhere(self.islands == island)
        row, column = cells[cells[:, 1].argmax()]
        # The ray lies between two rows: a step from one to the other crosses it.
        crosses = (here // width == row) & (here % width > column) & (there // width > row)
        return (
            np.concatenate([here, here + size]),
            np.concatenate([there + size * crosses, there + size * ~crosses]),
            np.tile(length, 2),
        )

    @cached_property
    def _steps(self) -> tuple[IndexArray, IndexArray, FloatArray]:
        """First and last cell of each step (n,), numbered row by row, and the steps' lengths, m."""
        number = np.arange(self.is_water.size).reshape(self.is_water.shape)
        up = float(self.lat[1] - self.lat[0]) * METRES_PER_DEGREE
        across = float(self.lon[1] - self.lon[0]) * np.cos(np.radians(self.lat)) * METRES_PER_DEGREE
        across = np.broadcast_to(across[:, None], number.shape)
        here, there, length = [], [], []
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            first, second = _shifted(self.is_water, down, right)
            passable = first & second
            if down and right:  # both cells beside a diagonal step are water, too
                passable &= np.logical_and(*_shifted(self.is_water, down, -right))
            one, other = _shifted(number, down, right)
            steps = np.hypot(down * up, right * _shifted(across, down, right)[0])
            here.append(one[passable])
            there.append(other[passable])
            length.append(np.broadcast_to(steps, passable.shape)[passable])
        return np.concatenate(here), np.concatenate(there), np.concatenate(length)


def _shifted(
    values: npt.NDArray[ScalarT], down: int, right: int
) -> tuple[npt.NDArray[ScalarT], npt.NDArray[ScalarT]]:
    """Return the values of cells and of their neighbours `down` (0, 1) and `right` (-1, 0, 1)."""
    rows = values.shape[0] - down
    if right >= 0:
        columns = values.shape[1] - right
        return values[:rows, :columns], values[down:, right:]
    return values[:rows, 1:], values[down:, :-1]


# Margin around endpoints, ways and islands: a share of the voyage's distance; its minimum, m.
MARGIN_SHARE = 0.1
_MIN_MARGIN_M = 2_000.0
# The first search looks for ways up to this distance from the direct line, as a share of the
# distance between start and goal.
_REACH_SHARE = 1.0
# The first search looks at least so far from the direct line, m.
_MIN_REACH_M = 10_000.0
# Largest number of searches.
_SEARCHES = 4
# Factor by which the distance from the direct line grows for each further search.
_FURTHER = 2.5
# Longest way round an island that is considered, in lengths of the shortest way.
_LONGEST_WAY = 2.5
FAR_WAY = 1.5
"""Longest way on the far side of an island that the region would not hold, in lengths of the
shortest way. Longer ones are left out."""
# Largest factor by which the shortest way in steps to eight neighbours exceeds the true one.
_DETOUR = 1 / math.cos(math.pi / 8)
# Number of the largest islands on the direct line for which ways on both sides are searched, each
# in 0.1 s; smaller islands lie almost completely inside the region anyway. The same number limits
# the islands that are considered because the region would not hold them.
_MAX_ISLANDS = 5
# Number of points on the direct line.
_DIRECT_POINTS = 1000
MAX_LATITUDE = 89.0
"""Latitude beyond which a region does not reach, degrees: the pole itself has no longitude."""
MAX_WIDTH = 179.5
"""Width up to which a region is widened, degrees: a chart must not meet itself round the world."""


@dataclass(frozen=True, slots=True)
class DirectLine:
    """Start and goal (lon, lat), degrees, with longitudes continuous across 180; distance in m."""

    start: LonLat
    goal: LonLat
    distance_m: float
    points: FloatArray
    """Points (n, 2) of the geodesic from start to goal."""

    @classmethod
    def between(cls, start: LonLat, goal: LonLat) -> "DirectLine":
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


def choose_region(
    direct: DirectLine, mask_of: Callable[[Bounds], LandMask], limits: Bounds
) -> tuple[Bounds, bool]:
    """Choose a region for a voyage: its bounds, degrees, and whether it leaves out long ways.

    `mask_of` returns the land inside bounds. The region does not exceed the `limits`, the bounds of
    the currents, in which start and goal must lie.
    """
    reach_m = max(_REACH_SHARE * direct.distance_m, _MIN_REACH_M)
    for _ in range(_SEARCHES):
        searched = _within(widened_by(bounds_of(direct.points), reach_m), limits)
        grid = WaterGrid.of(mask_of(searched), searched)
        start, goal = grid.water_near(*direct.start), grid.water_near(*direct.goal)
        if start is not None and goal is not None and (ways := grid.shortest_paths(start, goal)):
            return _around_ways(direct, grid, (start, goal), ways[0], limits)
        reach_m *= _FURTHER
    # The coarse grid has no way, for example through a canal; the real coast may have one.
    return _region(direct, [bounds_of(direct.points)], limits), False


def _around_ways(
    direct: DirectLine,
    grid: WaterGrid,
    ends: tuple[Cell, Cell],
    shortest: tuple[float, IndexArray],
    limits: Bounds,
) -> tuple[Bounds, bool]:
    """Choose a region that holds the shortest way, and the ways round the islands beside it."""
    shortest_m, shortest_cells = shortest

    def around(island: int, longest: float) -> Bounds | None:
        """Return the bounds of an island and the way on its far side; None if that is too long."""
        ways = grid.shortest_paths(*ends, island)
        length_m, cells = ways[-1]
        if len(ways) == 1 or length_m > longest * shortest_m:
            return None
        own = np.argwhere(grid.islands == island)
        return bounds_of([grid.bounds_of(cells), grid.bounds_of(own)])

    places = [bounds_of([direct.start, direct.goal]), grid.bounds_of(shortest_cells)]
    places += filter(None, (around(one, _LONGEST_WAY) for one in _islands_between(direct, grid)))
    tried = set[int]()
    for _ in range(_MAX_ISLANDS):
        beyond = grid.islands_beyond(_region(direct, places, limits))
        island = next((one for one in beyond if one not in tried), 0)
        if not island:
            break
        tried.add(island)
        side = around(island, FAR_WAY * _DETOUR)
        places += [side] if side else []
    region = _region(direct, places, limits)
    return region, bool(grid.islands_beyond(region))


def _region(direct: DirectLine, places: Sequence[Bounds], limits: Bounds) -> Bounds:
    """Return the bounds of all places with the voyage's margin, within limits."""
    return _within(rounded_outward(widened_by(bounds_of(places), direct.margin_m)), limits)


def _islands_between(direct: DirectLine, grid: WaterGrid) -> list[int]:
    """Return the largest islands on the direct line, the largest first."""
    cells = grid.cells(direct.points)
    met = np.unique(grid.islands[cells[:, 0], cells[:, 1]])
    size = np.bincount(grid.islands.ravel())
    largest = sorted((int(one) for one in met if one), key=lambda one: -size[one])
    return [one for one in largest if not grid.leaves(one)][:_MAX_ISLANDS]


def widened_by(bounds: Bounds, metres: float) -> Bounds:
    """Return bounds with a margin in metres, without the poles, and over half the world at most."""
    west, south, east, north = bounds
    up = metres / METRES_PER_DEGREE
    south, north = max(south - up, -MAX_LATITUDE), min(north + up, MAX_LATITUDE)
    aside = up / math.cos(math.radians(max(abs(south), abs(north))))
    aside = min(aside, max(0.0, (MAX_WIDTH - (east - west)) / 2))
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
