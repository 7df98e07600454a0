"""What counts as a count and as a size: for arguments that may be anything at all."""

from __future__ import annotations

import math

import numpy as np


def is_count(value: object, least: int) -> bool:
    """Whether a value is a whole number (no bool) of at least so much."""
    return (
        isinstance(value, int | np.integer) and not isinstance(value, bool) and int(value) >= least
    )


def is_size(value: object) -> bool:
    """Whether a value is a finite number of at least 0."""
    return isinstance(value, int | float | np.number) and 0 <= float(value) < math.inf
