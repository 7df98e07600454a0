"""The quickest chain against all chains, and shortcuts against a plain twin, by the clock."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from renew._types import FloatArray
from renew.inputs.options import Drift
from renew.kernels.capsules import Capsules, legs_are_clear
from renew.kernels.current_table import STILL_WATER, table_of, velocities
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import (
    TOO_STRONG,
    Clock,
    Stream,
    arrivals,
    leg_time,
    quickest_chain,
    shortcut,
)
from renew.voyage.fuel import ground_speed
from tests.compiler import uncompiled
from tests.strategies import examples, seeds

# Side (m) of the water, and how far apart its nodes stand.
SIDE, CELL = 12.0, 2.0


def stream(rng: np.random.Generator, slices: int, strength: float, *, crab: bool) -> Stream:
    """A random current, steady if it has one slice; begun at 3 s, in steps of 0.7 m."""
    axis = np.arange(-SIDE, SIDE + CELL, CELL)
    uv = rng.normal(0, strength, (slices, len(axis), len(axis), 2))
    times = np.cumsum(rng.uniform(2, 5, slices))
    return Stream(table_of(axis, axis, uv, times=times), Polar(1.0, crab), Clock(3.0, 0.7))


def plain_leg_time(a: FloatArray, b: FloatArray, begin: float, water: Stream) -> float:
    """Time (s) over a leg: in each piece its length times the mean of the slowness at both ends."""
    length = float(np.linalg.norm(b - a))
    if length == 0:
        return 0.0
    pieces = 1 if water.table.is_steady else math.ceil(length / water.clock.step)

    def slow(place: float, time: float) -> float:
        point = (a + place * (b - a))[None]
        current = velocities(water.table, point, np.array([time]))
        drift: Drift = "crab" if water.polar.crab else "projected"
        speed = float(ground_speed(current, (b - a)[None] / length, 1.0, drift)[0])
        return 1 / speed if np.linalg.norm(current) < 1 and speed > 0 else math.inf

    now, here = begin, slow(0.0, begin)
    for k in range(pieces):
        if here == math.inf:
            return math.inf
        there = slow((k + 1) / pieces, now + length / pieces * here)
        now += length / pieces * (here + there) / 2
        here = there
    return now - begin


def kernel_time(a: FloatArray, b: FloatArray, begin: float, water: Stream) -> float:
    """The same by the kernel."""
    return leg_time(float(a[0]), float(a[1]), float(b[0]), float(b[1]), begin, water)


@settings(max_examples=40, deadline=None)
@given(seed=seeds, slices=st.sampled_from([1, 6]))
def test_a_legs_time_is_its_length_times_its_mean_slowness(seed: int, slices: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 10, (2, 2))
    for crab in (False, True):
        water = stream(rng, slices, 0.3, crab=crab)
        expected = plain_leg_time(a, b, 4.0, water)
        assert kernel_time(a, b, 4.0, water) == pytest.approx(expected)
        assert kernel_time(a, a, 4.0, water) == 0
        there = 3.0 + kernel_time(a, b, 3.0, water)
        back = there + kernel_time(b, a, there, water) if there < math.inf else math.inf
        assert arrivals(np.stack([a, b, a]), water) == pytest.approx([3.0, there, back])


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_a_later_departure_does_not_arrive_earlier(seed: int) -> None:
    rng = np.random.default_rng(seed)
    water = stream(rng, 6, 0.1, crab=bool(seed % 2))
    a, b = rng.uniform(-10, 10, (2, 2))
    begin = np.linspace(0, 20, 200)
    ends = begin + np.array([kernel_time(a, b, time, water) for time in begin.tolist()])
    assert (np.diff(ends[np.isfinite(ends)]) >= 0).all()


@examples(4, 10)
@given(seed=seeds, slices=st.sampled_from([1, 6]))
def test_quickest_chain_is_the_best_of_all_chains(seed: int, slices: int) -> None:
    rng = np.random.default_rng(seed)
    rows, count = 4, 5
    points = np.cumsum(rng.uniform(0.5, 2, (rows, 1, 1)), axis=0) * [[[1.0, 0.0]]]
    points = points + rng.normal(0, 1, (rows, count, 2)) * [0.1, 2.0]
    points[[0, -1]] = points[[0, -1], :1]
    start, end = rng.uniform(0, 5, (2, 2, 2))
    capsules = Capsules(start, end, rng.uniform(0.1, 0.6, 2))
    exempt = np.zeros((2, 2), dtype=bool)
    for crab in (False, True):
        water = stream(rng, slices, 0.25, crab=crab)
        arguments = (points, water, capsules, exempt)
        arrival, chain = quickest_chain(*arguments)
        best = math.inf
        for choice in itertools.product(range(count), repeat=rows - 2):
            now = water.clock.departure
            index = (0, *choice, 0)
            for row, (i, j) in enumerate(itertools.pairwise(index)):
                a, b = points[row, i], points[row + 1, j]
                if not legs_are_clear(a[None], b[None], capsules)[0]:
                    now = math.inf
                    break
                now += plain_leg_time(a, b, now, water)
                if now == math.inf:
                    break
                current = velocities(water.table, b[None], np.array([now]))
                if (current**2).sum() >= TOO_STRONG:
                    now = math.inf
                    break
            best = min(best, now)
        # With long legs and few slices an earlier departure from a node may arrive later.
        assert arrival == pytest.approx(best, rel=1e-9 if slices == 1 else 1e-3)
        without_compiler = uncompiled(quickest_chain)(*arguments)
        assert without_compiler[0] == pytest.approx(arrival)
        assert without_compiler[1].tolist() == chain.tolist()


@examples(8, 20)
@given(seed=seeds, slices=st.sampled_from([1, 6]))
def test_shortcuts_are_those_of_a_plain_twin_and_leave_no_point_to_skip(
    seed: int, slices: int
) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.uniform(-0.5, 1.5, (14, 2)), axis=0)
    start = rng.uniform(0, path.max(), (5, 2))
    capsules = Capsules(start, start + rng.normal(0, 1, (5, 2)), rng.uniform(0.05, 0.4, 5))
    land = shapely.linestrings(np.stack([capsules.start, capsules.end], axis=1))
    water, longest = stream(rng, slices, 0.2, crab=bool(seed % 2)), 5.0
    times = arrivals(path, water)

    def can_skip(a: int, b: int, c: int) -> bool:
        leg = shapely.LineString(path[[a, c]])
        clear = (shapely.distance(leg, land) >= capsules.radius).all()
        via = plain_leg_time(path[a], path[b], times[a], water)
        via += plain_leg_time(path[b], path[c], times[b], water)
        direct = plain_leg_time(path[a], path[c], times[a], water)
        return bool(leg.length <= longest and clear and not direct > via)

    kept = [0]
    for new in range(1, len(path)):
        while len(kept) > 1 and can_skip(kept[-2], kept[-1], new):
            kept.pop()
        kept.append(new)

    arguments = (path, water, capsules, longest)
    found = np.flatnonzero(shortcut(*arguments)).tolist()
    assert found == kept
    assert np.flatnonzero(uncompiled(shortcut)(*arguments)).tolist() == kept
    assert not any(can_skip(*three) for three in zip(kept, kept[1:], kept[2:], strict=False))


def test_a_detour_is_cut_short_only_where_the_way_past_it_is_clear() -> None:
    path = np.array([[0, 0], [1, 1], [2, 0], [3, 1], [4, 0]], dtype=float)
    still = Stream(STILL_WATER, Polar(1.0, crab=False), Clock(0.0, math.inf))
    # An edge of land below the first bend only.
    land = Capsules(np.array([[1.0, -1.0]]), np.array([[1.0, 0.3]]), np.array([0.1]))
    assert shortcut(path, still, land, 10.0).tolist() == [True, True, False, False, True]
    assert shortcut(path, still, land, 1.9).all()
