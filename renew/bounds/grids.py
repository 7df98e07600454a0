"""Grids for the lower bound on a voyage's fuel, refined in steps: their water, currents and hours.

The lower bound on fuel (:mod:`renew.bounds.fuel_lower_bound`) knows a current at the grid's nodes
and takes it as linear between them; the error of that is bounded here, by kind of field.
`UniformCurrent`, `GyreCurrent` and `GriddedCurrent` have closed forms, whose proofs stand with
them: second derivatives of the gyre's sines, slopes of the bilinear cells. Any other field is known
by its values alone, and gets an estimate.

A grid in the opposite current with the clock running backwards has the same routes, sailed from
goal to start: a vessel at rest in it drifts back along the way it came.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import shapely

from renew._compiled import for_kernels, kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.bounds.travel_time import TravelGrid
from renew.inputs.chart_and_vessel import Chart
from renew.inputs.current import (
    CurrentField,
    GriddedCurrent,
    GyreCurrent,
    UniformCurrent,
    VaryingCurrent,
)
from renew.kernels.current_table import CurrentTable, table_of
from renew.voyage.voyage import Voyage, Waters


def wet_cells(
    chart: Chart, x: FloatArray, y: FloatArray, among: BoolArray | None = None
) -> BoolArray:
    """Cells (ny - 1, nx - 1), of `among` if given, with water; slivers along sides don't count."""
    from scipy.ndimage import label

    near_shore = _near_lines(chart.open_water.boundary, x, y)
    # A region of cells without a shore is all water or all land: one point decides.
    regions, count = label(~near_shore)
    one_of = np.zeros(count + 1, dtype=np.int64)
    one_of[regions.ravel()] = np.arange(regions.size)
    row, column = np.divmod(one_of, regions.shape[1])
    middle_x, middle_y = (x[column] + x[column + 1]) / 2, (y[row] + y[row + 1]) / 2
    wet = shapely.contains_xy(chart.open_water, middle_x, middle_y)[regions]
    if among is not None:
        wet &= among
        near_shore &= among
    # Cells are shrunk, so that a shore along a grid line does not make the cells on its land side
    # wet.
    shrink = 10 * chart.precision
    row, column = np.nonzero(near_shore)
    cells = shapely.box(
        x[column] + shrink, y[row] + shrink, x[column + 1] - shrink, y[row + 1] - shrink
    )
    water = shapely.get_parts(chart.open_water)
    holds_water = np.zeros(len(cells), dtype=bool)
    holds_water[shapely.STRtree(cells).query(water, predicate="intersects")[1]] = True
    wet[near_shore] = holds_water
    return np.asarray(wet)


def _near_lines(lines: shapely.Geometry, x: FloatArray, y: FloatArray) -> BoolArray:
    """Which cells (ny - 1, nx - 1) touch the bounding box of a segment of the lines."""
    points, line = shapely.get_coordinates(shapely.get_parts(lines), return_index=True)
    joined = line[:-1] == line[1:]
    low, high = (
        np.minimum(points[:-1], points[1:])[joined],
        np.maximum(points[:-1], points[1:])[joined],
    )
    # A box that ends on a line of the grid touches the cells on both sides of it.
    count = np.zeros((len(y) + 1, len(x) + 1), dtype=np.int64)
    left, right = np.searchsorted(x, low[:, 0]) - 1, np.searchsorted(x, high[:, 0], "right")
    below, above = np.searchsorted(y, low[:, 1]) - 1, np.searchsorted(y, high[:, 1], "right")
    left, below = np.maximum(left, 0), np.maximum(below, 0)
    for rows, columns, step in (
        (below, left, 1),
        (below, right, -1),
        (above, left, -1),
        (above, right, 1),
    ):
        np.add.at(count, (rows, columns), step)
    return np.asarray(count.cumsum(axis=0).cumsum(axis=1)[:-2, :-2] > 0)


