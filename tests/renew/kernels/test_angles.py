"""Angles folded into one turn, in NumPy and in compiled code."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, strategies as st

from renew.kernels.capsules import wrapped


def in_kernel(angle: float) -> float:
    return wrapped(angle)


COMPILED: Any = numba.njit(in_kernel)


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
