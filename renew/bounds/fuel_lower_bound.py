"""A lower bound on the fuel of every route, over all classes and whatever clearance.

Proof. Let φ be continuous on the water, linear on each triangle of a grid. Along a route with unit
tangent T and ground speed g(x, T) > 0, φ grows by ∇φ·T a metre and time by 1/g. So if

    (∇φ·T) g(x, T) <= 1 for every T, at every x of every triangle that holds water,            (1)

then time >= φ(goal) - φ(start) for every route, and fuel is α vᵏ times that. (Along an edge of the
grid φ's slope is that of the triangles on either side, so (1) covers routes along edges, too.)

φ = f∘u, where u is the vessel's travel time from the start on a grid (`travel_time.py`), each
of whose cells is cut into two triangles. u is only nearly right, and (1) is then *made* true. Each
triangle gets the ratio λ = max (∇u·T) g(x, T) over all T and x in it, never underrated:

- in a triangle the current is within a radius r of the linear interpolant of its corners' currents
  (`interpolation_error.py`); the maximum is convex in the current, so it is taken at a corner;
- crab: g T runs over the disc of radius v about c, so max over T is v |∇u| + ∇u·c;
- projected: max (∇u·T)(v + c·T) over the unit circle is the maximum of a quadratic, bounded by any
  Lagrange multiplier (`growth_rate.py`);
- both grow by at most |δ| |∇u| when c changes by δ, whence the term r |∇u|.

f has slope 1/Λ(u) between start and goal and 0 beyond, where Λ(s) is the largest λ of the cells
through which the level set u = s runs. So (1) holds for φ: ∇φ = ∇u/Λ. Cells of nothing but land
hold no route and don't count; cells that a shore crosses are treated as water. Where λ > 1 (fans
around the start and corners), the cell's slowness is lowered by λ and u is solved again: every
round gives a bound, and the best is returned.

Where the current changes, c is read at the front's own arrival. (1) is asked of the velocities at
x at the time t₀ + φ(x) alone, t₀ being the departure: along a route put m = φ - (t - t₀), which is
0 at the start. Where m > 0 the current differs from that at t₀ + φ by at most κ m, κ bounding its
change with time; so m' <= κ |∇φ| m, and by Grönwall's lemma m <= 0 for ever: nobody is anywhere
before t₀ + φ. (A barrier: it is enough to hold the line on the line.) In a triangle φ runs over
an interval of time, and the current over it is in the hull of those at its ends and at the slices
between, from which λ is taken. λ depends on f, which depends on λ of no later times: f is worked
out from the start on. Λ counts as no less than _LEAST_RATE there (raising it is on the safe side),
so that f rises by no more than the inverse of that: from where a triangle's lowest corner is
reached, that bounds the time at its highest.

What is proven for which current: everything for `UniformCurrent`, `GyreCurrent` and
`GriddedCurrent`, whose deviation r is bounded in closed form. Any other field is known by its
values alone: r is four times the error that the second differences between neighbouring nodes
suggest, so the bound holds for fields that the grid resolves (a cell is under 1 % of a square
extent's side). Of a current that changes r is the largest of all its slices; where it is not linear
between them, the deviation that second differences in time suggest is added.

Where the vessel chooses its speed v, and has to arrive by a deadline D, let λ be a price of time.
(1) is then asked of (∇φ·T) g(x, T, v) <= α vᵏ + λ for every v as well: φ bounds fuel + λ time from
below, and no route that arrives by D needs less fuel than φ(goal) - φ(start) - λ (D - t₀), whatever
λ >= 0 (weak duality). It is taken at the λ of the best route found. In a current that changes φ
does not tell when the vessel is where: (1) is asked, in each cell, of the currents of all hours at
which a vessel may be there that has left at t₀ and arrives by D, as fast as v and the strongest
current together. That is looser, and a little less than the price at the route's end is better.

Currents above v are no obstacle here: such water may be crossed, at no less than its true cost.
"""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.bounds.growth_rate import growth_rate
from renew.bounds.interpolation_error import deviation_radius
from renew.bounds.travel_time import BEYOND, TOLERANCE, TravelGrid, locate, solve, source, wet_cells
from renew.inputs.current import CurrentField
from renew.kernels.current_table import CurrentTable, next_slice, node_velocity, table_of
from renew.voyage.voyage import Voyage

