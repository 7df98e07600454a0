"""Segments and capsules against shapely and dense sampling; angles folded into one turn."""

import math
from typing import Any

import numba
import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from renew.kernels.capsules import (
    Capsules,
    Segment,
    capsule_interval,
    capsules_near,
    distances_within,
    leg_is_clear,
    legs_are_clear,
    segment_distance,
    segments_near,
    tracks_touch,
    wrapped,
)
from tests.compiler import uncompiled
from tests.strategies import seeds


@settings(max_examples=30)
@given(seed=seeds)
def test_capsule_interval_matches_dense_distances(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, p, q = rng.uniform(0, 10, (4, 2))
    if seed % 5 == 0:
        q = p
    if seed % 7 == 0:
        b = a
    radius = float(rng.uniform(0.1, 4))
    leg, axis = Segment(*a.tolist(), *b.tolist()), Segment(*p.tolist(), *q.tolist())
    enter, leave = capsule_interval(leg, axis, radius)
    s = np.linspace(0, 1, 2001)
    inside = segment_distance(a + s[:, None] * (b - a), p, q) < radius
    expected = (s >= enter) & (s <= leave)
    assert (inside != expected).sum() <= 2
    # The same without the compiler.
    assert uncompiled(capsule_interval)(leg, axis, radius) == pytest.approx((enter, leave))


@settings(max_examples=20)
@given(seed=seeds)
def test_clear_legs_match_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 30, (2, 70, 2))
    b = a + (b - a) * rng.uniform(0, 0.5, (70, 1))
    start = rng.uniform(0, 30, (9, 2))
    # A radius of 0 is no capsule, one below 0 an edge that may not be touched.
    capsules = Capsules(start, start + rng.normal(0, 3, (9, 2)), rng.choice([-1.0, 0.0, 1.5], 9))
    legs = shapely.linestrings(np.stack([a, b], axis=1))
    axes = shapely.linestrings(np.stack([capsules.start, capsules.end], axis=1))
    entered = (capsules.radius != 0) & (
        shapely.distance(legs[:, None], axes) <= np.maximum(capsules.radius, 0)
    )
    assert legs_are_clear(a, b, capsules).tolist() == (~entered.any(axis=1)).tolist()
    # For a single leg, the capsules to look at and those to exempt can be chosen.
    exempt = rng.random(9) < 0.3
    chosen = np.flatnonzero(rng.random(9) < 0.7)
    leg = Segment(*a[0].tolist(), *b[0].tolist())
    expected = not (entered[0] & ~exempt)[chosen].any()
    assert leg_is_clear(leg, capsules, chosen, exempt) == expected


@settings(max_examples=20)
@given(seed=seeds)
def test_no_capsule_near_a_path_is_missed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0, 1, (70, 2)), axis=0)
    start = rng.uniform(-20, 20, (60, 2))
    capsules = Capsules(start, start + rng.normal(0, 2, (60, 2)), rng.uniform(0, 2, 60))
    axes = shapely.linestrings(np.stack([capsules.start, capsules.end], axis=1))
    distance = shapely.distance(shapely.LineString(path), axes) - capsules.radius
    found = capsules_near(capsules, path, 1.0)
    assert set(np.flatnonzero(distance <= 1.0).tolist()) <= set(found.tolist())
    # Bounding boxes find a few more, at most a diagonal away, but not all.
    boxes = shapely.distance(
        shapely.linestrings(np.stack([path[:-1], path[1:]], axis=1))[:, None],
        shapely.envelope(shapely.buffer(axes[found], capsules.radius[found])),
    )
    assert (boxes.min(axis=0, initial=np.inf) <= 2 + np.ptp(path, axis=0).max()).all()
    assert len(found) < 60


@settings(max_examples=10)
@given(seed=seeds)
def test_segments_near_and_touching_tracks_match_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(0, 1, (70, 2)), axis=0)
    start = rng.uniform(-10, 10, (25, 2))
    end = start + rng.normal(0, 2, (25, 2))
    reach = rng.uniform(0.5, 4, 70)
    first, near = segments_near(points, reach, start, end)
    distance = segment_distance(points[:, None], start, end)
    for i in range(70):
        assert set(near[first[i] : first[i + 1]].tolist()) == set(
            np.flatnonzero(distance[i] <= reach[i]).tolist()
        )
    tracks = points[:, None, None] + np.cumsum(rng.normal(0, 0.3, (70, 2, 6, 2)), axis=2)
    track, segment = tracks_touch(tracks, first, near, start, end, np.full(70, 0.2))
    lines = shapely.linestrings(tracks.reshape(140, 6, 2))
    edges = shapely.linestrings(np.stack([start, end], axis=1))
    expected = {
        (2 * i + turn, int(h))
        for i in range(70)
        for h in near[first[i] : first[i + 1]]
        for turn in range(2)
        if shapely.dwithin(lines[2 * i + turn], edges[h], 0.2)
    }
    assert set(zip(track.tolist(), segment.tolist(), strict=True)) == expected


def in_kernel(angle: float) -> float:
    return wrapped(angle)


COMPILED: Any = numba.njit(in_kernel)


@settings(max_examples=20)
@given(seed=seeds, reach=st.sampled_from([0.5, 3.0, math.inf]))
def test_distances_within_reach_match_shapely(seed: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 30, (100, 2)).cumsum(axis=0) % 30
    start = rng.uniform(0, 30, (12, 2))
    end = start + rng.normal(0, 2, (12, 2)) * rng.choice([0.0, 1.0], (12, 1))
    edges = shapely.linestrings(np.stack([start, end], axis=1))
    expected = shapely.distance(shapely.points(points)[:, None], edges).min(axis=1)
    expected[expected > reach] = math.inf
    assert distances_within(points, reach, start, end) == pytest.approx(expected)
    assert uncompiled(distances_within)(points, reach, start, end) == pytest.approx(expected)


@given(st.floats(-1e3, 1e3))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle: float) -> None:
    folded = wrapped(angle)
    assert -math.pi <= folded <= math.pi
    turns = (angle - folded) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)
    assert wrapped(np.array([angle, angle])) == pytest.approx(folded)
    assert COMPILED(angle) == folded


def test_a_half_turn_counts_to_starboard() -> None:
    assert wrapped(math.pi) == -math.pi
    assert wrapped(-math.pi) == -math.pi
    assert wrapped(1.5 * math.pi) == pytest.approx(-math.pi / 2)
