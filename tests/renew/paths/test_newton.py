"""Newton's method on a path's points: long stretches rotate; none gets slower or touches land."""

import math

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings, strategies as st

from renew.kernels.capsules import legs_are_clear
from renew.kernels.current_table import table_of
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import Clock, Stream, arrivals
from renew.paths.least_fuel_path import _newton_step, straightened
from renew.paths.sections import WaterAround
from tests.renew.paths.scenes import CALM, NO_LAND, NOTHING_WHOLE, water_beside
from tests.strategies import SIZE, seeds


def test_a_long_slight_bulge_is_straight_afterwards_in_still_water() -> None:
    along = np.linspace(0, 100, 81)
    path = np.column_stack([along, 1.7 * np.sin(np.pi * along / 100)])
    found = straightened(path, 5.0, CALM, NOTHING_WHOLE)
    assert np.abs(found[:, 1]).max() < 1e-4
    assert found[[0, -1]].tolist() == path[[0, -1]].tolist()


def test_a_bulge_of_a_sixteenth_of_the_way_is_straight_afterwards_too() -> None:
    along = np.linspace(0, 100, 81)
    path = np.column_stack([along, 6.0 * np.sin(np.pi * along / 100)])
    found = straightened(path, 7.5, CALM, NOTHING_WHOLE)
    assert np.abs(found[:, 1]).max() < 1e-2


@pytest.mark.parametrize("infinite", [math.inf, -math.inf, math.nan])
def test_no_step_is_taken_where_a_derivative_is_infinite(infinite: float) -> None:
    movable = np.array([False, True, True, True, False])
    gradient, beside = np.array([0.0, 1.0, 1.0, 1.0, 0.0]), np.zeros(5)
    shift, found = _newton_step(gradient, np.full(5, 2.0), beside, 0.0, movable)
    assert found
    assert shift.tolist() == [0.0, -0.5, -0.5, -0.5, 0.0]
    gradient[2] = infinite
    for diagonal in (2.0, math.inf):
        some = np.array([2.0, 2.0, diagonal, 2.0, 2.0])
        assert not _newton_step(gradient, some, beside, 0.0, movable)[1]


def test_no_point_moves_farther_than_it_may() -> None:
    along = np.linspace(0, 100, 81)
    path = np.column_stack([along, 20 * np.sin(np.pi * along / 100)])
    found = straightened(path, 3.0, CALM, NOTHING_WHOLE)
    moved = np.linalg.norm(found - path, axis=1).max()
    assert 1.0 < moved <= 3.0


@settings(max_examples=25)
@given(seed=seeds, crab=st.booleans())
def test_a_path_is_never_slower_and_stays_clear(seed: int, crab: bool) -> None:
    rng = np.random.default_rng(seed)
    along = np.linspace(20, SIZE - 20, 30)
    path = np.column_stack([along, SIZE / 2 + np.cumsum(rng.normal(0, 2, 30))])
    water = water_beside(path, rng, seed, crab=crab)
    found = straightened(path, 10.0, water, NOTHING_WHOLE)
    assert arrivals(found, water.stream)[-1] <= arrivals(path, water.stream)[-1]
    assert legs_are_clear(found[:-1], found[1:], water.capsules).all()


def test_first_and_last_leg_stay_whole_where_asked() -> None:
    path = np.column_stack([np.linspace(0, 100, 41), np.zeros(41)])
    path[1:-1, 1] = 2.0
    found = straightened(path, 10.0, CALM, np.array([True, True]))
    assert found[[0, 1, -2, -1]].tolist() == path[[0, 1, -2, -1]].tolist()
    freed = straightened(path, 10.0, CALM, NOTHING_WHOLE)
    assert np.abs(freed[:, 1]).max() < 1e-3


@pytest.mark.parametrize("is_steady", [True, False])
def test_a_general_optimiser_finds_nothing_quicker_square_to_the_path(is_steady: bool) -> None:
    """In open water SciPy's BFGS over the same points ends where Newton's method does."""
    axis = np.linspace(-20, 120, 141)
    x, y = np.meshgrid(axis, axis)
    psi = np.stack([0.3 * np.cos(np.pi * x / 90), 0.4 * np.sin(np.pi * y / 70)], axis=-1)
    if is_steady:
        table = table_of(axis, axis, psi)
    else:
        times = np.array([0.0, 60.0, 150.0])
        table = table_of(axis, axis, np.stack([psi, 0.2 * psi, -psi]), times=times)
    water = WaterAround(Stream(table, Polar(1.0, crab=True), Clock(0.0, 2.0)), NO_LAND)
    path = np.column_stack([np.linspace(0, 100, 25), np.linspace(0, 30, 25)])
    found = straightened(path, 60.0, water, NOTHING_WHOLE)
    normal = np.array([-30.0, 100.0]) / math.hypot(30, 100)

    def time(shift: np.ndarray) -> float:
        moved = path.copy()
        moved[1:-1] += shift[:, None] * normal
        return float(arrivals(moved, water.stream)[-1])

    least = scipy.optimize.minimize(time, np.zeros(23), method="BFGS", options={"gtol": 1e-7})
    gained = arrivals(path, water.stream)[-1] - least.fun
    assert gained > 0.3
    assert arrivals(found, water.stream)[-1] <= least.fun + 0.01 * gained
