"""Profiles and legs of routes: lengths, times, speeds and clearances, and in each file."""

import itertools
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import gpxpy
import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import assume, example, given, strategies as st
from lxml import etree
from shapely.geometry import Polygon

import renew
from pipeline._types import FloatArray
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.findings.route_profile import (
    RouteProfile,
    coast_edges,
    legs,
    metres_along,
    route_profile,
    steps_along_legs,
    times_at,
)
from pipeline.formats.gis.geopackage import write_geojson, write_geopackage
from pipeline.formats.passage.missions import write_mission, write_plan
from pipeline.formats.passage.routes import write_gpx, write_rtz
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    MAX_EXTRA_FUEL,
    Waypoints,
    case_waypoints,
)
from pipeline.formats.tables import rows
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.measure import measured
from tests.pipeline import chosen_speeds, tidal_run
from tests.pipeline.formats import oracles, runs, small_run
from tests.pipeline.results import with_case, with_measures, with_water
from tests.strategies import examples
from tests.true_scale import GEOD


def evaluated(result: RunResult) -> RunResult:
    """The run with the metrics of the real evaluation."""
    for case in result.cases:
        rows = measured(case.case, case.result, PlannerOptions()).routes
        result = with_measures(result, case.name, routes=rows)
    return result


def profile_of(
    result: RunResult,
    path: FloatArray,
    *,
    land: tuple[Polygon, ...] | None = None,
    current: renew.UniformCurrent | None = None,
) -> tuple[RouteProfile, RunResult]:
    """Profile of any path as the first season's best route, with other land or current."""
    entry = result.results[0]
    assert entry.plan is not None
    if land is not None:
        result = with_water(result, land=land)
    if current is not None:
        result = with_case(result, entry.name, current=current)
    scene = result.planned[entry.name]
    field = scene.current
    legs = range(2, len(path) + 1)
    fuels = [0.0, *(renew.fuel(path[:end], field, scene.vessel) for end in legs)]
    route = replace(
        entry.plan.best,
        path=path,
        speeds=np.full(len(path) - 1, scene.vessel.speed),
        times=np.array(fuels) / scene.vessel.fuel_rate,
        trajectory=sailed(path, field, scene.vessel),
        length=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        fuel=fuels[-1],
        duration=fuels[-1] / scene.vessel.fuel_rate,
    )
    alone = replace(entry, plan=replace(entry.plan, routes=(route,), chosen=0))
    changed = evaluated(replace(result, results=(alone,)))
    return route_profile(changed.routes[0]), changed


def sailed(path: FloatArray, current: renew.CurrentField, vessel: renew.Vessel) -> FloatArray:
    """A trajectory (m, 4) along a path whose corners need not be steerable."""
    line = shapely.LineString(path)
    track = shapely.get_coordinates(line.segmentize(line.length / 200))
    times = [renew.fuel(leg, current, vessel) for leg in np.stack([track[:-1], track[1:]], axis=1)]
    time = np.concatenate([[0.0], np.cumsum(times)]) / vessel.fuel_rate
    return np.column_stack([time, track, np.zeros(len(track))])


def check_sums(profile: RouteProfile, ranked: RankedRoute) -> None:
    """Check the arrays against each other, and against the route's own metrics."""
    metrics = ranked.metrics
    for figures in (profile.distance_m, profile.time_s, profile.fuel):
        assert figures[0] == 0
        assert (np.diff(figures) > 0).all()
    assert profile.distance_m[-1] == pytest.approx(metrics.length_m, rel=1e-6)
    assert profile.time_s[-1] == pytest.approx(metrics.duration_s, rel=1e-12)
    assert profile.fuel[-1] == pytest.approx(metrics.fuel, rel=1e-12)
    assert profile.speed_m_s[:-1] * np.diff(profile.time_s) == pytest.approx(
        np.diff(profile.distance_m)
    )
    if math.isfinite(metrics.clearance_m):
        assert profile.clearance_m.min() == pytest.approx(metrics.clearance_m, rel=1e-9, abs=1e-6)
    else:
        assert np.isinf(profile.clearance_m).all()


@pytest.mark.parametrize("planar", [False, True])
def test_the_figures_end_at_the_routes_own(planar: bool) -> None:
    result = evaluated(small_run.parts(planar=planar))
    assert result.routes
    for ranked in result.routes:
        profile = route_profile(ranked)
        check_sums(profile, ranked)
        # Speed over ground is speed through water plus the current along the course. The current is
        # the one at the point, the speed the mean up to the next point.
        tolerance = np.abs(np.diff(profile.current_along_m_s)).max() + 1e-3
        gained = profile.speed_m_s - result.cases[0].case.vessel.speed
        assert np.abs(gained - profile.current_along_m_s).max() < tolerance


