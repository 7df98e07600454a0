"""Choose a region that holds start, goal and the ways between; list the sides that it leaves out.

The ways are found on a coarse grid: the shortest, and the shortest on either side of each larger
island that lies on the direct line, or that the region would not hold. Currents are not known yet:
if a best route comes near the region's edge, :mod:`pipeline.stages.choosing.region` widens it.

A far side is a side of an island that the region leaves out. A best route passes such an island on
its near side. In a wider region with all of the island, the near side is shut by a strip of land.
The lower bound on fuel then holds for ways on the far side (see
:mod:`pipeline.findings.other_ways`). Islets are left out of the wider region's land: that
makes the bound no higher.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.errors import PipelineError
from pipeline.findings.islands import island_places
from pipeline.findings.other_ways import fuel_elsewhere, strip_across
from pipeline.findings.result import RunResult
from pipeline.geo.coast import inner_land
from pipeline.geo.lonlat import METRES_PER_DEGREE, Bounds, bounds_of, common_bounds
from pipeline.geo.projection import Projection
from pipeline.machine.interpreters import cores
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import Note, Place, PlaceName, Scene, SeasonPlan
from pipeline.scenario.region import Region
from pipeline.sources.current_field import LandMask
from pipeline.sources.land.shapes import in_plane
from pipeline.stages.choosing.water_grid import Cell, GridPath, LonLat, WaterGrid
from pipeline.stages.fetch import fetch
from pipeline.stages.project import extent_polygon, planar_current
from renew.inputs.current import as_field

# Margin around endpoints, ways and islands: a share of the voyage's distance; its minimum, m.
MARGIN_SHARE = 0.1
_MIN_MARGIN_M = 2_000.0
# The first search looks for ways up to this distance from the direct line: a share of the distance
# between start and goal, and at least some metres. Then the number of searches, and the factor by
# which the distance grows for each further search.
_REACH_SHARE, _MIN_REACH_M = 1.0, 10_000.0
_SEARCHES, _FURTHER = 4, 2.5
# Longest way round an island that is considered, in lengths of the shortest way.
_LONGEST_WAY = 2.5
FAR_WAY = 1.5
"""Longest way on the far side of an island that the region would not hold: its length or least
fuel, as a multiple of the best way's. Longer ones are left out."""
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


class FarSide(NamedTuple):
    """A side of an island that a region leaves out, because the way round it is too long.

    `lon`, `lat` are a place on the island, degrees. On a coarse grid of the land in the bounds
    `searched`, each way on that side is at least `length_m` long, `ratio` times as long as the
    shortest way. `around` are the bounds of the island and of the shortest way on that side.
    """

    lon: float
    lat: float
    length_m: float
    ratio: float
    around: Bounds
    searched: Bounds


class RegionChoice(NamedTuple):
    """Bounds of a region, degrees, and the sides of islands that it leaves out.

    `largest` are far sides of the largest islands where a way may be at most `FAR_WAY` times as
    long as the shortest. The planned routes decide whether these sides are left out. The list ends
    with the first side that certainly has such a way.
    """

    bounds: Bounds
    far_sides: tuple[FarSide, ...] = ()
    largest: tuple[FarSide, ...] = ()


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
            return _around_ways(direct, grid, (start, goal), ways[0], searched, limits)
        reach_m *= _FURTHER
    # The coarse grid has no way, for example through a canal; the real coast may have one.
    return RegionChoice(_region(direct, [bounds_of(direct.points)], limits))


