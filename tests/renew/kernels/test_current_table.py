"""The current's table at times that are no numbers, its strong spells, and searches in arrays."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from renew.kernels.capsules import extremes
from renew.kernels.current_table import (
    CurrentTable,
    number_below,
    number_up_to,
    overpowered_spells,
    table_of,
    velocities,
)
from tests.strategies import seeds


@pytest.mark.parametrize("period", [math.inf, 30.0])
@pytest.mark.parametrize("middle", [15.0, 7.0], ids=["even", "uneven"])
def test_times_that_are_no_numbers_read_a_slice_of_the_table(period: float, middle: float) -> None:
    """An index made of one would lie outside the table, and end the process."""
    axis, uv = np.array([0.0, 1.0]), np.zeros((3, 2, 2, 2))
    uv[:, ..., 0] = np.array([1.0, 2.0, 1.0])[:, None, None]
    table = table_of(axis, axis, uv, times=np.array([0.0, middle, 30.0]), period=period)
    times = np.array([math.nan, math.inf, 1e308, 30.0, middle, -math.inf, -1e308])
    found = velocities(table, np.full((len(times), 2), 0.5), times)
    assert (found[:, 0] >= 1.0).all()
    assert (found[:, 0] <= 2.0).all()
    assert found[:2].tolist() == [[1.0, 0.0]] * 2
    assert found[4].tolist() == [2.0, 0.0]


PLACE = np.array([0.3, 0.6])


def random_table(seed: int, period: float = math.inf) -> CurrentTable:
    """A table of four nodes whose slices stand unevenly in time; a periodic one begins again."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(1.0, 9.0, rng.integers(2, 9)))
    uv = rng.normal(0.0, 0.8, (len(times), 2, 2, 2))
    if period < math.inf:
        times = np.linspace(times[0], times[0] + period, len(times))
        uv[-1] = uv[0]
    axis = np.array([0.0, 1.0])
    return table_of(axis, axis, uv, times=times, period=period)


@pytest.mark.parametrize("period", [math.inf, 21.0])
@given(seed=seeds)
def test_the_current_is_strong_inside_the_spells_and_weaker_outside(
    seed: int, period: float
) -> None:
    table = random_table(seed, period)
    rng = np.random.default_rng([seed, 1])
    begin, end = np.sort(rng.uniform(-30.0, 80.0, 2))
    spells = overpowered_spells(table, PLACE, 1.0, begin, end)
    looked = np.linspace(begin, end, 4001)
    strength = np.linalg.norm(velocities(table, np.tile(PLACE, (4001, 1)), looked), axis=1)
    inside = ((looked[:, None] >= spells[:, 0]) & (looked[:, None] <= spells[:, 1])).any(axis=1)
    assert (strength[inside] >= 1.0 - 1e-9).all()
    assert (strength[~inside] <= 1.0 + 1e-9).all()
    assert (spells[:, 0] <= end).all()
    assert (spells[:, 1] >= begin).all()
    assert (np.diff(spells.ravel()) > 0).all()
    # Whole: just before and after a spell the current is weaker.
    edges = spells[np.isfinite(spells)]
    beside = edges + np.where(np.isin(edges, spells[:, 0]), -1e-4, 1e-4)
    assert (
        np.linalg.norm(velocities(table, np.tile(PLACE, (len(beside), 1)), beside), axis=1) < 1.0
    ).all()


def test_a_current_that_is_held_is_strong_for_ever() -> None:
    axis, uv = np.array([0.0, 1.0]), np.zeros((3, 2, 2, 2))
    uv[:, ..., 0] = np.array([2.0, 0.0, 4.0])[:, None, None]
    table = table_of(axis, axis, uv, times=np.array([0.0, 10.0, 30.0]))
    spells = overpowered_spells(table, PLACE, 1.0, -100.0, 100.0)
    np.testing.assert_allclose(spells, [[-math.inf, 5.0], [15.0, math.inf]])
    steady = table_of(axis, axis, uv[0])
    assert overpowered_spells(steady, PLACE, 1.0, 0.0, 1.0).tolist() == [[-math.inf, math.inf]]
    assert not len(overpowered_spells(steady, PLACE, 3.0, 0.0, 1.0))


_NUMBERS = st.lists(st.integers(-4, 4).map(float), min_size=1, max_size=9).map(np.array)


@given(_NUMBERS, st.floats())
def test_they_find_what_numpy_finds(numbers: np.ndarray, value: float) -> None:
    assert extremes(numbers) == (numbers.min(), numbers.max())
    axis = np.sort(numbers)
    for wanted in (value, float(axis[0]), float(axis[-1])):
        assert number_up_to(axis, wanted) == np.searchsorted(axis, wanted, side="right")
        if wanted == wanted:  # noqa: PLR0124 - NaN, which no axis is searched for from the left
            assert number_below(axis, wanted) == np.searchsorted(axis, wanted)
