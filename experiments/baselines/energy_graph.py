"""Least energy on a grid at any thrust: Kularatne, Bhattacharya & Hsieh (2018).

A leg of length L in the current c, sailed at the speed s over ground in the direction T, takes the
energy (K + |s T − c|²) L/s: a hotel load, and drag at the square of the speed through water. Each
leg takes the s that is cheapest among those with |s T − c| <= v. With K = v² the vessel sails at v
in still water, as ours does; the path found is then judged at constant thrust like all others.
"""

from __future__ import annotations

import itertools
import math
import time

import numpy as np

import renew
from experiments.baselines.candidate import Candidate, Task
from experiments.baselines.grid_a_star import shifted
from experiments.baselines.with_fuel import quickest
from renew._types import BoolArray, FloatArray, IntArray

# Number of cells of the grid along the longer side.
_CELLS = 150
# Largest number of cells that a leg spans along an axis.
_REACH = 3
# Places on a leg at which the current is taken, by Simpson's rule: its ends and its middle.
_PLACES = (0.0, 0.5, 1.0)
# Their weights.
_WEIGHTS = (1 / 6, 4 / 6, 1 / 6)


def energy_graph(task: Task) -> list[Candidate]:
    """The path of least energy over a grid's legs."""
    started = time.process_time()
    voyage, water = task.voyage, task.water
    xmin, ymin, xmax, ymax = voyage.chart.bounds
    cell = max(xmax - xmin, ymax - ymin) / _CELLS
    x, y = (np.arange(low + cell / 2, high, cell) for low, high in ((xmin, xmax), (ymin, ymax)))
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    free = water.holds(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])
    points = np.vstack([voyage.start, voyage.goal, nodes[free]])
    pairs = np.concatenate([_grid_legs(free), *_end_legs(points, cell)])
    pairs = pairs[water.clear(points[pairs[:, 0]], points[pairs[:, 1]])]
    cost = energies(points[pairs[:, 0]], points[pairs[:, 1]], voyage.current, voyage.vessel.speed)
    usable = np.isfinite(cost)
    path = quickest(points, pairs[usable], cost[usable])
    return [Candidate(path, len(points), seconds=time.process_time() - started)]


def energies(a: FloatArray, b: FloatArray, current: renew.CurrentField, speed: float) -> FloatArray:
    """Least energy (m,) of legs a -> b (m, 2); inf where no way can be made."""
    leg = b - a
    length = np.linalg.norm(leg, axis=1)
    tangent = leg / np.where(length > 0, length, 1.0)[:, None]
    total = np.zeros(len(a))
    for place, weight in zip(_PLACES, _WEIGHTS, strict=True):
        velocity = current(a + place * leg)
        along = (velocity * tangent).sum(axis=1)
        square = (velocity**2).sum(axis=1)
        ahead = speed**2 - (square - along**2)
        fastest = along + np.sqrt(np.maximum(ahead, 0.0))
        slowest = along - np.sqrt(np.maximum(ahead, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            # (K + |sT − c|²)/s = (K + |c|²)/s + s − 2 c·T is least at s² = K + |c|².
            ground = np.clip(np.sqrt(speed**2 + square), np.maximum(slowest, 0.0), fastest)
            a_metre = (speed**2 + square) / ground + ground - 2 * along
        passable = (ahead >= 0) & (fastest > 0) & (square < speed**2)
        total += weight * np.where(passable, a_metre, np.inf)
    return np.where(length > 0, total * length, 0.0)


def _grid_legs(free: BoolArray) -> IntArray:
    """Pairs (m, 2) of free nodes (ny, nx) that stand close; numbers start at 2."""
    number = np.full(free.shape, -1)
    number[free] = 2 + np.arange(free.sum())
    reach = range(-_REACH, _REACH + 1)
    ways = [way for way in itertools.product(reach, repeat=2) if math.gcd(*way) == 1]
    return np.concatenate([shifted(number, dx, dy) for dy, dx in ways])


def _end_legs(points: FloatArray, cell: float) -> list[IntArray]:
    """Legs from the start and to the goal, points 0 and 1, and the nodes around them."""
    legs = []
    for end in (0, 1):
        near = 2 + np.flatnonzero(np.linalg.norm(points[2:] - points[end], axis=1) <= _REACH * cell)
        ends = np.full(len(near), end)
        legs.append(np.column_stack([ends, near] if end == 0 else [near, ends]))
    return legs
