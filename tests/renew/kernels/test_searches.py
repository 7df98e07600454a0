"""Searches in arrays beside NumPy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies as st

from renew.kernels.searches import extremes, number_below, number_up_to

_NUMBERS = st.lists(st.integers(-4, 4).map(float), min_size=1, max_size=9).map(np.array)


@given(_NUMBERS, st.floats())
def test_they_find_what_numpy_finds(numbers: np.ndarray, value: float) -> None:
    assert extremes(numbers) == (numbers.min(), numbers.max())
    axis = np.sort(numbers)
    for wanted in (value, float(axis[0]), float(axis[-1])):
        assert number_up_to(axis, wanted) == np.searchsorted(axis, wanted, side="right")
        if wanted == wanted:  # noqa: PLR0124 - NaN, which no axis is searched for from the left
            assert number_below(axis, wanted) == np.searchsorted(axis, wanted)
