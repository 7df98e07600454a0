"""Where speeds are chosen: legs of about one speed, and files that hold what is sailed."""

import json
from pathlib import Path

import gpxpy
import numpy as np
import pyogrio
import pytest
import shapely
from lxml import etree
from pymavlink import mavutil, mavwp

import renew
from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import legs, route_profile
from pipeline.formats.gis.geopackage import write_geojson, write_geopackage
from pipeline.formats.passage.missions import write_mission, write_plan
from pipeline.formats.passage.routes import write_gpx, write_rtz
from pipeline.formats.passage.safe_corridor import Drawing
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    Waypoints,
    case_waypoints,
    with_speed_changes,
)
from tests.pipeline import chosen_speeds
from tests.pipeline.formats import oracles
from tests.pipeline.tidal_run import DEPARTURE


@pytest.fixture(scope="module")
def result() -> RunResult:
    return chosen_speeds.planned()


@pytest.fixture(scope="module")
def points(result: RunResult) -> Waypoints:
    return case_waypoints(result.case("chosen"))[0]


def speeds_near(points: Waypoints, result: RunResult, leg: int) -> np.ndarray:
    """Speeds of the path's legs beside a leg, found by brute force."""
    route = points.ranked.route
    line = shapely.LineString(oracles.in_plane(result, oracles.drawn(points)[leg]).coords)
    middles = shapely.line_interpolate_point(line, np.linspace(0.01, 0.99, 99), normalized=True)
    own = shapely.linestrings(np.stack([route.path[:-1], route.path[1:]], axis=1))
    nearest = shapely.distance(np.asarray(middles)[:, None], own).argmin(axis=1)
    return np.asarray(route.speeds[nearest])


def test_a_leg_has_about_one_speed(points: Waypoints, result: RunResult) -> None:
    assert points.ranked.route.speeds.max() > 1.3 * points.ranked.route.speeds.min()
    for leg in range(len(points.lonlat) - 1):
        speeds = speeds_near(points, result, leg)
        assert speeds.max() <= 1.15 * speeds.min()
        assert speeds.min() <= points.through_water_m_s[leg] * (1 + 1e-6)
        assert points.through_water_m_s[leg] <= speeds.max() * (1 + 1e-6)
    assert np.ptp(points.through_water_m_s[:-1]) > 0.3


def test_the_legs_at_their_own_speeds_take_the_planned_time_and_fuel(points: Waypoints) -> None:
    scene, route = points.ranked.case.case, points.ranked.route
    line = scene.projection.to_plane(points.lonlat)
    current, vessel = scene.current, scene.vessel
    own = points.through_water_m_s[:-1]
    fuel = renew.fuel(line, current, vessel, drift="crab", speeds=own)
    assert fuel == pytest.approx(route.fuel, rel=5e-3)
    clock = renew.Vessel(vessel.speed, 1.0, fuel_exponent=1e-12)
    time = renew.fuel(line, current, clock, drift="crab", speeds=own)
    assert time == pytest.approx(route.duration, rel=5e-3)


def test_a_route_of_one_speed_gets_no_more_waypoints(result: RunResult) -> None:
    (own, *_) = case_waypoints(result.case("own"))
    drawing = Drawing(result.water.projection, own.curve, 1.0)
    assert with_speed_changes(own.lonlat, own.ranked.route, drawing) is own.lonlat
    assert own.through_water_m_s[:-1] == pytest.approx(1.5)


def test_times_along_the_path_are_the_planners(result: RunResult) -> None:
    ranked = result.case("chosen").routes[0]
    own = legs(ranked)
    stretch = ranked.metrics.duration_s / ranked.route.duration
    assert own.time_s == pytest.approx(stretch * ranked.route.times, rel=1e-4, abs=0.2)
    assert own.through_water_m_s[:-1].tolist() == ranked.route.speeds.tolist()


