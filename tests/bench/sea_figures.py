"""Figures on real waters that nobody tuned: beside a grid on the land as it is charted.

Land is OpenStreetMap's; the current is made of stream functions, as no file of currents covers all.
The rival is a grid Dijkstra with string pulling that keeps the route's own clearance off the
unsimplified land, and shares no code with the planner.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.geo.projection import Projection
from pipeline.model import Land
from pipeline.sources.land import osm
from pipeline.stages.project import extent_polygon
from pipeline.stages.simplify import simplify_land
from renew.inputs.options import DistinctBy
from tests.bench.figure import Figure, at_most
from tests.bench.islands_between import largest_between, sides
from tests.eddies import eddies
from tests.oracles import grid_dijkstra, tighten

VESSEL = renew.Vessel(speed=5.0, turn_rate=math.radians(10), length=7.0)
PEAK_M_S, WAVES = 0.8, 6
"""Strongest current, and its half-waves along the longer side."""

# Number of waters whose chart is refined, and distance between the places where turns begin.
_REFINED, _TURNS_EVERY_M = 5, 100.0

CELLS = 170
"""Cells of the rival's grid along the longer side; it pulls its path taut afterwards."""


@dataclass(frozen=True)
class Water:
    """A region (west, south, east, north) and two places in it, lon/lat degrees."""

    name: str
    bounds: tuple[float, float, float, float]
    start: tuple[float, float]
    goal: tuple[float, float]

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

    def chart(self, tolerance_m: float | None = None) -> renew.Chart:
        """The chart as the pipeline simplifies it."""
        simplified = simplify_land(
            self.land.polygons,
            shapely.box(*self.bounds),
            accuracy_m=osm.ACCURACY_M,
            tolerance_m=tolerance_m,
            endpoints=(self.start, self.goal),
        ).simplified
        no_go, inner = (
            self.projection.geometry_to_plane(np.array(polygons, dtype=object)).tolist()
            for polygons in (simplified.polygons, simplified.inner_polygons)
        )
        return renew.Chart(self.extent, no_go, land=inner)

    def plane(self, lonlat: FloatArray) -> FloatArray:
        """A place (2,) in the plane."""
        return np.asarray(self.projection.to_plane(lonlat))

    def over_land(self, route: renew.Route) -> float:
        """Metres of a route inside the land as it is."""
        way = shapely.LineString(route.path)
        return float(shapely.intersection(way, self.raw.hard_no_go).length)

    def plan(self, chart: renew.Chart, distinct_by: DistinctBy = "auto") -> renew.Plan:
        """Plan on a chart of this water."""
        return renew.plan(chart, self.current, VESSEL, *self.ends, distinct_by=distinct_by)

    def rival(self, clearance: float) -> float:
        """Least fuel by the grid, so far (m) off the land as it is."""
        xmin, ymin, xmax, ymax = self.extent.bounds
        spacing = max(xmax - xmin, ymax - ymin) / CELLS
        _, path = grid_dijkstra(
            self.raw, self.current, VESSEL, *self.ends, spacing, clearance, radius=4
        )
        fuel, _ = tighten(
            path, self.raw, self.current, VESSEL, clearance, spacing=spacing, width=2 * spacing
        )
        return fuel


WATERS = (
    Water("Palawan", (115.5, 7.0, 122.0, 13.5), (120.30, 12.80), (116.80, 7.70)),
    Water("Aegean", (22.5, 35.0, 29.0, 38.6), (23.55, 37.85), (28.3, 36.5)),
    Water("Bahamas", (-80.6, 23.0, -73.5, 27.6), (-80.0, 25.75), (-74.7, 24.1)),
    Water("Florida", (-83.5, 23.2, -79.0, 27.5), (-82.9, 26.8), (-79.6, 26.5)),
    Water("Messina", (14.0, 36.3, 17.5, 40.9), (14.2, 40.7), (15.5, 37.0)),
    Water("Balearics", (0.5, 37.8, 5.2, 42.0), (0.9, 38.9), (4.6, 40.6)),
    Water("Channel", (-5.6, 48.3, 1.9, 51.1), (-5.2, 49.6), (1.2, 50.6)),
    Water("Gibraltar", (-8.0, 34.6, -2.0, 37.2), (-7.5, 36.2), (-2.5, 36.3)),
    Water("Stockholm", (17.5, 58.5, 20.2, 60.2), (18.2, 58.75), (19.1, 59.95)),
    Water("Fiji", (176.3, -19.4, 181.0, -15.4), (176.8, -18.9), (180.4, -16.0)),
)
"""Ten waters, and where from and to."""