def deviation_radius(
    current: CurrentField,
    x: FloatArray,
    y: FloatArray,
    velocity: FloatArray,
    cells: BoolArray | None = None,
) -> FloatArray:
    """Radius r (ny - 1, nx - 1) >= |c - linear interpolant of c| in each cell's triangles, m/s.

    `x` (nx,) and `y` (ny,) are the nodes, m, and `velocity` (nt, ny, nx, 2) is c there in each
    slice; a cell may be cut along either diagonal. The interpolant is linear between slices. If
    `cells` are given, only their radii are computed.

    Gyre: |d²c/de²| <= A (a² + b²) for every unit e, with a, b the wave numbers along x and y; and
    linear interpolation in a triangle errs by at most that times half the square of the radius
    of the circle around it.
    """
    wide, high = np.diff(x)[None, :], np.diff(y)[:, None]
    if isinstance(current, UniformCurrent):
        return np.zeros((y.size - 1, x.size - 1))
    if isinstance(current, GyreCurrent):
        waves = (current.columns / current.width) ** 2 + (current.rows / current.height) ** 2
        return abs(current.amplitude) * np.pi**2 * waves * (wide**2 + high**2) / 8
    if isinstance(current, GriddedCurrent):
        along_x = _slope_spread(current.x, current.y, current.uv, x, y)
        along_y = _slope_spread(current.y, current.x, current.uv.swapaxes(0, 1), y, x).T
        return np.asarray((along_x * wide + along_y * high) / 2)
    if isinstance(current, VaryingCurrent) and current.slices:
        every = zip(current.slices, velocity, strict=True)
        radii = [deviation_radius(one, x, y, at[None]) for one, at in every]
        return np.asarray(np.max(radii, axis=0))
    every_cell = np.ones((y.size - 1, x.size - 1), dtype=bool)
    cells = every_cell if cells is None else cells
    return _sampled_deviation(x, y, for_kernels(current.slice_times), velocity, cells)


