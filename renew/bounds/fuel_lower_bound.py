"""A lower bound on the fuel of every route, over all classes and whatever clearance.

Proof. Let φ be continuous on the water, smooth on each triangle of a grid. Along a route with unit
tangent T and ground speed g(x, T) > 0, φ grows by ∇φ·T a metre and time by 1/g. So if

    (∇φ·T) g(x, T) <= 1 for every T, at every x of every triangle that holds water,            (1)

then time >= φ(goal) - φ(start) for every route, and fuel is α vᵏ times that. (Along an edge of the
grid φ's slope is that of the triangles on either side, so (1) covers routes along edges, too.)

φ = f∘u, where u is the vessel's travel time from the start on a grid (`travel_time.py`), each
of whose cells is cut into two triangles. On a triangle u is quadratic: it has the travel times at
the corners, and bends on each side as the times at the nodes beyond its ends suggest (`march.py`).
Both triangles of a side share its bend, so u is continuous. u is only nearly right, and (1) is then
*made* true. Each triangle gets the ratio λ = max (∇u·T) g(x, T) over all T and x in it, never
underrated:

- in a triangle the current is within a radius r of the linear interpolant of its corners' currents
  (`grids.py`), and ∇u is linear. So (∇u·T) g is, for each T, a quadratic function of the place: at
  most the largest value at a corner and 2/3 of the largest bend on a side, -2 (δ∇u·T)(δc·T) with
  half the differences of ∇u and of c between its ends;
- crab: g T runs over the disc of radius v about c, so max over T is v |∇u| + ∇u·c, and the bend is
  -2 δ∇u·δc;
- projected: max (∇u·T)(v + c·T) over the unit circle is the maximum of a quadratic, bounded by any
  Lagrange multiplier (`march.py`), and the bend is at most |δ∇u||δc| - δ∇u·δc;
- both grow by at most |δ| |∇u| when c changes by δ, whence the term r |∇u|.

f has slope 1/Λ(u) between start and goal and 0 beyond, where Λ(s) is the largest λ of the cells
through which the level set u = s runs. So (1) holds for φ: ∇φ = ∇u/Λ. Cells of nothing but land
hold no route and don't count; cells that a shore crosses are treated as water. Where λ > 1 (fans
around the start and corners), the cell's slowness is lowered by λ and u is solved again: every
round gives a bound, and the best is returned.

Cells that no better route can cross don't count either. Let U be any time, φₐ such a φ, and φᵦ one
from the goal in the opposite current. A route that takes less than U is at x no earlier than φₐ,
and needs at least φᵦ from there on. So it keeps to the places where

    φₐ(x) + φᵦ(x) < U,                                                                           (2)

and (1) need hold only there. Then no route takes less than min(U, φₐ(goal)), or than
min(U, φᵦ(start)): one that leaves these cells takes at least U, any other at least what φ says.
Cells that are left are cut in four, on that finer grid more are dropped by (2), and so on. Within a
cell φ is no less than f at the least u, and rises with u no more slowly than f does anywhere
between the cell's least and largest u; (2) is tested with this lower bound on φ. U is the time of
the front in the mean current, and a little more. It need not be the time of any route: where it is
too small, the bound is U.

Where the current changes, c is read at the front's own arrival. (1) is asked of the velocities at
x at the time t₀ + φ(x) alone, t₀ being the departure: along a route put m = φ - (t - t₀), which is
0 at the start. Where m > 0 the current differs from that at t₀ + φ by at most κ m, κ bounding its
change with time; so m' <= κ |∇φ| m, and by Grönwall's lemma m <= 0 for ever: no vessel is anywhere
before t₀ + φ. (So (1) need hold at this one time only.) In a triangle φ runs over an interval of
time, and the current over it is in the hull of those at its ends and at the slices between, from
which λ is taken. f depends on λ, and λ on f at no later times, so f is worked out from the start
on. Λ counts as no less than _LEAST_RATE there (raising it is on the safe side), so that f's slope
is at most the inverse of that: this bounds φ at a triangle's highest corner once its lowest is
reached.

φᵦ is such a φ, too, with the clock running backwards from t₀ + U: a route that takes less than U is
at the goal by then, m = φᵦ - (t₀ + U - t) is at most 0 there, and, by the same lemma, all along the
way back. So the route is at x no later than t₀ + U - φᵦ(x), which is (2). It meets no current after
t₀ + U, so none is read.

What is proven for which current: everything for `UniformCurrent`, `GyreCurrent` and
`GriddedCurrent`, whose deviation r is bounded in closed form. Any other field is known by its
values alone: r is four times the error that the second differences between neighbouring nodes
suggest, so the bound holds for fields that the grid resolves (a cell is under 1 % of a square
extent's side). For a changing current r is the largest over all its slices; where it is not linear
between them, the deviation that second differences in time suggest is added.

Where the vessel chooses its speed v, and has to arrive by a deadline D, let λ be a price of time.
(1) is then asked of (∇φ·T) g(x, T, v) <= α vᵏ + λ for every v as well: φ bounds fuel + λ time from
below, and no route that arrives by D needs less fuel than φ(goal) - φ(start) - λ (D - t₀), whatever
λ >= 0 (weak duality). It is taken at the λ of the best route found. In a changing current φ does
not tell when the vessel is where. So (1) is asked in each cell of the currents of all hours at
which a vessel may be there that leaves at t₀, arrives by D and goes no faster than v plus the
strongest current. This is looser, and a λ a little below the price at the route's end gives a
better bound.

In a uniform current a linear φ that obeys (1) at one point obeys it everywhere. The best one says
how long the straight way takes at the speed of the convex hull of all velocities over ground, which
is exact in free water. Where land is in the way, the grid's φ is mostly better; the larger bound
counts.

Currents above v are no obstacle here: such water may be crossed, at no less than its true cost.

A lower bound on the time from any place of the water to a haven (`HavenBound`) is this bound from
the haven outwards in the opposite current: a way there, sailed backwards. φ(x) is then a bound for
every x at once. In a current that changes no such equation holds backwards, because the time of
arrival is not known (Vladimirsky, 2006). There the current at a place may be any in a ball that
holds its currents of all hours: no vessel is faster over ground than in the best of these.

A haven's grids are refined where φ is below `most`. A quicker way never leaves that water, because
φ of the grid before bounds it, too: so min(φ, `most`) is a bound on the finer grid, too.
"""

