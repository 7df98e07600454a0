"""Spells of a strong current by root finding, against dense samples of the current."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given

from renew.kernels.current_table import CurrentTable, overpowered_spells, table_of, velocities
from tests.strategies import seeds

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