def figures() -> Iterator[Figure]:
    """Fuel beside the rival's, whatever makes a class, and a bound below what the sea allows."""
    for water in WATERS:
        started = time.process_time()
        chart = water.chart()
        simplified = time.process_time()
        plan = water.plan(chart)
        planned = time.process_time()
        best = plan.best
        way = shapely.LineString(best.path)
        clearance = float(water.raw.hard_no_go.distance(way))
        name = water.name
        yield at_most(
            f"{name}: fuel beside a grid's", best.fuel / water.rival(clearance), 1.003, digits=4
        )
        least = water.rival(0.0)
        bound = best.fuel / (1 + best.optimality_gap)
        text = f"{bound / least:.4f}"
        yield Figure(
            f"{name}: bound beside a grid's on the land itself", "<= 1", text, bound <= least
        )
        fuels = [water.plan(chart, size).best.fuel for size in (0.0, 10_000.0, 30_000.0)]
        spread = max(*fuels, best.fuel) / min(*fuels, best.fuel) - 1
        yield at_most(f"{name}: least fuel by what makes a class", 100 * spread, 0.02, " %", 4)
        yield _turns(water, plan)
        over = sum(water.over_land(route) for route in plan.routes)
        yield at_most(f"{name}: over the land itself, all routes", over, 0.0, " m")
        yield _both_sides(water, plan)
        vertices = int(shapely.get_num_coordinates(chart.hard_no_go))
        text = f"{vertices:,}: {simplified - started:.1f} s, {planned - simplified:.1f} s"
        yield Figure(
            f"{name}: vertices, CPU to simplify, to plan {len(plan.routes)} routes", "", text
        )
    for water in WATERS[:_REFINED]:
        yield _refined(water)


def _turns(water: Water, plan: renew.Plan) -> Figure:
    """Hard-over turns of all routes that met the land itself."""
    flown = [
        renew.contingency(route, water.raw, water.current, VESSEL, spacing=_TURNS_EVERY_M)
        for route in plan.routes
    ]
    hits, trials = sum(one.collisions for one in flown), sum(one.trials for one in flown)
    text = f"{hits} of {trials:,}"
    return Figure(f"{water.name}: turns that met the land itself, all routes", "0", text, not hits)


def _both_sides(water: Water, plan: renew.Plan) -> Figure:
    """Whether a plan's routes pass the largest island between start and goal on both sides."""
    name = f"{water.name}: sides of the largest island between"
    island = largest_between(
        water.land.polygons, water.bounds, np.array(water.start), np.array(water.goal)
    )
    if island is None:
        return Figure(name, "", "no island")
    found = sides((np.asarray(route.path) for route in plan.routes), water.plane(island))
    text = f"{len(found)} of the one at {island[0]:.2f} {island[1]:.2f}"
    return Figure(name, "2", text, len(found) >= 2)


def _refined(water: Water) -> Figure:
    """By how much the least fuel rises as the tolerance is halved four times."""
    tolerance_m = simplify_land(
        water.land.polygons, shapely.box(*water.bounds), accuracy_m=osm.ACCURACY_M
    ).simplified.tolerance_m
    fuels = [water.plan(water.chart(tolerance_m / 2**i)).best.fuel for i in range(5)]
    rises = [fuel / min(fuels[: i + 1]) - 1 for i, fuel in enumerate(fuels)]
    falls = ", ".join(f"{100 * (fuel / fuels[0] - 1):+.3f}" for fuel in fuels)
    name = f"{water.name}: rise of fuel from {tolerance_m:.1f} m to a 16th ({falls} %)"
    return at_most(name, 100 * max(rises), 0.02, " %", 4)
