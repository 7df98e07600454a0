"""Planned runs for the exchange formats: random islands, 180 degrees, the far north, V."""

from datetime import UTC, datetime
from functools import cache
from unittest import mock

import numpy as np
import shapely

from pipeline.findings.result import RunResult
from pipeline.geo.projection import Projection
from pipeline.model import Credit, CurrentGrid, Fetched, Land, SimplifiedLand
from pipeline.scenario.model import Scenario
from pipeline.stages.plan_case import plan_case
from pipeline.stages.project import project
from tests.pipeline.formats import small_run

STREAM = Credit("Test stream", "current", "A stream made up for a test", "CC0")
SEASON = "summer"


def planned(
    bbox: tuple[float, float, float, float],
    islands: list[shapely.Polygon],
    start: tuple[float, float],
    goal: tuple[float, float],
    *,
    scale: float = 1000.0,
    **changes: object,
) -> RunResult:
    """Plan in a current with eddies between islands (degrees), and evaluate the routes."""
    asked = small_run.scenario(
        region={"bbox": list(bbox)},
        start=list(start),
        goal=list(goal),
        scale=scale,
        seasons=[{"name": SEASON, "valid": "2024-07", "currents": ["table"]}],
        **changes,
    )
    got = Fetched(Land(tuple(islands), (small_run.LAND,), 60.0), (_stream(bbox),))
    simplified = SimplifiedLand(tuple(islands), (), 0, 0, 0.0, 0.0)
    return _finished(asked, got, simplified)


def _stream(bbox: tuple[float, float, float, float]) -> CurrentGrid:
    """Currents of up to 0.4 m/s that curve, so that the best paths do."""
    west, south, east, north = bbox
    lon, lat = np.linspace(west - 0.2, east + 0.2, 15), np.linspace(south - 0.2, north + 0.2, 14)
    x, y = np.meshgrid(np.linspace(0, 2 * np.pi, 15), np.linspace(0, 2 * np.pi, 14))
    u, v = 0.2 + 0.2 * np.sin(y), 0.2 * np.sin(x)
    return CurrentGrid(SEASON, lon, lat, u[None], v[None], "2024-07", STREAM)


def _finished(asked: Scenario, got: Fetched, simplified: SimplifiedLand) -> RunResult:
    """Run the stages from the projection on."""
    (case,) = project(asked, got, simplified)
    found = plan_case(case, asked.planner)
    assert found.plan is not None, found.failure
    return RunResult(
        scenario=asked,
        fetched=got,
        simplified=simplified,
        water=case.water,
        planned={SEASON: case},
        results=(found,),
        timings={},
        created=datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC),
    )


def _islands(
    seed: int, bbox: tuple[float, float, float, float], count: int, size: float
) -> list[shapely.Polygon]:
    """Convex islands of up to `size` of the box's height, clear of its west and east end."""
    rng = np.random.default_rng(seed)
    west, south, east, north = bbox
    islands = []
    for _ in range(count):
        centre = rng.uniform([west, south], [east, north])
        centre[0] = west + (0.2 + 0.6 * (centre[0] - west) / (east - west)) * (east - west)
        angle = np.sort(rng.uniform(0, 2 * np.pi, 6))
        spread = rng.uniform(0.3, 1.0) * size * np.array([east - west, north - south])
        corners = centre + spread * np.column_stack([np.cos(angle), np.sin(angle)])
        islands.append(shapely.convex_hull(shapely.MultiPoint(corners)))
    return list(shapely.get_parts(shapely.union_all(islands)))


@cache
def random_run(seed: int) -> RunResult:
    """Five or so islands east of Palawan, at 1:30 to 1:1000."""
    bbox = (119.0, 9.0, 120.2, 10.0)
    scale = (30.0, 200.0, 1000.0)[seed % 3]
    islands = _islands(seed, bbox, 5, 0.15)
    return planned(bbox, islands, (119.05, 9.5), (120.15, 9.5), scale=scale)


@cache
def across_180() -> RunResult:
    """From Fiji's longitude over 180 degrees and on, 400 km."""
    bbox = (178.0, -19.0, 182.0, -16.0)
    return planned(bbox, _islands(3, bbox, 4, 0.12), (178.2, -17.5), (181.8, -17.4))


@cache
def far_north() -> RunResult:
    """North of 74 degrees, where loxodromes curve most and orthodromes are written."""
    bbox = (10.0, 73.0, 28.0, 77.0)
    return planned(bbox, _islands(5, bbox, 4, 0.12), (10.5, 75.0), (27.5, 75.2))


@cache
def long_way() -> RunResult:
    """A thousand kilometres at 55 degrees north: loxodromes are far from the plane's lines."""
    bbox = (-30.0, 50.0, -10.0, 60.0)
    return planned(bbox, _islands(2, bbox, 3, 0.08), (-29.0, 55.0), (-11.0, 55.0), scale=5000.0)


@cache
def short_way() -> RunResult:
    """Six kilometres round a few islands."""
    bbox = (119.0, 9.0, 119.06, 9.05)
    return planned(bbox, _islands(4, bbox, 5, 0.15), (119.003, 9.025), (119.057, 9.025), scale=15.0)


@cache
def stretched() -> RunResult:
    """From 41 to 59 degrees north in Mercator's plane, which stretches it by 1.3 to 1.9."""
    bbox = (-30.0, 40.0, -20.0, 60.0)
    islands = _islands(2, bbox, 2, 0.05)
    plane = Projection("EPSG:3395", 5000.0, -25.0)
    with mock.patch.object(Projection, "for_region", return_value=plane):
        return planned(bbox, islands, (-28.0, 41.0), (-22.0, 59.0), scale=5000.0)


@cache
def harbours() -> RunResult:
    """Start and goal are so close to land that both lie in V."""
    islands = [
        shapely.box(119.05, 9.3, 119.2, 9.7),
        shapely.box(119.5, 9.3, 119.7, 9.6),
        shapely.box(119.95, 9.4, 120.1, 9.8),
    ]
    return planned((119.0, 9.0, 120.2, 10.0), islands, (119.206, 9.5), (119.944, 9.6))


@cache
def open_sea() -> RunResult:
    """No land at all."""
    return planned((119.0, 9.0, 120.2, 10.0), [], (119.2, 9.5), (120.0, 9.5))


@cache
def along_the_edge() -> RunResult:
    """From end to end of the chart's southern edge, 50 m inside it."""
    bbox = (119.0, 9.0, 120.2, 10.0)
    island = shapely.box(119.5, 9.4, 119.7, 9.6)
    return planned(bbox, [island], (119.05, 9.0005), (120.15, 9.0005))