import math
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, reading_kernel
from renew._types import BoolArray, FloatArray
from renew.bounds.grids import ROUNDING, halved, in_hours, turned_round, whole_grid
from renew.bounds.march import LEVELS, march, set_bends
from renew.bounds.travel_time import (
    BEYOND,
    PointInCell,
    TravelGrid,
    locate,
    mean_times,
    solve,
    source,
)
from renew.inputs.current import UniformCurrent
from renew.kernels.current_table import table_of
from renew.voyage.voyage import Voyage

# Least number of cells of the grid that is refined first.
_COARSE = 2_000
# Largest number of nodes of all slices together.
_MAX_NODES = 6_000_000
# Share of these nodes for which a grid is planned.
_SPARE = 0.9
# U on the first grid, as a multiple of the time in the mean current.
_SLACK = 1.02
# The same on finer grids.
_CLOSE = 1.001
# Number of rounds on the finest grid.
_ROUNDS = 3
# Number of rounds on coarser grids, which only tell which cells count.
_ROUNDS_BEFORE = 2
# A bound above this share of U counts as limited by U.
_ALL = 1 - 1e-9


def least_time(voyage: Voyage, cells: int, wanted: float) -> float:
    """Return a lower bound (s) on a voyage without via points; on its cost, at a price of time.

    The finest grid has about `cells` cells in the whole extent. Refinement ends when the bound is
    above `wanted`.
    """
    cells = min(cells, int(_SPARE * _MAX_NODES / _slices_met(voyage)))
    halvings, proven = max(0, math.floor(math.log(cells / _COARSE, 4))), _straight_time(voyage)
    if proven > wanted:
        return proven
    while True:
        # On a coarse grid the front may slip through narrow land. Then U is too small and limits
        # the bound, so the next try begins with a finer grid; the finest does not use U.
        most, bound = _refined(voyage, cells, halvings, wanted)
        proven = max(proven, bound)
        if bound < most * _ALL or halvings == 0:
            return proven
        halvings //= 2


