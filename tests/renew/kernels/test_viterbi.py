"""The quickest chain against all chains, and shortcuts against a plain twin."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely
from hypothesis import given, settings

from renew.inputs.fuel import ground_speed
from renew.kernels.capsules import Capsules, legs_are_clear
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import TOO_STRONG, leg_time, quickest_chain, shortcut
from tests.compiler import uncompiled
from tests.strategies import seeds

if TYPE_CHECKING:
    from renew._types import FloatArray


def plain_leg_time(
    a: FloatArray, b: FloatArray, velocity: tuple[FloatArray, FloatArray], polar: Polar
) -> float:
    """Time (s) over a leg: its length times the mean of the slowness at both ends."""
    length = float(np.linalg.norm(b - a))
    if length == 0:
        return 0.0
    speeds = ground_speed(
        np.array(velocity), (b - a) / length, polar.speed, "crab" if polar.crab else "projected"
    )
    too_strong = np.linalg.norm(velocity, axis=1) >= polar.speed
    if too_strong.any() or not (speeds > 0).all():
        return math.inf
    return length * float((1 / speeds).mean())


@settings(max_examples=40)
@given(seed=seeds)
def test_a_legs_time_is_its_length_times_its_mean_slowness(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 10, (2, 2))
    here, there = rng.normal(0, 0.6, (2, 2))
    for crab in (False, True):
        polar = Polar(1.0, crab)
        expected = plain_leg_time(a, b, (here, there), polar)
        assert leg_time(a, b, here, there, polar) == pytest.approx(expected)
        assert leg_time(a, a, here, there, polar) == 0


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_quickest_chain_is_the_best_of_all_chains(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, count = 4, 5
    points = np.cumsum(rng.uniform(0.5, 2, (rows, 1, 1)), axis=0) * [[[1.0, 0.0]]]
    points = points + rng.normal(0, 1, (rows, count, 2)) * [0.1, 2.0]
    points[[0, -1]] = points[[0, -1], :1]
    velocity = rng.normal(0, 0.3, points.shape)
    velocity[[0, -1]] = velocity[[0, -1], :1]
    velocity[0] = 0.2  # the current at the start is weaker than the vessel
    start, end = rng.uniform(0, 5, (2, 2, 2))
    capsules = Capsules(start, end, rng.uniform(0.1, 0.6, 2))
    exempt = np.zeros((2, 2), dtype=bool)
    for crab in (False, True):
        arguments = (points, velocity, Polar(1.0, crab), capsules, exempt)
        arrival, chain = quickest_chain(*arguments)
        best = math.inf
        for choice in itertools.product(range(count), repeat=rows - 2):
            total = 0.0
            index = (0, *choice, 0)
            for row, (i, j) in enumerate(itertools.pairwise(index)):
                a, b = points[row, i], points[row + 1, j]
                if not legs_are_clear(a[None], b[None], capsules)[0]:
                    total = math.inf
                    break
                tangent = (b - a) / np.linalg.norm(b - a)
                current = np.stack([velocity[row, i], velocity[row + 1, j]])
                speeds = ground_speed(current, tangent, 1.0, "crab" if crab else "projected")
                if (current[1] ** 2).sum() >= TOO_STRONG or (speeds <= 0).any():
                    total = math.inf
                    break
                total += float(np.linalg.norm(b - a) * (1 / speeds).mean())
            best = min(best, total)
        assert arrival == pytest.approx(best)
        without_compiler = uncompiled(quickest_chain)(*arguments)
        assert without_compiler[0] == pytest.approx(arrival)
        assert without_compiler[1].tolist() == chain.tolist()


@settings(max_examples=20)
@given(seed=seeds)
def test_shortcuts_are_those_of_a_plain_twin_and_leave_no_point_to_skip(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.uniform(-0.5, 1.5, (14, 2)), axis=0)
    velocity = rng.normal(0, 0.3, path.shape)
    start = rng.uniform(0, path.max(), (5, 2))
    capsules = Capsules(start, start + rng.normal(0, 1, (5, 2)), rng.uniform(0.05, 0.4, 5))
    land = shapely.linestrings(np.stack([capsules.start, capsules.end], axis=1))
    polar, longest = Polar(1.0, bool(seed % 2)), 5.0

    def time(a: int, b: int) -> float:
        return plain_leg_time(path[a], path[b], (velocity[a], velocity[b]), polar)

    def can_skip(a: int, b: int, c: int) -> bool:
        leg = shapely.LineString(path[[a, c]])
        clear = (shapely.distance(leg, land) >= capsules.radius).all()
        return bool(leg.length <= longest and clear and not time(a, c) > time(a, b) + time(b, c))

    kept = [0]
    for new in range(1, len(path)):
        while len(kept) > 1 and can_skip(kept[-2], kept[-1], new):
            kept.pop()
        kept.append(new)

    arguments = (path, velocity, polar, capsules, longest)
    found = np.flatnonzero(shortcut(*arguments)).tolist()
    assert found == kept
    assert np.flatnonzero(uncompiled(shortcut)(*arguments)).tolist() == kept
    assert not any(can_skip(*three) for three in zip(kept, kept[1:], kept[2:], strict=False))


def test_a_detour_is_cut_short_only_where_the_way_past_it_is_clear() -> None:
    path = np.array([[0, 0], [1, 1], [2, 0], [3, 1], [4, 0]], dtype=float)
    still = np.zeros_like(path)
    polar = Polar(1.0, crab=False)
    # An edge of land below the first bend only.
    land = Capsules(np.array([[1.0, -1.0]]), np.array([[1.0, 0.3]]), np.array([0.1]))
    assert shortcut(path, still, polar, land, 10.0).tolist() == [True, True, False, False, True]
    assert shortcut(path, still, polar, land, 1.9).all()
