"""Figures and objects as callers give them: refused where they aren't what they should be."""

import math
import reprlib
from typing import TypeGuard

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 100


def shown(value: object) -> str:
    """A value as Python writes it, on one line; of a long one the beginning and the end."""
    return " ".join(_SHORT.repr(value).split())


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a real number, and neither true or false nor a duration."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(
        value, bool | np.timedelta64
    )


def is_finite(value: object) -> TypeGuard[float]:
    """Whether a value is a number that is finite as a float."""
    try:
        return is_number(value) and math.isfinite(value)
    except OverflowError:  # a whole number beyond the floats
        return False


def as_floats(name: str, value: object) -> FloatArray:
    """Take real numbers as an array of floats; not text, complex numbers, dates or masked ones."""
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O":
            # NumPy would take None for NaN.
            array = np.array([float(one) for one in array.ravel()]).reshape(array.shape)
        if array.dtype.kind in "biuf" and not np.ma.is_masked(value):
            return np.asarray(array, dtype=float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ParameterError(f"{name} = {shown(value)} must be real numbers")


def check_kind(name: str, value: object, kind: type) -> None:
    """Refuse an object that is not of a class of ours."""
    if not isinstance(value, kind):
        raise ParameterError(f"{name} = {shown(value)} must be a renew.{kind.__name__}")
