"""Angles."""

import math
from typing import TypeVar

import numpy as np
from numba.extending import register_jitable

from renew._types import FloatArray

AngleT = TypeVar("AngleT", float, np.float64, FloatArray)


@register_jitable
def wrapped(angle: AngleT) -> AngleT:
    """Return angles (rad), a number or an array, folded into [-π, π); for NumPy and kernels."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
