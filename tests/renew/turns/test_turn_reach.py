"""The reach of a hard-over turn: the published pair, and the closed form against integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings

from renew.turns.turn_reach import normals_away, turn_reach
from tests.strategies import PAPER_VESSEL, angles, seeds, speeds

NORTH = np.array([0.0, 1.0])


@pytest.mark.parametrize(
    ("towards", "published"), [(0.255, 4.47), (-0.255, 1.96)], ids=["towards", "away"]
)
def test_reach_is_the_published_padding(towards: float, published: float) -> None:
    # An edge to the north, travelled along to the east, in a current of 0.255 m/s.
    reach = turn_reach(PAPER_VESSEL, np.asarray(0.0), towards * NORTH, NORTH)
    assert reach == pytest.approx(published, rel=0.05)


@given(heading=angles, strength=speeds, towards=angles, normal=angles)
def test_reach_equals_a_densely_sampled_turn(
    heading: float, strength: float, towards: float, normal: float
) -> None:
    current = strength * np.array([math.cos(towards), math.sin(towards)])
    n = np.array([math.cos(normal), math.sin(normal)])
    time = np.linspace(0, PAPER_VESSEL.turn_period, 20_001)
    furthest = 0.0
    for omega in (PAPER_VESSEL.turn_rate, -PAPER_VESSEL.turn_rate):
        # The track by integrating its velocity, not by the closed form under test.
        theta = heading + omega * time
        velocity = np.column_stack([np.cos(theta), np.sin(theta)]) + current
        step = (velocity[1:] + velocity[:-1]) / 2 * np.diff(time)[:, None]
        furthest = max(furthest, float((np.cumsum(step, axis=0) @ n).max()))
    reach = turn_reach(PAPER_VESSEL, np.asarray(heading), current, n)
    assert reach == pytest.approx(furthest, abs=2e-3)


@settings(max_examples=20)
@given(seed=seeds)
def test_normals_are_unit_vectors_square_to_their_edge_and_point_away(seed: int) -> None:
    edges = np.random.default_rng(seed).normal(0, 5, (20, 2, 2))
    point = np.array([1.0, 2.0])
    normals = normals_away(edges, np.broadcast_to(point, (20, 2)))
    along = edges[:, 1] - edges[:, 0]
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)
    assert (normals * along).sum(axis=1) == pytest.approx(0, abs=1e-9)
    assert (((edges.mean(axis=1) - point) * normals).sum(axis=1) >= 0).all()
