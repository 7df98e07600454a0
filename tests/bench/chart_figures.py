"""Figures on real charts: random pairs among islands, checked on earth, and the far east."""

from __future__ import annotations

import csv
import math
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pyproj
import shapely
from shapely.geometry import Polygon

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Case, Credit, CurrentGrid, Fetched, Land
from pipeline.scenario.model import Scenario
from pipeline.sources.land import osm
from pipeline.stages.plan_case import plan_case
from pipeline.stages.project import project
from pipeline.stages.simplify import simplify_land
from tests.bench.figure import Figure, at_most
from tests.bench.pipeline_figures import run_scenario
from tests.true_scale import clearance_m, over_land_m

ARCHIPELAGOS = {
    "Calamian Islands": (119.85, 11.90, 120.30, 12.35),
    "Cyclades": (25.00, 36.80, 25.50, 37.20),
    "Archipelago Sea": (21.40, 60.08, 21.65, 60.22),
}
"""West, south, east, north in degrees."""
PAIRS = 500
FAR_EAST = (118.0, 22.0, 148.0, 45.0)
# The axis of the Kuroshio, lon/lat degrees, and its strength and half width.
_AXIS = ((122.0, 22.0), (123.5, 25.0), (128.0, 29.0), (131.0, 30.5), (136.0, 33.0), (148.0, 35.5))
_STRENGTH_M_S, _HALF_WIDTH_DEG = 0.95, 0.6
# Beyond the margin of the chart's accuracy, so that both ends lie in water for certain.
_OFF_SHORE_M = 150.0
# The line that is checked has a point this often (m).
_STEP_M = 200.0


