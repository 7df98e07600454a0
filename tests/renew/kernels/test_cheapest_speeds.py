"""Speeds of least cost beside SciPy's optimizer, on tides that turn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from renew._types import FloatArray
from renew.kernels.cheapest_chain import CostModel
from renew.kernels.cheapest_speeds import SpeedProblem, _cost, cheapest_speeds
from renew.kernels.current_table import CurrentTable, table_of

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
    costs = CostModel(turning_tide(seed), 3.0, IS_CRAB, 2.0 + seed % 2, 2.0, math.inf, 1.0)
    problem = SpeedProblem(
        path,
        legs,
        scale,
        low,
        high,
        3.0,
        costs,
        deadline,
        price,
        1.0,
        100.0,
    )
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
    costs = CostModel(table, 1.0, IS_CRAB, 2.0, 2.0, math.inf, 1.0)
    ones = np.ones(10)
    limits = 0.5 * ones, ones
    problem = SpeedProblem(path, np.arange(10), ones, *limits, 0.0, costs, 200.0, 1.0, 1.0, 100.0)
    np.testing.assert_array_equal(cheapest_speeds(problem, 0.8 * ones), 0.8 * ones)
