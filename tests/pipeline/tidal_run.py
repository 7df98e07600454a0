"""A run whose current changes on the way: an island in a tide, really planned."""

from datetime import UTC, datetime
from functools import cache

import numpy as np
import shapely

from pipeline.findings.result import RunResult
from pipeline.model import Credit, CurrentGrid, Fetched, Land, SimplifiedLand
from pipeline.stages.plan_case import plan_case
from pipeline.stages.project import project
from tests.pipeline.formats import small_run

BBOX = (119.0, 9.50, 119.10, 9.56)
ISLAND = shapely.Polygon([(119.04, 9.52), (119.06, 9.522), (119.058, 9.54), (119.042, 9.538)])
DEPARTURE = datetime(2026, 11, 22, 6, 20, tzinfo=UTC)
CREDIT = Credit("A tide", "current", "A tide made up for a test", "CC0")
# Of the tide M2, s.
PERIOD_S = 12.42 * 3600


def tide(hours: float, *, spacing_s: float = 1800.0) -> CurrentGrid:
    """Give a tide along the parallels, stronger in the north, for some hours from departure on."""
    west, south, east, north = BBOX
    lon, lat = (
        np.linspace(west - 0.02, east + 0.02, 15),
        np.linspace(south - 0.02, north + 0.02, 11),
    )
    times = np.arange(-spacing_s / 3, hours * 3600 + spacing_s, spacing_s)
    strength = 0.3 + 0.2 * (lat - south) / (north - south)
    phase = 2 * np.pi * times / PERIOD_S + 0.6
    u = np.cos(phase)[:, None, None] * strength[:, None] * np.ones(lon.size)
    v = 0.1 * np.sin(phase)[:, None, None] * np.ones((lat.size, lon.size))
    return CurrentGrid("tide", lon, lat, u, v, "2026-11-22", CREDIT, times_s=times)


def run(grid: CurrentGrid, islands: tuple[shapely.Polygon, ...] = (ISLAND,)) -> RunResult:
    """Project, plan and evaluate, as a run does."""
    asked = small_run.scenario(
        region={"bbox": list(BBOX)},
        start=[119.005, 9.53],
        goal=[119.095, 9.53],
        scale=1.0,
        vessel={"length_m": 4.0, "speed_m_s": 1.5, "turn_rate_deg_s": 4.0},
        seasons=[
            {
                "name": "tide",
                "time_method": "changing",
                "departure": DEPARTURE.isoformat(),
                "currents": ["./tide.nc"],
            }
        ],
        planner={"classes": 2, "clearance": 100.0, "drift": "crab"},
    )
    got = Fetched(Land(islands, (small_run.LAND,), 60.0), (grid,))
    no_go = tuple(island.buffer(0.0005) for island in islands)
    simplified = SimplifiedLand(no_go, islands, 0, 0, 0.0, 0.0)
    (case,) = project(asked, got, simplified)
    found = plan_case(case, asked.planner)
    return RunResult(asked, got, simplified, case.water, {"tide": case}, (found,), {}, DEPARTURE)


@cache
def planned() -> RunResult:
    """Run with a tide that is known for twelve hours, once per test session."""
    return run(tide(12))
