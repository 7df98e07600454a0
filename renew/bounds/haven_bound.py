"""A lower bound on the time from any place of the water to a haven.

It is the bound of :mod:`renew.bounds.fuel_lower_bound`, from the haven outwards in the opposite
current: a way there, sailed backwards. φ(x) is then a bound for every x at once. In a current that
changes no such equation holds backwards, because the time of arrival is not known (Vladimirsky,
2006). There the current at a place may be any in a ball that holds its currents of all hours: no
vessel is faster over ground than in the best of these.

Grids are refined where φ is below `most`. A quicker way never leaves that water, because φ of the
grid before bounds it, too: so min(φ, `most`) is a bound on the finer grid, too.
"""

from dataclasses import dataclass, replace

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.bounds.fuel_lower_bound import Rise, drop_cells, u_range
from renew.bounds.grids import ROUNDING, halved, in_hours, turned_round, whole_grid
from renew.bounds.march import LEVELS, march
from renew.bounds.travel_time import BEYOND, TravelGrid, locate, solve, source
from renew.kernels.current_table import table_of
from renew.voyage.voyage import Voyage

# Number of cells of the first grid.
_FIRST = 8_000
# Largest number of cells that count on the finest grid.
_MOST_CELLS = 40_000
# Number of rounds on each grid.
_ROUNDS = 5
# Multiple of `most` up to which φ is solved for on the first grid, where it orders havens that are
# farther.
_FARTHER = 4.0
# The same on finer grids.
_BEYOND = 1.25


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
        grid = whole_grid(voyage, _FIRST)
        known = [_solved(_outwards(grid), grid.wet, voyage.goal, _FARTHER * most, np.inf)]
        while True:
            counts = _below(known[-1], most)
            if not counts.any() or 4 * counts.sum() > _MOST_CELLS:
                return cls(tuple(known))
            grid, counts = halved(voyage, grid, counts)
            known.append(_solved(_outwards(grid), counts, voyage.goal, _BEYOND * most, most))

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
    stretch, place = np.ones(grid.wet.shape), locate(grid, haven)
    found = list[_Known]()
    # A view, as the kernel knows it: it ends a little after these times.
    until = np.full((4, 4), top / BEYOND)[:2, :2]
    for _ in range(_ROUNDS):
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
