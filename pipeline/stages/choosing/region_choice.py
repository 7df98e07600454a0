"""Choose a region that holds start, goal and the ways between.

The ways are found on a coarse grid: the shortest, and the shortest on either side of each larger
island that lies on the direct line, or that the region would not hold. Ways that are much longer
than the shortest are left out. Currents are not known yet: if a best route comes near the region's
edge, :mod:`pipeline.stages.choosing.region` widens it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline._types import FloatArray
from pipeline.geo.lonlat import METRES_PER_DEGREE, Bounds, bounds_of, common_bounds
from pipeline.sources.current_field import LandMask
from pipeline.stages.choosing.water_grid import Cell, GridPath, LonLat, WaterGrid

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


class RegionChoice(NamedTuple):
    """Bounds of a region, degrees, and whether it leaves out ways for their length."""

    bounds: Bounds
    leaves_out: bool = False


def choose_region(
    direct: DirectLine, mask_of: Callable[[Bounds], LandMask], limits: Bounds
) -> RegionChoice:
    """Choose the bounds of a region for a voyage.

    Parameters
    ----------
    direct
        Its start and goal must lie inside the limits.
    mask_of
        Returns the land inside bounds.
    limits
        Bounds of the currents, which the region does not exceed.
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
    return RegionChoice(_region(direct, [bounds_of(direct.points)], limits))


def _around_ways(
    direct: DirectLine,
    grid: WaterGrid,
    ends: tuple[Cell, Cell],
    shortest: GridPath,
    limits: Bounds,
) -> RegionChoice:
    """Choose a region that holds the shortest way, and the ways round the islands beside it."""

    def around(island: int, longest: float) -> Bounds | None:
        """Return the bounds of an island and the way on its far side; None if that is too long."""
        ways = grid.shortest_paths(*ends, island)
        if len(ways) == 1 or ways[-1].length_m > longest * shortest.length_m:
            return None
        return bounds_of([grid.bounds_of(ways[-1].cells), grid.bounds_of_island(island)])

    places = [bounds_of([direct.start, direct.goal]), grid.bounds_of(shortest.cells)]
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
    return RegionChoice(region, leaves_out=bool(grid.islands_beyond(region)))


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
