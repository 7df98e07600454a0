"""A season whose current changes on the way: projected, planned, evaluated, with its times."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

import renew
from pipeline.findings.route_profile import legs, route_profile
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.measure import measured
from pipeline.stages.plan_case import plan_case
from pipeline.stages.project import planar_current, project
from tests.pipeline.results import rows_of
from tests.pipeline.tidal_run import DEPARTURE, PERIOD_S, planned, tide


def test_each_slice_is_projected_as_a_steady_current_is() -> None:
    result, grid = planned(), tide(12)
    current = result.case("tide").case.current
    assert isinstance(current, renew.VaryingCurrent)
    assert current.slice_times.tolist() == grid.times_s.tolist()
    bounds = result.water.chart.bounds
    points = np.random.default_rng(1).uniform(bounds[:2], bounds[2:], (50, 2))
    for k in (0, 7, len(grid.times_s) - 1):
        alone = replace(grid, u=grid.u[k : k + 1], v=grid.v[k : k + 1], times_s=np.zeros(1))
        steady = planar_current(alone, result.water.projection, bounds)
        assert np.array_equal(current.velocity(points, grid.times_s[k]), steady(points))


def test_the_clock_begins_at_departure() -> None:
    """At departure the tide is a third of a step old, and turns from there on."""
    result = planned()
    current = result.case("tide").case.current
    assert result.planned["tide"].departure == DEPARTURE
    middle = result.water.projection.to_plane((119.05, 9.53))[None]
    for hours in (0.0, 3.0, 6.21):
        wanted = 0.4 * np.cos(2 * np.pi * hours * 3600 / PERIOD_S + 0.6)
        assert current.velocity(middle, hours * 3600)[0, 0] == pytest.approx(wanted, abs=0.005)
    assert result.routes[0].route.times[0] == 0


def test_turns_are_flown_early_on_time_and_late() -> None:
    result = planned()
    steady = replace(result.planned["tide"], current=renew.UniformCurrent(0.0, 0.0))
    still = measured(steady, result.results[0], PlannerOptions())
    for row, other in zip(rows_of(result), still.routes, strict=True):
        assert row.trials == 3 * other.trials > 300
        assert row.collisions == 0


def test_times_are_the_planners_own() -> None:
    result = planned()
    for ranked in result.routes:
        times = ranked.route.times
        assert ranked.metrics.duration_s == pytest.approx(times[-1], rel=1e-9)
        assert legs(ranked).time_s == pytest.approx(times, abs=0.5)
        profile = route_profile(ranked)
        assert profile.time_s[-1] == pytest.approx(times[-1], rel=1e-9)
        # The current met is that at the time of passage, not that at departure.
        current = result.case("tide").case.current
        points = result.water.projection.to_plane(profile.lonlat)
        ahead = np.diff(points, axis=0)
        ahead /= np.linalg.norm(ahead, axis=1)[:, None]
        met = current.velocity(points[:-1], profile.time_s[:-1])
        assert profile.current_along_m_s[:-1] == pytest.approx((met * ahead).sum(axis=1), abs=2e-3)


def test_currents_that_end_too_early_are_named_with_their_end() -> None:
    result = planned()
    needed_s = result.routes[0].metrics.duration_s
    short = tide(0.5 * needed_s / 3600)
    fetched = replace(result.fetched, currents=(short,))
    (case,) = project(result.scenario, fetched, result.simplified)
    plan = plan_case(case, result.scenario.planner)
    end = DEPARTURE + timedelta(seconds=float(short.times_s[-1]))
    assert plan.plan is None
    assert f"the current is known until {end:%Y-%m-%d %H:%M} UTC" in plan.failure
    assert "arrive at 2026-11-22" in plan.failure
    assert "give currents that reach further" in plan.failure
