"""Zermelo's isochrones: least arrival times over the whole water, and the way back along them.

The times are those of `renew.bounds.travel_time`: the vessel crabs, as in Zermelo's problem (1931).
The path is followed back from the goal from isochrone to isochrone.
"""

from __future__ import annotations

import math
import time

import numpy as np

from experiments.baselines.candidate import Candidate, NoPathError, Task
from experiments.kernels.leg_time import LegTimes, leg_times
from experiments.kernels.water import PaddedWater
from renew._types import BoolArray, FloatArray
from renew.bounds.travel_time import TravelGrid, mean_times
from renew.kernels.current_table import table_of
from renew.kernels.ground_speed import Polar

# Number of cells of the grid along the longer side.
_CELLS = 400
# Length of a step back, in cells.
_STEP = 2.0
# Number of directions that are tried.
_DIRECTIONS = 180
# Number of steps, as a multiple of those straight across the chart, after which it gives up.
_DETOUR = 20


def isochrone(task: Task) -> list[Candidate]:
    """The quickest way of a vessel that crabs."""
    started = time.process_time()
    voyage, vessel = task.voyage, task.voyage.vessel
    start, goal = voyage.start, voyage.goal
    xmin, ymin, xmax, ymax = voyage.chart.bounds
    side = max(xmax - xmin, ymax - ymin)
    x, y = (
        np.linspace(low, high, math.ceil(_CELLS * (high - low) / side) + 1)
        for low, high in ((xmin, xmax), (ymin, ymax))
    )
    velocity = voyage.current(np.stack(np.meshgrid(x, y), axis=-1))
    weak = (velocity**2).sum(axis=-1) < vessel.speed**2
    wet = _wet(task.water, weak, x, y, (start, goal))
    none = np.zeros(wet.shape)
    table = table_of(x, y, velocity)
    polar, metres = Polar(vessel.speed, crab=True), np.ones(wet.shape)
    grid = TravelGrid(x, y, table, 0.0, none, wet, polar, metres)
    times = mean_times(grid, start, goal)
    path = _followed_back(grid, times, task)
    return [Candidate(path, times.size, seconds=time.process_time() - started)]


def _wet(
    water: PaddedWater,
    weak: BoolArray,
    x: FloatArray,
    y: FloatArray,
    ends: tuple[FloatArray, FloatArray],
) -> BoolArray:
    """Cells (ny - 1, nx - 1) whose corners are in the water, as are all their edges.

    Cells around start and goal count, too: these may lie in a corner of the padding.
    """
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    # The extent's own edge is water, but no point on it lies inside.
    inside = nodes.copy()
    inset = 1e-6 * (x[-1] - x[0])
    inside[..., 0] = np.clip(inside[..., 0], x[0] + inset, x[-1] - inset)
    inside[..., 1] = np.clip(inside[..., 1], y[0] + inset, y[-1] - inset)
    free = water.holds(inside.reshape(-1, 2)).reshape(nodes.shape[:2]) & weak
    level = water.clear(inside[:, :-1].reshape(-1, 2), inside[:, 1:].reshape(-1, 2))
    level = level.reshape(len(y), len(x) - 1) & free[:, :-1] & free[:, 1:]
    upright = water.clear(inside[:-1].reshape(-1, 2), inside[1:].reshape(-1, 2))
    upright = upright.reshape(len(y) - 1, len(x)) & free[:-1] & free[1:]
    wet = level[:-1] & level[1:] & upright[:, :-1] & upright[:, 1:]
    for end in ends:
        row, column = np.searchsorted(y, end[1]) - 1, np.searchsorted(x, end[0]) - 1
        wet[max(row, 0) : row + 2, max(column, 0) : column + 2] = True
    return np.asarray(wet)


def _followed_back(grid: TravelGrid, times: FloatArray, task: Task) -> FloatArray:
    """Path (n, 2) from the start to the goal, step by step against the arrival times."""
    voyage, water, start = task.voyage, task.water, task.voyage.start
    legs = LegTimes.of(voyage.chart, voyage.current, voyage.vessel)
    step = _STEP * float(grid.x[1] - grid.x[0])
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    circle = step * np.column_stack([np.cos(angle), np.sin(angle)])
    path, now = [voyage.goal], math.inf
    for _ in range(_DETOUR * _CELLS):
        here = path[-1]
        if math.dist(here, start) <= step and water.clear(here[None], start[None])[0]:
            return np.array([*path, start])[::-1]
        around = here + circle
        there = np.broadcast_to(here, around.shape)
        arrival = _interpolated(grid, times, around)
        ahead = arrival + leg_times(np.ascontiguousarray(around), np.ascontiguousarray(there), legs)
        ahead[~(water.clear(around, there) & (arrival < now))] = np.inf
        best = int(ahead.argmin())
        if not math.isfinite(ahead[best]):
            break
        now = float(arrival[best])
        path.append(around[best])
    raise NoPathError(f"the isochrones lead nowhere from {path[-1].round(1).tolist()} m")


def _interpolated(grid: TravelGrid, times: FloatArray, points: FloatArray) -> FloatArray:
    """Arrival times (n,), s, at points (n, 2), bilinear; inf beside what can't be reached."""
    column = np.clip(np.searchsorted(grid.x, points[:, 0]) - 1, 0, len(grid.x) - 2)
    row = np.clip(np.searchsorted(grid.y, points[:, 1]) - 1, 0, len(grid.y) - 2)
    s = (points[:, 0] - grid.x[column]) / (grid.x[column + 1] - grid.x[column])
    t = (points[:, 1] - grid.y[row]) / (grid.y[row + 1] - grid.y[row])
    outside = (np.minimum(s, t) < 0) | (np.maximum(s, t) > 1)
    # Where a corner is out of reach the nearest of the others stands for it.
    corners = np.stack([times[row + j, column + i] for j in (0, 1) for i in (0, 1)], axis=-1)
    known = np.where(np.isfinite(corners), corners, corners.min(axis=-1, keepdims=True))
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=-1)
    weighted = (np.where(np.isfinite(known), known, 0.0) * weights).sum(axis=-1)
    reachable = np.isfinite(known).all(axis=-1) & ~outside
    return np.where(reachable, weighted, np.inf)
