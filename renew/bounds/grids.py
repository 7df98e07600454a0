"""Grids on which a voyage is bounded: their cells, currents and hours, coarse and then finer.

A grid in the opposite current with the clock running backwards has the same routes, sailed from
goal to start: a vessel at rest in it drifts back along the way it came.
"""

import itertools
import math
from dataclasses import replace

import numpy as np

from renew._compiled import for_kernels
from renew._types import BoolArray, FloatArray
from renew.bounds.interpolation_error import deviation_radius
from renew.bounds.travel_time import TravelGrid
from renew.bounds.wet_cells import wet_cells
from renew.inputs.current import CurrentField
from renew.inputs.varying_current import VaryingCurrent
from renew.kernels.current_table import CurrentTable, table_of
from renew.voyage.voyage import Voyage, Waters

ROUNDING = 1e-6
"""Share by which a bound is lowered for rounding, and for routes that graze a shore by that."""

# Least number of cells along the shorter side, and largest along the longer.
_MIN_CELLS, _MAX_CELLS = 4, 50_000
# Least distance, as a share of a cell, of the grid lines through start and goal from each other and
# from the extent's sides.
_NARROWEST = 0.2
# Number of cells around those that count over which a finer grid still finds its travel times: the
# way of a front that leaves them for a while.
_AROUND = 2


def whole_grid(voyage: Voyage, cells: int) -> TravelGrid:
    """Grid of about so many cells over the extent's bounding box, with nodes at start and goal."""
    chart = voyage.chart
    xmin, ymin, xmax, ymax = chart.bounds
    wide, high = xmax - xmin, ymax - ymin
    step = min(math.sqrt(wide * high / cells), wide / _MIN_CELLS, high / _MIN_CELLS)
    (start_x, start_y), (goal_x, goal_y) = voyage.start.tolist(), voyage.goal.tolist()
    x = _axis(xmin, xmax, (start_x, goal_x), max(step, wide / _MAX_CELLS))
    y = _axis(ymin, ymax, (start_y, goal_y), max(step, high / _MAX_CELLS))
    return _over(voyage, x, y, wet_cells(chart, x, y))


def halved(voyage: Voyage, grid: TravelGrid, counts: BoolArray) -> tuple[TravelGrid, BoolArray]:
    """Grid of half the step around the cells that count, and which of its own cells count."""
    wet = grid.wet & widened(counts, _AROUND)
    rows, columns = np.flatnonzero(wet.any(axis=1)), np.flatnonzero(wet.any(axis=0))
    tall, wide = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    x = _with_middles(grid.x[columns[0] : columns[-1] + 2])
    y = _with_middles(grid.y[rows[0] : rows[-1] + 2])
    wet, counts = (cells[tall, wide].repeat(2, axis=0).repeat(2, axis=1) for cells in (wet, counts))
    wet = wet_cells(voyage.chart, x, y, wet)
    return _over(voyage, x, y, wet), counts & wet


def in_hours(voyage: Voyage, duration: float) -> Voyage:
    """A voyage in the slices of its current from the departure until so much later (s).

    A route that takes no longer meets no others.
    """
    current = voyage.current
    if not isinstance(current, VaryingCurrent):
        return voyage
    times = current.slice_times
    end = voyage.departure + duration
    # One more on either side tells how the current bends in time.
    first = max(int(np.searchsorted(times, voyage.departure, side="right")) - 2, 0)
    last = min(int(np.searchsorted(times, end)) + 2, len(times))
    first = min(first, last - 2)
    then = VaryingCurrent(times[first:last], current.slices[first:last] or current.velocity)
    return replace(voyage, waters=Waters(voyage.chart, then))


def turned_round(grid: TravelGrid, arrival: float) -> TravelGrid:
    """The grid in the opposite current, with a clock that runs backwards from an arrival (s)."""
    table = grid.current
    backwards = table._replace(
        uv=for_kernels(-table.uv[::-1]), times=for_kernels(-table.times[::-1])
    )
    return grid._replace(
        current=backwards, departure=-arrival, hours=for_kernels(-grid.hours[::-1])
    )


