"""The reach of a hard-over turn: the published pair, and the closed form against integration."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from renew._types import FloatArray
from renew.inputs.current import CurrentStatistics, TabulatedCurrent
from renew.kernels.turn_tracks import TurnsBegun
from renew.turns.contingency import fly_turns
from renew.turns.turn_reach import (
    HEADING_SPREAD,
    MAX_DEVIATIONS,
    TurnReach,
    TurnSampler,
    TurnsAtEdges,
    TurnStarts,
    normals_away,
    reach_along,
    turn_reach,
)
from tests.strategies import PAPER_VESSEL, SIZE, StreamFunctionCurrent, angles, seeds, speeds

NORTH = np.array([0.0, 1.0])


def begun(points: FloatArray, course: FloatArray) -> TurnsBegun:
    """Turns of the paper's vessel that begin at points (n, 2) on courses (n,), at time 0."""
    return TurnsBegun(points, course, np.zeros(len(points)), np.ones(len(points)))


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


# Two currents, of which the second one is steadier; and an edge to the north and one to the west.
MEAN = np.array([[0.3, 0.1], [-0.2, 0.4]])
STATISTICS = CurrentStatistics(
    mean=MEAN,
    speed=np.linalg.norm(MEAN, axis=1),
    direction=np.arctan2(MEAN[:, 1], MEAN[:, 0]),
    speed_std=np.array([0.1, 0.02]),
    direction_std=np.array([0.4, 0.1]),
)
COURSE = np.array([0.2, 1.5])
ROW = np.array([0, 0, 1, 1])
NORMALS = np.array([[0.0, 1.0], [-1.0, 0.0]] * 2)
TURNS = TurnsAtEdges(STATISTICS, COURSE, ROW, NORMALS, PAPER_VESSEL)


@settings(max_examples=20)
@given(seed=seeds, risk=st.floats(0.002, 0.98), count=st.integers(50, 600))
def test_no_more_than_the_risk_exceed_the_quantile(seed: int, risk: float, count: int) -> None:
    sampler = TurnSampler(seed, count)
    reaches = sampler.reaches(TURNS)
    found = sampler.quantile(TURNS, risk)
    assert reaches.shape == (4, count)
    assert (reaches == found[:, None]).any(axis=1).all()
    # On the safe side, and not by more than a fifth of the risk.
    assert ((reaches > found[:, None]).mean(axis=1) <= risk).all()
    assert ((reaches >= found[:, None]).mean(axis=1) >= 0.8 * risk).all()


def test_draws_depend_on_the_seed_alone() -> None:
    one, same, other = (TurnSampler(seed, 100).reaches(TURNS) for seed in (1, 1, 2))
    assert (one == same).all()
    assert (one != other).any()


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("risk", [5e-4, 1e-4])
def test_quantiles_far_in_the_tail_hold_for_millions_of_random_draws(risk: float) -> None:
    rng = np.random.default_rng(1)
    places, draws = 4, 2_000_000
    spread = CurrentStatistics(
        np.zeros((places, 2)),
        rng.uniform(0.1, 0.5, places),
        rng.uniform(-3, 3, places),
        rng.uniform(0.02, 0.2, places),
        rng.uniform(0.1, 0.6, places),
    )
    course, bearing = rng.uniform(-3, 3, (2, places))
    normals = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    asked = TurnsAtEdges(spread, course, np.arange(places), normals, PAPER_VESSEL)
    quantile = TurnSampler.for_risk(0, risk).quantile(asked, risk)
    for at in range(places):
        speed = rng.normal(spread.speed[at], spread.speed_std[at], draws).clip(min=0)
        towards = rng.normal(spread.direction[at], spread.direction_std[at], draws)
        heading = course[at] + rng.uniform(-HEADING_SPREAD, HEADING_SPREAD, draws)
        turns = TurnStarts(
            heading,
            np.cos(heading),
            np.sin(heading),
            speed * np.cos(towards),
            speed * np.sin(towards),
            PAPER_VESSEL.speed,
            PAPER_VESSEL.turn_rate,
        )
        reach = np.empty(draws)
        reach_along(normals[at], turns, reach)
        share = float((reach > quantile[at]).mean())
        assert 0.4 * risk <= share <= risk + 3 * math.sqrt(risk / draws)


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_no_turn_gets_further_than_its_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = StreamFunctionCurrent(seed, 0.9).table((0.0, 0.0, SIZE, SIZE))
    points, course = rng.uniform(0, SIZE, (100, 2)), rng.uniform(-math.pi, math.pi, 100)
    deviations = MAX_DEVIATIONS * rng.choice([-1.0, 0.0, 1.0], (100, 6, 2))
    tracks = fly_turns(begun(points, course), TabulatedCurrent(table), PAPER_VESSEL, deviations)
    furthest = np.linalg.norm(tracks - points[:, None, None], axis=-1).max(axis=(1, 2))
    reach = TurnReach.of(table, PAPER_VESSEL)(points)
    assert (furthest <= reach).all()
    # It is smaller in calm water than where the current is strongest.
    assert reach.min() < 0.9 * reach.max()
