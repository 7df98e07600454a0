"""Speeds and times of legs, against sums of small steps: what the vessel can sail, in each file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import gpxpy
import numpy as np
import pyogrio
import pytest
from lxml import etree

import renew
from pipeline._types import FloatArray
from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import steps_along_legs
from pipeline.formats.gis.geopackage import write_geojson, write_geopackage
from pipeline.formats.passage.missions import write_mission, write_plan
from pipeline.formats.passage.routes import write_gpx, write_kml, write_rtz
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    MAX_EXTRA_FUEL,
    Waypoints,
    case_waypoints,
)
from pipeline.formats.tables import rows
from tests.pipeline import chosen_speeds, tidal_run
from tests.pipeline.formats import oracles, runs
from tests.pipeline.results import with_case

DEPARTURE = datetime(2026, 11, 22, 6, 20, tzinfo=UTC)


def every(result: RunResult) -> Iterator[Waypoints]:
    for entry in result.results:
        yield from case_waypoints(result.case(entry.name))


def speeds_in_files(result: RunResult, season: str, folder: Path) -> dict[str, FloatArray]:
    """Speed over ground of each leg of the best route, m/s, as each format has it."""
    write_mission(result.case(season), folder / "a.waypoints")
    table = [line.split("\t") for line in (folder / "a.waypoints").read_text().splitlines()[1:]]
    write_plan(result.case(season), folder / "a.plan")
    items = json.loads((folder / "a.plan").read_text())["mission"]["items"]
    write_rtz(result.case(season), folder / "a.rtz", departure=DEPARTURE)
    calculated = etree.parse(str(folder / "a.rtz")).findall(".//{*}scheduleElement")
    write_gpx(result.case(season), folder / "a.gpx", departure=DEPARTURE)
    route = gpxpy.parse((folder / "a.gpx").read_text("utf-8")).routes[0]
    write_geojson(result.case(season), folder / "a.geojson")
    features = json.loads((folder / "a.geojson").read_text("utf-8"))["features"]
    own = [one["properties"] for one in features if one["properties"]["rank"] == 1]
    write_geopackage(result, folder / "a.gpkg")
    best = f"season = '{season}' AND rank = 1"
    legs = pyogrio.read_dataframe(folder / "a.gpkg", layer="legs", where=best)
    plan = rows(case_waypoints(result.case(season))[0], DEPARTURE)
    found = {
        ".waypoints": [float(row[5]) for row in table if row[3] == "178"],
        ".plan": [one["params"][1] for one in items if one["command"] == 178],
        ".rtz": [float(one.get("speed")) / KNOTS_PER_M_S for one in calculated[1:]],
        ".gpx": [
            float(point.extensions[0].get("planned_speed")) / KNOTS_PER_M_S
            for point in route.points[1:]
        ],
        ".geojson": [one["speed_over_ground_m_s"] for one in own if one["feature"] == "waypoint"],
        ".gpkg": legs.speed_over_ground_m_s,
        "passage plan": [float(row.speed_kn.split(" ")[0]) / KNOTS_PER_M_S for row in plan[1:]],
    }
    found[".geojson"] = found[".geojson"][:-1]
    return {name: np.array(speeds, dtype=float) for name, speeds in found.items()}


def times_in_files(result: RunResult, season: str, folder: Path) -> dict[str, list[datetime]]:
    """Times at which the best route's waypoints are passed, as each format has them."""
    write_rtz(result.case(season), folder / "a.rtz", departure=DEPARTURE)
    calculated = etree.parse(str(folder / "a.rtz")).findall(".//{*}scheduleElement")
    write_gpx(result.case(season), folder / "a.gpx", departure=DEPARTURE)
    route = gpxpy.parse((folder / "a.gpx").read_text("utf-8")).routes[0]
    write_kml(result.case(season), folder / "a.kml", departure=DEPARTURE)
    passed = etree.parse(str(folder / "a.kml")).findall(".//{*}when")
    return {
        ".rtz": [datetime.fromisoformat(one.get("eta", one.get("etd"))) for one in calculated],
        ".gpx": [point.time for point in route.points if point.time is not None],
        ".kml": [datetime.fromisoformat(one.text) for one in passed],
    }


