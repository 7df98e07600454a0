"""Rivals for least fuel, which the paper lacks: OMPL's anytime planners with the cost of Eq. 4.

BIT* (Gammell et al., 2015), RRT* and PRM* (Karaman & Frazzoli, 2011). They end after a number of
calls of their cost and collision functions. Their paths are not simplified afterwards, because
simplifyMax ignores fuel, and not rounded. So they may be a little cheaper than a path that can be
steered.
"""

from __future__ import annotations

import functools
import time

import numpy as np
import ompl.geometric as og
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from experiments.baselines.candidate import Candidate, NoPathError, Task
from experiments.baselines.roadmaps import roadmap
from experiments.baselines.spaces import Calls, Space, fuel_objective, seed_ompl
from experiments.kernels.leg_time import LegTimes, leg_times
from renew._types import FloatArray, IntArray

# More nodes than PRM* reaches: its budget of calls ends it first.
_NODES = 1_000_000


def _anytime(task: Task, planner_name: str) -> list[Candidate]:
    """The best path that a tree finds within its calls."""
    seed_ompl(task.seed)
    started = time.process_time()
    voyage = task.voyage
    space = Space(task.water, calls=Calls(task.budget.calls))
    objective = fuel_objective(space, voyage.current, voyage.vessel)
    problem = space.problem(voyage.start, voyage.goal)
    problem.setOptimizationObjective(objective)
    planner = space.solved(problem, planner_name)
    states = list(problem.getSolutionPath().getStates())
    # PlannerData of an unfinished BIT* batch is slow to make; the number of batches serves as well.
    size = planner.numIterations()
    seconds = time.process_time() - started
    return [Candidate(space.polyline(states), int(size), seconds=seconds)]


bit_star = functools.partial(_anytime, planner_name="BITstar")
rrt_star_fuel = functools.partial(_anytime, planner_name="RRTstar")


def prm_star_fuel(task: Task) -> list[Candidate]:
    """The path of least fuel on OMPL's PRM* roadmap, each edge with its fuel there and back."""
    seed_ompl(task.seed)
    started = time.process_time()
    voyage, space = task.voyage, Space(task.water, calls=Calls(task.budget.calls))
    ends = voyage.start, voyage.goal
    points, pairs = roadmap(og.PRMstar(space.information), space, _NODES, ends)
    legs = LegTimes.of(voyage.chart, voyage.current, voyage.vessel)
    a, b = (np.ascontiguousarray(points[pairs[:, end]]) for end in (0, 1))
    cost = leg_times(a, b, legs)
    path = quickest(points, pairs[np.isfinite(cost)], cost[np.isfinite(cost)])
    return [Candidate(path, len(points), seconds=time.process_time() - started)]


def quickest(points: FloatArray, pairs: IntArray, cost: FloatArray) -> FloatArray:
    """Path (n, 2) of least cost from point 0 to point 1 over directed edges (m, 2)."""
    graph = csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    total, before = dijkstra(graph, indices=0, return_predecessors=True)
    if not np.isfinite(total[1]):
        raise NoPathError(f"no path over {len(points)} nodes")
    row = [1]
    while row[-1] != 0:
        row.append(int(before[row[-1]]))
    return np.asarray(points[row[::-1]])
