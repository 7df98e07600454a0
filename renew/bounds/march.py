"""The proof's inequality on a grid: growth rates λ of its cells, level by level of u.

Let p = ∇u be the gradient of the function u, T the unit tangent of the way, and c the current. With
g the speed over ground, u grows by (p·T) g a second. Where the vessel chooses its speed v, a second
costs (R(v) + μ) over the polar's scale (:mod:`renew.kernels.ground_speed`), and λ is the largest
growth divided by this cost:

- crab: in any direction T the growth is at most v |p| + p·c. Growth divided by cost is largest at
  the v that would be best if there were no cross-current.
- projected: the largest growth over all T is a convex function of v, and so lies below its chords.
  The range of speeds is cut into a few pieces, and on each piece the chord replaces the function.

See :mod:`renew.bounds.fuel_lower_bound` for what λ, Λ and φ are.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.bounds.travel_time import TOLERANCE, TravelGrid
from renew.kernels.current_table import next_slice, node_velocity
from renew.kernels.fuel_law import effort
from renew.kernels.ground_speed import Polar, ground_speed

# Share by which a rate is raised for rounding.
_ROUNDING = 1e-6
# Number of pieces into which a range of speeds is cut.
_PIECES = 8


@small_kernel
def growth_rate(
    p: FloatArray, corner_currents: FloatArray, deviation: float, polar: Polar
) -> float:
    """λ of a triangle: an upper bound on (p·T) g over all T and all its points.

    p (3, 2) in s/m and c (3, 2) are given at its corners and linear between them. For any T and v,
    (p·T) g is then a quadratic function, so it is at most its largest corner value plus two thirds
    of the largest excess of a side. The excess is the middle coefficient in Bernstein's form less
    the mean of the ends: -2 (δp·T)(δc·T), where δp and δc are half the differences along the side.
    """
    largest, steepest, excess = -math.inf, 0.0, 0.0
    for k in range(3):
        px, py = p[k, 0], p[k, 1]
        cx, cy = corner_currents[k, 0], corner_currents[k, 1]
        steepest = max(steepest, px * px + py * py)
        if polar.least < polar.speed:
            rate = _rate_at_choice(px, py, cx, cy, deviation, polar)
        elif polar.crab:
            rate = polar.speed * math.sqrt(px * px + py * py) + px * cx + py * cy
        else:
            rate = projected_rate(px, py, cx, cy, polar.speed, largest)
        largest = max(largest, rate)
        other = (k + 1) % 3
        px, py = (p[other, 0] - px) / 2, (p[other, 1] - py) / 2
        cx, cy = (corner_currents[other, 0] - cx) / 2, (corner_currents[other, 1] - cy) / 2
        rise = -(px * cx + py * cy)
        rise += rise if polar.crab else math.sqrt((px * px + py * py) * (cx * cx + cy * cy))
        excess = max(excess, rise)
    excess *= 2 / 3
    if polar.least < polar.speed:
        # A second costs no less than this.
        excess *= polar.scale / (effort(polar.least, polar.law) + polar.price)
        return float(largest + excess)
    return float(largest + excess + deviation * math.sqrt(steepest))


@kernel
def projected_rate(
    px: float, py: float, cx: float, cy: float, speed: float, enough: float = -math.inf
) -> float:
    """Upper bound, nearly attained, on (p·T)(v + c·T) over unit T; p in s/m.

    The Lagrange dual of a quadratic on the unit circle: with w = (v |p|/2)² and the quadratic
    form's eigenvalues e, e' = (p·c ± |p||c|)/2, every μ > e gives the bound
    μ + w μ / ((μ - e)(μ - e')). The bound is least where (μ - e)(μ - e') = √w √(μ² - e e').
    Newton's iteration approaches this μ from the right. The bound holds wherever the iteration
    stops. At the end it is raised by more than rounding can have lowered it.
    """
    p = math.sqrt(px * px + py * py)
    if p == 0.0:
        return 0.0
    dot, root = px * cx + py * cy, speed * p / 2
    cross = px * cy - py * cx
    if root + dot > 0.0:
        # The best direction, at an angle from p, by Newton's iteration.
        side = cross / (2 * (root + dot))
        along = 1.0 / math.sqrt(1.0 + side * side)
        side *= along
        slope = cross * (along * along - side * side) - 2 * side * (root + dot * along)
        bend = 4 * cross * along * side + 2 * root * along + 2 * dot * (along * along - side * side)
        turn = slope / bend
        along, side = along - turn * side, side + turn * along
        norm = 1.0 - 0.5 * turn * turn
        along, side = along * norm, side * norm
        mu = along * (dot * along + cross * side + root)
        product = mu * (mu - dot) - cross * cross / 4
        if product > 0.0 and 2 * mu > dot:
            bound = mu + root * root * mu / product
            if bound <= (mu + root * along) * (1 + 1e-4):
                return bound * (1 + _ROUNDING)
    product = p * math.sqrt(cx * cx + cy * cy)
    top, bottom = (dot + product) / 2, (dot - product) / 2
    mu = top + root
    least = mu + root * root * mu / ((mu - top) * (mu - bottom))
    for _ in range(6):
        side = math.sqrt(max(mu * mu - top * bottom, 0.0))
        if side == 0.0:
            break
        residual = (mu - top) * (mu - bottom) - root * side
        slope = 2 * mu - top - bottom - root * mu / side
        following = mu - residual / slope if slope > 0.0 else top
        mu = following if following > top else (mu + top) / 2
        # Closer to the eigenvalue the bound drowns in rounding.
        if mu - top <= _ROUNDING * (mu + abs(bottom)):
            break
        bound = mu + root * root * mu / ((mu - top) * (mu - bottom))
        if bound >= least * (1 - 1e-7) or bound * (1 + _ROUNDING) <= enough:
            return min(bound, least) * (1 + _ROUNDING)
        least = bound
    return least * (1 + _ROUNDING)


@kernel
def _rate_at_choice(
    px: float, py: float, cx: float, cy: float, deviation: float, polar: Polar
) -> float:
    """λ in a current that may be off by a deviation (m/s), over all speeds that may be chosen."""
    p = math.sqrt(px * px + py * py)
    if p == 0.0:
        return 0.0
    if polar.crab:
        along = (px * cx + py * cy) / p + deviation
        return p * _most_made(along, polar.least, polar.speed, polar)
    step = (polar.speed / polar.least) ** (1.0 / _PIECES)
    low, at_low, largest = polar.least, 0.0, 0.0
    at_low = projected_rate(px, py, cx, cy, low) + deviation * p
    for piece in range(_PIECES):
        high = polar.speed if piece == _PIECES - 1 else low * step
        at_high = projected_rate(px, py, cx, cy, high) + deviation * p
        slope = (at_high - at_low) / (high - low)
        if slope > 0.0:
            rate = slope * _most_made(at_low / slope - low, low, high, polar)
        else:
            rate = polar.scale * at_low / (effort(low, polar.law) + polar.price)
        largest = max(largest, rate)
        low, at_low = high, at_high
    return largest


@kernel
def _most_made(along: float, low: float, high: float, polar: Polar) -> float:
    """Largest value of scale * (v + along) / (R(v) + μ), with v from `low` to `high` (m/s)."""
    no_crab = False
    piece = Polar(high, no_crab, low, polar.price, polar.law, polar.scale, polar.still, 0.0)
    return ground_speed(along, 0.0, 1.0, 0.0, piece) * (1 + _ROUNDING)


LEVELS = 2_000
"""Number of levels of u at which Λ is tabulated."""

# Least Λ in a current that changes.
_LEAST_RATE = 0.8
# Least λ that counts; smaller ones are raised to it, which is on the safe side, so that no 1/λ is
# lost to rounding.
_SMALLEST = 0.1


class _Corners(NamedTuple):
    """The corners of a triangle: their nodes (row, column), the gradient of u and the current."""

    nodes: IntArray  # (3, 2)
    slopes: FloatArray  # (3, 2), s/m
    currents: FloatArray  # (3, 2), m/s


@small_kernel
def _rate_in_window(
    corners: _Corners, cell: tuple[int, int], grid: TravelGrid, window: tuple[float, float]
) -> float:
    """λ of a triangle of a cell in a window of time, s: at its ends and at the slices between.

    The currents at its corners are written to.
    """
    nodes, slopes, currents = corners
    now, last = window
    deviation, metres = grid.deviation[cell], grid.metres[cell]
    largest = -math.inf
    while True:
        for k in range(3):
            currents[k] = node_velocity(grid.current, nodes[k, 0], nodes[k, 1], now)
        largest = max(largest, growth_rate(slopes, currents, deviation, grid.polar))
        if now >= last or len(grid.current.times) == 1:
            # A vessel covers more metres of the plane in a second than true ones.
            return float(largest / metres)
        now = min(next_slice(grid.current, now), last)


@kernel
def march(
    time: FloatArray, grid: TravelGrid, counts: BoolArray, low: float, high: float
) -> tuple[FloatArray, FloatArray]:
    """λ of the cells that count (ny - 1, nx - 1), 0 elsewhere, and φ (LEVELS + 1,), s, by level.

    Level by level of u from low to high: a cell's λ is worked out when its lowest corner is
    reached, for the times from the present φ to the largest φ that its highest corner can have.
    """
    rows, columns = grid.wet.shape
    rates, reached = np.zeros((rows, columns)), np.zeros(LEVELS + 1)
    step = (high - low) / LEVELS
    if not step > 0.0:
        return rates, reached
    # If speeds are chosen, u is no time: a vessel may pass at any time up to the deadline.
    is_any_time = grid.polar.least < grid.polar.speed
    least = _SMALLEST if is_any_time or len(grid.current.times) == 1 else _LEAST_RATE
    first, order = _by_level(time, grid.wet, counts, low, step)
    largest = np.zeros(LEVELS + 1)
    clock, k = 0.0, 0
    corners = _Corners(np.empty((3, 2), dtype=np.int64), np.empty((3, 2)), np.empty((3, 2)))
    bends = np.empty(6)
    for level in range(LEVELS + 1):
        while k < len(order) and first[order[k]] <= level:
            r, c = order[k] // columns, order[k] % columns
            k += 1
            set_bends(bends, time, grid.wet, r, c)
            highest = max(time[r, c], time[r, c + 1], time[r + 1, c], time[r + 1, c + 1])
            highest += 2 / 3 * max(bends.max(), 0.0)
            lasts = max(highest - (low + level * step), 0.0) / least
            begin = grid.departure + clock
            # A current that repeats itself has nothing new after a period.
            end = begin + min(lasts, grid.current.period)
            if is_any_time:
                begin, end = grid.hours[0, r, c], grid.hours[1, r, c]
                if end < begin:
                    continue
            rates[r, c] = _cell_rate(time, grid, (r, c), (begin, end), bends, corners)
            # One level more on either side covers rounding.
            last = math.floor((min(highest, high) - low) / step) + 1
            for above in range(level, min(last, LEVELS) + 1):
                largest[above] = max(largest[above], rates[r, c])
        if level < LEVELS:
            if largest[level] > 0.0:
                clock += step / max(largest[level], least)
            reached[level + 1] = clock
    return rates, reached


@kernel
def _by_level(
    time: FloatArray, wet: BoolArray, counts: BoolArray, low: float, step: float
) -> tuple[IntArray, IntArray]:
    """Return the level of u from which each cell (c,) counts, and the cells ordered by level.

    Cells out of reach of the start don't count: no route gets there. Cells beyond the last level
    come last.
    """
    rows, columns = counts.shape
    bends = np.empty(6)
    first = np.full(rows * columns, LEVELS + 1)
    # Sorted by counting: where the cells of each level begin.
    begin = np.zeros(LEVELS + 2, dtype=np.int64)
    for r in range(rows):
        for c in range(columns):
            if counts[r, c] and time[r, c] < np.inf:
                south, north = (
                    min(time[r, c], time[r, c + 1]),
                    min(time[r + 1, c], time[r + 1, c + 1]),
                )
                set_bends(bends, time, wet, r, c)
                lowest = min(south, north) + 2 / 3 * min(bends.min(), 0.0)
                level = math.floor((lowest - low) / step) - 1
                level = min(max(level, 0), LEVELS)
                first[r * columns + c] = level
                begin[level + 1] += 1
    for level in range(LEVELS + 1):
        begin[level + 1] += begin[level]
    order = np.empty(begin[LEVELS + 1], dtype=np.int64)
    for cell in range(rows * columns):
        level = first[cell]
        if level <= LEVELS:
            order[begin[level]] = cell
            begin[level] += 1
    return first, order


@small_kernel
def _cell_rate(
    time: FloatArray,
    grid: TravelGrid,
    cell: tuple[int, int],
    window: tuple[float, float],
    bends: FloatArray,
    corners: _Corners,
) -> float:
    """λ of a cell (row, column), cut along its better diagonal, in a window of time, s.

    `corners` is room for those of a triangle.
    """
    (r, c), (nodes, slopes, _) = cell, corners
    wide, high = grid.x[c + 1] - grid.x[c], grid.y[r + 1] - grid.y[r]
    best = np.inf
    # The diagonal along which u rises more is the better one, nearly always.
    rising = abs(time[r + 1, c + 1] - time[r, c]) > abs(time[r + 1, c] - time[r, c + 1])
    for way in range(2):
        falling = way if rising else 1 - way
        worst = 0.0
        across = bends[4 + falling]
        for north in range(2):
            # A triangle has a side along x, in the cell's south or north, and one along
            # y: across the diagonal from it. They meet at the first node.
            east = north if falling else 1 - north
            nodes[0, 0], nodes[0, 1] = r + north, c + east
            nodes[1, 0], nodes[1, 1] = r + north, c + 1 - east
            nodes[2, 0], nodes[2, 1] = r + 1 - north, c + east
            here = time[r + north, c + east]
            dx, dy = time[r + north, c + 1 - east] - here, time[r + 1 - north, c + east] - here
            along_x, along_y = bends[north], bends[2 + east]
            w, h = wide * (1 - 2 * east), high * (1 - 2 * north)
            slopes[0, 0], slopes[0, 1] = (dx + 2 * along_x) / w, (dy + 2 * along_y) / h
            slopes[1, 0], slopes[1, 1] = (dx - 2 * along_x) / w, (dy + 2 * (across - along_x)) / h
            slopes[2, 0], slopes[2, 1] = (dx + 2 * (across - along_y)) / w, (dy - 2 * along_y) / h
            worst = max(worst, _rate_in_window(corners, cell, grid, window))
            if worst >= best:
                break
        best = min(best, worst)
        if best <= 1 + TOLERANCE:
            break
    return max(best, _SMALLEST)


@small_kernel
def set_bends(bends: FloatArray, time: FloatArray, wet: BoolArray, r: int, c: int) -> None:
    """Write the bends of a cell's sides S, N, W, E and of its rising and falling diagonal (6,).

    On a side u is quadratic: its bend is the middle coefficient in Bernstein's form, less the mean
    of the ends. Both cells of a side work out the same, so that u is continuous.
    """
    bends[0] = _bend(time, wet, r, c, 0, 1)
    bends[1] = _bend(time, wet, r + 1, c, 0, 1)
    bends[2] = _bend(time, wet, r, c, 1, 0)
    bends[3] = _bend(time, wet, r, c + 1, 1, 0)
    bends[4] = _bend(time, wet, r, c, 1, 1)
    bends[5] = _bend(time, wet, r, c + 1, 1, -1)


@small_kernel
def _bend(time: FloatArray, wet: BoolArray, r: int, c: int, dr: int, dc: int) -> float:
    """Bend of a side that begins at a node (r, c): minus a quarter of a second difference of u.

    It is the smaller of the bends at its ends, or 0 if their signs differ: where two fronts meet,
    and in a fan, u bends at one end only. Without water beyond both ends it is 0.
    """
    least, most = np.inf, -np.inf
    for k in range(-1, 2):
        if not _is_open(wet, r + k * dr, c + k * dc, dr, dc):
            return 0.0
    for k in range(2):
        i, j = r + k * dr, c + k * dc
        bend = 2 * time[i, j] - time[i - dr, j - dc] - time[i + dr, j + dc]
        least, most = min(least, bend), max(most, bend)
    if least > 0.0:
        return least / 4
    return most / 4 if most < 0.0 else 0.0


@small_kernel
def _is_open(wet: BoolArray, r: int, c: int, dr: int, dc: int) -> bool:
    """Whether a side or diagonal begins at a node (r, c), with water beside it."""
    rows, columns = wet.shape
    to_r, to_c = r + dr, c + dc
    if min(r, to_r) < 0 or max(r, to_r) > rows or min(c, to_c) < 0 or max(c, to_c) > columns:
        return False
    south, west = min(r, to_r), min(c, to_c)
    if dr == 0:
        return bool((south > 0 and wet[south - 1, west]) or (south < rows and wet[south, west]))
    if dc == 0:
        return bool((west > 0 and wet[south, west - 1]) or (west < columns and wet[south, west]))
    return bool(wet[south, west])
