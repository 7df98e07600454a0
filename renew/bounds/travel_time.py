"""Travel times from a point to the nodes of a grid in a current: the value function u.

u, the least time from the start, is taken as linear on the grid's triangles: a node is reached
from the best place on a segment between two others of its triangle (Tsitsiklis, 1995), in the
most helpful of that triangle's currents at the time of the first. Nodes are settled in Dijkstra's
order, and settled again where a later node improves them, as it may in a current. Only the cells
that hold water are crossed.

u is an approximation: :mod:`renew.bounds.fuel_lower_bound` derives a proven bound from it, and has
it solved again with the slowness of some cells lowered.
"""

import heapq
import itertools
import math
from typing import Literal, NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray
from renew.kernels.current_table import CurrentTable, node_velocity
from renew.kernels.ground_speed import Polar, ground_speed

TOLERANCE = 1e-4
"""Least correction of a time, as a share of the cost of the step to it; others are skipped."""

BEYOND = 1.02
"""Multiple of the goal's time beyond which no times are computed."""

HELPFUL, MEAN = False, True
"""In which current a leg is sailed: the most helpful of its triangle's, or the mean on its way."""

# Lowest ground speed of the travel times, as a share of v: keeps them finite upstream of currents
# as strong as the vessel. No part of the proof.
_MIN_SPEED = 0.05
# A place beside an end of a segment, as a share of it.
_BESIDE = 1 / 16
# The two sides of a place among the nodes of an axis: they differ where it is a node.
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
    # (2, ny - 1, nx - 1), s, on that clock: where speeds are chosen, from when until when a vessel
    # that is in time may be in the cell
    hours: FloatArray = np.empty((2, 0, 0))


class Place(NamedTuple):
    """A cell, and a point in it as a mean of its corners SW, SE, NW, NE with weights (2, 4).

    Two means, for the two ways to cut the cell into triangles.
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


def locate(grid: TravelGrid, point: FloatArray) -> Place:
    """Cell that holds a point, one with water if there is any, and the point's place in it."""
    columns, rows = (
        np.unique(
            np.clip([np.searchsorted(axis, at, side) - 1 for side in _SIDES], 0, len(axis) - 2)
        ).tolist()
        for axis, at in ((grid.x, point[0]), (grid.y, point[1]))
    )
    row, column = max(itertools.product(rows, columns), key=lambda cell: bool(grid.wet[cell]))
    s = float(np.clip((point[0] - grid.x[column]) / (grid.x[column + 1] - grid.x[column]), 0, 1))
    t = float(np.clip((point[1] - grid.y[row]) / (grid.y[row + 1] - grid.y[row]), 0, 1))
    rising = [1 - max(s, t), max(s - t, 0.0), max(t - s, 0.0), min(s, t)]
    lower, upper = max(1 - s - t, 0.0), max(s + t - 1, 0.0)
    falling = [lower, s - upper, t - upper, upper]
    return Place(row, column, np.array([rising, falling]))


@kernel
def _passage(
    dx: float, dy: float, corner_currents: FloatArray, deviation: float, polar: Polar
) -> float:
    """Time (s) along (dx, dy) m in the most helpful of three currents (3, 2).

    Projected, a vessel may tack: v + c·T is no convex polar below v/2, and its hull there is
    v²/(-4 c·T).
    """
    length = math.sqrt(dx * dx + dy * dy)
    tx, ty = dx / length, dy / length
    # A current that is off by up to the deviation helps no more than as much speed would. A vessel
    # that chooses its speed may not want more of it, so it gets a following current instead.
    following = deviation if polar.least < polar.speed else 0.0
    speed, crab, least, price, exponent, scale, still, _ = polar
    faster = speed + deviation - following
    helped = Polar(faster, crab, least, price, exponent, scale, still, 0.0)
    fastest = -math.inf
    for k in range(3):
        cx, cy = corner_currents[k]
        speed = ground_speed(cx + following * tx, cy + following * ty, tx, ty, helped)
        fastest = max(fastest, speed)
    if not polar.crab and fastest <= polar.speed / 2:
        fastest = polar.speed * polar.speed / (4 * (polar.speed - fastest))
    return float(length / max(fastest, _MIN_SPEED * polar.speed))


