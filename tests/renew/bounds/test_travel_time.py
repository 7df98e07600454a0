"""Travel times on a grid against straight lines in still water and in a uniform current."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from shapely import box

import renew
from renew._types import FloatArray
from renew.bounds.grids import sampled, wet_cells
from renew.bounds.travel_time import TravelGrid, locate, solve, source
from renew.kernels.ground_speed import Polar, ground_speed
from tests.compiler import uncompiled
from tests.renew.bounds.fields import FIELDS

START = np.array([30.0, 40.0])
EMPTY = renew.Chart(box(0, 0, 100, 100))
STILL = renew.UniformCurrent(0.0, 0.0)
# Empty times, so that a search doesn't stop early; a slice, so that the compiler sees the type of a
# grid's view.
EVERYWHERE = np.full((3, 3), np.inf)[:2, :2]


def grid_over(
    chart: renew.Chart, current: renew.CurrentField = STILL, *, crab: bool = False, nodes: int = 51
) -> TravelGrid:
    """Grid of nodes over a square of 100 m, for a vessel of 1 m/s."""
    x = y = np.linspace(0, 100, nodes)
    return TravelGrid(
        x,
        y,
        sampled(current, x, y, np.ones((nodes, nodes), dtype=bool)),
        0.0,
        np.zeros((nodes - 1, nodes - 1)),
        wet_cells(chart, x, y),
        Polar(1.0, crab),
    )


def times_from_start(grid: TravelGrid) -> FloatArray:
    """Travel times (ny, nx) from the start to all nodes that can be reached."""
    time, dirty = source(grid, START)
    solve(time, dirty, np.ones(grid.wet.shape), grid, EVERYWHERE)
    return time


@settings(max_examples=8)
@given(strength=st.floats(0, 0.8), towards=st.floats(-math.pi, math.pi), crab=st.booleans())
def test_a_uniform_current_is_crossed_in_a_straight_line(
    strength: float, towards: float, crab: bool
) -> None:
    u, v = strength * math.cos(towards), strength * math.sin(towards)
    grid = grid_over(EMPTY, renew.UniformCurrent(u, v), crab=crab)
    time = times_from_start(grid)
    assert time.min() == 0
    for row, column in np.random.default_rng(0).integers(0, 51, (30, 2)):
        way = np.array([grid.x[column], grid.y[row]]) - START
        distance = float(np.linalg.norm(way))
        if distance < 20:
            continue
        tx, ty = way / distance
        straight = distance / ground_speed(u, v, tx, ty, grid.polar)
        assert time[row, column] <= straight * 1.05
        # Against more than half of its speed the projected vessel does better by tacking.
        if crab or u * tx + v * ty > -0.5:
            assert time[row, column] >= straight * 0.97


def test_land_is_gone_round_and_water_behind_it_is_out_of_reach() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(46, 20, 54, 101), box(80, -1, 82, 101)])
    grid = grid_over(chart)
    time = times_from_start(grid)
    behind = locate(grid, np.array([70.0, 40.0])).values(time)
    assert behind == pytest.approx(2 * math.hypot(16, 20) + 8, rel=0.03)
    assert np.isinf(time[:, grid.x > 83]).all()


def test_interpolation_is_exact_where_times_are_linear() -> None:
    grid = grid_over(EMPTY)
    linear = 3.0 * grid.x + 2.0 * grid.y[:, None]
    for point in np.random.default_rng(0).uniform(0, 100, (20, 2)):
        found = locate(grid, point)
        assert found.values(linear) == pytest.approx(3 * point[0] + 2 * point[1])
        assert found.weights.sum(axis=1) == pytest.approx(1)


@pytest.mark.parametrize("name", FIELDS)
def test_the_compiler_changes_no_time(name: str) -> None:
    grid = grid_over(EMPTY, FIELDS[name], nodes=11)
    time, dirty = source(grid, START)
    uncompiled(solve)(time, dirty, np.ones(grid.wet.shape), grid, EVERYWHERE)
    assert times_from_start(grid) == pytest.approx(time)
    assert np.isfinite(time).all()
