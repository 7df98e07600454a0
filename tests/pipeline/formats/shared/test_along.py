from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import renew
from pipeline.formats.shared.along import _coast, along
from pipeline.formats.shared.legs import legs
from pipeline.stages.evaluate import evaluate_season
from tests.pipeline.formats import small_run

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from pipeline.formats.shared.along import Along
    from pipeline.formats.shared.result import FloatArray, RankedRoute, RunResult

GEOD = pyproj.Geod(ellps="WGS84")


def judged(result: RunResult) -> RunResult:
    """Give a run the figures of the real evaluation."""
    parts = [
        evaluate_season(result.scene, plan, result.scenario.scale, seed=0) for plan in result.plans
    ]
    rows = tuple(row for part in parts for row in part.routes)
    return replace(result, evaluation=replace(result.evaluation, routes=rows))


def through(
    result: RunResult,
    path: FloatArray,
    *,
    land: tuple[Polygon, ...] | None = None,
    current: renew.UniformCurrent | None = None,
) -> tuple[Along, RunResult]:
    """Look along any path, as the best route of the first season, on other land or current."""
    entry = result.plans[0]
    assert entry.plan is not None
    scene = result.scene if land is None else replace(result.scene, land=land)
    if current is not None:
        scene = replace(scene, currents={entry.season: current})
    field = scene.currents[entry.season]
    route = replace(
        entry.plan.best,
        path=path,
        trajectory=sailed(path, field, scene.vessel),
        length=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        fuel=renew.fuel(path, field, scene.vessel),
        duration=renew.fuel(path, field, scene.vessel) / scene.vessel.fuel_rate,
    )
    plans = (replace(entry, plan=replace(entry.plan, routes=(route,), chosen=0)),)
    changed = judged(replace(result, scene=scene, plans=plans))
    return along(changed.routes[0], changed), changed


def sailed(path: FloatArray, current: renew.CurrentField, vessel: renew.Vessel) -> FloatArray:
    """A trajectory (m, 4) over a path whose corners need not be steerable."""
    line = shapely.LineString(path)
    track = shapely.get_coordinates(line.segmentize(line.length / 200))
    times = [renew.fuel(leg, current, vessel) for leg in np.stack([track[:-1], track[1:]], axis=1)]
    time = np.concatenate([[0.0], np.cumsum(times)]) / vessel.fuel_rate
    return np.column_stack([time, track, np.zeros(len(track))])


def check_sums(found: Along, ranked: RankedRoute) -> None:
    """What must hold between the arrays, and against the route's own figures."""
    metrics = ranked.metrics
    for figures in (found.distance_m, found.time_s, found.fuel):
        assert figures[0] == 0
        assert (np.diff(figures) > 0).all()
    assert found.distance_m[-1] == pytest.approx(metrics.length_m, rel=1e-6)
    assert found.time_s[-1] == pytest.approx(metrics.duration_s, rel=1e-12)
    assert found.fuel[-1] == pytest.approx(metrics.fuel, rel=1e-12)
    assert found.speed_m_s[:-1] * np.diff(found.time_s) == pytest.approx(np.diff(found.distance_m))
    if math.isfinite(metrics.clearance_m):
        assert found.clearance_m.min() == pytest.approx(metrics.clearance_m, rel=1e-9, abs=1e-6)
    else:
        assert np.isinf(found.clearance_m).all()


@pytest.mark.parametrize("planar", [False, True])
def test_the_figures_end_at_the_routes_own(planar: bool) -> None:
    result = judged(small_run.parts(planar=planar))
    assert result.routes
    for ranked in result.routes:
        found = along(ranked, result)
        check_sums(found, ranked)
        # Speed over ground is speed through water plus what the current gives along the course;
        # the current is that of a place, and speed the mean to the next.
        slack = np.abs(np.diff(found.current_along_m_s)).max() + 1e-3
        given_by_current = found.speed_m_s - result.scene.vessel.speed
        assert np.abs(given_by_current - found.current_along_m_s).max() < slack


