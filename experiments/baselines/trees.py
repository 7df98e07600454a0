"""RRT (LaValle, 1998) and RRT* (Karaman & Frazzoli, 2011) up to their first solution, by OMPL.

As in the paper: the published sizes of both trees are equal, so RRT* stops there as well.
"""

from __future__ import annotations

import functools
import time

import ompl.base as ob

from experiments.baselines.candidate import Candidate, Task
from experiments.baselines.spaces import Calls, Space, seed_ompl, smoothed
from renew.classes.h_signature import Rays

# Longest step of a tree (m): with it the trees are about as large as published. A tree of poses
# takes the environment's own.
_RANGE = 4.0


def _tree(task: Task, planner_name: str, *, is_dubins: bool) -> list[Candidate]:
    """First solution of a tree, and the same simplified."""
    seed_ompl(task.seed)
    started = time.process_time()
    voyage, budget = task.voyage, task.budget
    radius = voyage.vessel.turning_radius if is_dubins else None
    space = Space(task.water, radius, Calls(budget.calls))
    problem = space.problem(voyage.start, voyage.goal)
    objective = ob.PathLengthOptimizationObjective(space.information)
    # Any solution is good enough.
    objective.setCostThreshold(objective.infiniteCost())
    problem.setOptimizationObjective(objective)
    planner = space.solved(problem, planner_name, budget.dubins_step if is_dubins else _RANGE)
    data = ob.PlannerData(space.information)
    planner.getPlannerData(data)
    states = list(problem.getSolutionPath().getStates())
    seconds = time.process_time() - started
    original = Candidate(space.polyline(states), data.numVertices(), seconds=seconds)
    return [original, smoothed(space, states, Rays.of(voyage.chart), data.numVertices())]


rrt = functools.partial(_tree, planner_name="RRT", is_dubins=False)
rrt_star = functools.partial(_tree, planner_name="RRTstar", is_dubins=False)
rrt_dubins = functools.partial(_tree, planner_name="RRT", is_dubins=True)
rrt_star_dubins = functools.partial(_tree, planner_name="RRTstar", is_dubins=True)
