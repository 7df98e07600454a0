"""A run whose vessel chooses its speed from leg to leg: an island in a steady current, planned."""

from dataclasses import replace
from datetime import timedelta
from functools import cache

import numpy as np

import renew
from pipeline.findings.result import RunResult
from pipeline.findings.way_names import way_names
from pipeline.model import Case, CurrentGrid, Fetched, Land, SimplifiedLand, SpeedChoice
from pipeline.stages.plan_case import plan_case
from pipeline.stages.project import project
from tests.pipeline.formats import small_run
from tests.pipeline.tidal_run import BBOX, CREDIT, DEPARTURE, ISLAND

SPEEDS = (0.8, 3.0)
"""Lowest and highest, m/s; the vessel's own is 1.5."""
WITHIN = timedelta(hours=1, minutes=40)


def choice() -> SpeedChoice:
    """The case's choice."""
    return SpeedChoice(*SPEEDS, WITHIN.total_seconds())


def stream(season: str) -> CurrentGrid:
    """A current along the parallels that sets against the vessel first, and then with it."""
    west, south, east, north = BBOX
    lon, lat = (
        np.linspace(west - 0.02, east + 0.02, 29),
        np.linspace(south - 0.02, north + 0.02, 11),
    )
    u = 0.5 * np.tanh((lon - (west + east) / 2) / 0.01) * np.ones((lat.size, 1))
    return CurrentGrid(season, lon, lat, u[None], np.zeros((1, *u.shape)), "2026-11", CREDIT)


def run() -> RunResult:
    """Project, plan and evaluate, as a run does: a season with a choice, and one without."""
    own = {"valid": "2026-11", "currents": ["table"], "departure": DEPARTURE.isoformat()}
    chosen = {
        "arrive_by": (DEPARTURE + WITHIN).isoformat(),
        "speed": dict(zip(("least", "most"), SPEEDS, strict=True)),
    }
    asked = small_run.scenario(
        region={"bbox": list(BBOX)},
        start=[119.005, 9.53],
        goal=[119.095, 9.53],
        scale=1.0,
        vessel={"length_m": 4.0, "speed_m_s": 1.5, "turn_rate_deg_s": 4.0},
        seasons=[{"name": "chosen", **own, **chosen}, {"name": "own", **own}],
        planner={"classes": 2, "clearance": 100.0, "drift": "crab"},
    )
    grids = tuple(stream(season.name) for season in asked.seasons)
    got = Fetched(Land((ISLAND,), (small_run.LAND,), 60.0), grids)
    simplified = SimplifiedLand((ISLAND.buffer(0.0005),), (ISLAND,), 0, 0, 0.0, 0.0)
    cases = project(asked, got, simplified)
    results = [plan_case(case, asked.planner) for case in cases]
    named, islands, class_islands = way_names(cases[0].water, results, ())
    return RunResult(
        asked,
        got,
        simplified,
        cases[0].water,
        {case.name: case for case in cases},
        named,
        {},
        DEPARTURE,
        islands,
        class_islands,
    )


@cache
def planned() -> RunResult:
    """Run, once per test session."""
    return run()


def plan_by_renew(result: RunResult, arrive_by_s: float) -> renew.Plan:
    """Plan the run's voyage with `renew` itself, to arrive by a time, s."""
    case = result.case("chosen").case
    return renew.plan(
        case.chart,
        case.current,
        case.vessel,
        case.start,
        case.goal,
        **{**result.scenario.planner.model_dump(exclude={"snap", "lanes"}), "clearance": 100.0},
        min_lateness=3600.0,
        speed=SPEEDS,
        arrive_by=arrive_by_s,
    )


def stretched(case: Case) -> Case:
    """The same case on a plane whose scale grows by 2 % from its west to its east."""
    xmin, _, xmax, _ = case.chart.bounds

    class Stretched(type(case.projection)):  # type: ignore[misc]
        """The case's projection with another point scale."""

        def point_scale(self, lonlat: object) -> np.ndarray:
            x = self.to_plane(np.asarray(lonlat))[..., 0]
            return np.asarray(1.0 + 0.02 * (x - xmin) / (xmax - xmin))

    plane = case.projection
    other = Stretched(plane.crs, plane.scale, plane.central_longitude)
    given = case.water.chart
    chart = renew.Chart(given.extent, given.no_go, point_scale=other.scale_at)
    return replace(case, water=replace(case.water, chart=chart, projection=other))
