"""A lower bound on the fuel of every route, over all classes and whatever clearance.

Proof. Let φ be continuous on the water, linear on each triangle of a mesh. Along a route with unit
tangent T and ground speed g(x, T) > 0, φ grows by ∇φ·T a metre and time by 1/g. So if

    (∇φ·T) g(x, T) <= 1 for every T, at every x of every triangle that holds water,            (1)

then time >= φ(goal) - φ(start) for every route, and fuel is α vᵏ times that. (Along an edge of the
mesh φ's slope is that of the triangles on either side, so (1) covers routes along edges, too.)

φ = f∘u, where u is the vessel's travel time from the start on a grid, each of whose cells is cut
into two triangles. u is only nearly right, and (1) is then *made* true. Each triangle gets the
ratio λ = max (∇u·T) g(x, T) over all T and x in it, never underrated:

- in a triangle the current is within a radius r of the linear interpolant of its corners' currents
  (`_deviation`); the maximum is convex in the current, so it is taken at a corner;
- crab: g T runs over the disc of radius v about c, so max over T is v |∇u| + ∇u·c;
- projected: max (∇u·T)(v + c·T) over the unit circle is a quadratic's, bounded by any Lagrange
  multiplier (`_projected_rate`);
- both grow by at most |δ| |∇u| when c changes by δ, whence the term r |∇u|.

f has slope 1/Λ(u) between start and goal and 0 beyond, where Λ(s) is the largest λ of the cells
through which the level set u = s runs. So (1) holds for φ: ∇φ = ∇u/Λ. Cells without water hold no
route and don't count; those that a shore crosses are treated as water. Where λ > 1 (fans around
the start and corners), the cell's slowness is lowered by λ and u is solved again: every round
gives a bound, and the best is returned.

What is proven for which current: everything for `UniformCurrent`, `GyreCurrent` and
`GriddedCurrent`, whose deviation r is bounded in closed form. Any other field is known by its
values alone: r is four times the error that the second differences between neighbouring nodes
suggest, so the bound holds for fields that the grid resolves (a cell is under 1 % of a square
extent's side).

Currents above v are no obstacle here: such water may be crossed at no less than its true cost.
"""

from __future__ import annotations

import heapq
import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from numba import njit

from renew.current import CurrentField, GriddedCurrent, GyreCurrent, UniformCurrent

if TYPE_CHECKING:
    from collections.abc import Iterator

    from renew._types import BoolArray, FloatArray
    from renew.chart import Chart
    from renew.fuel import Drift
    from renew.vessel import Vessel

# Cells of the grid: the gap is 2 % on the published single gyre; twice as many take twice the time
# and make it 1.5 %.
_CELLS = 16_000
_FEWEST = 4  # cells along the shorter side
# Rounds of solving; after the third the bound rises by less than 0.2 %.
_ROUNDS = 3
# A value is only corrected by more than this share of what the step to it costs.
_TOLERANCE = 1e-4
# Slowest ground speed of the travel times, as a share of v: keeps them finite upstream of currents
# that outrun the vessel. No part of the proof.
_SLOWEST = 0.05
# Times beyond this multiple of the goal's are cut off there.
_BEYOND = 1.02
# Levels of u at which Λ is tabulated.
_LEVELS = 2_000
# Smaller λ count as this much, which is on the safe side, so that no 1/λ is lost to rounding.
_SMALLEST = 0.1
# Share by which the bound is lowered for rounding, and for routes that graze a shore by as much.
_ROUNDING = 1e-6
# A line of the mesh through the start must be this share of a cell from the extent's sides.
_NARROWEST = 0.2


class _Mesh(NamedTuple):
    """Nodes, row by row from the south-west, and the cells between them; m and m/s.

    Cell (row, column) has the nodes (row, column) to (row + 1, column + 1).
    """

    x: FloatArray  # (nx,)
    y: FloatArray  # (ny,)
    current: FloatArray  # (ny, nx, 2)
    deviation: FloatArray  # (ny - 1, nx - 1): r
    wet: BoolArray  # (ny - 1, nx - 1): whether a route may touch the cell
    speed: float
    crab: bool


class _Place(NamedTuple):
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


def fuel_lower_bound(
    chart: Chart,
    current: CurrentField,
    vessel: Vessel,
    start: FloatArray,
    goal: FloatArray,
    drift: Drift = "projected",
) -> float:
    """Fuel below which no route from start to goal can stay, over all homotopy classes.

    Infinite if no water joins them. See the module for the proof and for which currents it holds.
    """
    mesh = _mesh(chart, current, vessel.speed, start, drift == "crab")
    return vessel.fuel_rate * max(bound for _, _, bound in _rounds(mesh, start, goal))