# Number of cells of the grid: the gap is 2 % on the published single gyre; twice as many take twice
# the time and make it 1.5 %. Small eddies need more: with as few the gap is 7 % there.
_CELLS, _CELLS_IN_EDDIES = 16_000, 64_000
# Number where speeds are chosen in a current that changes: that bound is loose, but not for the
# grid.
_CELLS_AT_CHOICE = 4_000
# Price of time there, as a share of the route's own: where all hours count time is worth less.
_SHARE_OF_PRICE = 0.9
# Least number of cells along the shorter side, and largest along the longer.
_MIN_CELLS, _MAX_CELLS = 4, 50_000
# Number of rounds of solving; after the third the bound rises by less than 0.2 %.
_ROUNDS = 3
# Largest number of nodes of all slices together, where eddies ask for more cells.
_MAX_NODES = 6_000_000
# Number of levels of u at which Λ is tabulated.
_LEVELS = 2_000
# Least Λ in a current that changes.
_LEAST_RATE = 0.8
# Least λ that counts; smaller ones are raised to it, which is on the safe side, so that no 1/λ is
# lost to rounding.
_SMALLEST = 0.1
# Share by which the bound is lowered for rounding, and for routes that graze a shore by that share.
_ROUNDING = 1e-6
# Least distance, as a share of a cell, of the grid line through the start from the extent's sides.
_NARROWEST = 0.2


def fuel_lower_bound(voyage: Voyage, cells: int = 0, enough: float = math.inf) -> float:
    """Fuel below which no route from start to goal can stay, over all homotopy classes.

    Infinite if no water joins them. See the module for the proof and for which currents it holds.
    The grid has at least `cells` cells, as far as a changing current's slices leave room: where
    narrow land matters, a coarse one lets the front through. A bound above `enough` (fuel units) is
    made no better.

    With via points the bounds of the parts add up. Each holds for a part begun no earlier than the
    bounds before it say, as a later start brings no earlier end (FIFO). Where
    the current changes, and is as strong as the vessel in places, that may fail: then a part after
    a via point takes no less than the straight way with the strongest current behind.
    """
    if voyage.has_price and voyage.waters.current_change > 0:
        voyage = voyage.at_price(_SHARE_OF_PRICE * voyage.choice.price)
    time, vessel = 0.0, voyage.vessel
    wanted = (enough + voyage.price_of_all_time) / voyage.cost_rate
    knows_order = voyage.current.is_steady or voyage.table.strongest < vessel.speed
    for at in range(len(voyage.via) + 1):
        # At a price of time `time` is a cost, and the hours of each part may be any.
        begin = voyage.departure if voyage.has_price else voyage.departure + time
        part = voyage.part(at, begin)
        if at == 0 or knows_order or voyage.has_price:
            grid = _grid(part, cells)
            proven = 0.0
            for _, _, bound in _rounds(grid, part.start, part.goal):
                proven = max(proven, bound)
                if time + proven > wanted:
                    break
            time += proven
        else:
            fastest = vessel.speed + voyage.table.strongest
            time += math.dist(part.start, part.goal) / fastest
    return voyage.cost_rate * time - voyage.price_of_all_time


def _rounds(
    grid: TravelGrid, start: FloatArray, goal: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray, float]]:
    """Of each round: u at the nodes (s), λ of the cells, and the time (s) that they prove."""
    stretch = np.ones(grid.wet.shape)
    time, dirty = source(grid, start)
    at_start, at_goal = locate(grid, start), locate(grid, goal)
    for _ in range(_ROUNDS):
        solve(time, dirty, stretch, grid, at_goal.corners(time))
        # Nodes far beyond the goal need no exact time: any φ will do that obeys (1).
        known = np.minimum(time, BEYOND * at_goal.corners(time).max())
        low, high = at_start.values(known).max(), at_goal.values(known).min()
        if not math.isfinite(high):
            yield known, np.zeros(grid.wet.shape), math.inf
            return
        rate, proven = _march(known, grid, float(low), float(high))
        yield known, rate, proven * (1 - _ROUNDING)
        _relax(rate, stretch, dirty)


# --- the grid ---------------------------------------------------------------------------------


