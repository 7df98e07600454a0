"""A* on a grid: one shortest path a homotopy class; also with the paper's Dubins-style motion."""

from __future__ import annotations

import functools
import itertools
import time
from typing import TYPE_CHECKING

import numpy as np

from pipeline.experiments.baselines.candidate import Budget, Candidate, NoPathError
from pipeline.experiments.baselines.class_search import Graph, best_of_classes
from pipeline.experiments.baselines.smoothing import with_smoothed
from pipeline.experiments.baselines.spaces import Space, seed_ompl
from renew.classes.h_signature import Rays

if TYPE_CHECKING:
    import renew
    from pipeline.experiments.kernels.water import PaddedWater
    from renew._types import FloatArray, IntArray

# The eight neighbours in the order of their directions, 45 degrees apart.
_STEPS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
# Start and goal are joined to the nodes within this number of cells.
_REACH = 1.5


def _a_star(
    chart: renew.Chart,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    start: FloatArray,
    goal: FloatArray,
    *,
    water: PaddedWater,
    budget: Budget,
    seed: int,
    is_dubins: bool,
) -> list[Candidate]:
    """The shortest path of each class, and each simplified.

    With Dubins-style motion the course changes by at most 45 degrees from step to step.
    """
    del current, vessel
    seed_ompl(seed)
    started = time.process_time()
    points, steps = grid(water, start, goal, budget.cell)
    graph = _with_headings(points, steps) if is_dubins else _plain(points, steps)
    paths = best_of_classes(graph, Rays.of(chart), budget.classes)
    if not paths:
        raise NoPathError(f"no path on a grid of {budget.cell:g} m")
    seconds = time.process_time() - started
    space, rays, size = Space(water), Rays.of(chart), len(graph.nodes)
    found = (with_smoothed(space, path, rays, size, seconds) for path in paths)
    return list(itertools.chain.from_iterable(found))


a_star = functools.partial(_a_star, is_dubins=False)
a_star_dubins = functools.partial(_a_star, is_dubins=True)


def grid(
    water: PaddedWater, start: FloatArray, goal: FloatArray, cell: float
) -> tuple[FloatArray, IntArray]:
    """Points (n, 2), start and goal first, and clear steps (m, 3): from, to, direction.

    Start and goal are joined to the nodes around; such steps have the nearest of the directions.
    """
    xmin, ymin, xmax, ymax = water.chart.bounds
    x, y = (np.arange(low + cell / 2, high, cell) for low, high in ((xmin, xmax), (ymin, ymax)))
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    free = water.holds(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])
    number = np.full(free.shape, -1)
    number[free] = 2 + np.arange(free.sum())
    points = np.vstack([start, goal, nodes[free]])
    steps = [_shifted(number, dx, dy, way) for way, (dx, dy) in enumerate(_STEPS)]
    for end, is_start in ((0, True), (1, False)):
        near = 2 + np.flatnonzero(np.abs(points[2:] - points[end]).max(axis=1) < _REACH * cell)
        leg = points[near] - points[end]
        leg = leg if is_start else -leg
        way = np.round(np.arctan2(leg[:, 1], leg[:, 0]) / (np.pi / 4)).astype(int) % 8
        ends = np.full(len(near), end)
        pair = (ends, near) if is_start else (near, ends)
        steps.append(np.column_stack([*pair, way]))
    every = np.concatenate(steps)
    return points, every[water.clear(points[every[:, 0]], points[every[:, 1]])]


def _shifted(number: IntArray, dx: int, dy: int, way: int) -> IntArray:
    """Steps (m, 3) in one direction between free nodes (ny, nx)."""
    rows, columns = number.shape
    here = number[max(0, -dy) : rows - max(0, dy), max(0, -dx) : columns - max(0, dx)]
    there = number[max(0, dy) : rows + min(0, dy), max(0, dx) : columns + min(0, dx)]
    both = (here >= 0) & (there >= 0)
    return np.column_stack([here[both], there[both], np.full(both.sum(), way)])


def _plain(points: FloatArray, steps: IntArray) -> Graph:
    """Graph of the steps."""
    cost = np.linalg.norm(points[steps[:, 1]] - points[steps[:, 0]], axis=1)
    return Graph(points, steps[:, :2], cost)


def _with_headings(points: FloatArray, steps: IntArray) -> Graph:
    """Graph of (node, direction of arrival): a step may follow one at most 45 degrees off.

    Node 0 is the start, which may be left in any direction; the goal may be reached from any.
    """
    cost = np.linalg.norm(points[steps[:, 1]] - points[steps[:, 0]], axis=1)
    tails, heads, costs = [], [], []
    for turn in (-1, 0, 1):
        before = (steps[:, 2] + turn) % 8
        tail = np.where(steps[:, 0] == 0, 0, 1 + 8 * steps[:, 0] + before)
        # From the start once is enough.
        keep = (steps[:, 0] != 0) | (turn == 0)
        tails.append(tail[keep])
        heads.append((1 + 8 * steps[:, 1] + steps[:, 2])[keep])
        costs.append(cost[keep])
    edges = np.column_stack([np.concatenate(tails), np.concatenate(heads)])
    nodes = np.vstack([points[:1], np.repeat(points, 8, axis=0)])
    goals = tuple(range(1 + 8, 1 + 16))
    return Graph(nodes, edges, np.concatenate(costs), goals=goals)
