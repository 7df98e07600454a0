"""Searches in arrays, in place of NumPy's, which Numba takes several times as long to compile."""

from renew._compiled import kernel, small_kernel
from renew._types import FloatArray


@kernel
def extremes(values: FloatArray) -> tuple[float, float]:
    """Return the least and the largest of some numbers, at least one."""
    least = most = values[0]
    for value in values:
        least = min(least, value)
        most = max(most, value)
    return least, most


@small_kernel
def number_up_to(axis: FloatArray, value: float) -> int:
    """Return how many of some ascending numbers are at most a value; NaN is above all."""
    first, last = 0, len(axis)
    while first < last:
        middle = (first + last) >> 1
        if value < axis[middle]:
            last = middle
        else:
            first = middle + 1
    return first


@small_kernel
def number_below(axis: FloatArray, value: float) -> int:
    """Return how many of some ascending numbers are less than a value."""
    first, last = 0, len(axis)
    while first < last:
        middle = (first + last) >> 1
        if axis[middle] < value:
            first = middle + 1
        else:
            last = middle
    return first
