"""A small run, really planned: two islands east of Palawan, two seasons, made-up currents."""

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

import numpy as np
import shapely

import renew
from pipeline.findings.result import RunResult
from pipeline.findings.way_names import way_names
from pipeline.model import (
    Case,
    CaseResult,
    Credit,
    CurrentGrid,
    Fetched,
    Land,
    Measures,
    Note,
    RouteMetrics,
    ShutStrait,
    SimplifiedLand,
    Zone,
)
from pipeline.model.inputs import current_notes
from pipeline.scenario.model import Scenario
from pipeline.stages.project import project

LAND = Credit("Test land", "land", "© nobody in particular", "none", "https://example.org/land")
STAND_IN = Credit("Test table", "current", "Figures made up for a test", "CC0")
PREFERRED = Credit("Better source", "current", "Figures made up with more care", "CC BY 4.0")
PASSED_OVER = ("better-source", "better-source needs an account")
REASON = f"summer: {PASSED_OVER[1]}"


def note(text: str) -> Note:
    """A note of just these words."""
    return Note.of("source-passed-over", source="a source", reason=text)


NOTES = (REASON, "summer: planned on Test table, valid 2020-06-17")
SPACING = 4.0


def scenario(**changes: object) -> Scenario:
    """A chart scenario at 1:1000; `changes` replace whole keys."""
    content: dict[str, object] = {
        "schema_version": 1,
        "name": "small-run",
        "title": "Two islands",
        "description": "North or south about?",
        "region": {"bbox": [119.0, 9.0, 120.2, 10.0]},
        "vessel": {"length_m": 2.0, "speed_m_s": 1.0, "turn_rate_deg_s": 35.0},
        "scale": 1000.0,
        "start": [119.1, 9.5],
        "goal": [120.1, 9.5],
        "seasons": [
            {"name": "summer", "title": "July 2024", "valid": "2024-07", "currents": ["table"]},
            {"name": "winter", "title": "December", "valid": "2024-12", "currents": ["table"]},
        ],
        "planner": {"classes": 4},
    }
    return Scenario.model_validate({**content, **changes})


def planar_scenario() -> Scenario:
    """A scenario in metres: one obstacle in one gyre."""
    return scenario(
        region=None,
        plane={
            "extent": [0.0, 0.0, 100.0, 100.0],
            "obstacles": [[[40.0, 40.0], [60.0, 40.0], [60.0, 60.0], [40.0, 60.0]]],
        },
        scale=1.0,
        start=[10.0, 10.0],
        goal=[90.0, 90.0],
        seasons=[{"name": "gyre", "gyre": {"amplitude": 0.5}}],
    )


def fetched(asked: Scenario) -> Fetched:
    """Land of two islands; a current to the east in summer, a shear in winter, with a gap."""
    if asked.plane is not None:
        lonlat = [
            shapely.Polygon(np.array(corners) / 111_000.0) for corners in asked.plane.obstacles
        ]
        return Fetched(Land(tuple(lonlat), (LAND,), 0.0), ())
    islands = (
        shapely.Polygon(
            [(119.4, 9.35), (119.6, 9.38), (119.62, 9.6), (119.45, 9.66), (119.38, 9.5)]
        ),
        shapely.Polygon([(119.8, 9.5), (119.9, 9.52), (119.88, 9.7), (119.78, 9.68)]),
    )
    lon, lat = np.linspace(118.8, 120.4, 9), np.linspace(8.8, 10.2, 8)
    north = np.broadcast_to((lat[:, None] - 9.5) / 0.7, (8, 9))
    gap = np.zeros((8, 9), dtype=bool)
    gap[3:5, 3:5] = True
    grids = tuple(
        CurrentGrid(
            season,
            lon,
            lat,
            np.where(gap, np.nan, u)[None],
            np.where(gap, np.nan, v)[None],
            valid,
            credit,
            passed_over=(PASSED_OVER,) if credit is STAND_IN else (),
        )
        for season, valid, credit, u, v in (
            ("summer", "2020-06-17", STAND_IN, 0.3 + 0.1 * north, 0.05 * north),
            ("winter", "2024-01", PREFERRED, -0.4 * north, 0.1 + 0.0 * north),
        )
        if season in {spec.name for spec in asked.seasons}
    )
    return Fetched(Land(islands, (LAND,), 60.0), grids, current_notes(grids))


