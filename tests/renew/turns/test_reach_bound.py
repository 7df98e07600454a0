"""The bound on the reach of turns: none gets further, and calm water has a smaller one."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings

from renew.inputs.current import TabulatedCurrent
from renew.turns.contingency import fly_turns
from renew.turns.reach_bound import MAX_DEVIATIONS, TurnReach
from tests.strategies import PAPER_VESSEL, SIZE, StreamFunctionCurrent, seeds


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_no_turn_gets_further_than_its_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = StreamFunctionCurrent(seed, 0.9).table((0.0, 0.0, SIZE, SIZE))
    points, course = rng.uniform(0, SIZE, (100, 2)), rng.uniform(-math.pi, math.pi, 100)
    deviations = MAX_DEVIATIONS * rng.choice([-1.0, 0.0, 1.0], (100, 6, 2))
    tracks = fly_turns(
        points, course, TabulatedCurrent(table), PAPER_VESSEL, deviations, np.zeros(100)
    )
    furthest = np.linalg.norm(tracks - points[:, None, None], axis=-1).max(axis=(1, 2))
    reach = TurnReach.of(table, PAPER_VESSEL)(points)
    assert (furthest <= reach).all()
    # It is smaller in calm water than where the current is strongest.
    assert reach.min() < 0.9 * reach.max()