def _around_ways(
    direct: DirectLine,
    grid: WaterGrid,
    ends: tuple[Cell, Cell],
    shortest: GridPath,
    searched: Bounds,
    limits: Bounds,
) -> RegionChoice:
    """Choose a region that holds the shortest way, and the ways round the islands beside it."""

    @cache
    def far_side(island: int) -> FarSide | None:
        ways = grid.shortest_paths(*ends, island)
        if len(ways) == 1:
            return None
        length_m = ways[-1].length_m / _DETOUR
        around = bounds_of([grid.bounds_of(ways[-1].cells), grid.bounds_of_island(island)])
        place, ratio = grid.place_on(island), length_m / shortest.length_m
        return FarSide(*place, length_m, ratio, around, searched)

    places = [bounds_of([direct.start, direct.goal]), grid.bounds_of(shortest.cells)]
    for island in _islands_between(direct, grid):
        side = far_side(island)
        if side is not None and side.ratio * _DETOUR <= _LONGEST_WAY:
            places.append(side.around)
    far_sides, tried = list[FarSide](), set[int]()
    for _ in range(_MAX_ISLANDS):
        beyond = grid.islands_beyond(_region(direct, places, limits))
        island = next((one for one in beyond if one not in tried), 0)
        if not island:
            break
        tried.add(island)
        side = far_side(island)
        if side is not None and side.ratio <= FAR_WAY:
            places.append(side.around)
        elif side is not None:
            far_sides.append(side)
    is_long = grid.around_island(*ends) > FAR_WAY * _DETOUR * shortest.length_m
    near = [one for one in grid.large_islands if not is_long[one]][:_MAX_ISLANDS]
    largest = _up_to_short(filter(None, map(far_side, near)))
    return RegionChoice(_region(direct, places, limits), tuple(far_sides), tuple(largest))


def _up_to_short(sides: Iterable[FarSide]) -> Iterator[FarSide]:
    """Yield the sides whose way may be short, up to the first whose way certainly is short."""
    for side in sides:
        if side.ratio <= FAR_WAY:
            yield side
            if side.ratio * _DETOUR <= FAR_WAY:
                return


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


# Number of cells of the bound's grid, and width of the strip as a share of the square root of the
# region's area: three cells.
_CELLS = 16_000
_WIDTH = 3 / math.sqrt(_CELLS)
# Tolerance of the land there, as a share of a cell's side.
_FINE = 1 / 100


@dataclass(frozen=True, slots=True)
class BoundedSide:
    """A far side, the island's name or "", and a lower bound on fuel there.

    `fuel_ratio` is the bound divided by the best route's fuel: the least of all seasons, NaN if
    there is no bound. A ratio below 1 is of no use to a reader.
    """

    side: FarSide
    name: str
    fuel_ratio: float

    @property
    def note(self) -> Note:
        """The note on it for a reader."""
        # Where the wider chart has no way on that side, its length on the coarse grid says enough.
        has_bound = 1.0 <= self.fuel_ratio < math.inf
        return Note.of(
            "side-left-out",
            island=self.name,
            place=Place(self.side.lon, self.side.lat),
            ratio=self.fuel_ratio if has_bound else max(self.side.ratio, 1.0),
            of="fuel" if has_bound else "length",
        )


def bounded_sides(
    sides: Sequence[FarSide], made: Artefact[RunResult], store: Store
) -> tuple[BoundedSide, ...]:
    """Find names and lower bounds of far sides, in the currents that are on this machine."""
    keys = {side: artefact_key("far-sides", made.key, side) for side in sides}
    known = {side: store.load("far-sides", key, BoundedSide) for side, key in keys.items()}
    # As a rule all sides were found in one search.
    searched = dict.fromkeys(side.searched for side in sides if known[side] is None)
    scenes = {bounds: _wide_scene(bounds, made.value, store) for bounds in searched}
    places = {bounds: island_places(scene) for bounds, scene in scenes.items() if scene}

    def bounded(side: FarSide) -> BoundedSide:
        found = known[side]
        if found is None:
            at = side.searched
            found = _bounded(side, scenes[at], places.get(at, ()), made.value)
            store.save("far-sides", keys[side], found)
        return found

    with ThreadPoolExecutor(cores()) as pool:
        return tuple(pool.map(bounded, sides))