@kernel
def _arrival(
    legs: FloatArray,
    times: FloatArray,
    corner_currents: FloatArray,
    deviation: float,
    stretch: float,
    polar: Polar,
) -> float:
    """Earliest arrival (s) from the segment between two nodes with these times.

    `legs` (2, 2) lead from the nodes to the place of arrival, m. A convex function of the place
    on the segment: halving steps find its least value closely enough.
    """
    first = times[0] + stretch * _passage(legs[0, 0], legs[0, 1], corner_currents, deviation, polar)
    if times[1] == np.inf:
        return float(first)
    second = times[1] + stretch * _passage(
        legs[1, 0], legs[1, 1], corner_currents, deviation, polar
    )
    best = min(first, second)
    place, least = 0.5, np.inf
    step, side = 0.5, 0.0
    for k in range(-1, 7):
        # Beside the better end: if it is no better there, the end is best. Then the middle, then a
        # step of a quarter, an eighth, a sixteenth: towards the side that was better last, and only
        # if that is no better to the other.
        if k > 0 and k % 2 == 1:
            step /= 2
            is_better = False
        elif k > 0 and is_better:
            continue
        s = place + side * step
        if k < 0:
            s = _BESIDE if first <= second else 1 - _BESIDE
        dx = (1 - s) * legs[0, 0] + s * legs[1, 0]
        dy = (1 - s) * legs[0, 1] + s * legs[1, 1]
        value = (1 - s) * times[0] + s * times[1]
        value += stretch * _passage(dx, dy, corner_currents, deviation, polar)
        if k < 0:
            if value >= best:
                return float(best)
            best = value
        elif k == 0:
            least, side = value, 1.0 if second < first else -1.0
        elif value < least:
            place, least, is_better = s, value, True
        else:
            side = -side
    return float(min(best, least))


@kernel
def solve(
    time: FloatArray,
    dirty: BoolArray,
    stretch: FloatArray,
    grid: TravelGrid,
    cell: FloatArray,
    current: bool,
) -> None:
    """Lower the times (ny, nx) until no triangle improves any; starts from dirty nodes.

    It ends a little after `cell`, a view of some of the times, is known; later nodes stay dirty.
    Legs are sailed in the HELPFUL or the MEAN current.

    Dijkstra's order, but a node whose time is improved later is settled again: with currents, the
    quickest way to a node may come through a node that is reached after it.
    """
    rows, columns = time.shape
    table = grid.current
    legs, times, corner_currents = np.empty((2, 2)), np.empty(2), np.empty((3, 2))
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
        clock = grid.departure + now
        own = node_velocity(table, row, column, clock)
        for way in range(16):
            # To each neighbour, from the segments to the nodes beside this one on its ring.
            to_row, to_column = row + _RING[way // 2, 0], column + _RING[way // 2, 1]
            beside = (way // 2 + 3 + 2 * (way % 2)) % 8
            by_row, by_column = to_row + _RING[beside, 0], to_column + _RING[beside, 1]
            r, c = min(row, to_row, by_row), min(column, to_column, by_column)
            inside = 0 <= r < rows - 1 and 0 <= c < columns - 1
            inside = inside and max(row, to_row, by_row) < rows
            inside = inside and max(column, to_column, by_column) < columns
            if not (inside and grid.wet[r, c]) or time[to_row, to_column] <= now:
                continue
            times[1] = time[by_row, by_column]
            if dirty[by_row, by_column] and times[1] > now:
                times[1] = np.inf  # its turn comes, and this triangle's with it
            corner_currents[0] = own
            corner_currents[1] = node_velocity(table, by_row, by_column, clock)
            corner_currents[2] = node_velocity(table, to_row, to_column, clock)
            deviation = grid.deviation[r, c]
            if current == MEAN:
                deviation = 0.0
                for k in range(2):
                    ends = corner_currents[0, k] + corner_currents[1, k]
                    corner_currents[:, k] = ends / 4 + corner_currents[2, k] / 2
            legs[0, 0] = grid.x[to_column] - grid.x[column]
            legs[0, 1] = grid.y[to_row] - grid.y[row]
            legs[1, 0] = grid.x[to_column] - grid.x[by_column]
            legs[1, 1] = grid.y[to_row] - grid.y[by_row]
            arrival = _arrival(legs, times, corner_currents, deviation, stretch[r, c], grid.polar)
            known = time[to_row, to_column]
            if known == np.inf or arrival < known - TOLERANCE * (known - now):
                time[to_row, to_column] = arrival
                dirty[to_row, to_column] = True
                heapq.heappush(queue, (arrival, to_row, to_column))
