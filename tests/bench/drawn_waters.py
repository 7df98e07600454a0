"""Waters drawn by a seed from the whole world's land of OpenStreetMap, and vessels that sail there.

Each voyage has the region, chart and offing that the pipeline chooses. An island lies between two
places where both ways round it are at most a given multiple of the best way, on a raster of the
water: no planner's code says so. Land that no raster cell parts counts as one island: whether a
narrower strait can be sailed is a matter of margin and padding.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.random import Generator
from shapely.geometry import Polygon

import renew
from pipeline._types import FloatArray
from pipeline.geo.projection import METRES_PER_DEGREE, Bounds, Projection
from pipeline.model import Land
from pipeline.scenario.catalogue import VesselSpec
from pipeline.sources.current_field import LandMask
from pipeline.sources.land import osm
from pipeline.stages.choose import offing_m
from pipeline.stages.project import extent_polygon
from pipeline.stages.simplify import simplify_land
from pipeline.stages.water_grid import DirectLine, WaterGrid, choose_region
from tests.bounded_scenes import eddies
from tests.oracles import leg_times

KNOT = 1852 / 3600
PLACES = 500
"""Number of transversals along a path of the rival."""
PEAK_M_S = 0.8
"""Strongest current."""
WAVES = 6
"""Half-waves of the current along the longer side."""

_WORLD = (-360.0, -89.0, 360.0, 89.0)
# Half the side of the box in which a coast is drawn, degrees of latitude; tries at each end.
_BOX_DEG, _TRIES = 0.3, 40
# Round corners of a buffer are cut by this share of the width.
_QUAD_SEGMENTS = 16
_CUT = math.cos(math.pi / 4 / _QUAD_SEGMENTS)


@dataclass(frozen=True)
class DrawnWater:
    """A water drawn by a seed, with the vessel that sails there.

    It has a region (west, south, east, north) and two places in it, lon/lat degrees.
    """

    name: str
    bounds: tuple[float, float, float, float]
    start: tuple[float, float]
    goal: tuple[float, float]
    spec: VesselSpec
    leaves_out: bool

    @cached_property
    def projection(self) -> Projection:
        """The plane of the region."""
        return Projection.for_region(shapely.box(*self.bounds))

    @cached_property
    def land(self) -> Land:
        """The land as it is charted."""
        return osm.land_polygons(shapely.box(*self.bounds))

    @cached_property
    def extent(self) -> shapely.Polygon:
        """The region in the plane."""
        return extent_polygon(shapely.box(*self.bounds), self.projection)

    @cached_property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Start and goal in the plane."""
        first, last = self.projection.to_plane(np.array([self.start, self.goal]))
        return first, last

    @cached_property
    def raw(self) -> renew.Chart:
        """The land as it is, in the plane."""
        planar = self.projection.geometry_to_plane(np.array(self.land.polygons, dtype=object))
        return renew.Chart(self.extent, shapely.get_parts(shapely.make_valid(planar)).tolist())

    @cached_property
    def current(self) -> renew.GriddedCurrent:
        """A current of large eddies, the same whenever it is asked for."""
        xmin, ymin, xmax, ymax = self.extent.bounds
        side = max(xmax - xmin, ymax - ymin)
        field = eddies(np.random.default_rng(7), WAVES, side)
        x, y = np.linspace(0, xmax - xmin, 200), np.linspace(0, ymax - ymin, 200)
        uv = field(np.stack(np.meshgrid(x, y), axis=-1))
        uv *= PEAK_M_S / np.linalg.norm(uv, axis=-1).max()
        return renew.GriddedCurrent(x + xmin, y + ymin, uv[..., 0], uv[..., 1])

    def plane(self, lonlat: FloatArray) -> FloatArray:
        """A place (2,) in the plane."""
        return np.asarray(self.projection.to_plane(lonlat))

    def over_land(self, route: renew.Route) -> float:
        """Metres of a route inside the land as it is."""
        way = shapely.LineString(route.path)
        return float(shapely.intersection(way, self.raw.hard_no_go).length)

    @cached_property
    def vessel(self) -> renew.Vessel:
        """The vessel as the planner takes it."""
        spec = self.spec
        rate = math.radians(spec.turn_rate_deg_s)
        return renew.Vessel(speed=spec.speed_m_s, turn_rate=rate, length=spec.length_m)

    @cached_property
    def turns_m(self) -> float:
        """Room for any hard-over turn: the turning circle, and the drift meanwhile at most."""
        return 2 * self.vessel.turning_radius + PEAK_M_S * self.vessel.turn_period

    @cached_property
    def offing(self) -> float:
        """The offing that a run chooses, m."""
        distance = DirectLine.between(self.start, self.goal).distance_m
        return float(math.floor(offing_m(self.spec, osm.ACCURACY_M, distance)))

    def simplified(self) -> renew.Chart:
        """The chart as a run simplifies it for this vessel."""
        land = simplify_land(
            self.land.polygons,
            shapely.box(*self.bounds),
            accuracy_m=osm.ACCURACY_M,
            turning_radius_m=self.vessel.turning_radius,
            endpoints=(self.start, self.goal),
        )
        no_go, inner = (
            self.projection.geometry_to_plane(np.array(polygons, dtype=object)).tolist()
            for polygons in (land.polygons, land.inner_polygons)
        )
        return renew.Chart(self.extent, no_go, land=inner)

    def has_way(self, width: float) -> bool:
        """Whether some water at least `width` m off the raw land joins both ends' own water."""
        grown = shapely.buffer(self.raw.hard_no_go, width / _CUT, quad_segs=_QUAD_SEGMENTS)
        parts, reached = shapely.get_parts(shapely.difference(self.extent, grown)), []
        for end in self.ends:
            here = shapely.Point(end)
            ways = shapely.shortest_line(here, parts)
            near = shapely.length(ways) < width
            near &= ~shapely.intersects(self.raw.hard_no_go, ways)
            reached.append(set(np.flatnonzero(near).tolist()))
        return bool(reached[0] & reached[1])

    def fuel(self, path: FloatArray) -> float:
        """Fuel along a path by the oracle's quadrature."""
        piece = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) / PLACES
        there, _ = leg_times(path[:-1], path[1:], self.current, self.vessel, "projected", piece)
        return self.vessel.fuel_rate * float(there.sum())