def _rounds(
    mesh: _Mesh, start: FloatArray, goal: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray, float]]:
    """Of each round: u at the nodes (s), λ of the cells, and the time (s) that they prove."""
    stretch = np.ones(mesh.wet.shape)
    time, dirty = _source(mesh, start)
    at_start, at_goal = _locate(mesh, start), _locate(mesh, goal)
    for _ in range(_ROUNDS):
        _solve(time, dirty, stretch, mesh, at_goal.corners(time))
        # Nodes far beyond the goal need no exact time: any φ will do that obeys (1).
        known = np.minimum(time, _BEYOND * at_goal.corners(time).max())
        rate = _rates(known, mesh)
        low, high = at_start.values(known).max(), at_goal.values(known).min()
        if not math.isfinite(high):
            yield known, rate, math.inf
            return
        yield known, rate, _feasible_difference(known, rate, low, high) * (1 - _ROUNDING)
        _relax(rate, stretch, dirty)


# --- the mesh ---------------------------------------------------------------------------------


def _mesh(
    chart: Chart,
    current: CurrentField,
    speed: float,
    start: FloatArray,
    crab: bool,  # noqa: FBT001
) -> _Mesh:
    """Grid over the extent's bounding box with a node at the start."""
    xmin, ymin, xmax, ymax = chart.bounds
    wide, high = xmax - xmin, ymax - ymin
    step = min(math.sqrt(wide * high / _CELLS), wide / _FEWEST, high / _FEWEST)
    x, y = _axis(xmin, xmax, float(start[0]), step), _axis(ymin, ymax, float(start[1]), step)
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    velocity = np.ascontiguousarray(current(nodes))
    deviation = _deviation(current, x, y, velocity)
    return _Mesh(x, y, velocity, deviation, _wet(chart, x, y), speed, crab)


def _axis(low: float, high: float, through: float, step: float) -> FloatArray:
    """Ascending nodes from low to high, about a step apart, one at `through` if well inside."""
    inside = min(through - low, high - through) > _NARROWEST * step
    stops = [low, through, high] if inside else [low, high]
    pieces = [
        np.linspace(a, b, max(1, round((b - a) / step)) + 1)[:-1]
        for a, b in itertools.pairwise(stops)
    ]
    return np.concatenate([*pieces, [high]])


def _wet(chart: Chart, x: FloatArray, y: FloatArray) -> BoolArray:
    """Cells (ny - 1, nx - 1) that hold water; a sliver along their sides is none."""
    # Land whose shore runs along a line of the mesh leaves no cells of water on its own side.
    shrink = 10 * chart.precision
    west, south = np.meshgrid(x[:-1] + shrink, y[:-1] + shrink)
    east, north = np.meshgrid(x[1:] - shrink, y[1:] - shrink)
    cells = shapely.box(west, south, east, north)
    wet = np.zeros(cells.size, dtype=bool)
    water = shapely.get_parts(chart.water)
    wet[shapely.STRtree(cells.ravel()).query(water, predicate="intersects")[1]] = True
    return wet.reshape(cells.shape)


def _deviation(
    current: CurrentField, x: FloatArray, y: FloatArray, velocity: FloatArray
) -> FloatArray:
    """Radius r >= |c - linear interpolant of c| in both triangles of each cell, m/s.

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
    return _sampled_deviation(x, y, velocity)


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
    low = np.stack([slope[:, i : max(i, j) + 1].min(1) for i, j in zip(first, last, strict=True)])
    high = np.stack([slope[:, i : max(i, j) + 1].max(1) for i, j in zip(first, last, strict=True)])
    # Along y each ∂c/∂x is linear between the grid's rows: extremes are at rows or cell sides.
    spread = np.empty((y.size - 1, x.size - 1, 2))
    place = np.interp(y, grid_y, np.arange(grid_y.size))
    for row, (south, north) in enumerate(itertools.pairwise(place)):
        between = np.arange(math.floor(south) + 1, math.ceil(north))
        rows = np.concatenate([[south], between, [north]])
        floor = np.minimum(rows.astype(int), grid_y.size - 2)
        part = (rows - floor)[None, :, None]
        lowest = ((1 - part) * low[:, floor] + part * low[:, floor + 1]).min(1)
        highest = ((1 - part) * high[:, floor] + part * high[:, floor + 1]).max(1)
        spread[row] = highest - lowest
    return np.asarray(np.hypot(spread[..., 0], spread[..., 1]) / 2)


def _sampled_deviation(x: FloatArray, y: FloatArray, velocity: FloatArray) -> FloatArray:
    """Four times the interpolation error (m/s) that the nodes' second differences suggest."""
    bend = _bend(x, velocity.swapaxes(0, 1)).T + _bend(y, velocity)
    bend = np.maximum(
        np.maximum(bend[:-1, :-1], bend[:-1, 1:]), np.maximum(bend[1:, :-1], bend[1:, 1:])
    )
    twist = velocity[1:, 1:] - velocity[1:, :-1] - velocity[:-1, 1:] + velocity[:-1, :-1]
    return np.asarray(bend + np.linalg.norm(twist, axis=-1))


