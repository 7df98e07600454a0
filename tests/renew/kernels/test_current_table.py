"""The current's table, read at times that are NaN, infinite or huge."""

from __future__ import annotations

import math

import numpy as np
import pytest

from renew.kernels.current_table import table_of, velocities


@pytest.mark.parametrize("period", [math.inf, 30.0])
@pytest.mark.parametrize("middle", [15.0, 7.0], ids=["even", "uneven"])
def test_times_that_are_no_numbers_read_a_slice_of_the_table(period: float, middle: float) -> None:
    """An index made of one would lie outside the table, and end the process."""
    axis, uv = np.array([0.0, 1.0]), np.zeros((3, 2, 2, 2))
    uv[:, ..., 0] = np.array([1.0, 2.0, 1.0])[:, None, None]
    table = table_of(axis, axis, uv, times=np.array([0.0, middle, 30.0]), period=period)
    times = np.array([math.nan, math.inf, 1e308, 30.0, middle, -math.inf, -1e308])
    found = velocities(table, np.full((len(times), 2), 0.5), times)
    assert (found[:, 0] >= 1.0).all()
    assert (found[:, 0] <= 2.0).all()
    assert found[:2].tolist() == [[1.0, 0.0]] * 2
    assert found[4].tolist() == [2.0, 0.0]