def _slope_spread(
    grid_x: FloatArray, grid_y: FloatArray, uv: FloatArray, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Radius of a ball that holds every ∂c/∂x of a bilinear field in each cell, 1/s.

    With such radii ρ of ∂c/∂x and σ of ∂c/∂y, linear interpolation in a triangle w wide and h
    high errs by at most (ρ w + σ h)/2: the error is Σ λᵢ ∫ (∇c - q)·(xᵢ - x) over the segments
    from x to the corners xᵢ, for any constant q, and Σ λᵢ |xᵢ - x| <= w/2 along x.
    """
    slope = np.diff(uv, axis=1) / np.diff(grid_x)[None, :, None]
    still = np.zeros((grid_y.size, 1, 2))
    slope = np.concatenate([still, slope, still], axis=1)  # the field is constant outside
    first = np.searchsorted(grid_x, x[:-1], side="right")
    last = np.searchsorted(grid_x, x[1:], side="left")
    low = _least_of_columns(slope, first, last)
    high = -_least_of_columns(-slope, first, last)
    # Along y each ∂c/∂x is linear between the grid's rows: extremes are at rows or cell sides.
    place = np.interp(y, grid_y, np.arange(grid_y.size))
    spread = -_least_of_rows(-high, place) - _least_of_rows(low, place)
    return np.asarray(np.hypot(spread[..., 0], spread[..., 1]) / 2)


def _least_of_columns(values: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """Return least values (n, c, 2) of (n, m, 2) over columns `first` (c,) to `last` (c,)."""
    least = values[:, first]
    for further in range(1, int((last - first).max(initial=0)) + 1):
        least = np.minimum(least, values[:, np.maximum(first, np.minimum(first + further, last))])
    return least


def _least_of_rows(values: FloatArray, place: FloatArray) -> FloatArray:
    """Least of values (n, c, 2), linear between rows, from place to place (r,): (r - 1, c, 2)."""
    floor = np.minimum(place.astype(int), len(values) - 2)
    part = (place - floor)[:, None, None]
    ends = (1 - part) * values[floor] + part * values[floor + 1]
    least = np.minimum(ends[:-1], ends[1:])
    # The rows that lie between two places.
    between = np.searchsorted(place, np.arange(len(values)), side="right") - 1
    for row, at in enumerate(between.tolist()):
        if 0 <= at < len(least):
            np.minimum(least[at], values[row], out=least[at])
    return np.asarray(least)


@kernel
def _sampled_deviation(
    x: FloatArray, y: FloatArray, times: FloatArray, velocity: FloatArray, cells: BoolArray
) -> FloatArray:
    """Four times the interpolation error (m/s) that second differences of the nodes suggest.

    They are taken along x, along y, across cells, and between slices.
    """
    rows, columns = cells.shape
    bends, in_time = np.zeros((rows + 1, columns + 1)), np.zeros((rows + 1, columns + 1))
    wanted, radius = np.zeros(bends.shape, dtype=np.bool_), np.zeros(cells.shape)
    wanted[:-1, :-1], wanted[1:, 1:] = cells, cells
    wanted[1:, :-1] |= cells
    wanted[:-1, 1:] |= cells
    c = velocity
    for at in range(len(times)):
        for i in range(rows + 1):
            for j in range(columns + 1):
                if not wanted[i, j]:
                    continue
                bends[i, j] = _bend_at(c, at, i, j, x, y)
                if 0 < at < len(times) - 1:
                    in_time[i, j] = max(in_time[i, j], _bend_in_time(c, at, i, j, times))
        for i in range(rows):
            for j in range(columns):
                if cells[i, j]:
                    u = c[at, i + 1, j + 1, 0] - c[at, i + 1, j, 0]
                    v = c[at, i + 1, j + 1, 1] - c[at, i + 1, j, 1]
                    u -= c[at, i, j + 1, 0] - c[at, i, j, 0]
                    v -= c[at, i, j + 1, 1] - c[at, i, j, 1]
                    off = _largest(bends, i, j) + math.sqrt(u * u + v * v)
                    radius[i, j] = max(radius[i, j], off)
    south, north = in_time[:-1], in_time[1:]
    corners = np.maximum(np.maximum(south[:, :-1], south[:, 1:]), north[:, :-1])
    return radius + np.maximum(corners, north[:, 1:])


@small_kernel
def _bend_at(c: FloatArray, at: int, i: int, j: int, x: FloatArray, y: FloatArray) -> float:
    """How far the velocity at a node is off the lines through its neighbours along x and along y.

    On the grid's edge, where a neighbour is missing, the figure of the next inner node is taken.
    """
    m, n = min(max(i, 1), y.size - 2), min(max(j, 1), x.size - 2)
    bend = 0.0
    if x.size > 2:
        bend += _off_line(c[at, i, n - 1], c[at, i, n], c[at, i, n + 1], x[n - 1 : n + 2])
    if y.size > 2:
        bend += _off_line(c[at, m - 1, j], c[at, m, j], c[at, m + 1, j], y[m - 1 : m + 2])
    return bend


@small_kernel
def _bend_in_time(c: FloatArray, at: int, i: int, j: int, times: FloatArray) -> float:
    """How far a node's velocity is off the line through those one slice before and after."""
    return _off_line(c[at - 1, i, j], c[at, i, j], c[at + 1, i, j], times[at - 1 : at + 2])


@small_kernel
def _largest(nodes: FloatArray, i: int, j: int) -> float:
    """Largest figure at the corners of a cell."""
    return float(max(nodes[i, j], nodes[i, j + 1], nodes[i + 1, j], nodes[i + 1, j + 1]))


@small_kernel
def _off_line(
    before: FloatArray, velocity: FloatArray, after: FloatArray, along: FloatArray
) -> float:
    """Return how far a velocity (2,) is off the line through two others, before and after it.

    `along` (3,) are the coordinates of the three.
    """
    part = (along[1] - along[0]) / (along[2] - along[0])
    u = velocity[0] - (1 - part) * before[0] - part * after[0]
    v = velocity[1] - (1 - part) * before[1] - part * after[1]
    return math.sqrt(u * u + v * v)


ROUNDING = 1e-6
"""Share by which a bound is lowered, for rounding and for routes that touch a shore by rounding."""

# Least number of cells along the shorter side.
_MIN_CELLS = 4
# Largest number of cells along the longer side.
_MAX_CELLS = 50_000
# Least distance, as a share of a cell, of the grid lines through start and goal from each other and
# from the extent's sides.
_NARROWEST = 0.2
# Share by which a plane's metres may be less within a cell than at its corners: those of a plane of
# the whole earth are by 1e-6 in a cell of one 256th of it, and by 2e-5 in the largest cells here.
_WITHIN = 2e-5
# Travel times on a finer grid are also computed on this number of cells around those that count,
# because a front may leave them for a while.
_AROUND = 2


def whole_grid(voyage: Voyage, cells: int) -> TravelGrid:
    """Return a grid of about `cells` cells over the extent, with nodes at start and goal."""
    chart = voyage.chart
    xmin, ymin, xmax, ymax = chart.bounds
    wide, high = xmax - xmin, ymax - ymin
    step = min(math.sqrt(wide * high / cells), wide / _MIN_CELLS, high / _MIN_CELLS)
    (start_x, start_y), (goal_x, goal_y) = voyage.start.tolist(), voyage.goal.tolist()
    x = _axis(xmin, xmax, (start_x, goal_x), max(step, wide / _MAX_CELLS))
    y = _axis(ymin, ymax, (start_y, goal_y), max(step, high / _MAX_CELLS))
    return _over(voyage, x, y, wet_cells(chart, x, y))


def halved(voyage: Voyage, grid: TravelGrid, counts: BoolArray) -> tuple[TravelGrid, BoolArray]:
    """Return a grid of half the step around the cells that count, and which of its cells count."""
    wet = grid.wet & widened(counts, _AROUND)
    rows, columns = np.flatnonzero(wet.any(axis=1)), np.flatnonzero(wet.any(axis=0))
    tall, wide = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    x = _with_middles(grid.x[columns[0] : columns[-1] + 2])
    y = _with_middles(grid.y[rows[0] : rows[-1] + 2])
    wet, counts = (cells[tall, wide].repeat(2, axis=0).repeat(2, axis=1) for cells in (wet, counts))
    wet = wet_cells(voyage.chart, x, y, wet)
    return _over(voyage, x, y, wet), counts & wet


def in_hours(voyage: Voyage, duration: float) -> Voyage:
    """Return the voyage with the slices of its current from departure to `duration` (s) later.

    A route that takes no longer than that meets no other slices.
    """
    current = voyage.current
    if not isinstance(current, VaryingCurrent):
        return voyage
    times = current.slice_times
    end = voyage.departure + duration
    # One more slice on either side shows how the current's change varies in time.
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
    """Return the cells within `by` rows and columns of some cells."""
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
    deviation = deviation_radius(voyage.current, x, y, current.uv, wet)
    strongest = current.strongest + float(deviation.max(initial=0.0))
    hours = _hours(voyage, x, y, strongest) if voyage.has_price else np.empty((2, 0, 0))
    metres = _least_metres(voyage.chart, x, y)
    return TravelGrid(x, y, current, voyage.departure, deviation, wet, voyage.polar, metres, hours)


def _least_metres(chart: Chart, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return at most the true metres per metre of the plane in cells (ny - 1, nx - 1)."""
    if len(chart.metres) == 1:
        return np.ones((len(y) - 1, len(x) - 1))
    nodes = chart.true_metres(np.stack(np.meshgrid(x, y), axis=-1))
    least = np.minimum(nodes[:-1], nodes[1:])
    return for_kernels(np.minimum(least[:, :-1], least[:, 1:]) * (1 - _WITHIN))


def _hours(voyage: Voyage, x: FloatArray, y: FloatArray, strongest: float) -> FloatArray:
    """Times (2, ny - 1, nx - 1), s, between which a vessel that is in time may be in each cell.

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
        apart = np.hypot(across, up) * voyage.chart.metres.min()
        away.append(apart / (fastest * (1 + ROUNDING)))
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
    """Ascending nodes from low to high, about a step apart, and at `through` if well inside."""
    stops = [low]
    for place in sorted(through):
        if min(place - stops[-1], high - place) > _NARROWEST * step:
            stops.append(place)
    pieces = [
        np.linspace(a, b, max(1, round((b - a) / step)) + 1)[:-1]
        for a, b in itertools.pairwise([*stops, high])
    ]
    return np.concatenate([*pieces, [high]])
