"""Trajectories: they can be sailed, take the crab model's time, or are refused for a reason."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

import renew
from renew.steering.trajectory import steer
from tests.renew.steering.motion import assert_sailable
from tests.strategies import PAPER_VESSEL, SIZE, STILL, StreamFunctionCurrent, seeds, single_gyre


def test_trajectory_takes_as_long_as_the_crab_model_says() -> None:
    best = single_gyre().plan(drift="crab").best
    assert best.trajectory[-1, 0] == pytest.approx(best.fuel, rel=0.01)


def test_a_corner_without_room_cannot_be_steered() -> None:
    zigzag = np.array([[0, 0], [10, 0], [10.2, 0.5], [20, 0.5]], dtype=float)
    with pytest.raises(renew.PlanningError, match="to turn in"):
        steer(zigzag, STILL, PAPER_VESSEL)
    gentle = np.array([[0, 0], [20, 0], [40, 5]], dtype=float)
    assert_sailable(steer(gentle, STILL, PAPER_VESSEL), STILL, gentle[0], gentle[-1])


@settings(max_examples=10)
@given(seed=seeds, turn=st.floats(-2.0, 2.0))
def test_a_path_with_room_is_followed_closely_and_can_be_sailed(seed: int, turn: float) -> None:
    current = StreamFunctionCurrent(seed, 0.5)
    corner = np.array([SIZE / 2, SIZE / 2])
    end = corner + 40 * np.array([math.cos(turn), math.sin(turn)])
    path = np.array([corner - [40, 0], corner, end])
    trajectory = steer(path, current, PAPER_VESSEL)
    assert_sailable(trajectory, current, path[0], path[-1])
    line, track = shapely.LineString(path), shapely.LineString(trajectory[:, 1:3])
    # It leaves the path only to cut the corner, by no more than the corner's arc does.
    cut = 4 * PAPER_VESSEL.turning_radius * (1 / math.cos(turn / 2) - 1) + 0.01
    assert line.hausdorff_distance(track) <= cut


def test_a_current_too_strong_to_hold_the_course_is_refused_with_its_place() -> None:
    class Race(renew.CurrentField):
        def __call__(self, points: np.ndarray) -> np.ndarray:
            return np.where(points[..., :1] > 50, [0.0, 1.5], [0.0, 0.0])

    path = np.array([[10.0, 20.0], [90.0, 20.0]])
    with pytest.raises(renew.PlanningError, match=r"at \(50\.\d+, 20\) m is too strong"):
        steer(path, Race(), PAPER_VESSEL)


def test_a_shear_too_steep_to_turn_in_is_refused() -> None:
    class Shear(renew.CurrentField):
        def __call__(self, points: np.ndarray) -> np.ndarray:
            return np.where(points[..., :1] > 50, [0.0, 0.9], [0.0, -0.9])

    path = np.array([[10.0, 20.0], [90.0, 20.0]])
    with pytest.raises(renew.PlanningError, match=r"turn faster than 35\.0 degrees a second"):
        steer(path, Shear(), PAPER_VESSEL)
