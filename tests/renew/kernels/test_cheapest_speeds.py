"""Speeds of least cost beside SciPy's optimizer, their slopes, and chains in simple water."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from renew._types import FloatArray
from renew.kernels.capsules import Capsules
from renew.kernels.cheapest_speeds import (
    Chain,
    CostModel,
    Rows,
    SailedLegs,
    SpeedProblem,
    _cost,
    cheapest_chain,
    cheapest_speeds,
    legs_between,
    sailed,
    slopes,
)
from renew.kernels.current_table import CurrentTable, table_of
from renew.kernels.fuel_law import FuelLaw, efforts, spline_nodes

IS_CRAB = False


def turning_tide(seed: int) -> CurrentTable:
    """A current along x that turns every 50 s, of a seeded strength at each place."""
    rng = np.random.default_rng(seed)
    axis, times = np.linspace(0.0, 100.0, 6), np.linspace(0.0, 400.0, 33)
    uv = np.zeros((33, 6, 6, 2))
    uv[..., 0] = np.sin(times * math.pi / 50)[:, None, None] * rng.uniform(0.1, 0.4, (6, 6))
    return table_of(axis, axis, uv, times=times)


@pytest.mark.parametrize("legs", [np.arange(40), np.arange(40) // 8])
@pytest.mark.parametrize("seed", range(4))
def test_no_optimizer_finds_cheaper_speeds(seed: int, legs: np.ndarray) -> None:
    path = np.column_stack([np.linspace(5, 95, 41), np.linspace(20, 80, 41)])
    count, deadline, price = legs[-1] + 1, 100.0 + 20 * seed, 2.0
    scale = np.sqrt(np.bincount(legs) / 40)
    low, high = 0.6 * scale, 3.0 * scale
    costs = CostModel(turning_tide(seed), 3.0, IS_CRAB, FuelLaw(2.0 + seed % 2), 2.0, math.inf, 1.0)
    problem = SpeedProblem(path, legs, scale, low, high, 3.0, costs, deadline, price, 1.0, 100.0)
    begun = 1.2 * scale

    def cost(scaled: FloatArray) -> tuple[float, FloatArray]:
        slope = np.zeros(count)
        return float(_cost(problem, scaled, slope)), slope

    found = cheapest_speeds(problem, begun)
    bounds = np.column_stack([low, high])
    oracle = min(
        minimize(cost, at, jac=True, method=method, bounds=bounds).fun
        for at in (begun, found)
        for method in ("TNC", "L-BFGS-B")
    )
    assert ((found >= low) & (found <= high)).all()
    assert cost(found)[0] <= oracle * (1 + 3e-5)


def test_speeds_that_make_no_way_stay() -> None:
    path = np.column_stack([np.linspace(95, 5, 11), np.full(11, 50.0)])
    axis, times = np.array([0.0, 100.0]), np.array([0.0, 1e3])
    uv = np.zeros((2, 2, 2, 2))
    uv[..., 0] = 2.0
    table = table_of(axis, axis, uv, times=times)
    costs = CostModel(table, 1.0, IS_CRAB, FuelLaw(), 2.0, math.inf, 1.0)
    ones = np.ones(10)
    limits = 0.5 * ones, ones
    problem = SpeedProblem(path, np.arange(10), ones, *limits, 0.0, costs, 200.0, 1.0, 1.0, 100.0)
    np.testing.assert_array_equal(cheapest_speeds(problem, 0.8 * ones), 0.8 * ones)


NO_LAND = Capsules(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))


def shear_tide() -> CurrentTable:
    """A current that turns from west to east in 100 s, stronger in the north."""
    axis = np.array([0.0, 100.0])
    strength = np.array([[0.2, 0.2], [0.5, 0.5]])
    uv = np.zeros((2, 2, 2, 2))
    uv[0, ..., 0], uv[1, ..., 0] = -strength, strength
    return table_of(axis, axis, uv, times=np.array([0.0, 100.0]))


NODES = spline_nodes(((0.1, 0.5), (1.0, 1.2), (2.0, 5.0), (3.0, 14.0)))


@pytest.mark.parametrize("crab", [False, True])
@pytest.mark.parametrize("law", [FuelLaw(2.0), FuelLaw(3.0, 0.7), FuelLaw(math.nan, 0.7, NODES)])
def test_slopes_are_those_of_differences(law: FuelLaw, crab: bool) -> None:
    costs = CostModel(shear_tide(), 3.0, crab, law, 2.0, math.inf, 1.0)
    rng = np.random.default_rng(1)
    path = np.column_stack([np.linspace(5, 95, 8), rng.uniform(20, 80, 8)])
    speeds, price = rng.uniform(1.0, 2.5, 7), 1.7

    def cost(speeds: np.ndarray) -> float:
        times = SailedLegs(*sailed(path, speeds, 3.0, costs)).times
        return float((efforts(speeds, law) * np.diff(times)).sum() + price * times[-1])

    found = slopes(speeds, SailedLegs(*sailed(path, speeds, 3.0, costs)), price, law)
    for leg in range(7):
        step = 1e-4 * np.eye(7)[leg]
        expected = (cost(speeds + step) - cost(speeds - step)) / 2e-4
        assert found[leg] == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_no_time_is_known_behind_water_that_is_too_strong() -> None:
    crab = False
    costs = CostModel(shear_tide(), 3.0, crab, FuelLaw(), 2.0, math.inf, 1.0)
    path = np.array([[95.0, 90.0], [60.0, 90.0], [5.0, 90.0]])
    # At 0.3 m/s the vessel can't stem a fair current that has turned.
    times = SailedLegs(*sailed(path, np.array([2.0, 0.3]), 90.0, costs)).times
    assert math.isfinite(times[1])
    assert math.isinf(times[2])


def test_in_still_water_the_straight_chain_is_sailed_at_one_speed() -> None:
    axis = np.array([0.0, 100.0])
    still = table_of(axis, axis, np.zeros((2, 2, 2, 2)), times=np.array([0.0, 1e3]))
    x = np.linspace(0, 100, 11)
    points = np.empty((11, 3, 2))
    points[..., 0], points[..., 1] = x[:, None], np.array([40.0, 50.0, 60.0])
    points[[0, -1]] = [[[0.0, 50.0]], [[100.0, 50.0]]]
    clear = legs_between(points, NO_LAND, np.zeros((2, 0), dtype=bool))
    assert clear[1:-1].all()
    assert clear[0, 0].all()
    times = np.linspace(x / 2, x / 0.5, 41).T.copy()
    crab = False
    costs = CostModel(still, 2.0, crab, FuelLaw(3.0), 1e3, 100.0, 100.0)
    limits = np.tile([0.5, 2.0], (10, 1))
    found = Chain(*cheapest_chain(Rows(points, clear, times, limits), costs))
    assert (found.points[1:-1] == 1).all()
    assert found.times[-1] <= 100.0 + 1e-9
    assert found.cost == pytest.approx(100.0, rel=0.01)
    assert found.speeds == pytest.approx(1.0, rel=0.15)
    # Where the middle is shut the chain leads around.
    clear[4:6, 1], clear[4:6, :, 1] = False, False
    around = Chain(*cheapest_chain(Rows(points, clear, times, limits), costs))
    assert (around.points[5:6] != 1).all()
    assert around.cost > found.cost
    shut = Rows(points, clear & False, times, limits)
    assert math.isinf(Chain(*cheapest_chain(shut, costs)).cost)
