"""The least time of a voyage, bounded on grids that are refined where a better route could be.

See :mod:`renew.bounds.fuel_lower_bound` for the proof, whose conditions are numbered (1) and (2).
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray
from renew.bounds.grids import ROUNDING, halved, in_hours, turned_round, whole_grid
from renew.bounds.march import LEVELS, march, relax
from renew.bounds.travel_time import BEYOND, HELPFUL, MEAN, TravelGrid, locate, solve, source
from renew.voyage.voyage import Voyage

# Number of cells of the grid that is refined first.
_COARSE = 4_000
# Largest number of nodes of all slices together.
_MAX_NODES = 6_000_000
# U, as a multiple of the time in the mean current, on the first grid and on finer ones.
_SLACK, _CLOSE = 1.02, 1.001
# Number of rounds on a grid of two fronts, and of one front alone.
_ROUNDS, _ROUNDS_ALONE = 2, 3
# Share of U above which a bound counts as U itself: then it is U that holds the bound down.
_ALL = 1 - 1e-9


def least_time(voyage: Voyage, cells: int, wanted: float) -> float:
    """Time (s) below which no route of a voyage without stops can stay; a cost at a price of time.

    The finest grid has about `cells` cells in the whole extent. Above `wanted` the bound is made no
    better.
    """
    halvings, proven = max(0, round(math.log(cells / _COARSE, 4))), 0.0
    while True:
        # On a coarse grid the front may slip through narrow land. Then U, taken from it, holds the
        # bound down, and a finer grid is begun with; the finest makes do without U.
        most, bound = _refined(voyage, cells, halvings, wanted)
        proven = max(proven, bound)
        if bound < most * _ALL or halvings == 0:
            return proven
        halvings //= 2


def _refined(voyage: Voyage, cells: int, halvings: int, wanted: float) -> tuple[float, float]:
    """U (s), and a bound no larger than U, from a grid that is halved so many times."""
    room = _MAX_NODES // len(voyage.current.slice_times)
    grid = whole_grid(voyage, max(_COARSE, min(cells // 4**halvings, room)))
    counts, most, slack, proven = grid.wet.copy(), math.inf, _SLACK, 0.0
    for level in range(halvings + 1):
        if level > 0:
            grid, counts = halved(voyage, grid, counts)
        if halvings > 0:
            mean = _mean_time(grid, voyage.start, voyage.goal)
            most, slack = min(most, slack * mean), _CLOSE
            if not voyage.has_price:
                voyage = in_hours(voyage, most)
        proven = max(proven, _on_grid(voyage, grid, counts, most, wanted))
        slices = len(voyage.current.slice_times)
        if proven > wanted or proven >= most * _ALL or 4 * grid.wet.size * slices > _MAX_NODES:
            break
    return most, proven


def _on_grid(
    voyage: Voyage, grid: TravelGrid, counts: BoolArray, most: float, wanted: float
) -> float:
    """Time (s) that a grid proves, `most` at the most; cells that it drops count no longer."""
    ends, proven = (voyage.start, voyage.goal), 0.0
    there, back = Front(grid, *ends), None
    if most < math.inf:
        back = Front(turned_round(grid, grid.departure + most), *ends[::-1])
    for at in range(_ROUNDS if back else _ROUNDS_ALONE):
        for front in (there, back) if back else (there,):
            if at > 0:
                front.relax()
            proven = max(proven, min(most, front.advance(counts)))
            if proven > wanted:
                return proven
        if back:
            drop(counts, there, back, most)
        if not counts.any():
            return most
    return proven


class Rise(NamedTuple):
    """φ (s) by u: `reached` at even levels of u from `low` to `top`, and constant beyond."""

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
    known: FloatArray = field(init=False)
    rates: FloatArray = field(init=False)
    rise: Rise = field(init=False)

    def __post_init__(self) -> None:
        """Begin at the start."""
        self.stretch = np.ones(self.grid.wet.shape)
        self.time, self.dirty = source(self.grid, self.start)

    def advance(self, counts: BoolArray) -> float:
        """Solve for u, make it obey (1) in the cells that count; the time (s) that this proves."""
        at_start, at_goal = locate(self.grid, self.start), locate(self.grid, self.goal)
        solve(self.time, self.dirty, self.stretch, self.grid, at_goal.corners(self.time), HELPFUL)
        # Nodes far beyond the goal need no exact time: any φ will do that obeys (1).
        corners = at_goal.corners(self.time)
        top = BEYOND * float(corners[np.isfinite(corners)].max(initial=0.0))
        self.known = np.minimum(self.time, top)
        low = float(at_start.values(self.known).max())
        self.rates, reached = march(self.known, self.grid, counts, low, top)
        self.rise = Rise(low, top, reached)
        # No wet cells lead to the goal.
        high = float(at_goal.values(self.time).min())
        if high == math.inf:
            return high
        levels = np.linspace(low, top, LEVELS + 1)
        return float(np.interp(high, levels, reached)) * (1 - ROUNDING)

    def relax(self) -> None:
        """Lower the slowness of the cells that broke (1), to solve again."""
        relax(self.rates, self.stretch, self.dirty)


def _mean_time(grid: TravelGrid, start: FloatArray, goal: FloatArray) -> float:
    """Nearly the least time (s) from start to goal: no bound."""
    time, dirty = source(grid, start)
    at_goal = locate(grid, goal)
    solve(time, dirty, np.ones(grid.wet.shape), grid, at_goal.corners(time), MEAN)
    return float(at_goal.values(time).max())


def drop(counts: BoolArray, there: Front, back: Front, most: float) -> None:
    """Cells through which no route quicker than `most` (s) leads don't count from now on: (2)."""
    _drop(counts, there.known, there.rise, back.known, back.rise, most)


@kernel
def _drop(
    counts: BoolArray,
    there: FloatArray,
    rise: Rise,
    back: FloatArray,
    rise_back: Rise,
    most: float,
) -> None:
    """Drop the cells in which φₐ + φᵦ is `most` or more, by linear functions that are no larger."""
    rows, columns = counts.shape
    corners = np.empty(5)
    for r in range(rows):
        for c in range(columns):
            if not counts[r, c]:
                continue
            corners[:] = 0.0
            _add_least(corners, there, r, c, rise)
            _add_least(corners, back, r, c, rise_back)
            counts[r, c] = corners.min() < most


@kernel
def _add_least(corners: FloatArray, time: FloatArray, r: int, c: int, rise: Rise) -> None:
    """Add a function that is nowhere above φ, at a cell's corners and its middle (5,).

    It is linear on the four triangles around the middle, along whichever diagonal u is cut. Between
    the levels of u that the cell spans, φ rises no more slowly than at its least slope there.
    """
    sw, se, nw, ne = time[r, c], time[r, c + 1], time[r + 1, c], time[r + 1, c + 1]
    least, largest = min(sw, se, nw, ne), max(sw, se, nw, ne)
    low, top, reached = rise
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
    corners[0] += base + slope * (sw - least)
    corners[1] += base + slope * (se - least)
    corners[2] += base + slope * (nw - least)
    corners[3] += base + slope * (ne - least)
    corners[4] += base + slope * (middle - least)
