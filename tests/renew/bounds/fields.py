"""Currents of every kind that the lower bound on fuel distinguishes, on a square of 100 m."""

from __future__ import annotations

import numpy as np

import renew
from renew._types import FloatArray
from tests.strategies import StreamFunctionCurrent

CORNER, OPPOSITE = np.array([10.0, 10.0]), np.array([90.0, 90.0])
"""Start and goal."""


def _gridded(seed: int, nodes: int, strength: float = 0.4) -> renew.GriddedCurrent:
    """Rough current on an uneven grid inside the square."""
    rng = np.random.default_rng(seed)
    x, y = np.sort(rng.uniform(8, 95, (2, nodes)), axis=1)
    return renew.GriddedCurrent(x, y, *rng.uniform(-strength, strength, (2, nodes, nodes)))


_GYRES = renew.GyreCurrent(0.6, 100, 100, 2, 1)
_FINE = np.linspace(-3, 103, 331)
_FINE_NODES = np.stack(np.meshgrid(_FINE, _FINE), axis=-1)

FIELDS = {
    "uniform": renew.UniformCurrent(0.5, -0.3),
    "gyre": renew.GyreCurrent(0.8, 100, 100),
    "gyres, stronger than the vessel": renew.GyreCurrent(1.4, 100, 100, 2, 3),
    "coarse grid": _gridded(1, 5),
    "fine grid": renew.GriddedCurrent(_FINE, _FINE, *np.moveaxis(_GYRES(_FINE_NODES), -1, 0)),
    "stream function": StreamFunctionCurrent(3, 0.7),
}
"""One current of each kind, by name."""


def in_triangles(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Places (count, 2) in the unit square below its rising and below its falling diagonal."""
    s, t = np.sort(rng.uniform(0, 1, (2, count)), axis=0)[::-1]
    return np.stack([s, t], axis=-1), np.stack([1 - s, t], axis=-1)
