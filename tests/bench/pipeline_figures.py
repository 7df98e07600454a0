"""Figures of the pipeline as a user runs it, times until RENEW answers, and a real archipelago."""

import csv
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pyogrio
import shapely

import renew
from pipeline.geo.projection import Projection
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.sources.land.osm import land_polygons
from pipeline.stages.project import extent_polygon
from tests.bench.clock import ran, warm
from tests.bench.figure import Figure, at_most
from tests.strategies import PAPER_VESSEL, SINGLE_GYRE_ISLANDS
from tests.true_scale import GEOD


def figures() -> Iterator[Figure]:
    """Yield the pipeline's figures, one by one as they are measured."""
    with tempfile.TemporaryDirectory() as folder:
        seconds, peak = run_scenario("palawan-season", Path(folder), "--offline")
        yield at_most("palawan-season, both seasons, k = 16: time", seconds, 60, " s", 1)
        yield at_most("palawan-season: largest process", peak, 1.5, " GB")
        seconds, _ = run_scenario("palawan-season", Path(folder), "--offline")
        yield at_most("palawan-season, second run: time", seconds, 5, " s", 1)
        yield from _of_results(Path(folder) / "palawan-season")


def run_scenario(name: str, folder: Path, *options: str) -> tuple[float, float]:
    """Run a scenario as a user does; wall time (s) and the process's largest memory (GB)."""
    words = ("-m", "pipeline.cli.main", "run", name, *options, "--output", str(folder))
    taken = ran(*words)
    return taken.wall, taken.peak


def _of_results(folder: Path) -> Iterator[Figure]:
    """What the files say: collisions, land, lengths, sides."""
    with (folder / "metrics.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    collisions = sum(int(row["collisions"]) for row in rows)
    trials = sum(int(row["trials"]) for row in rows)
    yield Figure(
        "palawan-season: collisions on the original land",
        "0",
        f"{collisions} of {trials}",
        collisions == 0,
    )
    on_land = sum(float(row["land_m"]) for row in rows)
    yield at_most("palawan-season: route on the original land", on_land, 0, " m", 1)
    worst = 0.0
    _, _, shapes, (lengths,) = pyogrio.raw.read(
        folder / "routes.gpkg", layer="routes", columns=["length_m"]
    )
    for shape, length in zip(shapely.from_wkb(shapes), lengths, strict=True):
        worst = max(worst, abs(GEOD.geometry_length(shape) / length - 1))
    yield at_most("palawan-season: length attribute against its line", 100 * worst, 0.1, " %", 3)
    for season in dict.fromkeys(row["season"] for row in rows):
        found = [row for row in rows if row["season"] == season]
        first = {row["way"].split(",")[0]: row for row in reversed(found)}
        text = "; ".join(f"{way} {float(row['fuel']):.1f}" for way, row in first.items() if way)
        yield Figure(
            f"palawan-season, {season}: least fuel on each side of Palawan",
            "both sides",
            text,
            {"west of Palawan", "east of Palawan"} <= first.keys(),
        )


# Without the tests' modules, whose own imports a user's plan does not make.
FIRST_PLAN = f"""
import renew
from shapely import Polygon, box
chart = renew.Chart(box(0, 0, 100, 100), [Polygon(one) for one in {SINGLE_GYRE_ISLANDS}])
vessel = renew.{PAPER_VESSEL}
renew.plan(chart, renew.GyreCurrent(0.8, 100, 100), vessel, (10.0, 10.0), (90.0, 90.0))
"""


def startup() -> Iterator[Figure]:
    """Yield each command's least time of three, after one that is not counted (s)."""
    commands = {
        "import renew": (("-c", "import renew"), 0.5),
        "import renew and plan the single gyre": (("-c", FIRST_PLAN), 1.0),
        "renew --help": (("-m", "pipeline.cli.main", "--help"), 0.25),
    }
    for name, (words, limit) in commands.items():
        times = [ran(*words).cpu for _ in range(4)]
        yield at_most(f"{name}: CPU time", min(times[1:]), limit, " s")


ARCHIPELAGO_SEA = (20.8, 59.7, 22.9, 60.8)
"""Between Finland and Åland: west, south, east, north in degrees; some 25,000 islands."""
START, GOAL = (20.90, 60.72), (22.75, 59.85)
"""From the Bothnian Sea right through to the Gulf of Finland, lon/lat degrees."""
ISLANDS = 2000
CLASSES = 16
TOLERANCE_M = 200.0
A_CHOICE_M = 2000.0
"""What a navigator takes for an island to pass on either side there (m)."""


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
