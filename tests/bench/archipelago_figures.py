"""Figures on a chart of many islands: a real archipelago."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import shapely

import renew
from pipeline.geo.projection import Projection
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.sources.land.osm import land_polygons
from pipeline.stages.project import extent_polygon
from tests import yardstick
from tests.bench.clock import warm
from tests.bench.figure import Figure, at_most

ARCHIPELAGO_SEA = (20.8, 59.7, 22.9, 60.8)
"""Between Finland and Åland: west, south, east, north in degrees; some 25,000 islands."""
START, GOAL = (20.90, 60.72), (22.75, 59.85)
"""From the Bothnian Sea right through to the Gulf of Finland, lon/lat degrees."""
ISLANDS = 2000
CLASSES = 16
TOLERANCE_M = 200.0
A_CHOICE_M = 2000.0
"""What a navigator takes for an island to pass on either side there (m)."""
CLEARANCE_M, GRID_M = 50.0, 400.0
"""Of the plan that stands beside a grid search, and the grid's spacing (m)."""


def islands() -> Iterator[Figure]:
    """Yield the time of a plan through 2,000 islands of the Archipelago Sea."""
    projection = Projection.for_region(shapely.box(*ARCHIPELAGO_SEA))
    chart = _archipelago(projection)
    start, goal = projection.to_plane(START), projection.to_plane(GOAL)
    vessel = planner_vessel(catalogue.vessel("usv-7m"))
    current = _gridded(renew.GyreCurrent(0.3, 30e3, 30e3), chart.bounds, 1000.0)
    plan = partial(renew.plan, chart, current, vessel, start, goal, classes=CLASSES)
    name = f"{len(chart.no_go)} islands, {_vertices(chart)} vertices, k = {CLASSES}"
    for distinct_by in (0.0, A_CHOICE_M):
        took, found = warm(partial(plan, distinct_by=distinct_by), times=1)
        text = f"{name}, distinct by {distinct_by:g} m"
        yield at_most(f"{text}: time", took.wall, 3, " s")
        hours = [route.duration / 3600 for route in found.routes]
        yield Figure(
            f"{text}: routes (hours)",
            f"{CLASSES}",
            f"{len(hours)} ({hours[0]:.3f} to {hours[-1]:.3f})",
            len(hours) == CLASSES,
        )
    barred = yardstick.keep_out(chart.no_go, CLEARANCE_M)
    grid = yardstick.Grid.over(
        chart.extent, barred, current, vessel.speed, start, goal, GRID_M
    ).best()
    best = plan(padding="none", clearance=CLEARANCE_M, distinct_by=A_CHOICE_M).best
    if grid is not None:
        ours, limit = (
            yardstick.passage_time(path, current, vessel.speed) / 3600 for path in (best.path, grid)
        )
        what = f"{CLEARANCE_M:g} m clear, hours beside a grid of {GRID_M:g} m"
        yield at_most(f"{name}: {what}", ours, round(limit, 3), digits=3)


def _archipelago(projection: Projection) -> renew.Chart:
    """The largest islands as simple polygons with no point in common; of two that touch, one."""
    region = shapely.box(*ARCHIPELAGO_SEA)
    land = np.array(land_polygons(region, 0.0).polygons, dtype=object)
    planar = shapely.simplify(projection.geometry_to_plane(land), TOLERANCE_M)
    filled = shapely.polygons(shapely.get_exterior_ring(planar[shapely.is_valid(planar)]))
    largest = filled[np.argsort(-shapely.area(filled), kind="stable")]
    one, other = shapely.STRtree(largest).query(largest, predicate="intersects")
    largest = np.delete(largest, np.unique(np.maximum(one, other)[one != other]))
    return renew.Chart(extent_polygon(region, projection), largest[:ISLANDS].tolist())


def _gridded(
    field: renew.CurrentField, bounds: tuple[float, float, float, float], step: float
) -> renew.GriddedCurrent:
    """Put a field on a grid over bounds, as the pipeline's currents come."""
    xmin, ymin, xmax, ymax = bounds
    x, y = np.arange(xmin, xmax + step, step), np.arange(ymin, ymax + step, step)
    velocity = field(np.stack(np.meshgrid(x, y), axis=-1))
    return renew.GriddedCurrent(x, y, velocity[..., 0], velocity[..., 1])


def _vertices(chart: renew.Chart) -> int:
    """Vertices of the chart's land."""
    return sum(len(polygon.exterior.coords) - 1 for polygon in chart.no_go)