def metrics(case: Case, rank: int, route: renew.Route, found: renew.Contingency) -> RouteMetrics:
    """A route's metrics, computed in the simplest way."""
    line, land = shapely.LineString(route.path), shapely.union_all(case.water.land)
    scale = case.projection.scale
    return RouteMetrics(
        rank=rank,
        homotopy=route.homotopy,
        fuel=route.fuel,
        fuel_per_distance=route.fuel_per_distance,
        length=route.length,
        length_m=case.projection.geodesic_length_m(
            shapely.get_coordinates(line.segmentize(route.length / 500))
        ),
        clearance_m=float(shapely.distance(line, land)) * scale,
        duration_s=route.duration * scale,
        speed_m_s=case.vessel.speed,
        optimality_gap=route.optimality_gap,
        trials=found.trials,
        collisions=found.collisions,
        land_m=float(shapely.intersection(line, land).length) * scale,
        still_fuel=case.vessel.fuel_rate * route.length / case.vessel.speed,
    )


@cache
def parts(*, planar: bool = False) -> RunResult:
    """Run the scenario, once per test session."""
    asked = planar_scenario() if planar else scenario()
    got = fetched(asked)
    simplified = SimplifiedLand(
        polygons=tuple(polygon.buffer(0.002, quad_segs=1) for polygon in got.land.polygons),
        inner_polygons=got.land.polygons,
        original_vertices=sum(len(shapely.get_coordinates(p)) for p in got.land.polygons),
        vertices=24,
        tolerance_m=100.0,
        margin_m=60.0,
    )
    cases, results = project(asked, got, simplified), []
    for case in cases:
        plan = renew.plan(
            case.chart,
            case.current,
            case.vessel,
            case.start,
            case.goal,
            classes=asked.planner.classes,
        )
        original = renew.Chart(case.chart.extent, case.water.land)
        turns = tuple(
            renew.contingency(route, original, case.current, case.vessel, spacing=SPACING)
            for route in plan.routes
        )
        rows = tuple(
            metrics(case, rank, route, found)
            for rank, (route, found) in enumerate(zip(plan.routes, turns, strict=True), start=1)
        )
        results.append(CaseResult(case.name, plan, "", 1.5, measures=Measures(rows, turns)))
    named, islands, class_islands = way_names(cases[0].water, results, ())
    return RunResult(
        scenario=asked,
        fetched=got,
        simplified=simplified,
        water=cases[0].water,
        planned={case.name: case for case in cases},
        results=named,
        timings={"fetch": 0.25, "plan": 1.0},
        created=datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC),
        islands=islands,
        class_islands=class_islands,
    )


def with_zones(result: RunResult, name: str = "Whale & calf", rule: str = "") -> RunResult:
    """The same run on a chart with zones.

    A restricted area that extends beyond the chart and that the first season's best route runs
    through, a traffic scheme that no route meets, another outside the chart, and a shoal that is
    the second island's western half.
    """
    start = result.scenario.start
    zones = (
        Zone("restricted", name, rule, shapely.box(118.5, start[1] - 0.1, 119.2, start[1] + 0.1)),
        Zone("traffic", "", "keep to starboard", shapely.box(119.9, 9.9, 120.0, 9.95)),
        Zone("traffic", "", "none sees this", shapely.box(121.0, 9.9, 121.1, 9.95)),
        Zone(
            "shoal", "", "", shapely.box(119.7, 9.4, 119.84, 9.8) & result.fetched.land.polygons[1]
        ),
    )
    land = replace(result.fetched.land, zones=zones)
    return replace(result, fetched=replace(result.fetched, land=land))


def with_a_shut_strait(result: RunResult) -> RunResult:
    """The same run with a strait between its islands that counts as shut."""
    return replace(
        result,
        straits=(ShutStrait(119.7, 9.55, 900.0, 1000.0, 760.0, "padding", saves=0.2, way=1),),
    )


def with_a_failed_season(result: RunResult) -> RunResult:
    """The same run, but without a plan for winter."""
    failed = CaseResult("winter", None, "no water joins start and goal <b>at all</b>", 0.5)
    results = (failed if one.name == "winter" else one for one in result.results)
    return replace(result, results=tuple(results))


def without_a_current(result: RunResult) -> RunResult:
    """The same run, as if winter had no current, so that nothing was planned."""
    failed = with_a_failed_season(result)
    grids = tuple(grid for grid in result.fetched.currents if grid.case != "winter")
    planned = {name: case for name, case in result.planned.items() if name != "winter"}
    return replace(failed, fetched=replace(result.fetched, currents=grids), planned=planned)


def without_stand_ins(result: RunResult) -> RunResult:
    """The same run, as if every current were the requested one."""
    grids = tuple(replace(grid, passed_over=()) for grid in result.fetched.currents)
    return replace(result, fetched=replace(result.fetched, currents=grids))