def pairs() -> Iterator[Figure]:
    """Yield what the original land says of the routes between random pairs of water points."""
    share = -(-PAIRS // len(ARCHIPELAGOS))
    checked: list[Checked] = []
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        for number, (name, bounds) in enumerate(ARCHIPELAGOS.items()):
            region = shapely.box(*bounds)
            land = osm.land(region)
            ends = _water_pairs(land, region, min(share, PAIRS - number * share), seed=number)
            found = list(pool.map(partial(_check, land, bounds), ends))
            checked += found
            failures = Counter(one.failure.split(":")[0] for one in found if one.failure)
            yield Figure(
                f"{name}: {len(found)} random pairs",
                "",
                f"{sum(not one.failure for one in found)} planned"
                + "".join(f", {count} {why}" for why, count in failures.items()),
            )
    routes = [route for one in checked for route in one.routes]
    crossing = [route for route in routes if route.over_land_m > 0]
    name = f"{len(checked)} random pairs, {len(routes)} routes"
    yield Figure(f"{name}: routes over the original land", "0", str(len(crossing)), not crossing)
    worst = max(abs(route.reported_m - route.measured_m) for route in routes)
    yield at_most(f"{name}: clearance as reported, against AEQD planes", worst, 1.0, " m", 3)
    least = min(route.measured_m for route in routes)
    yield Figure(f"{name}: least clearance", "> 0", f"{least:.1f} m", least > 0)


def far_east() -> Iterator[Figure]:
    """Yield time and memory of `far-east` from nothing, on a current like the Kuroshio's."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        land = osm.land(shapely.box(*FAR_EAST))
        _write_kuroshio(folder / "kuroshio.nc", land)
        vertices = sum(int(shapely.get_num_coordinates(polygon)) for polygon in land.polygons)
        currents = str(folder / "kuroshio.nc")
        seconds, peak = run_scenario("far-east", folder, "--currents", currents)
        title = f"far-east, {len(land.polygons):,} polygons, {vertices:,} vertices, two seasons"
        yield at_most(f"{title}: fetch to files", seconds, 120, " s", 1)
        yield at_most("far-east: memory", peak, 3, " GB")
        with (folder / "far-east" / "metrics.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        over_land = sum(float(row["land_m"]) for row in rows)
        yield at_most(f"far-east, {len(rows)} routes: on the original land", over_land, 0, " m", 1)


@dataclass(frozen=True, slots=True)
class Route:
    """A route's clearance as reported and as measured, and how far it runs over land (m)."""

    reported_m: float
    measured_m: float
    over_land_m: float


@dataclass(frozen=True, slots=True)
class Checked:
    """A pair's routes, or why it has none."""

    routes: tuple[Route, ...]
    failure: str


def _water_pairs(
    land: Land, region: Polygon, count: int, seed: int
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Draw pairs of points in the sea of a region, off its shores."""
    plane = Projection.for_region(region)
    shores = plane.geometry_to_plane(np.array(land.polygons, dtype=object))
    sea = plane.geometry_to_plane(region, 1000.0).difference(
        shapely.union_all(shapely.buffer(shores, _OFF_SHORE_M))
    )
    # Lakes are water, but nobody gets there.
    sea = max(shapely.get_parts(sea), key=lambda part: part.area)
    shapely.prepare(sea)
    rng = np.random.default_rng(seed)
    west, south, east, north = region.bounds
    points: list[tuple[float, float]] = []
    while len(points) < 2 * count:
        lonlat = rng.uniform((west, south), (east, north))
        if shapely.contains_xy(sea, *plane.to_plane(lonlat)):
            points.append((float(lonlat[0]), float(lonlat[1])))
    return list(zip(points[::2], points[1::2], strict=True))


def _check(
    land: Land,
    bounds: tuple[float, float, float, float],
    ends: tuple[tuple[float, float], tuple[float, float]],
) -> Checked:
    """Plan between two points as a run does, and measure its routes on earth."""
    scenario = _scenario(bounds, *ends)
    try:
        scene = _scene(scenario, land)
    except RequestError as error:
        return Checked((), f"refused: {error}")
    plan = plan_case(scene, scenario.planner)
    if plan.plan is None:
        return Checked((), f"without a route: {plan.failure}")
    rows = plan.measures.routes
    return Checked(
        tuple(
            _measured(scene, land, np.asarray(route.path), row.clearance_m)
            for route, row in zip(plan.routes, rows, strict=True)
        ),
        "",
    )


def _scenario(
    bounds: tuple[float, float, float, float],
    start: tuple[float, float],
    goal: tuple[float, float],
) -> Scenario:
    """Make a scenario at true scale, for the 7 m vessel."""
    return Scenario.model_validate(
        {
            "schema_version": 1,
            "name": "pair",
            "region": {"bbox": bounds},
            "vessel": {"length_m": 7.0, "speed_m_s": 5.0, "turn_rate_deg_s": 16.5},
            "start": start,
            "goal": goal,
            "seasons": [{"name": "made-up", "valid": "2024-07", "currents": ["made-up"]}],
            "planner": {"classes": 3},
        }
    )


def _scene(scenario: Scenario, land: Land) -> Case:
    """Build the planner's world, with a current that turns once across the region."""
    if scenario.region is None:
        raise ValueError("a pair has a region")
    region, chart = scenario.region.shape, scenario.chart
    west, south, east, north = region.bounds
    lon, lat = np.linspace(west, east, 30), np.linspace(south, north, 30)
    turn = 2 * math.pi * (lon - west)[None, :] / (east - west) + (lat - south)[:, None]
    credit = Credit("made up", "current", "made up", "")
    u, v = 0.5 * np.sin(turn), 0.5 * np.cos(turn)
    current = CurrentGrid("made-up", lon, lat, u[None], v[None], "2024-07", credit)
    simplified = simplify_land(
        land.polygons,
        region,
        margin_m=chart.margin_m,
        accuracy_m=land.accuracy_m,
        tolerance_m=chart.tolerance_m,
        endpoints=(scenario.start, scenario.goal),
    )
    (case,) = project(scenario, Fetched(land, (current,)), simplified.simplified)
    return case


def _measured(scene: Case, land: Land, path: FloatArray, reported_m: float) -> Route:
    """Take a route to degrees by PROJ itself, finely cut, and measure it."""
    line = shapely.segmentize(shapely.LineString(path), _STEP_M / scene.projection.scale)
    xy = shapely.get_coordinates(line) * scene.projection.scale
    there = pyproj.Transformer.from_crs(scene.projection.crs, "OGC:CRS84", always_xy=True)
    lonlat = np.column_stack(there.transform(xy[:, 0], xy[:, 1]))
    return Route(reported_m, clearance_m(lonlat, land.polygons), over_land_m(lonlat, land.polygons))


def _write_kuroshio(path: Path, land: Land) -> None:
    """Write two months of a jet along the Kuroshio's axis over a weak drift, on a grid of 1/4°."""
    import xarray as xr

    west, south, east, north = FAR_EAST
    lon, lat = np.arange(west - 2, east + 2.1, 0.25), np.arange(south - 2, north + 2.1, 0.25)
    points = shapely.points(*np.meshgrid(lon, lat))
    axis = shapely.LineString(_AXIS)
    along = shapely.line_locate_point(axis, points)
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(axis, along.ravel() + 0.01))
    behind = shapely.get_coordinates(shapely.line_interpolate_point(axis, along.ravel() - 0.01))
    course = np.arctan2(*(ahead - behind).T).reshape(points.shape)
    strength = 0.1 + _STRENGTH_M_S * np.exp(
        -((shapely.distance(axis, points) / _HALF_WIDTH_DEG) ** 2)
    )
    dry = shapely.STRtree(land.polygons).query(points.ravel(), predicate="intersects")[0]
    strength.ravel()[dry] = np.nan
    months = np.array(["2019-02-15", "2019-08-15"], dtype="datetime64[ns]")
    field = np.stack([strength, 0.9 * strength])
    attributes = {"units": "m s-1"}
    xr.Dataset(
        {
            name: (
                ("time", "latitude", "longitude"),
                field * turn(course),
                {**attributes, "standard_name": f"{towards}_sea_water_velocity"},
            )
            for name, turn, towards in (("uo", np.sin, "eastward"), ("vo", np.cos, "northward"))
        },
        {
            "time": ("time", months, {"standard_name": "time"}),
            "latitude": ("latitude", lat, {"units": "degrees_north"}),
            "longitude": ("longitude", lon, {"units": "degrees_east"}),
        },
        {"title": "A jet like the Kuroshio, made up"},
    ).to_netcdf(path)