def drawn(seed: int) -> DrawnWater:
    """Draw ends until both lie in one body of water in the region that a run chooses."""
    rng = np.random.default_rng([35, seed])
    length = float(np.exp(rng.uniform(math.log(7), math.log(60))))
    speed, circle = rng.uniform(5, 15) * KNOT, rng.uniform(2, 6) * length
    rate = math.degrees(2 * speed / circle)
    spec = VesselSpec(length_m=length, speed_m_s=speed, turn_rate_deg_s=rate)
    while True:
        ends = _ends(rng)
        if ends is None:
            continue
        voyage = DirectLine.between(*ends)

        def mask_of(bounds: tuple[float, float, float, float]) -> LandMask:
            return LandMask.of(osm.OsmLand().land(shapely.box(*bounds)).polygons, bounds)

        bounds, leaves_out = choose_region(voyage, mask_of, _WORLD)
        water = DrawnWater(f"water {seed}", bounds, *ends, spec, leaves_out)
        parts = shapely.get_parts(water.raw.water)
        both = [shapely.covers(parts, shapely.Point(end)) for end in water.ends]
        if (both[0] & both[1]).any():
            return water


def _ends(rng: Generator) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Draw a coast, a start beside it, and a goal 5 to 120 km off, half of them by a coast."""
    place = np.array([rng.uniform(-179, 179), math.degrees(math.asin(rng.uniform(-0.9, 0.96)))])
    coast = _coast(place, _BOX_DEG)
    if not len(coast):
        return None
    furthest = 300.0 if rng.random() < 1 / 3 else 8_000.0
    start = _wet(rng, coast[rng.integers(len(coast))], 0.0, furthest)
    if start is None:
        return None
    distance = float(np.exp(rng.uniform(math.log(5_000), math.log(120_000))))
    goal = _wet(rng, start, distance, distance)
    if goal is not None and rng.random() < 1 / 2:
        coast = _coast(goal, _BOX_DEG)
        apart = np.hypot(*((coast - goal) * _degree(goal)).T) if len(coast) else np.empty(0)
        if len(coast) and apart.min() < 0.5 * distance:
            goal = _wet(rng, coast[apart.argmin()], 0.0, 1_000.0)
    if goal is None or not 5_000 <= np.hypot(*((goal - start) * _degree(start))) <= 120_000:
        return None
    return (float(start[0]), float(start[1])), (float(goal[0]), float(goal[1]))


def _degree(place: FloatArray) -> FloatArray:
    """Metres of a degree of longitude and of latitude."""
    return METRES_PER_DEGREE * np.array([math.cos(math.radians(place[1])), 1.0])


def _coast(place: FloatArray, half: float) -> FloatArray:
    """Vertices (n, 2) of the coast in a box."""
    low, high = (place + sign * half * METRES_PER_DEGREE / _degree(place) for sign in (-1, 1))
    land = osm.land_polygons(shapely.box(*low, *high), 0.0).polygons
    coast = shapely.get_coordinates(np.array(land, dtype=object))
    inside = ((coast > low + 1e-3) & (coast < high - 1e-3)).all(axis=1)
    return np.asarray(coast[inside])


def _wet(rng: Generator, near: FloatArray, least: float, most: float) -> FloatArray | None:
    """Draw a place in water at some distance from another, m; None where land takes all tries."""
    for _ in range(_TRIES):
        angle, metres = rng.uniform(0, 2 * math.pi), rng.uniform(least, most)
        place = near + metres * np.array([math.cos(angle), math.sin(angle)]) / _degree(near)
        box = shapely.Point(place).buffer(1e-4)
        land = np.array(osm.land_polygons(box, 10.0).polygons, dtype=object)
        if abs(place[1]) < 80 and not shapely.intersects_xy(land, *place).any():
            return np.round(place, 5)
    return None


# Cells along each side, and those that the smallest island has: rocks are no choice of sides.
_CELLS, _LEAST_CELLS = 400, 20
# Number of islands that are tried, the largest first.
_TRIED = 12


def largest_between(
    land: Sequence[Polygon],
    bounds: Bounds,
    start: FloatArray,
    goal: FloatArray,
    longest_way: float = 1.25,
) -> FloatArray | None:
    """Point (lon, lat) in the largest island with both ways at most so long, in best ways."""
    grid = _grid(land, bounds)
    first, last = grid.water_near(*start), grid.water_near(*goal)
    if first is None or last is None or not (ways := grid.shortest_paths(first, last)):
        return None
    longest = longest_way * ways[0][0]
    size = np.bincount(grid.islands.ravel())
    size[0] = 0
    largest_first = [int(one) for one in np.argsort(-size) if size[one] >= _LEAST_CELLS]
    inner = [island for island in largest_first if not grid.leaves(island)]
    for island in inner[:_TRIED]:
        ways = grid.shortest_paths(first, last, island)
        if len(ways) > 1 and ways[-1][0] <= longest:
            cells = np.argwhere(grid.islands == island)
            row, column = cells[np.abs(cells - cells.mean(axis=0)).sum(axis=1).argmin()]
            return np.array([grid.lon[column], grid.lat[row]])
    return None


def sides(paths: Iterable[FloatArray], point: FloatArray) -> set[int]:
    """Sides on which paths (n, 2) with the same ends pass a point: numbers of turns round it."""
    swept = []
    for path in paths:
        x, y = (path - point).T
        swept.append(np.diff(np.unwrap(np.arctan2(y, x))[[0, -1]]).item())
    return {round((angle - min(swept)) / (2 * np.pi)) for angle in swept}


def _grid(land: Sequence[Polygon], bounds: Bounds) -> WaterGrid:
    """Cells whose centres are half a cell off land: straits narrower than a cell are shut."""
    west, south, east, north = bounds
    lon, lat = (
        low + (high - low) * (np.arange(_CELLS) + 0.5) / _CELLS
        for low, high in ((west, east), (south, north))
    )
    centres = shapely.points(np.stack(np.meshgrid(lon, lat), axis=-1).reshape(-1, 2))
    is_water = np.ones(len(centres), dtype=bool)
    near = (north - south) / _CELLS / 2
    is_water[shapely.STRtree(centres).query(land, predicate="dwithin", distance=near)[1]] = False
    return WaterGrid(lon, lat, is_water.reshape(_CELLS, _CELLS))
