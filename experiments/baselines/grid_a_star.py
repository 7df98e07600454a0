"""A* on a grid: one shortest path a homotopy class; also with the paper's Dubins-style motion."""

from __future__ import annotations

import functools
import itertools
import time

import numpy as np

from experiments.baselines.candidate import Candidate, NoPathError, Task
from experiments.baselines.class_search import Graph, best_of_classes
from experiments.baselines.spaces import Space, seed_ompl, with_smoothed
from experiments.kernels.water import PaddedWater
from renew._types import FloatArray, IntArray
from renew.classes.h_signature import Rays

# The eight neighbours in the order of their directions, 45 degrees apart.
_STEPS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
# Start and goal are joined to the nodes within this number of cells.
_REACH = 1.5


def _a_star(task: Task, *, is_dubins: bool) -> list[Candidate]:
    """The shortest path of each class, and each simplified.

    With Dubins-style motion the course changes by at most 45 degrees from step to step.
    """
    seed_ompl(task.seed)
    started = time.process_time()
    voyage, budget = task.voyage, task.budget
    points, steps = grid(task.water, voyage.start, voyage.goal, budget.cell)
    graph = _with_headings(points, steps) if is_dubins else _plain(points, steps)
    rays, size = Rays.of(voyage.chart), len(graph.nodes)
    paths = best_of_classes(graph, rays, budget.classes)
    if not paths:
        raise NoPathError(f"no path on a grid of {budget.cell:g} m")
    seconds = time.process_time() - started
    space = Space(task.water)
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
    legs = [shifted(number, dx, dy) for dx, dy in _STEPS]
    steps = [np.insert(leg, 2, way, axis=1) for way, leg in enumerate(legs)]
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


def shifted(number: IntArray, dx: int, dy: int) -> IntArray:
    """Steps (m, 2) in one direction between free nodes (ny, nx), whose numbers are 0 and more."""
    rows, columns = number.shape
    here = number[max(0, -dy) : rows - max(0, dy), max(0, -dx) : columns - max(0, dx)]
    there = number[max(0, dy) : rows + min(0, dy), max(0, dx) : columns + min(0, dx)]
    both = (here >= 0) & (there >= 0)
    return np.column_stack([here[both], there[both]])


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