def _grid(voyage: Voyage, least_cells: int = 0) -> TravelGrid:
    """Grid over the extent's bounding box with a node at the start."""
    chart, start = voyage.chart, voyage.start
    xmin, ymin, xmax, ymax = chart.bounds
    wide, high = xmax - xmin, ymax - ymin
    slices = len(voyage.current.slice_times)
    fewest = _CELLS_AT_CHOICE if voyage.has_price and voyage.waters.current_change > 0 else _CELLS
    wanted = _CELLS_IN_EDDIES if voyage.table.has_small_eddies else fewest
    cells = max(fewest, min(max(wanted, least_cells), _MAX_NODES // slices))
    step = min(math.sqrt(wide * high / cells), wide / _MIN_CELLS, high / _MIN_CELLS)
    x = _axis(xmin, xmax, float(start[0]), max(step, wide / _MAX_CELLS))
    y = _axis(ymin, ymax, float(start[1]), max(step, high / _MAX_CELLS))
    current = _sampled(voyage.current, x, y)
    deviation = deviation_radius(voyage.current, x, y, current.uv)
    strongest = current.strongest + float(deviation.max(initial=0.0))
    wet, hours = wet_cells(chart, x, y), _hours(voyage, x, y, strongest)
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
        away.append(np.hypot(across, up) / (fastest * (1 + _ROUNDING)))
    begin = voyage.departure + away[0]
    # A current that repeats itself has nothing new after a period.
    end = np.minimum(voyage.deadline - away[1], begin + voyage.current.period)
    return np.stack([begin, end])


def _sampled(current: CurrentField, x: FloatArray, y: FloatArray) -> CurrentTable:
    """A current at nodes x (nx,), y (ny,), in slices."""
    nodes, times = np.stack(np.meshgrid(x, y), axis=-1), current.slice_times
    slices = [current.velocity(nodes, time) for time in times.tolist()]
    return table_of(x, y, np.stack(slices), times=times, period=current.period)


def _axis(low: float, high: float, through: float, step: float) -> FloatArray:
    """Ascending nodes from low to high, about a step apart, one at `through` if well inside."""
    inside = min(through - low, high - through) > _NARROWEST * step
    stops = [low, through, high] if inside else [low, high]
    pieces = [
        np.linspace(a, b, max(1, round((b - a) / step)) + 1)[:-1]
        for a, b in itertools.pairwise(stops)
    ]
    return np.concatenate([*pieces, [high]])


# --- the proof's inequality -------------------------------------------------------------------


@kernel
def _rate_in_window(
    px: float,
    py: float,
    nodes: IntArray,
    first: float,
    last: float,
    deviation: float,
    grid: TravelGrid,
    corner_currents: FloatArray,
) -> float:
    """λ of a triangle with nodes (3, 2) in a window of time, s: at its ends and slices between."""
    largest, now = -math.inf, first
    while True:
        for k in range(3):
            corner_currents[k] = node_velocity(grid.current, nodes[k, 0], nodes[k, 1], now)
        largest = max(largest, growth_rate(px, py, corner_currents, deviation, grid.polar))
        if now >= last or len(grid.current.times) == 1:
            return largest
        now = min(next_slice(grid.current, now), last)


@kernel
def _march(time: FloatArray, grid: TravelGrid, low: float, high: float) -> tuple[FloatArray, float]:
    """λ of every cell (ny - 1, nx - 1), 0 where it doesn't count, and φ, s, where u = high.

    Level by level of u from low to high: a cell's λ is worked out when its lowest corner is
    reached, for the times from the present φ to the largest φ that its highest corner can have.
    """
    rows, columns = grid.wet.shape
    rates = np.zeros((rows, columns))
    step = (high - low) / _LEVELS
    if not step > 0.0:
        return rates, 0.0
    # Where speeds are chosen u doesn't tell the time: that may be any up to the deadline.
    is_any_time = grid.polar.least < grid.polar.speed
    least = _SMALLEST if is_any_time or len(grid.current.times) == 1 else _LEAST_RATE
    first, order = _by_level(time, grid, low, step)
    largest = np.zeros(_LEVELS + 1)
    clock, k = 0.0, 0
    corner_currents, nodes = np.empty((3, 2)), np.empty((3, 2), dtype=np.int64)
    for level in range(_LEVELS + 1):
        while k < len(order) and first[order[k]] <= level:
            r, c = order[k] // columns, order[k] % columns
            k += 1
            south, north = max(time[r, c], time[r, c + 1]), max(time[r + 1, c], time[r + 1, c + 1])
            highest = max(south, north)
            lasts = max(highest - (low + level * step), 0.0) / least
            begin = grid.departure + clock
            # A current that repeats itself has nothing new after a period.
            end = begin + min(lasts, grid.current.period)
            if is_any_time:
                begin, end = grid.hours[0, r, c], grid.hours[1, r, c]
                if end < begin:
                    continue
            rates[r, c] = _cell_rate(time, grid, r, c, begin, end, nodes, corner_currents)
            # One level more on either side covers rounding.
            last = math.floor((min(highest, high) - low) / step) + 1
            for above in range(level, min(last, _LEVELS) + 1):
                largest[above] = max(largest[above], rates[r, c])
        if level < _LEVELS and largest[level] > 0.0:
            clock += step / max(largest[level], least)
    return rates, clock


@kernel
def _by_level(
    time: FloatArray, grid: TravelGrid, low: float, step: float
) -> tuple[IntArray, IntArray]:
    """Level of u at which each cell (c,) begins to count; the cells that count, in that order.

    Cells out of reach of the start don't count: no route gets there. Cells beyond the last level
    come last.
    """
    rows, columns = grid.wet.shape
    first = np.full(rows * columns, _LEVELS + 1)
    # Sorted by counting: where the cells of each level begin.
    begin = np.zeros(_LEVELS + 2, dtype=np.int64)
    for r in range(rows):
        for c in range(columns):
            if grid.wet[r, c] and time[r, c] < np.inf:
                south, north = (
                    min(time[r, c], time[r, c + 1]),
                    min(time[r + 1, c], time[r + 1, c + 1]),
                )
                level = math.floor((min(south, north) - low) / step) - 1
                level = min(max(level, 0), _LEVELS)
                first[r * columns + c] = level
                begin[level + 1] += 1
    for level in range(_LEVELS + 1):
        begin[level + 1] += begin[level]
    order = np.empty(begin[_LEVELS + 1], dtype=np.int64)
    for cell in range(rows * columns):
        level = first[cell]
        if level <= _LEVELS:
            order[begin[level]] = cell
            begin[level] += 1
    return first, order


@kernel
def _cell_rate(
    time: FloatArray,
    grid: TravelGrid,
    r: int,
    c: int,
    first: float,
    last: float,
    nodes: IntArray,
    corner_currents: FloatArray,
) -> float:
    """λ of a cell, cut along its better diagonal, in a window of time, s.

    `nodes` (3, 2) and `corner_currents` (3, 2) are written to.
    """
    wide, high = grid.x[c + 1] - grid.x[c], grid.y[r + 1] - grid.y[r]
    best = np.inf
    for falling in range(2):
        worst = 0.0
        for north in range(2):
            # A triangle has a side along x, in the cell's south or north, and one along
            # y: across the diagonal from it.
            east = north if falling else 1 - north
            px = (time[r + north, c + 1] - time[r + north, c]) / wide
            py = (time[r + 1, c + east] - time[r, c + east]) / high
            nodes[0, 0], nodes[0, 1] = r + north, c + east
            nodes[1, 0], nodes[1, 1] = r + north, c + 1 - east
            nodes[2, 0], nodes[2, 1] = r + 1 - north, c + east
            rate = _rate_in_window(
                px, py, nodes, first, last, grid.deviation[r, c], grid, corner_currents
            )
            worst = max(worst, rate)
            if worst >= best:
                break
        best = min(best, worst)
        if best <= 1.0:
            break
    return max(best, _SMALLEST)


def _relax(rate: FloatArray, stretch: FloatArray, dirty: BoolArray) -> None:
    """Lower the slowness of each cell that broke (1) by its λ; mark its nodes."""
    broken = rate > 1 + TOLERANCE
    stretch[broken] /= rate[broken]
    dirty[:-1, :-1] |= broken
    dirty[1:, :-1] |= broken
    dirty[:-1, 1:] |= broken
    dirty[1:, 1:] |= broken
