"""Figures on charts of many islands: a real archipelago, and growth with the chart's vertices."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
import shapely
from shapely import Polygon

import renew
from pipeline.geo.projection import Projection
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.sources.land.osm import land_polygons
from pipeline.stages.project import extent_polygon
from renew._types import FloatArray
from tests import yardstick
from tests.bench.clock import warm
from tests.bench.figure import Figure, at_most
from tests.strategies import PAPER_VESSEL

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
SIZES = (100, 300, 1000, 3000, 10_000)
"""Vertices of the charts whose times are fitted."""


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


def growth() -> Iterator[Figure]:
    """Yield the exponent by which time grows with the chart's vertices, and the times."""
    sizes, times = [], []
    current = renew.GyreCurrent(0.5, 100.0, 100.0)
    for wanted in SIZES:
        chart, start, goal = _scattered(wanted)
        run = partial(renew.plan, chart, current, PAPER_VESSEL, start, goal, classes=CLASSES)
        took, _ = warm(run, times=1)
        sizes.append(_vertices(chart))
        times.append(took.cpu)
    text = ", ".join(f"{size}: {1e3 * time:.0f}" for size, time in zip(sizes, times, strict=True))
    yield Figure(f"growth: CPU time (ms) by vertices, k = {CLASSES}", "", text)
    for first, of in ((0, "all sizes"), (-3, "the largest three")):
        n = np.array(sizes[first:])
        limit, exponent = _exponent(n, n * np.log(n)), _exponent(n, np.array(times[first:]))
        yield Figure(
            f"growth: exponent of time by vertices, {of}",
            f"<= {limit:.2f} (n log n)",
            f"{exponent:.2f}",
            exponent <= limit,
        )


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


def _scattered(vertices: int) -> tuple[renew.Chart, FloatArray, FloatArray]:
    """Random convex islands, one a cell of 40 m, as many as give so many vertices or a few more.

    The water's area grows with the number of islands, so that any part of a large chart is like
    a small one.
    """
    rng = np.random.default_rng(vertices)
    cells = math.ceil(math.sqrt(vertices / 5))
    found: list[Polygon] = []
    for cell in rng.permutation(cells * cells):
        centre = 40.0 * (np.array(divmod(int(cell), cells)) + rng.uniform(0.4, 0.6, 2))
        angle = np.arange(5) * 2 * np.pi / 5 + rng.uniform(0, 1, 5)
        radius = rng.uniform(5, 15)
        found.append(Polygon(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])))
    side = 40.0 * cells
    chart = renew.Chart(shapely.box(-20, -20, side + 20, side + 20), found)
    return chart, np.array([-10.0, -10.0]), np.array([side + 10, side + 10])


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


def _exponent(n: FloatArray, time: FloatArray) -> float:
    """Slope of a line through times over n, both as logarithms."""
    return float(np.polyfit(np.log(n), np.log(time), 1)[0])
