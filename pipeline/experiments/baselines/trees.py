"""RRT (LaValle, 1998) and RRT* (Karaman & Frazzoli, 2011) up to their first solution, by OMPL.

As in the paper: the published sizes of both trees are equal, so RRT* stops there as well.
"""

from __future__ import annotations

import functools
import time
from typing import TYPE_CHECKING

import ompl.base as ob
import ompl.geometric as og

from pipeline.experiments.baselines.candidate import Budget, Candidate, NoPathError
from pipeline.experiments.baselines.smoothing import smoothed
from pipeline.experiments.baselines.spaces import Calls, Space, seed_ompl
from renew.classes.h_signature import Rays

if TYPE_CHECKING:
    import renew
    from pipeline.experiments.kernels.water import PaddedWater
    from renew._types import FloatArray

# Longest step of a tree (m): with it the trees are about as large as published. A tree of poses
# takes the environment's own.
_RANGE = 4.0


def _tree(
    chart: renew.Chart,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    start: FloatArray,
    goal: FloatArray,
    *,
    water: PaddedWater,
    budget: Budget,
    seed: int,
    planner_name: str,
    is_dubins: bool,
) -> list[Candidate]:
    """First solution of a tree, and the same simplified."""
    del current
    seed_ompl(seed)
    started = time.process_time()
    radius = vessel.turning_radius if is_dubins else None
    space = Space(water, radius, Calls(budget.calls))
    problem = space.problem(start, goal)
    objective = ob.PathLengthOptimizationObjective(space.information)
    # Any solution is good enough.
    objective.setCostThreshold(objective.infiniteCost())
    problem.setOptimizationObjective(objective)
    planner = getattr(og, planner_name)(space.information)
    planner.setRange(budget.dubins_step if is_dubins else _RANGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(space.calls.condition())
    if not problem.hasExactSolution():
        raise NoPathError(f"no path within {budget.calls:,} calls")
    data = ob.PlannerData(space.information)
    planner.getPlannerData(data)
    states = list(problem.getSolutionPath().getStates())
    seconds = time.process_time() - started
    original = Candidate(space.polyline(states), data.numVertices(), seconds=seconds)
    return [original, smoothed(space, states, Rays.of(chart), data.numVertices())]


rrt = functools.partial(_tree, planner_name="RRT", is_dubins=False)
rrt_star = functools.partial(_tree, planner_name="RRTstar", is_dubins=False)
rrt_dubins = functools.partial(_tree, planner_name="RRT", is_dubins=True)
rrt_star_dubins = functools.partial(_tree, planner_name="RRTstar", is_dubins=True)
