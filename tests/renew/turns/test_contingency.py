"""The current's table, and turns flown in it, against slower twins and independent libraries."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from scipy.interpolate import RegularGridInterpolator
from shapely import box

import renew
from renew.inputs.current import TabulatedCurrent
from renew.inputs.current_table import table_of, velocities, velocity
from renew.kernels.capsules import segment_distance, segments_near, tracks_touch
from renew.turns.contingency import fly_turns
from renew.turns.reach_bound import MAX_DEVIATIONS, TurnReach
from tests.compiler import uncompiled
from tests.strategies import PAPER_VESSEL, SIZE, StreamFunctionCurrent, seeds, single_gyre

BOUNDS = (0.0, 0.0, SIZE, SIZE)


@settings(max_examples=20)
@given(seed=seeds)
def test_lookups_are_bilinear_on_even_and_uneven_nodes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.5, 2.0, 7)) if seed % 2 else np.linspace(-3, 4, 7)
    y = np.cumsum(rng.uniform(0.5, 2.0, 5))
    uv = rng.normal(0, 1, (5, 7, 2))
    table = table_of(x, y, uv)
    assert (table.per_x > 0) == (seed % 2 == 0)
    points = rng.uniform((x[0] - 1, y[0] - 1), (x[-1] + 1, y[-1] + 1), (200, 2))
    inside = np.clip(points, (x[0], y[0]), (x[-1], y[-1]))
    expected = RegularGridInterpolator((y, x), uv)(inside[:, ::-1])
    assert velocities(table, points) == pytest.approx(expected, abs=1e-12)
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    assert velocities(table, nodes.reshape(-1, 2)) == pytest.approx(uv.reshape(-1, 2), abs=1e-9)
    # The same without the compiler.
    assert uncompiled(velocity)(table, *points[0]) == pytest.approx(expected[0], abs=1e-12)


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_a_fine_table_is_as_good_as_its_field(seed: int) -> None:
    field = StreamFunctionCurrent(seed, 0.8)
    table = field.table(BOUNDS)
    assert table.is_fine
    points = np.random.default_rng(seed).uniform(0, SIZE, (5000, 2))
    off = np.linalg.norm(TabulatedCurrent(table)(points) - field(points), axis=1).max()
    assert off <= 2 * table.error
    assert table.strongest == pytest.approx(0.8, rel=0.01)


def test_a_field_with_a_step_has_no_fine_table() -> None:
    class Step(renew.CurrentField):
        def __call__(self, points: np.ndarray) -> np.ndarray:
            return np.where(points[..., :1] < 0.3 * SIZE, [0.5, 0.0], [-0.5, 0.0])

    assert not Step().table(BOUNDS).is_fine
    # Its plan is made all the same, and its fuel is that in the field itself.
    chart = renew.Chart(box(*BOUNDS), [box(80, 80, 120, 120)])
    route = renew.plan(chart, Step(), PAPER_VESSEL, (10, 10), (190, 190)).best
    assert route.fuel == pytest.approx(renew.fuel(route.path, Step(), PAPER_VESSEL))


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_turns_in_a_table_are_the_turns_in_its_field(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = StreamFunctionCurrent(seed, 0.8).table(BOUNDS)
    points, course = rng.uniform(20, SIZE - 20, (6, 2)), rng.uniform(-math.pi, math.pi, 6)
    deviations = rng.uniform(-MAX_DEVIATIONS, MAX_DEVIATIONS, (6, 3, 2))

    class Untold(renew.CurrentField):
        """The same field, but for its type: flown step by step in NumPy."""

        def __call__(self, points: np.ndarray) -> np.ndarray:
            return TabulatedCurrent(table)(points)

    one, other = (
        fly_turns(points, course, field, PAPER_VESSEL, deviations)
        for field in (TabulatedCurrent(table), Untold())
    )
    assert one == pytest.approx(other, abs=1e-9)


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_no_turn_gets_further_than_its_reach(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = StreamFunctionCurrent(seed, 0.9).table(BOUNDS)
    points, course = rng.uniform(0, SIZE, (100, 2)), rng.uniform(-math.pi, math.pi, 100)
    deviations = MAX_DEVIATIONS * rng.choice([-1.0, 0.0, 1.0], (100, 6, 2))
    tracks = fly_turns(points, course, TabulatedCurrent(table), PAPER_VESSEL, deviations)
    furthest = np.linalg.norm(tracks - points[:, None, None], axis=-1).max(axis=(1, 2))
    reach = TurnReach.of(table, PAPER_VESSEL)(points)
    assert (furthest <= reach).all()
    # It tells calm water from strong: no turn anywhere could need as much as the strongest does.
    assert reach.min() < 0.9 * reach.max()


@settings(max_examples=10)
@given(seed=seeds)
def test_segments_near_and_touching_tracks_match_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(0, 1, (70, 2)), axis=0)
    start = rng.uniform(-10, 10, (25, 2))
    end = start + rng.normal(0, 2, (25, 2))
    reach = rng.uniform(0.5, 4, 70)
    first, near = segments_near(points, reach, start, end)
    apart = segment_distance(points[:, None], start, end)
    for i in range(70):
        assert set(near[first[i] : first[i + 1]].tolist()) == set(
            np.flatnonzero(apart[i] <= reach[i]).tolist()
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


def test_the_strongest_current_of_the_gyre_is_its_amplitude() -> None:
    chart, gyre = single_gyre()
    assert gyre.table(chart.bounds).strongest == pytest.approx(gyre.max_speed(chart.bounds))