def _bend(axis: FloatArray, velocity: FloatArray) -> FloatArray:
    """How far each node's velocity (n, m, 2) is off the line through its neighbours, (n, m)."""
    bend = np.zeros(velocity.shape[:2])
    if axis.size < 3:
        return bend
    part = ((axis[1:-1] - axis[:-2]) / (axis[2:] - axis[:-2]))[:, None, None]
    line = (1 - part) * velocity[:-2] + part * velocity[2:]
    bend[1:-1] = np.linalg.norm(velocity[1:-1] - line, axis=-1)
    bend[0], bend[-1] = bend[1], bend[-2]
    return bend


def _source(mesh: _Mesh, start: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Travel times that are zero at the node nearest to the start and unknown elsewhere."""
    time = np.full((mesh.y.size, mesh.x.size), np.inf)
    dirty = np.zeros(time.shape, dtype=bool)
    nearest = np.abs(mesh.y - start[1]).argmin(), np.abs(mesh.x - start[0]).argmin()
    time[nearest] = 0.0
    dirty[nearest] = True
    return time, dirty


def _locate(mesh: _Mesh, point: FloatArray) -> _Place:
    """Cell that holds a point, and the point's place in it."""
    column = int(np.clip(np.searchsorted(mesh.x, point[0]) - 1, 0, mesh.x.size - 2))
    row = int(np.clip(np.searchsorted(mesh.y, point[1]) - 1, 0, mesh.y.size - 2))
    s = float(np.clip((point[0] - mesh.x[column]) / (mesh.x[column + 1] - mesh.x[column]), 0, 1))
    t = float(np.clip((point[1] - mesh.y[row]) / (mesh.y[row + 1] - mesh.y[row]), 0, 1))
    rising = [1 - max(s, t), max(s - t, 0.0), max(t - s, 0.0), min(s, t)]
    lower, upper = max(1 - s - t, 0.0), max(s + t - 1, 0.0)
    falling = [lower, s - upper, t - upper, upper]
    return _Place(row, column, np.array([rising, falling]))


# --- travel times -----------------------------------------------------------------------------


@njit(cache=True)
def _passage(
    dx: float,
    dy: float,
    winds: FloatArray,
    speed: float,
    deviation: float,
    crab: bool,  # noqa: FBT001
) -> float:
    """Time (s) along (dx, dy) m in the most helpful of three currents (3, 2).

    Projected, a vessel may tack: v + c·T is no convex polar below v/2, and its hull there is
    v²/(-4 c·T).
    """
    length = math.sqrt(dx * dx + dy * dy)
    tx, ty = dx / length, dy / length
    fastest, helpful = _SLOWEST * speed, -math.inf
    for k in range(3):
        along = winds[k, 0] * tx + winds[k, 1] * ty + (0.0 if crab else deviation)
        helpful = max(helpful, along)
        if crab:
            across = winds[k, 1] * tx - winds[k, 0] * ty
            square = (speed + deviation) ** 2 - across * across
            if square > 0.0:
                fastest = max(fastest, along + math.sqrt(square))
    if not crab:
        tacking = helpful <= -speed / 2
        fastest = max(fastest, -speed * speed / (4 * helpful) if tacking else speed + helpful)
    return float(length / fastest)


@njit(cache=True)
def _arrival(
    legs: FloatArray,
    times: FloatArray,
    winds: FloatArray,
    speed: float,
    deviation: float,
    stretch: float,
    crab: bool,  # noqa: FBT001
) -> float:
    """Earliest arrival (s) from the segment between two nodes with these times.

    `legs` (2, 2) lead from the nodes to the place of arrival, m. A convex function of the place
    on the segment: halving steps find its least value closely enough.
    """
    first = times[0] + stretch * _passage(legs[0, 0], legs[0, 1], winds, speed, deviation, crab)
    if times[1] == np.inf:
        return float(first)
    second = times[1] + stretch * _passage(legs[1, 0], legs[1, 1], winds, speed, deviation, crab)
    best = min(first, second)
    place, least, step = 0.5, np.inf, 0.5
    for k in range(7):
        # The middle, then a step of a quarter, an eighth, a sixteenth to either side.
        if k == 0:
            s = 0.5
        elif k % 2 == 1:
            step /= 2
            centre = place
            s = centre - step
        else:
            s = centre + step
        dx = (1 - s) * legs[0, 0] + s * legs[1, 0]
        dy = (1 - s) * legs[0, 1] + s * legs[1, 1]
        value = (1 - s) * times[0] + s * times[1]
        value += stretch * _passage(dx, dy, winds, speed, deviation, crab)
        if value < least:
            place, least = s, value
    return float(min(best, least))


@njit(cache=True)
def _solve(
    time: FloatArray, dirty: BoolArray, stretch: FloatArray, mesh: _Mesh, cell: FloatArray
) -> None:
    """Lower the times (ny, nx) until none can be bettered through a triangle; from dirty nodes.

    It ends a little after `cell`, a view of some of the times, is known; later nodes stay dirty.

    Dijkstra's order, but a node whose time is bettered later is taken up again: with currents,
    the quickest way to a node may come through one that is reached after it.
    """
    rows, columns = time.shape
    legs, times, winds = np.empty((2, 2)), np.empty(2), np.empty((3, 2))
    queue = [(time[r, c], r, c) for r in range(rows) for c in range(columns) if dirty[r, c]]
    heapq.heapify(queue)
    while queue:
        now, row, column = heapq.heappop(queue)
        if now > _BEYOND * cell.max():
            break
        if not dirty[row, column] or now > time[row, column]:
            continue
        dirty[row, column] = False
        times[0] = now
        winds[0] = mesh.current[row, column]
        for quadrant in range(4):
            dr, dc = 2 * (quadrant // 2) - 1, 2 * (quadrant % 2) - 1
            cell_row, cell_column = row + min(dr, 0), column + min(dc, 0)
            inside = 0 <= cell_row < rows - 1 and 0 <= cell_column < columns - 1
            if not (inside and mesh.wet[cell_row, cell_column]):
                continue
            # Every triangle of this node, another corner that is reached, and a third.
            for pair in range(9):
                i, j = pair // 3 + 1, pair % 3 + 1
                to_row, to_column = row + dr * (i // 2), column + dc * (i % 2)
                if i == j or time[to_row, to_column] <= now:
                    continue
                by_row, by_column = row + dr * (j // 2), column + dc * (j % 2)
                times[1] = time[by_row, by_column]
                if dirty[by_row, by_column] and times[1] > now:
                    times[1] = np.inf  # its turn comes, and this triangle's with it
                winds[1] = mesh.current[by_row, by_column]
                winds[2] = mesh.current[to_row, to_column]
                legs[0, 0] = mesh.x[to_column] - mesh.x[column]
                legs[0, 1] = mesh.y[to_row] - mesh.y[row]
                legs[1, 0] = mesh.x[to_column] - mesh.x[by_column]
                legs[1, 1] = mesh.y[to_row] - mesh.y[by_row]
                arrival = _arrival(
                    legs,
                    times,
                    winds,
                    mesh.speed,
                    mesh.deviation[cell_row, cell_column],
                    stretch[cell_row, cell_column],
                    mesh.crab,
                )
                known = time[to_row, to_column]
                if known == np.inf or arrival < known - _TOLERANCE * (known - now):
                    time[to_row, to_column] = arrival
                    dirty[to_row, to_column] = True
                    heapq.heappush(queue, (arrival, to_row, to_column))


# --- the proof's inequality -------------------------------------------------------------------


@njit(cache=True)
def _projected_rate(px: float, py: float, cx: float, cy: float, speed: float) -> float:
    """Upper bound, nearly attained, on (p·T)(v + c·T) over unit T; p in s/m.

    The Lagrange dual of a quadratic on the unit circle: with w = (v |p|/2)² and the quadratic
    form's eigenvalues e, e' = (p·c ± |p||c|)/2, every μ > e gives the bound
    μ + w μ / ((μ - e)(μ - e')). The least is where (μ - e)(μ - e') = √w √(μ² - e e'); Newton's
    iteration from the right of it. However far it gets, the bound holds.
    """
    p = math.sqrt(px * px + py * py)
    if p == 0.0:
        return 0.0
    dot, product = px * cx + py * cy, p * math.sqrt(cx * cx + cy * cy)
    top, bottom = (dot + product) / 2, (dot - product) / 2
    root = speed * p / 2
    mu = top + root
    least = mu + root * root * mu / ((mu - top) * (mu - bottom))
    for _ in range(6):
        side = math.sqrt(mu * mu - top * bottom)
        residual = (mu - top) * (mu - bottom) - root * side
        slope = 2 * mu - top - bottom - root * mu / side
        following = mu - residual / slope if slope > 0.0 else top
        mu = following if following > top else (mu + top) / 2
        if not mu > top:
            break
        bound = mu + root * root * mu / ((mu - top) * (mu - bottom))
        if bound >= least * (1 - 1e-7):
            return min(bound, least)
        least = bound
    return least


@njit(cache=True)
def _rate(
    px: float,
    py: float,
    winds: FloatArray,
    speed: float,
    deviation: float,
    crab: bool,  # noqa: FBT001
) -> float:
    """λ of a triangle: (p·T) g(x, T) over all T and all x in it is no more; p = ∇u in s/m."""
    p = math.sqrt(px * px + py * py)
    largest = -math.inf
    for k in range(3):
        if crab:
            rate = speed * p + px * winds[k, 0] + py * winds[k, 1]
        else:
            rate = _projected_rate(px, py, winds[k, 0], winds[k, 1], speed)
        largest = max(largest, rate)
    return largest + deviation * p


@njit(cache=True)
def _rates(time: FloatArray, mesh: _Mesh) -> FloatArray:
    """λ of every cell (ny - 1, nx - 1), cut along its better diagonal; 0 where it doesn't count.

    Cells out of reach of the start don't: no route gets there.
    """
    rows, columns = time.shape
    rates = np.zeros((rows - 1, columns - 1))
    winds = np.empty((3, 2))
    for r in range(rows - 1):
        for c in range(columns - 1):
            if not mesh.wet[r, c] or time[r, c] == np.inf:
                continue
            wide, high = mesh.x[c + 1] - mesh.x[c], mesh.y[r + 1] - mesh.y[r]
            best = np.inf
            for falling in range(2):
                worst = 0.0
                for north in range(2):
                    # A triangle has a side along x, in the cell's south or north, and one along
                    # y: across the diagonal from it.
                    east = north if falling else 1 - north
                    px = (time[r + north, c + 1] - time[r + north, c]) / wide
                    py = (time[r + 1, c + east] - time[r, c + east]) / high
                    winds[0] = mesh.current[r + north, c + east]
                    winds[1] = mesh.current[r + north, c + 1 - east]
                    winds[2] = mesh.current[r + 1 - north, c + east]
                    rate = _rate(px, py, winds, mesh.speed, mesh.deviation[r, c], mesh.crab)
                    worst = max(worst, rate)
                best = min(best, worst)
                if best <= 1.0:
                    break
            rates[r, c] = max(best, _SMALLEST)
    return rates


def _relax(rate: FloatArray, stretch: FloatArray, dirty: BoolArray) -> None:
    """Lower the slowness of the cells that broke (1) by how much they did; mark their nodes."""
    broken = rate > 1 + _TOLERANCE
    stretch[broken] /= rate[broken]
    dirty[:-1, :-1] |= broken
    dirty[1:, :-1] |= broken
    dirty[:-1, 1:] |= broken
    dirty[1:, 1:] |= broken


@njit(cache=True)
def _feasible_difference(time: FloatArray, rate: FloatArray, low: float, high: float) -> float:
    """φ(high) - φ(low) with φ' = 1/Λ: a lower bound on the time (s) from u = low to u = high."""
    largest = np.zeros(_LEVELS)
    step = (high - low) / _LEVELS
    if not step > 0.0:
        return 0.0
    for r in range(rate.shape[0]):
        for c in range(rate.shape[1]):
            if rate[r, c] == 0.0:
                continue
            corners = time[r : r + 2, c : c + 2]
            first = math.floor((min(corners.min(), high) - low) / step)
            last = math.floor((min(corners.max(), high) - low) / step)
            # One level more on either side covers rounding.
            for level in range(max(first - 1, 0), min(last + 2, _LEVELS)):
                largest[level] = max(largest[level], rate[r, c])
    total = 0.0
    for level in range(_LEVELS):
        if largest[level] > 0.0:
            total += step / largest[level]
    return total