@pytest.mark.gate_share(4)
def test_no_file_asks_for_more_than_the_vessel_can_sail(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    points = case_waypoints(any_run.case(season))[0]
    quickest = oracles.quickest_s(points, any_run)
    length = np.array(
        [oracles.GEOD.line_length(line[:, 0], line[:, 1]) for line in oracles.drawn(points)]
    )
    for name, speeds in speeds_in_files(any_run, season, tmp_path).items():
        # Half a unit of the last place: hundredths of a knot on paper, else thousandths of m/s.
        rounding = 0.005 / KNOTS_PER_M_S if name == "passage plan" else 5e-4
        assert speeds.shape == length.shape
        assert (speeds <= length / quickest * (1 + 2e-5) + rounding).all(), name
    earliest = np.append(0.0, np.cumsum(quickest))
    for name, moments in times_in_files(any_run, season, tmp_path).items():
        passed = [(moment - DEPARTURE).total_seconds() for moment in moments]
        assert (np.array(passed) >= earliest * (1 - 2e-5) - 0.5).all(), name


@pytest.mark.parametrize("make", [runs.harbours, runs.long_way, runs.far_north, tidal_run.planned])
def test_a_vessel_of_one_speed_sails_each_leg_at_it(make: Callable[[], RunResult]) -> None:
    result = make()
    for points in every(result):
        taken = np.diff(points.time_s)
        assert points.time_s[0] == 0
        assert taken == pytest.approx(oracles.quickest_s(points, result), rel=2e-5)
        assert points.metrics.duration_s == points.time_s[-1]
        if result.scenario.planner.drift == "crab":
            late = points.time_s[-1] / points.ranked.metrics.duration_s - 1
            assert abs(late) <= 1.01 * MAX_EXTRA_FUEL


def test_in_still_water_a_speed_over_ground_is_the_vessels_own() -> None:
    """The legs stand off V, and are a little longer than the path."""
    moving = runs.random_run(1)
    result = with_case(moving, runs.SEASON, current=renew.UniformCurrent(0.0, 0.0))
    for points in every(result):
        assert points.speed_m_s[:-1] == pytest.approx(result.cases[0].case.vessel.speed, rel=1e-6)


def test_across_a_fifth_of_the_speed_a_leg_takes_two_per_cent_longer_than_projected() -> None:
    """outputs/README.md says so: the drift of the plan doesn't count what heading into it costs."""
    leg, across = np.array([(0.0, 0.0), (1e4, 0.0)]), renew.UniformCurrent(0.0, 1.0)
    vessel = renew.Vessel(speed=5.0, turn_rate=0.3, length=7.0)
    made, planned = (
        renew.fuel(leg, across, vessel, drift=drift) for drift in ("crab", "projected")
    )
    assert made / planned == pytest.approx((1 - 0.2**2) ** -0.5, rel=1e-9)
    assert made / planned == pytest.approx(1.02, abs=1e-3)


def test_chosen_speeds_keep_the_planned_arrival() -> None:
    result = chosen_speeds.planned()
    for points in case_waypoints(result.case("chosen")):
        assert points.time_s[-1] == pytest.approx(points.ranked.metrics.duration_s, rel=2e-6)
        assert points.through_water_m_s[:-1].max() <= chosen_speeds.SPEEDS[1]


def test_the_highest_speed_is_not_exceeded_to_arrive_in_time() -> None:
    result = chosen_speeds.planned()
    points = case_waypoints(result.case("chosen"))[0]
    quickest_s = oracles.quickest_s(points, result).sum()
    planned = replace(points.ranked.metrics, duration_s=0.9 * quickest_s)
    line = result.water.projection.to_plane(points.lonlat)
    found = steps_along_legs(line, replace(points.ranked, metrics=planned))
    assert found.through_water_m_s == pytest.approx(chosen_speeds.SPEEDS[1])
    assert found.true_s.sum() == pytest.approx(quickest_s, rel=2e-5)
