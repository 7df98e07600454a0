"""A path that somebody else drew is assessed by the planner's own laws."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from shapely import LineString, box

import renew
from tests.strategies import PAPER_VESSEL

ISLAND = box(40, 30, 60, 70)
CHART = renew.Chart(box(0, 0, 100, 100), [ISLAND])
GYRE = renew.GyreCurrent(0.3, 100.0, 100.0)
ROUND_NORTH = np.array([[10.0, 50.0], [50.0, 85.0], [90.0, 50.0]])


def test_a_plans_own_route_is_assessed_as_it_was_planned() -> None:
    plan = renew.plan(CHART, GYRE, PAPER_VESSEL, (10, 50), (90, 50), classes=2)
    for route in plan.routes:
        found = renew.assess(route.path, CHART, GYRE, PAPER_VESSEL, classes=2)
        assert found.fuel == pytest.approx(route.fuel, rel=1e-9)
        assert found.times == pytest.approx(route.times, abs=1e-6)
        assert (found.homotopy, found.land) == (route.homotopy, 0.0)
        assert found.collisions == 0
        assert found.same_side is not None
        assert found.same_side.fuel == pytest.approx(route.fuel, rel=1e-4)
        assert found.best is not None
        assert found.best.fuel == pytest.approx(plan.best.fuel, rel=1e-4)


@settings(max_examples=15, deadline=None)
@given(st.floats(20, 80), st.floats(5, 95))
def test_figures_of_a_bent_line_are_those_of_the_laws(x: float, y: float) -> None:
    path = np.array([[10.0, 50.0], [x, y], [90.0, 50.0]])
    found = renew.assess(path, CHART, GYRE, PAPER_VESSEL, classes=2)
    assert found.fuel == pytest.approx(renew.fuel(path, GYRE, PAPER_VESSEL), rel=1e-12)
    line = LineString(path)
    assert found.land == pytest.approx(line.intersection(ISLAND).length, abs=1e-6)
    assert found.clearance == pytest.approx(line.distance(ISLAND), abs=1e-6)
    if found.land:
        assert found.collisions > 0
    elif found.same_side is not None:
        is_north = y > 50
        assert bool(found.same_side.path[:, 1].max() > 70) is is_north
        assert bool(found.same_side.path[:, 1].min() < 30) is not is_north
        if not found.collisions and found.clearance > 8:
            assert found.fuel >= found.same_side.fuel * (1 - 1e-6)


def test_the_side_that_the_plan_leaves_out_is_planned_beside() -> None:
    found = renew.assess(ROUND_NORTH, CHART, GYRE, PAPER_VESSEL, classes=1)
    plan = renew.plan(CHART, GYRE, PAPER_VESSEL, (10, 50), (90, 50), classes=2)
    by_name = {route.homotopy: route.fuel for route in plan.routes}
    assert found.same_side is not None
    assert found.same_side.fuel == pytest.approx(by_name[found.homotopy], rel=1e-3)
    assert found.best is not None
    assert found.best.fuel <= found.same_side.fuel * (1 + 1e-9)


def test_a_shut_area_is_named_and_a_path_from_land_is_assessed_without_a_plan() -> None:
    shut = renew.ShutArea(box(30, 80, 70, 95), 0.0, 1000.0, "range")
    found = renew.assess(ROUND_NORTH, CHART, GYRE, PAPER_VESSEL, avoid=[shut], classes=2)
    assert "range" in str(found.shut[0])
    inland = renew.assess(np.array([[50.0, 50.0], [90.0, 50.0]]), CHART, GYRE, PAPER_VESSEL)
    assert (inland.best, inland.same_side) == (None, None)
    assert isinstance(inland.cause, renew.StartInNoGoError)
    assert inland.land == pytest.approx(10.0)
    assert math.isfinite(inland.fuel)


def test_a_path_against_a_stronger_current_takes_for_ever() -> None:
    current = renew.UniformCurrent(-1.5, 0.0)
    found = renew.assess(np.array([[10.0, 10.0], [90.0, 10.0]]), CHART, current, PAPER_VESSEL)
    assert math.isinf(found.fuel)
    with pytest.raises(renew.ParameterError, match="path has shape"):
        renew.assess(np.array([[10.0, 10.0]]), CHART, current, PAPER_VESSEL)
