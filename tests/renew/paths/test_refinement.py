"""Refinement on transversals: the points it adds, and that no pass makes a path worse."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from renew._types import FloatArray
from renew.kernels.capsules import Capsules, legs_are_clear
from renew.kernels.viterbi import arrivals
from renew.paths.sections import (
    WaterAround,
    refined_on_transversals,
    with_transversals,
    without_detours,
)
from tests.renew.paths.waters import CALM, NOTHING_WHOLE, water_beside
from tests.strategies import SIZE, seeds


def time_of(path: FloatArray, water: WaterAround) -> float:
    """Time (s) along a path, leg by leg."""
    return float(arrivals(path, water.stream)[-1])


@settings(max_examples=20)
@given(seed=seeds, spacing=st.floats(0.3, 20))
def test_added_points_lie_on_the_path_and_close_together(seed: int, spacing: float) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0, 5, (8, 2)), axis=0)
    path = np.insert(path, 3, path[3], axis=0)  # a point that repeats another is left out
    found = with_transversals(path, spacing, math.inf, 0.0, NOTHING_WHOLE)
    line = shapely.LineString(path)
    assert shapely.LineString(found).length == pytest.approx(line.length)
    assert shapely.LineString(found).hausdorff_distance(line) < 1e-9
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert steps.min() > 0
    assert steps.max() <= spacing * (1 + 1e-9)
    # There are no more points than needed.
    legs = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert len(steps) == np.ceil(legs / spacing).sum()


def test_legs_beside_a_bend_are_halved_and_the_ends_are_kept_whole_where_asked() -> None:
    path = np.array([[0, 0], [10, 0], [10, 10], [20, 10.5], [30, 11]], dtype=float)
    bent = with_transversals(path, math.inf, math.radians(20), 1.0, NOTHING_WHOLE)
    halves = [[5, 0], [10, 5], [15, 10.25]]
    assert bent.tolist() == sorted([*path.tolist(), *halves])
    # The first leg stays whole, and no leg shorter than twice the limit is halved.
    whole = with_transversals(path, 3.0, math.inf, 1.0, np.array([True, True]))
    assert whole[:2].tolist() == path[:2].tolist()
    assert whole[-2:].tolist() == path[-2:].tolist()
    coarse = with_transversals(path, math.inf, math.radians(20), 6.0, NOTHING_WHOLE)
    assert coarse.tolist() == path.tolist()


@settings(max_examples=20)
@given(seed=seeds, crab=st.booleans())
def test_a_pass_is_never_slower_and_stays_clear_and_near(seed: int, crab: bool) -> None:
    rng = np.random.default_rng(seed)
    along = np.linspace(20, SIZE - 20, 9)
    path = np.column_stack([along, SIZE / 2 + rng.normal(0, 8, 9)])
    water = water_beside(path, rng, seed, crab=crab)
    exempt = np.zeros((2, len(water.capsules.radius)), dtype=bool)
    window = 10.0
    found = refined_on_transversals(path, window, 9, 60.0, water, exempt)
    assert found[[0, -1]].tolist() == path[[0, -1]].tolist()
    assert time_of(found, water) <= time_of(path, water) * (1 + 1e-12)
    assert legs_are_clear(found[:-1], found[1:], water.capsules).all()
    assert shapely.distance(shapely.points(found), shapely.LineString(path)).max() <= window * (
        1 + 1e-9
    )


def test_a_path_that_cannot_be_improved_stays_as_it_is() -> None:
    straight = np.column_stack([np.linspace(0, 100, 12), np.linspace(0, 50, 12)])
    for count in (5, 6, 9):
        exempt = np.zeros((2, 0), dtype=bool)
        found = refined_on_transversals(straight, 10.0, count, 0.0, CALM, exempt)
        assert found == pytest.approx(straight)


def test_passes_with_narrowing_windows_pull_a_path_straight_in_still_water() -> None:
    rng = np.random.default_rng(3)
    path = np.column_stack([np.linspace(0, 100, 12), rng.normal(0, 6, 12)])
    path[[0, -1], 1] = 0.0
    exempt = np.zeros((2, 0), dtype=bool)
    for step in range(12):
        path = refined_on_transversals(path, 15 * 0.5**step, 7, 0.0, CALM, exempt)
    assert time_of(path, CALM) == pytest.approx(100, rel=1e-3)


def test_detours_are_left_out() -> None:
    path = np.array([[0, 0], [1, 2], [2, 0], [3, 0]], dtype=float)
    assert without_detours(path, 10.0, CALM).tolist() == [[0, 0], [3, 0]]
    wall = Capsules(np.array([[1.0, -5.0]]), np.array([[1.0, 1.0]]), np.array([0.2]))
    blocked = without_detours(path, 10.0, CALM._replace(capsules=wall))
    assert blocked.tolist() == [[0, 0], [1, 2], [3, 0]]