@settings(max_examples=20)
@given(
    st.lists(st.tuples(st.floats(0.05, 0.95), st.floats(0.05, 0.95)), min_size=2, max_size=6),
)
@example([(0.5, 0.5), (0.375, 0.5)])  # on one island all the way
def test_any_path_over_water_and_land(shares: list[tuple[float, float]]) -> None:
    result = small_run.parts()
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    path = np.array([xmin, ymin]) + np.array(shares) * [xmax - xmin, ymax - ymin]
    assume(np.linalg.norm(np.diff(path, axis=0), axis=1).min() > 1)
    found, changed = through(result, path)
    check_sums(found, changed.routes[0])
    on_land = shapely.intersects_xy(
        shapely.union_all(result.scene.land), result.scene.projection.to_plane(found.lonlat)
    )
    assert (found.clearance_m[on_land] < 1).all()


def test_clearance_is_the_distance_on_earth_to_the_nearest_coast(result: RunResult) -> None:
    ranked = result.routes[0]
    found = along(ranked, result, points=40)
    islands = [shapely.segmentize(p, 2e-4) for p in result.fetched.land.polygons]
    coast = shapely.get_coordinates(islands)
    for place, clearance in zip(found.lonlat, found.clearance_m, strict=True):
        here = np.broadcast_to(place, coast.shape)
        apart = GEOD.inv(here[:, 0], here[:, 1], coast[:, 0], coast[:, 1])[2]
        assert clearance == pytest.approx(float(np.min(apart)), rel=2e-3)


def test_the_places_are_the_vertices_and_no_further_apart_than_asked(result: RunResult) -> None:
    ranked = result.routes[1]
    for points in (1, 10, 500):
        found = along(ranked, result, points=points)
        own = legs(ranked, result)
        places = result.scene.projection.to_plane(found.lonlat)
        for vertex in ranked.route.path:
            assert np.linalg.norm(places - vertex, axis=1).min() < 1e-6
        assert len(places) >= points
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert steps.max() <= ranked.route.length / points * (1 + 1e-9)
        # The same time and course at each vertex as in the list of legs.
        nearest = [int(np.argmin(np.linalg.norm(places - v, axis=1))) for v in ranked.route.path]
        assert found.time_s[nearest] == pytest.approx(own.time_s, rel=1e-3)
        turned = (found.course_deg[nearest] - own.course_deg + 180) % 360 - 180
        assert np.abs(turned[:-1]).max() < 0.1


def test_a_uniform_current_helps_one_way_and_hinders_the_other(planar_result: RunResult) -> None:
    current = renew.UniformCurrent(0.25, 0.0)
    out = np.array([[10.0, 10.0], [70.0, 10.0], [70.0, 90.0]])
    there, _ = through(planar_result, out, current=current)
    back, _ = through(planar_result, out[::-1].copy(), current=current)
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
    found, _ = through(planar_result, np.array([[10.0, 10.0], [90.0, 90.0]]), land=())
    assert np.isinf(found.clearance_m).all()


def test_a_crossing_of_land_has_no_clearance_all_the_way_through(planar_result: RunResult) -> None:
    found, changed = through(planar_result, np.array([[10.0, 50.0], [90.0, 50.0]]))
    assert changed.routes[0].metrics.land_m == pytest.approx(20, rel=1e-3)
    inside = (found.distance_m > 30.01) & (found.distance_m < 49.99)
    assert (found.clearance_m[inside] == 0).all()
    assert found.clearance_m[0] == pytest.approx(30, rel=1e-3)


def test_a_vertex_said_twice_is_one(planar_result: RunResult) -> None:
    path = np.array([[10.0, 10.0], [70.0, 10.0], [90.0, 90.0]])
    once, _ = through(planar_result, path)
    twice, _ = through(planar_result, np.repeat(path, 2, axis=0))
    assert twice.time_s == pytest.approx(once.time_s)
    assert twice.clearance_m == pytest.approx(once.clearance_m)


def test_the_coast_is_cut_once_for_all_routes(result: RunResult) -> None:
    _coast.cache_clear()
    for ranked in result.routes:
        along(ranked, result)
    assert _coast.cache_info().misses == 1


def test_land_with_a_lake_counts_its_inner_shore(planar_result: RunResult) -> None:
    ring: Polygon = shapely.box(0, 0, 100, 100) - shapely.box(5, 5, 95, 95)
    found, _ = through(planar_result, np.array([[10.0, 50.0], [90.0, 50.0]]), land=(ring,))
    assert found.clearance_m.min() == pytest.approx(5, rel=1e-3)
    assert found.clearance_m.max() == pytest.approx(45, rel=1e-2)
