"""Where a current carries what is adrift, and when that meets a shore, for compiled code.

Places are followed by the midpoint rule. Edges of the shore are listed by the cells of a raster, so
that a step is compared with those near it only.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import FloatArray, IntArray
from renew.kernels.current_table import CurrentTable, metre_at, velocity


class Shore(NamedTuple):
    """Edges (e, 2) of land by the cells of a raster with `columns` cells of a `size`, m, in a row.

    The raster begins at `west`, `south`, m. Cell k has the edges `edge[first[k]:first[k + 1]]`.
    """

    start: FloatArray
    end: FloatArray
    first: IntArray
    edge: IntArray
    west: float
    south: float
    size: float
    columns: int
    rows: int


@kernel
def shore_of(
    start: FloatArray, end: FloatArray, bounds: tuple[float, float, float, float], size: float
) -> Shore:
    """Return the edges (e, 2) of land inside bounds (xmin, ymin, xmax, ymax), in cells, m."""
    west, south, east, north = bounds
    columns = max(1, math.ceil((east - west) / size))
    rows = max(1, math.ceil((north - south) / size))
    count = np.zeros(rows * columns + 1, dtype=np.int64)
    edge = np.empty(0, dtype=np.int64)
    for fills in range(2):
        for h in range(len(start)):
            (ax, ay), (bx, by) = start[h], end[h]
            i, last_i, j, last_j = _cells(ax, ay, bx, by, west, south, size, columns, rows)
            for row in range(j, last_j + 1):
                for column in range(i, last_i + 1):
                    cell = row * columns + column
                    if fills:
                        edge[count[cell]] = h
                        count[cell] += 1
                    else:
                        count[cell + 1] += 1
        if not fills:
            count = np.cumsum(count)
            edge = np.empty(count[-1], dtype=np.int64)
    # Filling has moved each beginning to the next one.
    first = np.zeros_like(count)
    first[1:] = count[:-1]
    return Shore(start, end, first, edge, west, south, size, columns, rows)


@small_kernel
def _cells(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    west: float,
    south: float,
    size: float,
    columns: int,
    rows: int,
) -> tuple[int, int, int, int]:
    """Return first and last column and row of the cells around a line; none if it is outside."""
    i = max(math.floor((min(ax, bx) - west) / size), 0)
    j = max(math.floor((min(ay, by) - south) / size), 0)
    last_i = min(math.floor((max(ax, bx) - west) / size), columns - 1)
    last_j = min(math.floor((max(ay, by) - south) / size), rows - 1)
    return i, last_i, j, last_j


@reading_kernel
def _met(shore: Shore, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the share of a line from a to b at which it first meets the shore; inf if nowhere."""
    _, _, first, edge, west, south, size, columns, rows = shore
    i, last_i, j, last_j = _cells(ax, ay, bx, by, west, south, size, columns, rows)
    dx, dy, least = bx - ax, by - ay, np.inf
    for row in range(j, last_j + 1):
        for column in range(i, last_i + 1):
            cell = row * columns + column
            for k in range(first[cell], first[cell + 1]):
                h = edge[k]
                px, py = shore.start[h]
                ux, uy = shore.end[h, 0] - px, shore.end[h, 1] - py
                cross = dx * uy - dy * ux
                if cross == 0.0:
                    continue
                at = ((px - ax) * uy - (py - ay) * ux) / cross
                along = ((px - ax) * dy - (py - ay) * dx) / cross
                if 0.0 <= at <= 1.0 and 0.0 <= along <= 1.0:
                    least = min(least, at)
    return float(least)


@kernel
def drifted(
    points: FloatArray,
    times: FloatArray,
    table: CurrentTable,
    shore: Shore,
    step: float,
    horizon: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return seconds (n,) until places (n, 2) adrift from times (n,), s, meet the shore.

    It is inf where none is met within the `horizon`: some seconds, and the last time (s) at which
    the current is known; or before the raster's end. Also returns the last places (n, 2).
    """
    seconds, ends = np.full(len(points), np.inf), points.copy()
    east, north = shore.west + shore.columns * shore.size, shore.south + shore.rows * shore.size
    for n in range(len(points)):
        (x, y), since, longest = points[n], 0.0, min(horizon[0], horizon[1] - times[n])
        while since < longest and shore.west <= x <= east and shore.south <= y <= north:
            lasts, now = min(step, longest - since), times[n] + since
            # A metre of the plane is `metre` true ones.
            u, v = velocity(table, x, y, now)
            half = lasts / 2 / metre_at(table, x, y)
            half_x, half_y = x + half * u, y + half * v
            u, v = velocity(table, half_x, half_y, now + lasts / 2)
            whole = lasts / metre_at(table, half_x, half_y)
            after_x, after_y = x + whole * u, y + whole * v
            share = _met(shore, x, y, after_x, after_y)
            if share <= 1.0:
                seconds[n] = since + share * lasts
                x, y = x + share * (after_x - x), y + share * (after_y - y)
                break
            x, y, since = after_x, after_y, since + lasts
        ends[n, 0], ends[n, 1] = x, y
    return seconds, ends