def _straight_time(voyage: Voyage) -> float:
    """Return the time (s) of the straight way in a uniform current, without land; else 0."""
    current, speed = voyage.current, voyage.vessel.speed
    way = voyage.goal - voyage.start
    length = math.hypot(*way) * float(voyage.chart.metres.min())
    if not isinstance(current, UniformCurrent) or voyage.has_price or length == 0:
        return 0.0
    along = (current.u * way[0] + current.v * way[1]) / math.hypot(*way)
    across = (current.u * way[1] - current.v * way[0]) / math.hypot(*way)
    if voyage.drift == "crab":
        made = along + math.sqrt(max(speed**2 - across**2, 0.0))
    else:
        # Against more than half of its speed the vessel is quicker by tacking.
        made = speed + along if along > -speed / 2 else -(speed**2) / (4 * along)
    return length / made * (1 - ROUNDING) if made > 0 else 0.0


def _slices_met(voyage: Voyage) -> int:
    """Estimate the number of slices of the current that a quick route meets."""
    if not (voyage.has_price or voyage.current.is_steady):
        mean = _mean_time(whole_grid(voyage, _COARSE), voyage.start, voyage.goal)
        voyage = in_hours(voyage, _SLACK * mean)
    return len(voyage.current.slice_times)


def _refined(voyage: Voyage, cells: int, halvings: int, wanted: float) -> tuple[float, float]:
    """Return U (s), and a bound no larger than U, from a grid that is refined `halvings` times."""
    room = _MAX_NODES // len(voyage.current.slice_times)
    grid = whole_grid(voyage, max(_COARSE, min(cells // 4**halvings, room)))
    counts, most, slack, proven = grid.wet.copy(), math.inf, _SLACK, 0.0
    for level in range(halvings + 1):
        if level > 0:
            grid, counts = halved(voyage, grid, counts)
        # Grids finer than the second hardly change U.
        if halvings > 0 and level <= 1:
            most, slack = min(most, slack * _mean_time(grid, voyage.start, voyage.goal)), _CLOSE
            if not voyage.has_price:
                voyage = in_hours(voyage, most)
        rounds = _ROUNDS if level == halvings else _ROUNDS_BEFORE
        proven = max(proven, _on_grid(voyage, grid, counts, most, wanted, rounds))
        slices = len(voyage.current.slice_times)
        if proven > wanted or proven >= most * _ALL or 4 * grid.wet.size * slices > _MAX_NODES:
            break
        # In a strait a hundred thousand times as long as it is wide, even the first grid has more
        # cells than are asked for.
        if grid.wet.size > cells:
            break
    return most, proven


def _on_grid(
    voyage: Voyage,
    grid: TravelGrid,
    counts: BoolArray,
    most: float,
    wanted: float,
    rounds: int,
) -> float:
    """Return the bound (s) that a grid proves, up to `most`; dropped cells count no longer."""
    ends, proven = (voyage.start, voyage.goal), 0.0
    there, back = Front(grid, *ends), None
    if most < math.inf:
        back = Front(turned_round(grid, grid.departure + most), *ends[::-1])
    for at in range(rounds):
        for front in (there, back) if back else (there,):
            if at > 0:
                front.relax()
            proven = max(proven, min(most, front.advance(counts)))
            if proven > wanted:
                return proven
        if back:
            # Cells through which no route quicker than `most` leads don't count from now on: (2).
            drop_cells(counts, grid.wet, there.rise, back.rise, most)
        if not counts.any():
            return most
    return proven


class Rise(NamedTuple):
    """φ (s) by u: `reached` at even levels of u from `low` to `top`, and constant beyond.

    `time` (ny, nx), s, is u at the nodes of a grid.
    """

    time: FloatArray
    low: float
    top: float
    reached: FloatArray


@dataclass
class Front:
    """Travel times from one end of a voyage to the other on a grid, and what they prove."""

    grid: TravelGrid
    start: FloatArray
    goal: FloatArray
    time: FloatArray = field(init=False)
    dirty: BoolArray = field(init=False)
    stretch: FloatArray = field(init=False)
    rates: FloatArray = field(init=False)
    rise: Rise = field(init=False)

    def __post_init__(self) -> None:
        """Begin at the start."""
        self.stretch = self.grid.metres.copy()
        self.time, self.dirty = source(self.grid, self.start)

    def advance(self, counts: BoolArray) -> float:
        """Solve for u so that (1) holds in the cells that count; return the bound (s) proven."""
        at_start, at_goal = locate(self.grid, self.start), locate(self.grid, self.goal)
        solve(self.time, self.dirty, self.stretch, self.grid, at_goal.corners(self.time))
        # Nodes far beyond the goal need no exact time: any φ will do that obeys (1).
        corners = at_goal.corners(self.time)
        top = BEYOND * float(corners[np.isfinite(corners)].max(initial=0.0))
        known = np.minimum(self.time, top)
        _, low = u_range(known, self.grid.wet, at_start)
        self.rates, reached = march(known, self.grid, counts, low, top)
        self.rise = Rise(known, low, top, reached)
        # No wet cells lead to the goal.
        if np.isinf(at_goal.values(self.time)).all():
            return math.inf
        high, _ = u_range(known, self.grid.wet, at_goal)
        levels = np.linspace(low, top, LEVELS + 1)
        return float(np.interp(high, levels, reached)) * (1 - ROUNDING)

    def relax(self) -> None:
        """Lower the slowness of the cells that broke (1), to begin again at the start."""
        self.stretch /= np.maximum(self.rates, 1.0)
        self.time, self.dirty = source(self.grid, self.start)


def u_range(known: FloatArray, wet: BoolArray, place: PointInCell) -> tuple[float, float]:
    """Bounds of u (ny, nx) at a place."""
    bends = np.empty(6)
    set_bends(bends, known, wet, place.row, place.column)
    off = (1 - (place.weights**2).sum(axis=1)) * np.abs(bends).max()
    values = place.values(known)
    return float((values - off).min()), float((values + off).max())


def _mean_time(grid: TravelGrid, start: FloatArray, goal: FloatArray) -> float:
    """Estimate the least time (s) from start to goal; this is no bound."""
    return float(locate(grid, goal).values(mean_times(grid, start, goal)).max())


@kernel
def drop_cells(counts: BoolArray, wet: BoolArray, there: Rise, back: Rise, most: float) -> None:
    """Drop the cells in which linear functions that are nowhere above φₐ + φᵦ reach `most`."""
    rows, columns = counts.shape
    corners, bends = np.empty(5), np.empty(6)
    for r in range(rows):
        for c in range(columns):
            if not counts[r, c]:
                continue
            corners[:] = 0.0
            set_bends(bends, there.time, wet, r, c)
            _add_least(corners, there, bends, r, c)
            set_bends(bends, back.time, wet, r, c)
            _add_least(corners, back, bends, r, c)
            counts[r, c] = corners.min() < most


@reading_kernel
def _add_least(corners: FloatArray, rise: Rise, bends: FloatArray, r: int, c: int) -> None:
    """Add a function that is nowhere above φ, at a cell's corners and its middle (5,).

    It is linear on the four triangles around the middle, along whichever diagonal u is cut. Between
    the levels of u that the cell spans, φ rises no more slowly than at its least slope there.
    """
    time, low, top, reached = rise
    sw, se, nw, ne = time[r, c], time[r, c + 1], time[r + 1, c], time[r + 1, c + 1]
    lowest, largest = min(sw, se, nw, ne), max(sw, se, nw, ne)
    # Within a triangle u differs from the linear function through the corners by at most two thirds
    # of the bends.
    least = lowest + 2 / 3 * min(bends.min(), 0.0)
    largest += 2 / 3 * max(bends.max(), 0.0)
    levels = len(reached) - 1
    step = (top - low) / levels
    if not step > 0.0 or not largest < np.inf:
        return
    first = min(max(int((least - low) / step) - 1, 0), levels)
    last = min(max(int((largest - low) / step) + 2, 0), levels)
    slope = 0.0
    # Below the first level and above the last φ is constant.
    if least > low and largest < top:
        slope = np.inf
        for k in range(first, last):
            slope = min(slope, reached[k + 1] - reached[k])
        slope /= step
    at = max(least - low, 0.0) / step
    k = min(int(at), levels - 1)
    base = reached[k] + (min(at, levels) - k) * (reached[k + 1] - reached[k])
    middle = min((sw + ne) / 2, (se + nw) / 2)
    corners[0] += base + slope * (sw - lowest)
    corners[1] += base + slope * (se - lowest)
    corners[2] += base + slope * (nw - lowest)
    corners[3] += base + slope * (ne - lowest)
    corners[4] += base + slope * (middle - lowest)


# Number of cells of the finest grid, were it to cover the whole extent.
_CELLS = 128_000
# The same if speeds are chosen in a changing current: a finer grid does not tighten that loose
# bound.
_CELLS_AT_CHOICE = 4_000
# Price of time in that case, as a share of the route's own: a lower price gives a better bound.
_SHARE_OF_PRICE = 0.9


def fuel_lower_bound(voyage: Voyage, cells: int = 0, enough: float = math.inf) -> float:
    """Return a lower bound on the fuel of any route from start to goal, over all homotopy classes.

    It is infinite if no water joins start and goal. See the module for the proof, and for the
    currents for which it holds. The grid has at least `cells` cells, unless many slices of a
    changing current need the memory: on a coarse grid the front slips through narrow land.
    Refinement ends when the bound is above `enough` (fuel units).

    With via points the bounds of the parts add up. Each bound assumes that its part begins when the
    bounds before it end, or later; a later start never means an earlier end (FIFO). This may fail
    in a changing current that is as strong as the vessel in places. Then the bound of a part after
    a via point is the straight line with the strongest current behind the vessel.
    """
    fewest = _CELLS
    if voyage.has_price and voyage.waters.current_change > 0:
        voyage = replace(voyage, price=_SHARE_OF_PRICE * voyage.price)
        fewest = _CELLS_AT_CHOICE
    time = 0.0
    wanted = (enough + voyage.price_of_all_time) / voyage.cost_rate
    knows_order = voyage.current.is_steady or voyage.table.strongest < voyage.vessel.speed
    for at in range(len(voyage.via) + 1):
        # At a price of time `time` is a cost, and the hours of each part may be any.
        begin = voyage.departure if voyage.has_price else voyage.departure + time
        part = voyage.part(at, begin)
        if at == 0 or knows_order or voyage.has_price:
            time += least_time(part, max(cells, fewest), wanted - time)
        else:
            time += part.least_duration
    return voyage.cost_rate * time - voyage.price_of_all_time


# Number of cells of the finest grid if a gap is asked for: four times the standard number.
_FINE_CELLS = 512_000


@dataclass(frozen=True, repr=False, eq=False)
class FuelBound:
    """The fuel that every route of a voyage needs at least, whatever its class.

    It is computed from the voyage when first asked for, unless a number is given; once, also where
    two threads ask. If `enough` (fuel units) is finite, the grid may be refined further, until the
    bound is above it.
    """

    source: Voyage | float
    enough: float = math.inf
    _known: list[float] = field(default_factory=list, init=False)
    # A `cached_property` has one lock for all instances before Python 3.12: threads that plan
    # several voyages would wait for each other's bounds.
    _lock: Lock = field(default_factory=Lock, init=False)

    @property
    def value(self) -> float:
        """The bound on any route (fuel units); see :mod:`renew.bounds.fuel_lower_bound`."""
        if not isinstance(self.source, Voyage):
            return self.source
        with self._lock:
            if not self._known:
                # With chosen speeds the bound is loose on any grid.
                is_fine = self.enough < math.inf and not self.source.has_price
                cells = _FINE_CELLS if is_fine else 0
                self._known.append(fuel_lower_bound(self.source, cells, self.enough))
            return self._known[0]

    def __reduce__(self) -> "tuple[type[FuelBound], tuple[float]]":
        """Pickle the bound instead of its source: a current may be any function."""
        return FuelBound, (self.value,)

    def gap(self, fuel: float) -> float:
        """Share by which fuel exceeds the bound on any route, >= 0."""
        return max(0.0, fuel / self.value - 1) if self.value > 0 else math.inf


# Number of cells of the first grid.
_FIRST_CELLS = 8_000
# Largest number of cells that count on the finest grid.
_MOST_CELLS = 40_000
# Number of rounds on each grid.
_HAVEN_ROUNDS = 5
# Multiple of `most` up to which φ is solved for on the first grid, where it orders havens that are
# farther.
_FARTHER = 4.0
# The same on finer grids.
_BEYOND_HAVENS = 1.25


@dataclass(frozen=True, eq=False)
class _Known:
    """φ on one grid, proven up to `most` (s)."""

    grid: TravelGrid
    rise: Rise
    most: float

    def at(self, point: FloatArray) -> float:
        """Return the bound (s) at a point (2,)."""
        grid = self.grid
        if not (grid.x[0] <= point[0] <= grid.x[-1] and grid.y[0] <= point[1] <= grid.y[-1]):
            return self.most
        least, _ = u_range(self.rise.time, grid.wet, locate(grid, point))
        levels = np.linspace(self.rise.low, self.rise.top, LEVELS + 1)
        return min(float(np.interp(least, levels, self.rise.reached)) * (1 - ROUNDING), self.most)


@dataclass(frozen=True, eq=False)
class HavenBound:
    """Bounds on the time to a haven, on coarser and finer grids."""

    _known: tuple[_Known, ...]

    @classmethod
    def of(cls, voyage: Voyage, most: float, until: float) -> "HavenBound":
        """Return the bounds to a voyage's goal for the hours from its departure `until` (s).

        They are close up to `most` (s). The voyage's start counts for nothing.
        """
        voyage = in_hours(replace(voyage, start=voyage.goal), until - voyage.departure)
        grid = whole_grid(voyage, _FIRST_CELLS)
        known = [_solved(_outwards(grid), grid.wet, voyage.goal, _FARTHER * most, np.inf)]
        while True:
            counts = _below(known[-1], most)
            if not counts.any() or 4 * counts.sum() > _MOST_CELLS:
                return cls(tuple(known))
            grid, counts = halved(voyage, grid, counts)
            known.append(_solved(_outwards(grid), counts, voyage.goal, _BEYOND_HAVENS * most, most))

    def at(self, points: FloatArray) -> FloatArray:
        """Return bounds (n,), s, at points (n, 2), m; 0 off the chart."""
        x, y = self._known[0].grid.x, self._known[0].grid.y
        on = ((points >= (x[0], y[0])) & (points <= (x[-1], y[-1]))).all(axis=1)
        least = np.zeros(len(points))
        least[on] = [self._at(point) for point in points[on]]
        return least

    def _at(self, point: FloatArray) -> float:
        """Return the bound (s) at a point (2,): of the finest grid, up to where that is close."""
        first, finest = self._known[0], self._known[-1]
        least = first.at(point)
        return max(least, finest.at(point)) if least < finest.most else least


def _outwards(grid: TravelGrid) -> TravelGrid:
    """Return a grid in the opposite current; in all currents of its hours at once, if it changes.

    Between nodes, and between slices, the current is within the ball of the corners' balls.
    """
    table = grid.current
    if len(table.times) > 1:
        uv = np.asarray(table.uv)
        middle = (uv.min(axis=0) + uv.max(axis=0)) / 2
        spread = np.linalg.norm(uv - middle, axis=-1).max(axis=0)
        corners = np.maximum(spread[:-1], spread[1:])
        grid = grid._replace(
            current=table_of(grid.x, grid.y, middle[None], times=table.times[:1]),
            deviation=grid.deviation + np.maximum(corners[:, :-1], corners[:, 1:]),
        )
    return turned_round(grid, grid.departure)


def _solved(
    grid: TravelGrid, counts: BoolArray, haven: FloatArray, top: float, most: float
) -> _Known:
    """Return the best bound of a few rounds on a grid: up to a `top` u, proven up to `most` (s)."""
    stretch, place = grid.metres, locate(grid, haven)
    found = list[_Known]()
    # A view, as the kernel knows it: it ends a little after these times.
    until = np.full((4, 4), top / BEYOND)[:2, :2]
    for _ in range(_HAVEN_ROUNDS):
        time, dirty = source(grid, haven)
        solve(time, dirty, stretch, grid, until)
        time = np.minimum(time, top)
        _, low = u_range(time, grid.wet, place)
        rates, reached = march(time, grid, counts, low, top)
        found.append(_Known(grid, Rise(time, low, top, reached), most))
        stretch = stretch / np.maximum(rates, 1.0)
    return max(found, key=lambda one: float(one.rise.reached[-1]))


def _below(known: _Known, most: float) -> BoolArray:
    """Return the wet cells (ny - 1, nx - 1) that may hold a place with φ below `most` (s)."""
    cells, wet = known.grid.wet.copy(), known.grid.wet
    nothing = Rise(np.zeros(known.rise.time.shape), 0.0, 0.0, np.zeros(LEVELS + 1))
    drop_cells(cells, wet, known.rise, nothing, most)
    return cells
