"""Choose the region of a voyage: it contains start, goal and the ways between, with a margin.

The ways are found on a coarse grid: the shortest, and the shortest on either side of each larger
island on the direct line. Currents are not known yet: if a best route comes near the region's edge,
:mod:`pipeline.stages.choosing.region` widens the region.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pipeline._types import FloatArray, IndexArray
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.sources.quality.coverage import Bounds, common_bounds
from pipeline.sources.quality.field import LandMask
from pipeline.stages.choosing.water_grid import WaterGrid, Way

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


@dataclass(frozen=True, slots=True)
class Voyage:
    """Start and goal (lon, lat), degrees, with longitudes continuous across 180; distance in m."""

    start: LonLat
    goal: LonLat
    distance_m: float
    direct: FloatArray
    """Points (n, 2) of the geodesic from start to goal."""

    @classmethod
    def between(cls, start: LonLat, goal: LonLat) -> Voyage:
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


def _places(voyage: Voyage, grid: WaterGrid) -> list[Bounds] | None:
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


def _is_choice(way: Way | None, shortest: Way) -> bool:
    """Whether a way exists and is at most _LONGEST_WAY times as long as the shortest."""
    return way is not None and way.length_m <= _LONGEST_WAY * shortest.length_m


def _islands_between(voyage: Voyage, grid: WaterGrid) -> Iterator[tuple[int, list[IndexArray]]]:
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


def _barriers(grid: WaterGrid, middle: IndexArray, line: IndexArray) -> Iterator[IndexArray]:
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