def test_the_profile_sums_up_the_fuel_of_each_speed(result: RunResult) -> None:
    ranked = result.case("chosen").routes[0]
    profile = route_profile(ranked)
    route, vessel = ranked.route, result.cases[0].case.vessel
    assert profile.fuel[-1] == pytest.approx(route.fuel)
    # The planner's own, leg by leg, at the vertices of its path.
    spent = np.append(0.0, np.cumsum(np.diff(route.times) * route.speeds**vessel.fuel_exponent))
    at_vertices = np.interp(
        route.times * ranked.metrics.duration_s / route.duration, profile.time_s, profile.fuel
    )
    assert at_vertices == pytest.approx(spent * route.fuel / spent[-1], rel=2e-3, abs=0.5)
    gained = profile.speed_m_s - profile.through_water_m_s
    assert np.abs(gained - profile.current_along_m_s).max() < 0.06


def test_rtz_and_gpx_have_the_speed_of_each_leg(
    points: Waypoints, result: RunResult, tmp_path: Path
) -> None:
    knots = points.speed_m_s[:-1] * KNOTS_PER_M_S
    write_rtz(result.case("chosen"), tmp_path / "a.rtz", departure=DEPARTURE)
    root = etree.parse(str(tmp_path / "a.rtz")).getroot()
    elements = root.findall(".//{*}scheduleElement")
    assert [float(one.get("speed")) for one in elements[1:]] == pytest.approx(knots, abs=1e-4)
    by = DEPARTURE + chosen_speeds.WITHIN
    assert elements[-1].get("eta") <= f"{by:%Y-%m-%dT%H:%M:%SZ}"
    through = points.through_water_m_s[0] * KNOTS_PER_M_S
    info = root.findall(".//{*}leg")[0].get("legInfo")
    assert f"kn ({through:.2f} kn through water)" in info
    write_gpx(result.case("chosen"), tmp_path / "a.gpx", departure=DEPARTURE)
    route = gpxpy.parse((tmp_path / "a.gpx").read_text("utf-8")).routes[0]
    planned = [float(point.extensions[0].get("planned_speed")) for point in route.points[1:]]
    assert planned == pytest.approx(knots, abs=1e-4)


def test_missions_change_the_speed_before_each_leg(
    points: Waypoints, result: RunResult, tmp_path: Path
) -> None:
    write_mission(result.case("chosen"), tmp_path / "a.waypoints")
    loader = mavwp.MAVWPLoader()
    loader.load(str(tmp_path / "a.waypoints"))
    items = [loader.wp(index) for index in range(loader.count())]
    change = mavutil.mavlink.MAV_CMD_DO_CHANGE_SPEED
    speeds = [item.param2 for item in items if item.command == change]
    assert speeds == pytest.approx(points.speed_m_s[:-1], abs=6e-4)
    write_plan(result.case("chosen"), tmp_path / "a.plan")
    content = json.loads((tmp_path / "a.plan").read_text("utf-8"))
    own = [one["params"][1] for one in content["mission"]["items"] if one["command"] == change]
    assert own == pytest.approx(points.speed_m_s[:-1], abs=6e-4)


def test_layers_have_the_speed_through_water(
    points: Waypoints, result: RunResult, tmp_path: Path
) -> None:
    write_geopackage(result, tmp_path / "a.gpkg")
    best = "season = 'chosen' AND rank = 1"
    for layer, expected in (
        ("path_points", [*points.ranked.route.speeds, np.nan]),
        ("passage", points.through_water_m_s),
        ("legs", points.through_water_m_s[:-1]),
        ("routes", [points.ranked.metrics.speed_m_s]),
    ):
        table = pyogrio.read_dataframe(tmp_path / "a.gpkg", layer=layer, where=best)
        found = table.speed_through_water_m_s.to_numpy()
        assert found == pytest.approx(np.array(expected), nan_ok=True)
    write_geojson(result.case("chosen"), tmp_path / "a.geojson")
    features = json.loads((tmp_path / "a.geojson").read_text("utf-8"))["features"]
    rows = [one["properties"] for one in features if one["properties"]["rank"] == 1]
    speeds = [row["speed_through_water_m_s"] for row in rows if row["feature"] == "waypoint"]
    assert speeds[:-1] == pytest.approx(points.through_water_m_s[:-1])
    assert speeds[-1] is None