def are_on_both_sides(paths: Sequence[FloatArray], place: LonLat) -> bool:
    """Whether paths (n, 2) with the same ends pass a place on both sides, lon/lat degrees."""
    bearings = [np.unwrap(np.arctan2(*(path - place).T)) for path in paths]
    return bool(np.ptp([bearing[-1] - bearing[0] for bearing in bearings]) > math.pi)


def _bounded(
    side: FarSide, scene: Scene | None, places: Sequence[PlaceName], result: RunResult
) -> BoundedSide:
    """Find a far side's name and bound in a wide scene; neither without a scene."""
    if scene is None:
        return BoundedSide(side, "", math.nan)
    island = shapely.Point(scene.projection.to_plane(np.array([side.lon, side.lat])))
    ratios = list[float]()
    for plan in result.plans:
        # Only a season whose bound is lower than the others' matters.
        enough = min(ratios, default=math.inf)
        ratios += _fuel_ratio(side, island, plan, scene, result, enough)
    return BoundedSide(side, _name(island, scene, places), min(ratios, default=math.nan))


def _wide_scene(bounds: Bounds, result: RunResult, store: Store) -> Scene | None:
    """Build a scene of the bounds in which far sides were found; None without their currents."""
    region = Region(bbox=bounds)
    wide = result.scenario.model_copy(update={"region": region})
    try:
        # A bound is no reason for a download.
        fetched = fetch(wide, store, offline=True).fetched
    except PipelineError:
        return None
    grids, used = fetched.currents, result.fetched.currents
    if {(one.season, one.credit) for one in grids} != {(one.season, one.credit) for one in used}:
        return None
    projection = Projection.for_region(region.shape, wide.scale)
    polygons = np.array(fetched.land.polygons, dtype=object)
    large = polygons[shapely.area(polygons) >= region.shape.area / _CELLS]
    land = in_plane(large, projection)
    extent = extent_polygon(region.shape, projection)
    # Less land makes the bound no higher: coasts finer than the bound's cells would take minutes.
    chart = renew.Chart(extent, inner_land(land, math.sqrt(extent.area / _CELLS) * _FINE, 0.0))
    return replace(
        result.scene,
        chart=chart,
        land=tuple(land),
        currents={one.season: planar_current(one, projection, chart.bounds) for one in grids},
        start=projection.to_plane(wide.start),
        goal=projection.to_plane(wide.goal),
        projection=projection,
    )


def _name(island: shapely.Point, scene: Scene, places: Sequence[PlaceName]) -> str:
    """Return the catalogue's name of the island that holds a point, or ""."""
    outlines = [outline for outline in scene.land if outline.intersects(island)]
    for place in places:
        point = shapely.Point(scene.projection.to_plane(np.array([place.lon, place.lat])))
        if shapely.intersects(outlines, point).any():
            return place.name
    return ""


def _fuel_ratio(
    side: FarSide,
    island: shapely.Point,
    plan: SeasonPlan,
    scene: Scene,
    result: RunResult,
    enough: float,
) -> Iterator[float]:
    """Yield a bound on fuel on an island's far side, divided by a season's best route's fuel.

    At one speed, a way takes at least its length divided by the sum of the speed and the strongest
    current. A bound above `enough` is not improved.
    """
    if not plan.ranked_routes or len(scene.via):
        return
    best = plan.ranked_routes[0]
    path = scene.projection.to_plane(result.scene.projection.to_lonlat(best.path))
    strip = strip_across(island, shapely.LineString(path), [], scene, _WIDTH)
    if strip is None:
        return
    table = as_field(scene.currents[plan.season]).table(scene.chart.bounds)
    fastest = scene.vessel.speed + table.strongest
    seconds = side.length_m / scene.projection.scale / fastest
    by_length = 0.0 if plan.season in scene.speeds else seconds / best.duration
    fuel = 0.0
    if by_length < enough:
        wanted = enough * best.fuel
        fuel = fuel_elsewhere(strip, scene, plan, result.scenario.planner, _CELLS, wanted)
    yield max(fuel / best.fuel, by_length)
