"""Legs, against small steps along the planned line in a plane stretched like Mercator's."""

from __future__ import annotations

import itertools

import numpy as np
import pyproj
import pytest

from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import legs, metres_along, times_at
from tests.pipeline.formats import runs

GEOD = pyproj.Geod(ellps="WGS84")


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


def test_a_plane_has_legs_too(planar_result: RunResult) -> None:
    for ranked in planar_result.routes:
        own = legs(ranked)
        assert np.nansum(own.length_m) == pytest.approx(ranked.route.length, rel=1e-4)
        assert own.time_s[-1] == pytest.approx(ranked.metrics.duration_s)


def test_metres_along_adds_up_the_legs() -> None:
    assert metres_along(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]])).tolist() == [0, 5, 11]
