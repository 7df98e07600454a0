"""Oracles of their own for chosen speeds: SciPy's optimizer, and a table of times and speeds."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import minimize

from renew._types import FloatArray

# Places and weights of Simpson's rule on a leg.
_PLACES, _WEIGHTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0]), np.array([7, 32, 12, 32, 7]) / 90

_STEP = 1.5e-8
"""Of differences: about the square root of a float's precision."""


def leg_times(
    path: FloatArray,
    speeds: FloatArray,
    current: Callable[[FloatArray], FloatArray],
    *,
    crab: bool,
) -> FloatArray:
    """Times (..., n - 1), s, over the legs of paths (..., n, 2) at speeds through water.

    By Boole's rule.
    """
    legs = np.diff(path, axis=-2)
    length = np.linalg.norm(legs, axis=-1)
    unit = legs / length[..., None]
    c = current(path[..., :-1, None, :] + _PLACES[:, None] * legs[..., None, :])
    along = (c * unit[..., None, :]).sum(-1)
    across = c[..., 1] * unit[..., None, 0] - c[..., 0] * unit[..., None, 1]
    v = speeds[..., None]
    way = np.sqrt(np.maximum(v**2 - across**2, 1e-9)) if crab else v
    return np.asarray(length * (_WEIGHTS / np.maximum(along + way, 1e-3)).sum(axis=-1))


def gradient(function: Callable[[FloatArray], FloatArray], values: FloatArray) -> FloatArray:
    """Gradient by differences, all of them in one call: SciPy's own are a call each."""
    shifted = values + _STEP * np.eye(len(values))
    return np.asarray((function(shifted) - function(values)) / _STEP)


def least_fuel(
    path: FloatArray,
    current: Callable[[FloatArray], FloatArray],
    speeds: tuple[float, float],
    time: float,
    *,
    exponent: float,
    crab: bool,
    moving: bool,
) -> float:
    """Least fuel found to sail a path (n, 2) in a time (s), over the speeds of its legs.

    Its inner points may be moved as well, square to the line between its ends.
    """
    legs, (a, b) = len(path) - 1, path[[0, -1]]
    square = np.array([a[1] - b[1], b[0] - a[0]]) / math.dist(a, b)
    inner = legs - 1 if moving else 0

    def times(values: FloatArray) -> FloatArray:
        way = np.broadcast_to(path, (*values.shape[:-1], *path.shape)).copy()
        way[..., 1 : 1 + inner, :] += values[..., legs:, None] * square
        return leg_times(way, values[..., :legs], current, crab=crab)

    def fuel(values: FloatArray) -> FloatArray:
        return np.asarray((values[..., :legs] ** exponent * times(values)).sum(-1))

    def spare(values: FloatArray) -> FloatArray:
        return np.asarray((time - times(values).sum(-1)) / time)

    found = []
    for share in (0.3, 0.6, 0.9):
        first = np.concatenate(
            [np.full(legs, speeds[0] + share * (speeds[1] - speeds[0])), np.zeros(inner)]
        )
        result = minimize(
            fuel,
            first,
            jac=partial(gradient, fuel),
            method="SLSQP",
            bounds=[speeds] * legs + [(None, None)] * inner,
            constraints={"type": "ineq", "fun": spare, "jac": partial(gradient, spare)},
            options={"maxiter": 400, "ftol": 1e-10},
        )
        if times(result.x).sum() <= time * (1 + 1e-6):
            found.append(float(result.fun))
    return min(found)
