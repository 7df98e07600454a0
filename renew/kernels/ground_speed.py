"""Speed over ground along a course in a current: the denominator of Eq. 4, in both drift models."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, small_kernel
from renew._types import FloatArray


class Polar(NamedTuple):
    """What the vessel makes on every course: `speed` through water (m/s), by which drift model.

    `crab` is True for the exact model, in which the vessel heads into the cross-current, and False
    for the projected one, as published.
    """

    speed: float
    crab: bool


@small_kernel
def ground_speed(cx: float, cy: float, tx: float, ty: float, polar: Polar) -> float:
    """Speed over ground along the unit tangent t in the current c, m/s.

    Projected: v + c·T. Crab: c·T + √(v² - |c - (c·T)T|²). Not positive where the vessel can't make
    way in that direction, and NaN where it can't even hold the course.
    """
    along = cx * tx + cy * ty
    if not polar.crab:
        return along + polar.speed
    across = cy * tx - cx * ty
    square = polar.speed * polar.speed - across * across
    return along + math.sqrt(square) if square >= 0.0 else math.nan


@kernel
def ground_speeds(velocity: FloatArray, tangent: FloatArray, polar: Polar) -> FloatArray:
    """Speeds over ground (n,) along unit tangents (n, 2) in currents (n, 2); m/s."""
    speeds = np.empty(len(velocity))
    for k in range(len(velocity)):
        speeds[k] = ground_speed(
            velocity[k, 0], velocity[k, 1], tangent[k, 0], tangent[k, 1], polar
        )
    return speeds