@examples(8, 20)
@given(st.lists(st.tuples(st.floats(0.05, 0.95), st.floats(0.05, 0.95)), min_size=2, max_size=6))
@example([(0.5, 0.5), (0.375, 0.5)])  # all of it on one island
def test_any_path_over_water_and_land(shares: list[tuple[float, float]]) -> None:
    result = small_run.parts()
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    path = np.array([xmin, ymin]) + np.array(shares) * [xmax - xmin, ymax - ymin]
    assume(np.linalg.norm(np.diff(path, axis=0), axis=1).min() > 1)
    profile, changed = profile_of(result, path)
    check_sums(profile, changed.routes[0])
    on_land = shapely.intersects_xy(
        shapely.union_all(result.water.land), result.water.projection.to_plane(profile.lonlat)
    )
    assert (profile.clearance_m[on_land] < 1).all()


def test_clearance_is_the_distance_on_earth_to_the_nearest_coast(result: RunResult) -> None:
    ranked = result.routes[0]
    profile = route_profile(ranked, points=40)
    islands = [shapely.segmentize(p, 2e-4) for p in result.fetched.land.polygons]
    coast = shapely.get_coordinates(islands)
    for place, clearance in zip(profile.lonlat, profile.clearance_m, strict=True):
        here = np.broadcast_to(place, coast.shape)
        apart = GEOD.inv(here[:, 0], here[:, 1], coast[:, 0], coast[:, 1])[2]
        assert clearance == pytest.approx(float(np.min(apart)), rel=2e-3)


def test_points_include_the_vertices_and_are_close_enough(result: RunResult) -> None:
    ranked = result.routes[1]
    for points in (1, 10, 500):
        profile = route_profile(ranked, points=points)
        own = legs(ranked)
        sampled = result.water.projection.to_plane(profile.lonlat)
        for vertex in ranked.route.path:
            assert np.linalg.norm(sampled - vertex, axis=1).min() < 1e-6
        assert len(sampled) >= points
        steps = np.linalg.norm(np.diff(sampled, axis=0), axis=1)
        assert steps.max() <= ranked.route.length / points * (1 + 1e-9)
        # The same time and course at each vertex as in the list of legs.
        nearest = [int(np.argmin(np.linalg.norm(sampled - v, axis=1))) for v in ranked.route.path]
        assert profile.time_s[nearest] == pytest.approx(own.time_s, rel=1e-3)
        turned = (profile.course_deg[nearest] - own.course_deg + 180) % 360 - 180
        assert np.abs(turned[:-1]).max() < 0.1


def test_a_uniform_current_helps_one_way_and_hinders_the_other(planar_result: RunResult) -> None:
    current = renew.UniformCurrent(0.25, 0.0)
    out = np.array([[10.0, 10.0], [70.0, 10.0], [70.0, 90.0]])
    there, _ = profile_of(planar_result, out, current=current)
    back, _ = profile_of(planar_result, out[::-1].copy(), current=current)
    east = there.distance_m < 59.9
    assert there.current_along_m_s[east] == pytest.approx(0.25)
    assert there.speed_m_s[east] == pytest.approx(1.25)
    assert there.course_deg[east] == pytest.approx(90, abs=0.01)
    assert there.speed_m_s[-1] == pytest.approx(1.0)
    assert back.current_along_m_s[-1] == pytest.approx(-0.25)
    assert back.speed_m_s[-1] == pytest.approx(0.75)
    assert back.time_s[-1] == pytest.approx(60 / 0.75 + 80)
    # Coming from the north it passes the block's corner (60, 40) to (60, 60) ten metres off.
    assert back.clearance_m.min() == pytest.approx(10.0, rel=1e-6)


def test_open_sea_is_clear_of_everything(planar_result: RunResult) -> None:
    profile, _ = profile_of(planar_result, np.array([[10.0, 10.0], [90.0, 90.0]]), land=())
    assert np.isinf(profile.clearance_m).all()


def test_a_crossing_of_land_has_no_clearance_all_the_way_through(planar_result: RunResult) -> None:
    profile, changed = profile_of(planar_result, np.array([[10.0, 50.0], [90.0, 50.0]]))
    assert changed.routes[0].metrics.land_m == pytest.approx(20, rel=1e-3)
    inside = (profile.distance_m > 30.01) & (profile.distance_m < 49.99)
    assert (profile.clearance_m[inside] == 0).all()
    assert profile.clearance_m[0] == pytest.approx(30, rel=1e-3)


def test_a_repeated_vertex_is_one(planar_result: RunResult) -> None:
    path = np.array([[10.0, 10.0], [70.0, 10.0], [90.0, 90.0]])
    once, _ = profile_of(planar_result, path)
    twice, _ = profile_of(planar_result, np.repeat(path, 2, axis=0))
    assert twice.time_s == pytest.approx(once.time_s)
    assert twice.clearance_m == pytest.approx(once.clearance_m)


