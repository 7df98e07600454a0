"""Sections across a channel and their free intervals, and refinement on transversals."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from renew._types import FloatArray
from renew.kernels.capsules import Capsules, legs_are_clear
from renew.kernels.viterbi import arrivals
from renew.paths.sections import (
    FreeIntervals,
    Sections,
    WaterAround,
    free_intervals,
    refined_on_transversals,
    sections_of,
    with_transversals,
    without_detours,
)
from tests.renew.paths.scenes import CALM, NOTHING_WHOLE, corridor_in_scene, water_beside
from tests.strategies import SIZE, seeds


def random_free_parts(seed: int) -> tuple[Sections, Capsules, FreeIntervals]:
    """Thirty sections among nine capsules, and their free intervals."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(0, 20, (30, 2))
    right = left + rng.normal(0, 6, (30, 2))
    start = rng.uniform(0, 20, (9, 2))
    capsules = Capsules(start, start + rng.normal(0, 4, (9, 2)), rng.uniform(0.2, 2.0, 9))
    sections = Sections(left, right, np.ones(30, dtype=bool), np.arange(30))
    return sections, capsules, free_intervals(sections, capsules)


@settings(max_examples=10)
@given(
    scene=st.integers(0, 3),
    spacing=st.one_of(st.floats(2, 50), st.just(math.inf)),
    angle=st.floats(0.1, 1.5),
)
def test_sections_stand_close_and_take_in_all_passing_edges(
    scene: int, spacing: float, angle: float
) -> None:
    corridor = corridor_in_scene(scene)
    channel, start, goal = corridor.channel, corridor.voyage.start, corridor.voyage.goal
    sections = sections_of(channel, start, goal, spacing, angle)
    passing = sections.select(sections.passing)
    assert passing.left.tolist() == channel.left.tolist()
    assert passing.right.tolist() == channel.right.tolist()
    assert (np.diff(sections.place) >= 0).all()
    for bank in (sections.left, sections.right):
        steps = np.linalg.norm(np.diff(np.vstack([start, bank, goal]), axis=0), axis=1)
        assert steps.max() <= spacing * (1 + 1e-9)
    # A fan that turns by some angle is cut into at least this number of parts.
    across = np.arctan2(*(channel.left - channel.right).T[::-1])
    turned = np.abs((np.diff(across) + np.pi) % (2 * np.pi) - np.pi)
    parts = np.bincount(sections.place, minlength=len(channel.triangles))[1:-1]
    assert (parts >= turned / angle * (1 - 1e-9)).all()


def test_without_a_limit_the_sections_are_the_passing_edges() -> None:
    corridor = corridor_in_scene(0)
    channel, voyage = corridor.channel, corridor.voyage
    sections = sections_of(channel, voyage.start, voyage.goal, math.inf, math.inf)
    assert sections.passing.all()
    assert len(sections.left) == len(channel.left)
    ends = sections.points(np.array([[0.0, 1.0]] * len(channel.left)))
    assert ends[:, 0] == pytest.approx(channel.left)
    assert ends[:, 1] == pytest.approx(channel.right)


def test_a_tiny_spacing_gives_thousands_of_sections_and_not_millions() -> None:
    corridor = corridor_in_scene(0)
    channel, voyage = corridor.channel, corridor.voyage
    sections = sections_of(channel, voyage.start, voyage.goal, 1e-6, math.inf)
    assert 4000 < len(sections.left) < 6000


@settings(max_examples=10)
@given(seed=seeds)
def test_free_parts_are_what_dense_samples_find_outside_all_capsules(seed: int) -> None:
    sections, capsules, free = random_free_parts(seed)
    share = np.linspace(0, 1, 501)
    points = sections.points(np.broadcast_to(share, (30, 501)))
    axes = shapely.linestrings(np.stack([capsules.start, capsules.end], axis=1))
    distance = shapely.distance(shapely.points(points)[..., None], axes)
    outside = (distance > capsules.radius).all(axis=-1)
    for row in range(30):
        intervals = free.intervals[row, : free.count[row]]
        assert (np.diff(intervals.ravel()) > 0).all()
        inside = (share[:, None] >= intervals[:, 0]) & (share[:, None] <= intervals[:, 1])
        assert (inside.any(axis=1) != outside[row]).sum() <= 2 * (len(intervals) + 1)
        assert free.blocked[row] == (not len(intervals))


@settings(max_examples=20)
@given(seed=seeds, points=st.integers(12, 41))
def test_spread_points_lie_in_the_free_parts_evenly_and_at_all_their_ends(
    seed: int, points: int
) -> None:
    _, _, free = random_free_parts(seed)
    free = free.select(~free.blocked)
    places = free.spread(points)
    assert (np.diff(places, axis=1) >= 0).all()
    for row, parts, count in zip(places, free.intervals, free.count, strict=True):
        intervals = parts[:count]
        lengths = intervals[:, 1] - intervals[:, 0]
        inside = (row[:, None] >= intervals[:, 0]) & (row[:, None] <= intervals[:, 1] + 1e-12)
        assert (inside.sum(axis=1) == 1).all()
        assert (inside.sum(axis=0) >= 2).all()
        for (low, high), within in zip(intervals, inside.T, strict=True):
            assert row[within] == pytest.approx(np.linspace(low, high, within.sum()))
        # Each interval has its share of the points, and at least two.
        share = points * lengths / lengths.sum()
        assert inside.sum(axis=0) == pytest.approx(share, abs=2.0 * float(count))


@settings(max_examples=20)
@given(seed=seeds)
def test_drawn_points_are_uniform_over_the_free_parts(seed: int) -> None:
    _, _, free = random_free_parts(seed)
    free = free.select(~free.blocked)
    draws = 4000
    places = free.draw(draws, np.random.default_rng(seed))
    for row, intervals, count in zip(places, free.intervals, free.count, strict=True):
        # Free length to the left of each draw, as a share of all: uniform between 0 and 1.
        low, high = intervals[:count].T
        passed = np.clip(row[:, None], low, high) - low
        share = np.sort(passed.sum(axis=1) / (high - low).sum())
        inside = (row[:, None] >= low - 1e-12) & (row[:, None] <= high + 1e-12)
        assert inside.any(axis=1).all()
        expected = (np.arange(draws) + 0.5) / draws
        assert np.abs(share - expected).max() < 3.5 / math.sqrt(draws)  # Kolmogorov-Smirnov


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
