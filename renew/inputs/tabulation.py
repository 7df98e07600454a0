"""Tables of currents, as fine as the current needs them to be."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from renew._compiled import for_kernels, kernel, small_kernel
from renew._types import FloatArray
from renew.kernels.current_table import CurrentTable, largest_speed, table_of, velocities

# Number of cells along each side of the first table.
_MIN_CELLS = 64
# Cells are halved until the table is fine, or has this number of cells along each side: 16 MB.
_MAX_CELLS = 1024
# Refining stops if the error falls by less than this ratio when cells are halved. The ratio is 1/4
# in a smooth field, and larger in a field with a step.
_MAX_ERROR_RATIO = 0.5
# Largest number of nodes of all slices together: 128 MB.
_MAX_NODES = 8_000_000
# Number of slices of a changing current at which a table is made, to find how fine it must be.
_PROBES = 5
# Between nodes, cubics through the nodes stand for the field if they differ from it by at most this
# share of the strongest current. The error of a fine table may be ten times as large.
_CUBIC_TOLERANCE = 1e-4
# Number of random points at which the cubics are checked: about twice as many as the first table
# has nodes.
_RANDOM_POINTS = 16_384
# The cubics are rejected if their error at these points exceeds the table's by this factor.
_MAX_EXCESS = 1.5


def tabulated(
    field: Callable[[FloatArray], FloatArray], bounds: tuple[float, float, float, float]
) -> CurrentTable:
    """Table of a steady field inside (xmin, ymin, xmax, ymax), as fine as the field needs."""
    return _made(field, bounds)[0]


def _made(
    field: Callable[[FloatArray], FloatArray],
    bounds: tuple[float, float, float, float],
    *,
    trust_cubics: bool = True,
) -> tuple[CurrentTable, int]:
    """Return a table, and the cells per side at whose nodes it holds the field, not the cubics.

    Cubics are trusted once they meet the field in the middles of all cells.
    """
    cells, last, cells_asked = _MIN_CELLS, math.inf, 0
    x, y = _axes(bounds, cells)
    uv = for_kernels(field(_mesh(x, y)))
    while True:
        # Every second node is a node of this table; the others are middles of its cells and edges.
        finer_x, finer_y = _axes(bounds, 2 * cells)
        middles = _middles(uv)
        if not cells_asked:
            by_cubics, middles = middles, field(_mesh(finer_x[1::2], finer_y[1::2]))
            astray = largest_speed(middles - by_cubics)
            if trust_cubics and astray <= _CUBIC_TOLERANCE * largest_speed(uv):
                cells_asked = cells
        halfway = (uv[1:, 1:] + uv[1:, :-1] + uv[:-1, 1:] + uv[:-1, :-1]) / 4
        error = largest_speed(middles - halfway)
        table = table_of(x, y, uv, error)
        if table.is_fine or cells >= _MAX_CELLS or error > _MAX_ERROR_RATIO * last:
            break
        if cells_asked:
            uv = halved(uv)
        else:
            level, upright = _mesh(finer_x[1::2], y), _mesh(x, finer_y[1::2])
            on_edges = field(np.vstack([level.reshape(-1, 2), upright.reshape(-1, 2)]))
            finer = np.empty((2 * cells + 1, 2 * cells + 1, 2))
            finer[::2, ::2], finer[1::2, 1::2] = uv, middles
            finer[::2, 1::2] = on_edges[: level.size // 2].reshape(level.shape)
            finer[1::2, ::2] = on_edges[level.size // 2 :].reshape(upright.shape)
            uv = finer
        x, y, cells, last = finer_x, finer_y, 2 * cells, error
    if not 0 < cells_asked < cells:
        return table, cells
    error = max(table.error, _error_at_random(field, table))
    if error > _MAX_EXCESS * table.error:
        return _made(field, bounds, trust_cubics=False)
    return table._replace(error=error), cells_asked


def tabulated_in_time(
    field: Callable[[FloatArray, float], FloatArray],
    times: FloatArray,
    bounds: tuple[float, float, float, float],
    period: float = math.inf,
) -> CurrentTable:
    """Table of a changing field, with a slice for each of some times (nt,), s.

    It is as fine as the most demanding of a few slices needs, if memory allows that.
    """
    probes = np.unique(np.linspace(0, len(times) - 1, _PROBES).astype(int))
    made = [_made(partial(_at, field, float(times[k])), bounds) for k in probes]
    cells = max(len(table.x) for table, _ in made) - 1
    error = max(table.error for table, _ in made)
    asked = max(cells_asked for _, cells_asked in made)
    while (cells + 1) ** 2 * len(times) > _MAX_NODES and cells > _MIN_CELLS:
        cells //= 2
        error *= 4
    asked = min(asked, cells)
    x, y = _axes(bounds, cells)
    nodes = _mesh(*_axes(bounds, asked))
    uv = np.empty((len(times), cells + 1, cells + 1, 2))
    for k, time in enumerate(times):
        velocity = for_kernels(field(nodes, float(time)))
        while len(velocity) <= cells:
            velocity = halved(velocity)
        uv[k] = velocity
    return table_of(x, y, uv, error, times, period)


def _at(
    field: Callable[[FloatArray, float], FloatArray], time: float, points: FloatArray
) -> FloatArray:
    """Velocities (..., 2) of a changing field at one time."""
    return field(points, time)


def _axes(bounds: tuple[float, float, float, float], cells: int) -> tuple[FloatArray, FloatArray]:
    """Coordinates along x and y (cells + 1,) of a grid's nodes."""
    xmin, ymin, xmax, ymax = bounds
    return np.linspace(xmin, xmax, cells + 1), np.linspace(ymin, ymax, cells + 1)


