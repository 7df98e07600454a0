"""Grids of the bound: times against straight lines, and the current against its interpolant."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from shapely import box

import renew
from renew._types import FloatArray
from renew.bounds.grids import deviation_radius, sampled, wet_cells, whole_grid
from renew.bounds.travel_time import TravelGrid, locate, solve, source
from renew.kernels.ground_speed import Polar, ground_speed
from tests.compiler import uncompiled
from tests.strategies import STILL, StreamFunctionCurrent, voyage_on

CORNER, OPPOSITE = np.array([10.0, 10.0]), np.array([90.0, 90.0])
"""Start and goal."""


def _gridded(seed: int, nodes: int, strength: float = 0.4) -> renew.GriddedCurrent:
    """Rough current on an uneven grid inside the square."""
    rng = np.random.default_rng(seed)
    x, y = np.sort(rng.uniform(8, 95, (2, nodes)), axis=1)
    return renew.GriddedCurrent(x, y, *rng.uniform(-strength, strength, (2, nodes, nodes)))


_GYRES = renew.GyreCurrent(0.6, 100, 100, 2, 1)
_FINE = np.linspace(-3, 103, 331)
_FINE_NODES = np.stack(np.meshgrid(_FINE, _FINE), axis=-1)

FIELDS = {
    "uniform": renew.UniformCurrent(0.5, -0.3),
    "gyre": renew.GyreCurrent(0.8, 100, 100),
    "gyres, stronger than the vessel": renew.GyreCurrent(1.4, 100, 100, 2, 3),
    "coarse grid": _gridded(1, 5),
    "fine grid": renew.GriddedCurrent(_FINE, _FINE, *np.moveaxis(_GYRES(_FINE_NODES), -1, 0)),
    "stream function": StreamFunctionCurrent(3, 0.7),
}
"""One current of each kind, by name."""


def in_triangles(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Places (count, 2) in the unit square below its rising and below its falling diagonal."""
    s, t = np.sort(rng.uniform(0, 1, (2, count)), axis=0)[::-1]
    return np.stack([s, t], axis=-1), np.stack([1 - s, t], axis=-1)


START = np.array([30.0, 40.0])
EMPTY = renew.Chart(box(0, 0, 100, 100))
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
        np.ones((nodes - 1, nodes - 1)),
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


@pytest.mark.parametrize("name", FIELDS)
def test_the_current_stays_within_its_radius_of_the_interpolant(name: str) -> None:
    field, rng = FIELDS[name], np.random.default_rng(6)
    chart = renew.Chart(box(0, 0, 100, 100))
    grid = whole_grid(voyage_on(chart, (33.3, 77.7), OPPOSITE, field), 16_000)
    west, south = np.meshgrid(grid.x[:-1], grid.y[:-1])
    width, height = np.meshgrid(np.diff(grid.x), np.diff(grid.y))
    c = grid.current.uv[0]
    sw, se, nw, ne = c[:-1, :-1], c[:-1, 1:], c[1:, :-1], c[1:, 1:]
    for s, t in in_triangles(rng, 40)[0]:
        actual = field(np.stack([west + s * width, south + t * height], axis=-1))
        linear = (1 - s) * sw + (s - t) * se + t * ne
        assert (np.linalg.norm(actual - linear, axis=-1) <= grid.deviation + 1e-12).all()
        actual = field(np.stack([west + (1 - s) * width, south + t * height], axis=-1))
        linear = (s - t) * sw + (1 - s) * se + t * nw
        assert (np.linalg.norm(actual - linear, axis=-1) <= grid.deviation + 1e-12).all()


@pytest.mark.parametrize("name", FIELDS)
def test_the_radius_is_small_on_a_fine_grid_and_zero_in_still_water(name: str) -> None:
    field = FIELDS[name]
    x = y = np.linspace(0, 100, 101)
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    radius = deviation_radius(field, x, y, field(nodes)[None])
    assert radius.shape == (100, 100)
    # On a grid of 1 m a smooth current deviates by far less than its own strength.
    if name != "coarse grid":
        assert radius.max() < 0.02 * np.linalg.norm(field(nodes), axis=-1).max()
    still = renew.UniformCurrent(0, 0)
    assert not deviation_radius(still, x, y, still(nodes)[None]).any()