def widened(cells: BoolArray, by: int) -> BoolArray:
    """Cells within so many rows and columns of some cells."""
    wide = cells.copy()
    for _ in range(by):
        wide[1:] |= wide[:-1].copy()
        wide[:-1] |= wide[1:].copy()
        wide[:, 1:] |= wide[:, :-1].copy()
        wide[:, :-1] |= wide[:, 1:].copy()
    return wide


def _over(voyage: Voyage, x: FloatArray, y: FloatArray, wet: BoolArray) -> TravelGrid:
    """Grid of nodes x (nx,), y (ny,) whose wet cells (ny - 1, nx - 1) are crossed."""
    current = sampled(voyage.current, x, y, _corners(wet))
    deviation = deviation_radius(voyage.current, x, y, current.uv)
    strongest = current.strongest + float(deviation.max(initial=0.0))
    hours = _hours(voyage, x, y, strongest) if voyage.has_price else np.empty((2, 0, 0))
    return TravelGrid(x, y, current, voyage.departure, deviation, wet, voyage.polar, hours)


def _hours(voyage: Voyage, x: FloatArray, y: FloatArray, strongest: float) -> FloatArray:
    """Hours (2, ny - 1, nx - 1), s, from and until which a vessel in time may be in each cell.

    It goes no faster than at its highest speed with the strongest current (m/s) behind. Where the
    end comes before the beginning no way leads there.
    """
    west, south = np.meshgrid(x[:-1], y[:-1])
    east, north = np.meshgrid(x[1:], y[1:])
    fastest = voyage.vessel.speed + strongest
    away = []
    for px, py in (voyage.start, voyage.goal):
        across = np.maximum(np.maximum(west - px, px - east), 0.0)
        up = np.maximum(np.maximum(south - py, py - north), 0.0)
        away.append(np.hypot(across, up) / (fastest * (1 + ROUNDING)))
    begin = voyage.departure + away[0]
    # A current that repeats itself has nothing new after a period.
    end = np.minimum(voyage.deadline - away[1], begin + voyage.current.period)
    return np.stack([begin, end])


def _corners(cells: BoolArray) -> BoolArray:
    """Nodes (ny, nx) of some cells (ny - 1, nx - 1), and those beside them."""
    nodes = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1), dtype=bool)
    nodes[:-1, :-1] = cells
    nodes[1:, :-1] |= cells
    nodes[:, 1:] |= nodes[:, :-1].copy()
    return widened(nodes, 1)


def sampled(current: CurrentField, x: FloatArray, y: FloatArray, wanted: BoolArray) -> CurrentTable:
    """A current at nodes x (nx,), y (ny,), in slices; zero at nodes that aren't wanted."""
    nodes, times = np.stack(np.meshgrid(x, y), axis=-1), current.slice_times
    velocity = np.zeros((len(times), *nodes.shape))
    for at, time in enumerate(times.tolist()):
        velocity[at, wanted] = current.velocity(nodes[wanted], time)
    return table_of(x, y, velocity, times=times, period=current.period)


def _with_middles(axis: FloatArray) -> FloatArray:
    """Nodes of an axis, and the middles between them."""
    fine = np.empty(2 * len(axis) - 1)
    fine[::2], fine[1::2] = axis, (axis[:-1] + axis[1:]) / 2
    return fine


def _axis(low: float, high: float, through: tuple[float, float], step: float) -> FloatArray:
    """Ascending nodes from low to high, about a step apart, some at the places well inside."""
    stops = [low]
    for place in sorted(through):
        if min(place - stops[-1], high - place) > _NARROWEST * step:
            stops.append(place)
    pieces = [
        np.linspace(a, b, max(1, round((b - a) / step)) + 1)[:-1]
        for a, b in itertools.pairwise([*stops, high])
    ]
    return np.concatenate([*pieces, [high]])