def test_the_coast_is_indexed_once_for_all_routes(result: RunResult) -> None:
    coast_edges.cache_clear()
    for ranked in result.routes:
        route_profile(ranked)
    assert coast_edges.cache_info().misses == 1


def test_land_with_a_lake_counts_its_inner_shore(planar_result: RunResult) -> None:
    ring: Polygon = shapely.box(0, 0, 100, 100) - shapely.box(5, 5, 95, 95)
    profile, _ = profile_of(planar_result, np.array([[10.0, 50.0], [90.0, 50.0]]), land=(ring,))
    assert profile.clearance_m.min() == pytest.approx(5, rel=1e-3)
    assert profile.clearance_m.max() == pytest.approx(45, rel=1e-2)


# --- Legs, against small steps along the planned line in a plane stretched like Mercator's ---


def test_legs_add_up_to_the_route() -> None:
    result = runs.stretched()
    for ranked in result.routes:
        own = legs(ranked)
        assert np.nansum(own.length_m) == pytest.approx(ranked.metrics.length_m, rel=1e-9)
        assert own.time_s[-1] == pytest.approx(ranked.metrics.duration_s)


def test_courses_are_those_of_the_planned_line() -> None:
    result = runs.stretched()
    for ranked in result.routes:
        path, own = np.asarray(ranked.route.path), legs(ranked)
        ahead = path[:-1] + 1e-3 * np.diff(path, axis=0)
        at, on = result.water.projection.to_lonlat(np.stack([path[:-1], ahead]))
        course = GEOD.inv(at[:, 0], at[:, 1], on[:, 0], on[:, 1])[0]
        apart = (own.course_deg[:-1] - course + 180) % 360 - 180
        # Tolerance: the change of course along a piece of ten kilometres.
        assert np.abs(apart).max() < 0.1


def test_times_are_those_at_true_scale() -> None:
    """A step takes its true length divided by the speed over ground there."""
    result = runs.stretched()
    ranked = result.routes[0]
    scene = ranked.case.case
    path = np.asarray(ranked.route.path)
    share = np.linspace(0, 1, 200)[:, None]
    dense = np.vstack([a + share * (b - a) for a, b in itertools.pairwise(path)])
    lonlat = scene.projection.to_lonlat(dense)
    step = GEOD.inv(lonlat[:-1, 0], lonlat[:-1, 1], lonlat[1:, 0], lonlat[1:, 1])[2]
    ahead = np.diff(dense, axis=0)
    apart = np.linalg.norm(ahead, axis=1)
    ahead = np.divide(ahead, apart[:, None], where=apart[:, None] > 0, out=np.zeros_like(ahead))
    current = np.asarray(scene.current((dense[:-1] + dense[1:]) / 2))
    time = np.append(0.0, np.cumsum(step / (scene.vessel.speed + (current * ahead).sum(axis=1))))
    # The duration itself is that of the steered trajectory.
    time *= ranked.metrics.duration_s / time[-1]
    vertices = np.append(0, np.arange(1, len(path)) * 200 - 1)
    assert legs(ranked).time_s == pytest.approx(time[vertices], rel=1e-3)
    assert times_at(metres_along(dense), path, ranked) == pytest.approx(time, rel=1e-3, abs=60)


def test_metres_along_adds_up_the_legs() -> None:
    assert metres_along(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]])).tolist() == [0, 5, 11]


# --- Speeds and times of legs, against sums of small steps: what the vessel can sail, in each file.


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
        "passage plan": [float(row["speed_kn"].split(" ")[0]) / KNOTS_PER_M_S for row in plan[1:]],
    }
    found[".geojson"] = found[".geojson"][:-1]
    return {name: np.array(speeds, dtype=float) for name, speeds in found.items()}


def times_in_files(result: RunResult, season: str, folder: Path) -> dict[str, list[datetime]]:
    """Times at which the best route's waypoints are passed, as each format has them."""
    write_rtz(result.case(season), folder / "a.rtz", departure=DEPARTURE)
    calculated = etree.parse(str(folder / "a.rtz")).findall(".//{*}scheduleElement")
    write_gpx(result.case(season), folder / "a.gpx", departure=DEPARTURE)
    route = gpxpy.parse((folder / "a.gpx").read_text("utf-8")).routes[0]
    return {
        ".rtz": [datetime.fromisoformat(one.get("eta", one.get("etd"))) for one in calculated],
        ".gpx": [point.time for point in route.points if point.time is not None],
    }


@pytest.mark.gate_share(1)
def test_no_file_asks_for_more_than_the_vessel_can_sail(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    points = case_waypoints(any_run.case(season))[0]
    quickest = oracles.quickest_s(points, any_run)
    length = np.array([GEOD.line_length(line[:, 0], line[:, 1]) for line in oracles.drawn(points)])
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
