"""A current as a table of nodes, bilinear between them: how compiled code looks it up.

The search for paths asks for the current millions of times; it reads a table, made once a plan.
What a plan reports is worked out in the field itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from renew._types import FloatArray

# A table is fine enough when the field is off it by at most this share of its strongest current
# in the middle of any cell. What a path found with it needs more than the least is of second order.
_TOLERANCE = 1e-3
# Cells a side of the first table, which are halved while it is not fine enough, and of the last,
# of 16 MB. Halves of a smooth field's cells have a quarter of the error; a field in which they have
# hardly less has a step, and stays coarse.
_FIRST_CELLS, _MOST_CELLS, _SMOOTH = 64, 1024, 0.5

# Steps of an even axis differ by rounding only: by this share of its largest coordinate.
_EVEN = 1e-12


class Table(NamedTuple):
    """Ascending nodes x (nx,), y (ny,) in metres and velocities uv (ny, nx, 2) there in m/s.

    `error` (m/s) is how far the field was found to be off the table at the most. `per_x` and
    `per_y` are cells per metre, 0 where nodes don't stand evenly.
    """

    x: FloatArray
    y: FloatArray
    uv: FloatArray
    error: float
    per_x: float
    per_y: float

    @property
    def strongest(self) -> float:
        """Strongest current (m/s): between nodes it is no stronger than at the strongest."""
        return float(np.linalg.norm(self.uv, axis=-1).max())

    @property
    def is_fine(self) -> bool:
        """Whether the field can't be told from its table."""
        return self.error <= _TOLERANCE * self.strongest


def table_of(x: FloatArray, y: FloatArray, uv: FloatArray, error: float = 0.0) -> Table:
    """Table of nodes and velocities; see :class:`Table`."""
    x, y, uv = (np.ascontiguousarray(array, dtype=float) for array in (x, y, uv))
    return Table(x, y, uv, error, _per_metre(x), _per_metre(y))


def _per_metre(axis: FloatArray) -> float:
    """Cells per metre of an even axis (n,); 0 if it is uneven by more than rounding."""
    steps = np.diff(axis)
    even = np.ptp(steps) <= _EVEN * np.abs(axis).max()
    return float(len(steps) / (axis[-1] - axis[0])) if even else 0.0


STILL = table_of(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros((2, 2, 2)))
"""No current anywhere."""


def tabulated(
    field: Callable[[FloatArray], FloatArray], bounds: tuple[float, float, float, float]
) -> Table:
    """Table of a field inside (xmin, ymin, xmax, ymax), as fine as it needs to be."""
    xmin, ymin, xmax, ymax = bounds
    cells, last = _FIRST_CELLS, np.inf
    while True:
        x, y = np.linspace(xmin, xmax, cells + 1), np.linspace(ymin, ymax, cells + 1)
        uv = field(np.stack(np.meshgrid(x, y), axis=-1))
        middles = np.stack(np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2), axis=-1)
        halfway = (uv[1:, 1:] + uv[1:, :-1] + uv[:-1, 1:] + uv[:-1, :-1]) / 4
        error = float(np.linalg.norm(field(middles) - halfway, axis=-1).max())
        table = table_of(x, y, uv, error)
        if table.is_fine or cells >= _MOST_CELLS or error > _SMOOTH * last:
            return table
        cells, last = 2 * cells, error


@njit(cache=True, error_model="numpy")
def velocity(table: Table, px: float, py: float) -> tuple[float, float]:
    """Velocity (m/s) at a point, held constant outside the table."""
    i, s = _cell(table.x, table.per_x, px)
    j, t = _cell(table.y, table.per_y, py)
    uv = table.uv
    sw, se, nw, ne = (1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t
    return (
        sw * uv[j, i, 0] + se * uv[j, i + 1, 0] + nw * uv[j + 1, i, 0] + ne * uv[j + 1, i + 1, 0],
        sw * uv[j, i, 1] + se * uv[j, i + 1, 1] + nw * uv[j + 1, i, 1] + ne * uv[j + 1, i + 1, 1],
    )


@njit(cache=True, error_model="numpy")
def _cell(axis: FloatArray, per_metre: float, value: float) -> tuple[int, float]:
    """Index of the cell that holds a value, and the place in it in [0, 1]."""
    last = len(axis) - 2
    if per_metre > 0.0:
        along = min(max((value - axis[0]) * per_metre, 0.0), last + 1.0)
        i = min(int(along), last)
        return i, along - i
    i = min(max(int(np.searchsorted(axis, value, side="right")) - 1, 0), last)
    place = (value - axis[i]) / (axis[i + 1] - axis[i])
    return i, min(max(place, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def velocities(table: Table, points: FloatArray) -> FloatArray:
    """Velocities (n, 2) at points (n, 2)."""
    result = np.empty(points.shape)
    for k in range(len(points)):
        result[k, 0], result[k, 1] = velocity(table, points[k, 0], points[k, 1])
    return result
