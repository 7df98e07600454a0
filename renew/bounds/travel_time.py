"""Travel times from a point to the nodes of a grid in a current: the value function u.

u, the least time from the start, is taken as linear on the grid's triangles: a node is reached from
the best place on a segment between two others of its triangle (Tsitsiklis, 1995), in the mean
current on the way, at the time when the first of the two is reached. Nodes are settled in
Dijkstra's order, and settled again where a later node improves them, as it may in a current. Only
the cells that hold water are crossed.

u is an approximation: :mod:`renew.bounds.fuel_lower_bound` derives a proven bound from it, and has
it solved again with the slowness of some cells lowered.
"""

import heapq
import itertools
import math
from typing import Literal, NamedTuple

import numpy as np

from renew._compiled import kernel, small_kernel
from renew._types import BoolArray, FloatArray
from renew.kernels.current_table import CurrentTable, node_velocity
from renew.kernels.ground_speed import Polar, ground_speed

TOLERANCE = 1e-4
"""Least correction of a time, as a share of the cost of the step to it; others are skipped."""

BEYOND = 1.02
"""Multiple of the goal's time beyond which no times are computed."""

# Lowest ground speed of the travel times, as a share of v: keeps them finite upstream of currents
# as strong as the vessel. No part of the proof.
_MIN_SPEED = 0.05
# Arguments of `searchsorted`: the results differ only for a place that lies on a node.
_SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")
# Neighbours of a node, as rows and columns from it, in order around it.
_RING = np.array([[0, 1], [1, 1], [1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1]])


class TravelGrid(NamedTuple):
    """Nodes, row by row from the south-west, and the cells between them; m and m/s.

    Cell (row, column) has the nodes (row, column) to (row + 1, column + 1).
    """

    x: FloatArray  # (nx,)
    y: FloatArray  # (ny,)
    current: CurrentTable  # slices of the nodes' velocities
    departure: float  # s, on the table's clock: travel times count from it
    deviation: FloatArray  # (ny - 1, nx - 1): r
    wet: BoolArray  # (ny - 1, nx - 1): whether a route may touch the cell
    polar: Polar
    metres: FloatArray  # (ny - 1, nx - 1): least true metres per metre of the plane in the cell
    # (2, ny - 1, nx - 1), s, on that clock: the first and the last time at which a vessel that
    # chooses its speeds may be in the cell and still arrive in time
    hours: FloatArray = np.empty((2, 0, 0))


class PointInCell(NamedTuple):
    """A cell and a point in it: the mean of the corners SW, SE, NW and NE with `weights` (2, 4).

    Each row of the weights is for one of the two ways to cut the cell into triangles.
    """

    row: int
    column: int
    weights: FloatArray

    def corners(self, time: FloatArray) -> FloatArray:
        """Times at the corners: a view (2, 2) of the nodes' times."""
        return time[self.row : self.row + 2, self.column : self.column + 2]

    def values(self, time: FloatArray) -> FloatArray:
        """Interpolated time at the point, for both ways to cut the cell (2,)."""
        # A corner without weight may be out of reach, and 0 times infinity is no number.
        times = np.where(self.weights > 0, self.corners(time).ravel(), 0.0)
        return np.asarray((self.weights * times).sum(axis=1))


