"""Statistics of fuels by weights, beside those of plain lists and of a linear programme."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import linprog

from renew.vary.ensemble import statistic, surely_dearer, worst_weights
from tests.strategies import examples

counts = st.lists(st.integers(0, 4), min_size=2, max_size=9).filter(lambda some: sum(some) > 0)


@examples(gate=40, new=1000)
@given(counts, st.integers(0, 10_000))
def test_weights_count_like_members_that_are_there_several_times(
    often: list[int], seed: int
) -> None:
    fuels = np.random.default_rng(seed).integers(1, 20, (3, len(often))).astype(float)
    weights = np.array(often) / sum(often)
    every = np.repeat(fuels, often, axis=1)
    for at, row in enumerate(every):
        falling = sorted(row, reverse=True)
        assert statistic("mean", fuels, weights)[at] == pytest.approx(np.mean(row))
        # No more than a tenth of the members lie above P90.
        p90 = statistic("p90", fuels, weights)[at]
        assert p90 in falling
        assert sum(one > p90 for one in row) <= 0.1 * len(row) + 1e-9
        assert sum(one >= p90 for one in row) > 0.1 * len(row) - 1e-9
        regret = statistic("regret", fuels, weights)[at]
        assert regret == max(row - every.min(axis=0))


@examples(gate=25, new=500)
@given(counts, st.integers(0, 10_000))
def test_cvar_is_the_largest_mean_by_the_weights_that_it_allows(
    often: list[int], seed: int
) -> None:
    fuels = np.random.default_rng(seed).uniform(50, 150, (2, len(often)))
    weights = np.array(often) / sum(often)
    for at, row in enumerate(fuels):
        bounds = [(0, one / 0.1) for one in weights]
        largest = linprog(-row, A_eq=np.ones((1, len(row))), b_eq=[1], bounds=bounds)
        found = statistic("cvar90", fuels, weights)[at]
        assert found == pytest.approx(-largest.fun)
        own = worst_weights(row, weights)
        assert own @ row == pytest.approx(found)
        assert own.sum() == pytest.approx(1)
        assert (own <= weights / 0.1 + 1e-12).all()


def test_an_infinite_fuel_counts_as_soon_as_it_has_a_weight() -> None:
    fuels = np.array([[1.0, math.inf], [2.0, 3.0]])
    assert statistic("mean", fuels, np.array([1.0, 0.0])).tolist() == [1.0, 2.0]
    for name in ("mean", "p90", "cvar90", "regret"):
        found = statistic(name, fuels, np.array([0.8, 0.2]))
        assert found[0] == math.inf
        assert math.isfinite(found[1])
    # A twentieth of the members does not move P90.
    assert statistic("p90", fuels, np.array([0.95, 0.05]))[0] == 1.0


def test_only_a_difference_beyond_chance_counts() -> None:
    rng = np.random.default_rng(0)
    called = 0
    for seed in range(60):
        one, other = rng.normal(100, 5, (2, 20))
        fuels, weights = np.array([one, other, 1.03 * one]), np.full(20, 1 / 20)
        alike, dearer = surely_dearer("mean", fuels, weights, 0, sure=0.9, seed=seed)[1:]
        called += int(alike)
        # One that is dearer in every member, by however little, is dearer.
        assert dearer
    # An interval of 90 % lies wholly above 0 in 5 % of pairs that are alike.
    assert called <= 8
