from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import assume, example, given, strategies as st
from shapely.geometry import Polygon

import renew
from pipeline._types import FloatArray
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.findings.route_profile import RouteProfile, coast_index, legs, route_profile
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.measure import measured
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_case, with_measures, with_water
from tests.strategies import examples

GEOD = pyproj.Geod(ellps="WGS84")


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
@given(
    st.lists(st.tuples(st.floats(0.05, 0.95), st.floats(0.05, 0.95)), min_size=2, max_size=6),
)
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
    coast_index.cache_clear()
    for ranked in result.routes:
        route_profile(ranked)
    assert coast_index.cache_info().misses == 1


def test_land_with_a_lake_counts_its_inner_shore(planar_result: RunResult) -> None:
    ring: Polygon = shapely.box(0, 0, 100, 100) - shapely.box(5, 5, 95, 95)
    profile, _ = profile_of(planar_result, np.array([[10.0, 50.0], [90.0, 50.0]]), land=(ring,))
    assert profile.clearance_m.min() == pytest.approx(5, rel=1e-3)
    assert profile.clearance_m.max() == pytest.approx(45, rel=1e-2)