def _mesh(x: FloatArray, y: FloatArray) -> FloatArray:
    """Points (ny, nx, 2) of a grid."""
    return np.stack(np.meshgrid(x, y), axis=-1)


def _error_at_random(field: Callable[[FloatArray], FloatArray], table: CurrentTable) -> float:
    """Largest difference (m/s) between a field and its table at some points at random."""
    low, high = (table.x[0], table.y[0]), (table.x[-1], table.y[-1])
    points = np.random.default_rng(0).uniform(low, high, (_RANDOM_POINTS, 2))
    return largest_speed(field(points) - velocities(table, points, np.zeros(_RANDOM_POINTS)))


@kernel
def halved(uv: FloatArray) -> FloatArray:
    """Velocities (2n - 1, 2m - 1, 2) at twice as many nodes, from (n, m, 2) at nodes; n, m >= 4.

    New nodes lie on the cubics through the nearest four.
    """
    rows, columns = uv.shape[:2]
    finer = np.empty((2 * rows - 1, 2 * columns - 1, 2))
    finer[::2, ::2] = uv
    for row in range(0, 2 * rows - 1, 2):
        for k in range(columns - 1):
            for d in range(2):
                finer[row, 2 * k + 1, d] = _halfway(finer[row, ::2, d], k)
    for k in range(rows - 1):
        for column in range(2 * columns - 1):
            for d in range(2):
                finer[2 * k + 1, column, d] = _halfway(finer[::2, column, d], k)
    return finer


@kernel
def _middles(uv: FloatArray) -> FloatArray:
    """Velocities (n - 1, m - 1, 2) in the middles of the cells, by these cubics."""
    rows, columns = uv.shape[:2]
    between, middles = np.empty((rows, columns - 1, 2)), np.empty((rows - 1, columns - 1, 2))
    for row in range(rows):
        for k in range(columns - 1):
            for d in range(2):
                between[row, k, d] = _halfway(uv[row, :, d], k)
    for k in range(rows - 1):
        for column in range(columns - 1):
            for d in range(2):
                middles[k, column, d] = _halfway(between[:, column, d], k)
    return middles


@small_kernel
def _halfway(line: FloatArray, k: int) -> float:
    """Value between the k-th of some even points (n,) and the next."""
    last = len(line) - 2
    if k == 0:
        return float(5 * line[0] + 15 * line[1] - 5 * line[2] + line[3]) / 16
    if k == last:
        return float(5 * line[k + 1] + 15 * line[k] - 5 * line[k - 1] + line[k - 2]) / 16
    return float(9 * (line[k] + line[k + 1]) - line[k - 1] - line[k + 2]) / 16