def source(grid: TravelGrid, start: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Travel times (s) that are zero at the node nearest the start and unknown elsewhere."""
    time = np.full((grid.y.size, grid.x.size), np.inf)
    dirty = np.zeros(time.shape, dtype=bool)
    nearest = np.abs(grid.y - start[1]).argmin(), np.abs(grid.x - start[0]).argmin()
    time[nearest] = 0.0
    dirty[nearest] = True
    return time, dirty


def locate(grid: TravelGrid, point: FloatArray) -> PointInCell:
    """Cell that holds a point, one with water if there is any, and the point's place in it."""
    columns, rows = _beside(grid.x, point[0]), _beside(grid.y, point[1])
    row, column = max(itertools.product(rows, columns), key=lambda cell: bool(grid.wet[cell]))
    s, t = _share(grid.x, column, point[0]), _share(grid.y, row, point[1])
    rising = [1 - max(s, t), max(s - t, 0.0), max(t - s, 0.0), min(s, t)]
    lower, upper = max(1 - s - t, 0.0), max(s + t - 1, 0.0)
    falling = [lower, s - upper, t - upper, upper]
    return PointInCell(row, column, np.array([rising, falling]))


def _beside(axis: FloatArray, at: float) -> list[int]:
    """Return the intervals of an axis that hold a place: two where it is on their border."""
    intervals = (int(axis.searchsorted(at, side)) - 1 for side in _SIDES)
    return sorted({min(max(interval, 0), len(axis) - 2) for interval in intervals})


def _share(axis: FloatArray, interval: int, at: float) -> float:
    """Return how far along an interval of an axis a place lies, 0 to 1."""
    low, high = axis[interval], axis[interval + 1]
    return min(max(float((at - low) / (high - low)), 0.0), 1.0)


@small_kernel
def _passage(
    dx: float, dy: float, current: tuple[float, float], deviation: float, polar: Polar
) -> float:
    """Least time (s) along (dx, dy) m in a current c that may be off by a deviation (m/s).

    In the projected model a vessel may tack: below v/2 the polar v + c·T is not convex, and its
    hull is v²/(-4 c·T).
    """
    length = math.sqrt(dx * dx + dy * dy)
    tx, ty = dx / length, dy / length
    # The deviation helps no more than the same increase of speed would. A vessel that chooses its
    # speed may not want more speed; for it the deviation is taken as a following current.
    following = deviation if polar.least < polar.speed else 0.0
    cx, cy = current[0] + following * tx, current[1] + following * ty
    speed = ground_speed(cx, cy, tx, ty, polar)
    if not polar.crab and speed <= polar.speed / 2:
        speed = polar.speed * polar.speed / (4 * (polar.speed - speed))
    # The speed is NaN on a course that can't be held.
    if not speed > _MIN_SPEED * polar.speed:
        speed = _MIN_SPEED * polar.speed
    return float(length / (speed + deviation - following))


@small_kernel
def _arrival(
    legs: FloatArray,
    times: FloatArray,
    current: tuple[float, float],
    deviation: float,
    stretch: float,
    polar: Polar,
) -> float:
    """Earliest arrival (s) from the segment between two nodes with these times.

    `legs` (2, 2) lead from the nodes to the place of arrival, m. A convex function of the place
    on the segment: a parabola finds its least value closely enough.
    """
    first = times[0] + stretch * _passage(legs[0, 0], legs[0, 1], current, deviation, polar)
    second = times[1] + stretch * _passage(legs[1, 0], legs[1, 1], current, deviation, polar)
    dx, dy = (legs[0, 0] + legs[1, 0]) / 2, (legs[0, 1] + legs[1, 1]) / 2
    middle = (times[0] + times[1]) / 2
    middle += stretch * _passage(dx, dy, current, deviation, polar)
    best = min(first, second, middle)
    # The lowest place of the parabola through these three.
    bend = first + second - 2 * middle
    if not abs(first - second) < 2 * bend:
        return float(best)
    s = 0.5 + (first - second) / (4 * bend)
    dx = (1 - s) * legs[0, 0] + s * legs[1, 0]
    dy = (1 - s) * legs[0, 1] + s * legs[1, 1]
    value = (1 - s) * times[0] + s * times[1]
    value += stretch * _passage(dx, dy, current, deviation, polar)
    return float(min(best, value))


@kernel
def solve(
    time: FloatArray, dirty: BoolArray, stretch: FloatArray, grid: TravelGrid, cell: FloatArray
) -> None:
    """Lower the times (ny, nx) until no triangle improves any; starts from dirty nodes.

    It ends a little after `cell`, a view of some of the times, is known; later nodes stay dirty.

    Dijkstra's order, but a node whose time is improved later is settled again: with currents, the
    quickest way to a node may come through a node that is reached after it.
    """
    rows, columns = time.shape
    legs, times = np.empty((2, 2)), np.empty(2)
    front, segment = (time, dirty, stretch), (legs, times)
    queue = [(time[r, c], r, c) for r in range(rows) for c in range(columns) if dirty[r, c]]
    heapq.heapify(queue)
    while queue:
        now, row, column = heapq.heappop(queue)
        if now > BEYOND * cell.max():
            break
        if not dirty[row, column] or now > time[row, column]:
            continue
        dirty[row, column] = False
        times[0] = now
        own = node_velocity(grid.current, row, column, grid.departure + now)
        for way in range(8):
            to_row, to_column = row + _RING[way, 0], column + _RING[way, 1]
            if not (0 <= to_row < rows and 0 <= to_column < columns):
                continue
            known = time[to_row, to_column]
            if known <= now:
                continue
            arrival = _reached(front, grid, (row, column), way, own, segment)
            if arrival < known and (known == np.inf or arrival < known - TOLERANCE * (known - now)):
                time[to_row, to_column] = arrival
                dirty[to_row, to_column] = True
                heapq.heappush(queue, (arrival, to_row, to_column))


@small_kernel
def _reached(
    front: tuple[FloatArray, BoolArray, FloatArray],
    grid: TravelGrid,
    node: tuple[int, int],
    way: int,
    own: tuple[float, float],
    segment: tuple[FloatArray, FloatArray],
) -> float:
    """Earliest arrival (s) at a neighbour of a node (row, column) with its `own` current.

    The neighbour is the one on the `way`, a row of _RING. It is reached from the two segments that
    join the node to the nodes next to both, if those nodes are settled already, else straight from
    the node. `front` is what :func:`solve` knows; `segment` is room for the legs (2, 2) from a
    segment's ends, and the times (2,) there, of which the first, the node's own, is filled in.
    """
    (time, dirty, stretch), (row, column), (legs, times) = front, node, segment
    rows, columns = time.shape
    now = times[0]
    clock = grid.departure + now
    to_row, to_column = row + _RING[way, 0], column + _RING[way, 1]
    to = node_velocity(grid.current, to_row, to_column, clock)
    legs[0, 0] = grid.x[to_column] - grid.x[column]
    legs[0, 1] = grid.y[to_row] - grid.y[row]
    arrival, straight, deviation = np.inf, np.inf, 0.0
    for side in range(2):
        beside = (way + 3 + 2 * side) % 8
        by_row, by_column = to_row + _RING[beside, 0], to_column + _RING[beside, 1]
        if not (0 <= by_row < rows and 0 <= by_column < columns):
            continue
        r, c = min(row, to_row, by_row), min(column, to_column, by_column)
        if not grid.wet[r, c]:
            continue
        times[1] = time[by_row, by_column]
        if times[1] == np.inf or (dirty[by_row, by_column] and times[1] > now):
            # The node beside is settled later, and uses this triangle then.
            straight, deviation = min(straight, stretch[r, c]), grid.deviation[r, c]
            continue
        # The mean of the current on the way from the segment's middle.
        by = node_velocity(grid.current, by_row, by_column, clock)
        current = (own[0] + by[0]) / 4 + to[0] / 2, (own[1] + by[1]) / 4 + to[1] / 2
        legs[1, 0] = grid.x[to_column] - grid.x[by_column]
        legs[1, 1] = grid.y[to_row] - grid.y[by_row]
        across = _arrival(legs, times, current, grid.deviation[r, c], stretch[r, c], grid.polar)
        arrival = min(arrival, across)
    if straight < np.inf:
        current = (own[0] + to[0]) / 2, (own[1] + to[1]) / 2
        leg = _passage(legs[0, 0], legs[0, 1], current, deviation, grid.polar)
        arrival = min(arrival, now + straight * leg)
    return float(arrival)


def mean_times(grid: TravelGrid, start: FloatArray, goal: FloatArray) -> FloatArray:
    """Times (ny, nx), s, from a start to the goal's cell, in the current without its deviation."""
    grid = grid._replace(deviation=np.zeros(grid.wet.shape))
    time, dirty = source(grid, start)
    corners = locate(grid, goal).corners(time)
    solve(time, dirty, grid.metres, grid, corners)
    return time
