"""A current as a table of nodes, bilinear between them: how compiled code looks it up.

The search for paths asks for the current millions of times; it reads a table, made once a plan.
What a plan reports is worked out in the field itself.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable

    from renew._types import FloatArray

# A table is fine enough when the field is off it by at most this share of its strongest current
# in the middle of any cell. What a path found with it needs more than the least is of second order.
_TOLERANCE = 1e-3
# Cells a side of the first table, which are halved while it is not fine enough, and of the last,
# of 4 MB.
_FIRST_CELLS, _MOST_CELLS = 64, 512


class Table(NamedTuple):
    """Ascending nodes x (nx,), y (ny,) in metres and velocities uv (ny, nx, 2) there in m/s.

    `error` (m/s) is how far the field was found to be off the table at the most.
    """

    x: FloatArray
    y: FloatArray
    uv: FloatArray
    error: float

    @property
    def strongest(self) -> float:
        """Strongest current (m/s): between nodes it is no stronger than at the strongest."""
        return float(np.linalg.norm(self.uv, axis=-1).max())

    @property
    def is_fine(self) -> bool:
        """Whether the field can't be told from its table."""
        return self.error <= _TOLERANCE * self.strongest


STILL = Table(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros((2, 2, 2)), 0.0)
"""No current anywhere."""


def tabulated(
    field: Callable[[FloatArray], FloatArray], bounds: tuple[float, float, float, float]
) -> Table:
    """Table of a field inside (xmin, ymin, xmax, ymax), as fine as it needs to be."""
    xmin, ymin, xmax, ymax = bounds
    cells = _FIRST_CELLS
    while True:
        x, y = np.linspace(xmin, xmax, cells + 1), np.linspace(ymin, ymax, cells + 1)
        uv = field(np.stack(np.meshgrid(x, y), axis=-1))
        middles = np.stack(np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2), axis=-1)
        halfway = (uv[1:, 1:] + uv[1:, :-1] + uv[:-1, 1:] + uv[:-1, :-1]) / 4
        error = float(np.linalg.norm(field(middles) - halfway, axis=-1).max())
        table = Table(x, y, np.ascontiguousarray(uv), error)
        if table.is_fine or cells >= _MOST_CELLS:
            return table
        cells *= 2


@njit(cache=True, error_model="numpy")
def velocity(table: Table, px: float, py: float) -> tuple[float, float]:
    """Velocity (m/s) at a point, held constant outside the table."""
    i, s = _cell(table.x, px)
    j, t = _cell(table.y, py)
    uv = table.uv
    sw, se, nw, ne = (1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t
    return (
        sw * uv[j, i, 0] + se * uv[j, i + 1, 0] + nw * uv[j + 1, i, 0] + ne * uv[j + 1, i + 1, 0],
        sw * uv[j, i, 1] + se * uv[j, i + 1, 1] + nw * uv[j + 1, i, 1] + ne * uv[j + 1, i + 1, 1],
    )


@njit(cache=True, error_model="numpy")
def _cell(axis: FloatArray, value: float) -> tuple[int, float]:
    """Index of the cell that holds a value, and the place in it in [0, 1]."""
    last = len(axis) - 2
    # Nodes mostly stand evenly: the guess is right then, or off by one for rounding.
    guess = (value - axis[0]) / (axis[-1] - axis[0]) * (last + 1)
    i = int(min(max(math.floor(guess), 0), last))
    while i > 0 and value < axis[i]:
        i -= 1
    while i < last and value >= axis[i + 1]:
        i += 1
    place = (value - axis[i]) / (axis[i + 1] - axis[i])
    return i, min(max(place, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def velocities(table: Table, points: FloatArray) -> FloatArray:
    """Velocities (n, 2) at points (n, 2)."""
    result = np.empty(points.shape)
    for k in range(len(points)):
        result[k, 0], result[k, 1] = velocity(table, points[k, 0], points[k, 1])
    return result
