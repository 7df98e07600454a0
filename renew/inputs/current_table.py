"""A current as a table of nodes, bilinear between them: how compiled code looks it up.

The search for paths asks for the current millions of times; it reads a table, made once a plan.
What a plan reports is worked out in the field itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from renew._compiled import for_kernels, kernel
from renew._types import FloatArray

# Largest error of a table that counts as fine, as a share of its strongest current, in the middle
# of any cell. A path found with such a table needs more fuel than the least by a second-order term.
_TOLERANCE = 1e-3
# Number of cells a side of the first table, which are halved while it is not fine, and of the last
# one, of 16 MB.
_MIN_CELLS, _MAX_CELLS = 64, 1024
# Number of nodes a side above which a current has small eddies: about eight along the side.
_SMALL_EDDIES = 300
# Ratio of a table's error to that of the coarser one before, above which refining stops: in a
# smooth field it is a quarter, so a field in which it is more has a step.
_MAX_ERROR_RATIO = 0.5
# Largest difference between the steps of an even axis, as a share of its largest coordinate:
# rounding.
_EVEN = 1e-12


class Table(NamedTuple):
    """Ascending nodes x (nx,), y (ny,) in metres and velocities uv (ny, nx, 2) there in m/s.

    `error` (m/s) is the largest difference found between field and table. `per_x` and
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
    def has_small_eddies(self) -> bool:
        """Whether the current turns so often that it takes many nodes to reproduce it."""
        return max(len(self.x), len(self.y)) > _SMALL_EDDIES

    @property
    def is_fine(self) -> bool:
        """Whether the table reproduces the field to within _TOLERANCE."""
        return self.error <= _TOLERANCE * self.strongest


def table_of(x: FloatArray, y: FloatArray, uv: FloatArray, error: float = 0.0) -> Table:
    """Table of nodes and velocities; see :class:`Table`."""
    x, y, uv = (for_kernels(array) for array in (x, y, uv))
    return Table(x, y, uv, error, _per_metre(x), _per_metre(y))


def _per_metre(axis: FloatArray) -> float:
    """Cells per metre of an even axis (n,); 0 if it is uneven by more than rounding."""
    steps = np.diff(axis)
    even = np.ptp(steps) <= _EVEN * np.abs(axis).max()
    return float(len(steps) / (axis[-1] - axis[0])) if even else 0.0


STILL_WATER = table_of(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros((2, 2, 2)))
"""No current anywhere."""


def tabulated(
    field: Callable[[FloatArray], FloatArray], bounds: tuple[float, float, float, float]
) -> Table:
    """Table of a field inside (xmin, ymin, xmax, ymax), as fine as it needs to be."""
    xmin, ymin, xmax, ymax = bounds
    cells, last = _MIN_CELLS, np.inf
    uv = field(_mesh(np.linspace(xmin, xmax, cells + 1), np.linspace(ymin, ymax, cells + 1)))
    while True:
        # Every second node is one of this table, the others are its cells' and edges' middles.
        x, y = np.linspace(xmin, xmax, 2 * cells + 1), np.linspace(ymin, ymax, 2 * cells + 1)
        middles = field(_mesh(x[1::2], y[1::2]))
        halfway = (uv[1:, 1:] + uv[1:, :-1] + uv[:-1, 1:] + uv[:-1, :-1]) / 4
        error = float(np.linalg.norm(middles - halfway, axis=-1).max())
        table = table_of(x[::2], y[::2], uv, error)
        if table.is_fine or cells >= _MAX_CELLS or error > _MAX_ERROR_RATIO * last:
            return table
        level, upright = _mesh(x[1::2], y[::2]), _mesh(x[::2], y[1::2])
        on_edges = field(np.vstack([level.reshape(-1, 2), upright.reshape(-1, 2)]))
        finer = np.empty((2 * cells + 1, 2 * cells + 1, 2))
        finer[::2, ::2], finer[1::2, 1::2] = uv, middles
        finer[::2, 1::2] = on_edges[: level.size // 2].reshape(level.shape)
        finer[1::2, ::2] = on_edges[level.size // 2 :].reshape(upright.shape)
        uv, cells, last = finer, 2 * cells, error


def _mesh(x: FloatArray, y: FloatArray) -> FloatArray:
    """Points (ny, nx, 2) of a grid."""
    return np.stack(np.meshgrid(x, y), axis=-1)


@kernel
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


@kernel
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


@kernel
def velocities(table: Table, points: FloatArray) -> FloatArray:
    """Velocities (n, 2) at points (n, 2)."""
    result = np.empty(points.shape)
    for k in range(len(points)):
        result[k, 0], result[k, 1] = velocity(table, points[k, 0], points[k, 1])
    return result
