"""Whether a vessel can sail a trajectory."""

import numpy as np
import pytest

import renew
from renew._types import FloatArray
from tests.strategies import PAPER_VESSEL


def assert_sailable(
    trajectory: FloatArray, current: renew.CurrentField, start: FloatArray, goal: FloatArray
) -> None:
    """The vessel turns no faster than it can, and only its own speed and the current move it."""
    time, position, heading = trajectory[:, 0], trajectory[:, 1:3], trajectory[:, 3]
    assert position[0] == pytest.approx(start)
    assert position[-1] == pytest.approx(goal)
    step = np.diff(time)
    assert (step > 0).all()
    assert (np.abs(np.diff(heading)) <= PAPER_VESSEL.turn_rate * step * (1 + 1e-6)).all()
    middle = (heading[1:] + heading[:-1]) / 2
    through = PAPER_VESSEL.speed * np.column_stack([np.cos(middle), np.sin(middle)])
    expected = through + current((position[1:] + position[:-1]) / 2)
    assert np.diff(position, axis=0) / step[:, None] == pytest.approx(expected, abs=0.02)
