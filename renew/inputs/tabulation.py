"""Tables of currents, as fine as the current needs them to be."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from renew._types import FloatArray
from renew.kernels.current_table import Table, table_of

# Number of cells a side of the first table, which are halved while it is not fine, and of the last
# one, of 16 MB.
_MIN_CELLS, _MAX_CELLS = 64, 1024
# Ratio of a table's error to that of the coarser one before, above which refining stops: in a
# smooth field it is a quarter, so a field in which it is more has a step.
_MAX_ERROR_RATIO = 0.5
# Largest number of nodes of all slices together: 128 MB.
_MAX_NODES = 8_000_000
# Number of slices of a changing current at which a table is made, to find how fine it must be.
_PROBES = 5


def tabulated(
    field: Callable[[FloatArray], FloatArray], bounds: tuple[float, float, float, float]
) -> Table:
    """Table of a steady field inside (xmin, ymin, xmax, ymax), as fine as it needs to be."""
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


def tabulated_in_time(
    field: Callable[[FloatArray, float], FloatArray],
    times: FloatArray,
    bounds: tuple[float, float, float, float],
    period: float = math.inf,
) -> Table:
    """Table of a changing field, with a slice for each of some times (nt,), s.

    It is as fine as the finest of a few of its slices needs to be, if memory allows that.
    """
    probes = np.unique(np.linspace(0, len(times) - 1, _PROBES).astype(int))
    made = [tabulated(partial(_at, field, float(times[k])), bounds) for k in probes]
    cells = max(len(table.x) for table in made) - 1
    error = max(table.error for table in made)
    while (cells + 1) ** 2 * len(times) > _MAX_NODES and cells > _MIN_CELLS:
        cells //= 2
        error *= 4
    xmin, ymin, xmax, ymax = bounds
    x, y = np.linspace(xmin, xmax, cells + 1), np.linspace(ymin, ymax, cells + 1)
    nodes = _mesh(x, y)
    uv = np.stack([field(nodes, float(time)) for time in times])
    return table_of(x, y, uv, error, times, period)


def _at(
    field: Callable[[FloatArray, float], FloatArray], time: float, points: FloatArray
) -> FloatArray:
    """Velocities (..., 2) of a changing field at one time."""
    return field(points, time)


def _mesh(x: FloatArray, y: FloatArray) -> FloatArray:
    """Points (ny, nx, 2) of a grid."""
    return np.stack(np.meshgrid(x, y), axis=-1)
