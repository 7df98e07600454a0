"""OMPL's state spaces over padded water, with compiled motion checks and Eq. 4 as an objective.

And OMPL's simplifyMax, with which the paper smooths its baselines.

OMPL: Şucan, Moll & Kavraki, *The Open Motion Planning Library*, 2012.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import ompl.base as ob
import ompl.geometric as og
import ompl.util as ou
from numba import types

import renew
from experiments.baselines.candidate import Candidate, NoPathError
from experiments.baselines.virtual import TWO_STATES, never, of_states, override
from experiments.kernels.dubins import dubins_clear, dubins_path
from experiments.kernels.leg_time import LegTimes, leg_time
from experiments.kernels.water import Buckets, PaddedWater, leg_clear
from renew._types import FloatArray, IntArray
from renew.classes.h_signature import Rays

_Costs: TypeAlias = tuple[IntArray, LegTimes, float]


def seed_ompl(seed: int) -> None:
    """Seed OMPL's random numbers: to be called once in a process, before anything is sampled."""
    ou.setLogLevel(ou.LOG_ERROR)
    ou.RNG.setSeed(seed + 1)  # 0 is no seed


@dataclass
class Calls:
    """Counts the calls of a planner's cost and collision functions: its budget."""

    limit: float = math.inf
    count: IntArray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    def are_used_up(self) -> bool:
        """Whether the planner has to end."""
        return bool(self.count.item() >= self.limit)

    def condition(self) -> Any:  # noqa: ANN401 - OMPL has no types
        """OMPL's termination condition: the calls are used up."""
        return ob.PlannerTerminationCondition(self.are_used_up)


@dataclass
class Space:
    """A state space of OMPL over padded water; poses, if a turning radius (m) is given."""

    water: PaddedWater
    radius: float | None = None
    calls: Calls = field(default_factory=Calls)

    def __post_init__(self) -> None:
        """Build it; the validator must live as long as the space."""
        xmin, ymin, xmax, ymax = self.water.chart.bounds
        bounds = ob.RealVectorBounds(2)
        for axis, low, high in ((0, xmin, xmax), (1, ymin, ymax)):
            bounds.setLow(axis, low)
            bounds.setHigh(axis, high)
        self.space = (
            ob.RealVectorStateSpace(2) if self.radius is None else ob.DubinsStateSpace(self.radius)
        )
        self.space.setBounds(bounds)
        self.information = ob.SpaceInformation(self.space)
        self.information.setStateValidityChecker(self._is_valid)
        if self.radius is not None:
            self.validator = _PoseMotions(self, self.radius)
            self.information.setMotionValidator(self.validator)
        self.information.setup()
        if self.radius is None:
            function = f"_ZNK4ompl4base23DiscreteMotionValidator11checkMotion{TWO_STATES}"
            context = self.calls.count, self.water.buckets
            validator = self.information.getMotionValidator()
            override(validator, "DiscreteMotionValidator", {function: clear_leg}, context)

    def _is_valid(self, state: Any) -> bool:  # noqa: ANN401
        x, y = self.place(state)
        return self.water.holds_one(x, y)

    def place(self, state: Any) -> tuple[float, float]:  # noqa: ANN401
        """Coordinates (m) of a state."""
        return (state[0], state[1]) if self.radius is None else (state.getX(), state.getY())

    def pose(self, state: Any) -> FloatArray:  # noqa: ANN401
        """Coordinates and heading (3,) of a state of a Dubins space."""
        return np.array([state.getX(), state.getY(), state.getYaw()])

    def state(self, point: FloatArray, heading: float = 0.0) -> Any:  # noqa: ANN401
        """Make a state at a point (2,)."""
        state = self.space.allocState()
        if self.radius is None:
            state[0], state[1] = float(point[0]), float(point[1])
        else:
            state.setX(float(point[0]))
            state.setY(float(point[1]))
            state.setYaw(heading)
        return state

    def problem(self, start: FloatArray, goal: FloatArray) -> Any:  # noqa: ANN401
        """A problem of OMPL; poses begin and end on the course from start to goal."""
        course = math.atan2(goal[1] - start[1], goal[0] - start[0])
        problem = ob.ProblemDefinition(self.information)
        problem.setStartAndGoalStates(self.state(start, course), self.state(goal, course))
        return problem

    def solved(self, problem: Any, planner_name: str, step: float | None = None) -> Any:  # noqa: ANN401
        """A planner of OMPL that has solved a problem within the calls; `step` is its longest."""
        planner = getattr(og, planner_name)(self.information)
        if step is not None:
            planner.setRange(step)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(self.calls.condition())
        if not problem.hasExactSolution():
            raise NoPathError(f"no path within {self.calls.limit:,} calls")
        return planner

    def polyline(self, states: list[Any]) -> FloatArray:
        """Points (n, 2) of a path through some states; Dubins paths as their arcs' chords."""
        if self.radius is None:
            return np.array([self.place(state) for state in states])
        poses = [self.pose(state) for state in states]
        pieces = [dubins_path(one, other, self.radius) for one, other in itertools.pairwise(poses)]
        return np.vstack([pieces[0], *(piece[1:] for piece in pieces[1:])])


class _PoseMotions(ob.MotionValidator):  # type: ignore[misc]
    """Tests Dubins paths, exactly."""

    def __init__(self, space: Space, radius: float) -> None:
        super().__init__(space.information)
        self._space, self._radius, self._buckets = space, radius, space.water.buckets

    def checkMotion(self, one: Any, other: Any, _last: object = None) -> bool:  # noqa: N802, ANN401
        """OMPL's name for it."""
        space = self._space
        space.calls.count += 1
        return bool(dubins_clear(space.pose(one), space.pose(other), self._radius, self._buckets))


@of_states(types.boolean)
def clear_leg(context: tuple[IntArray, Buckets], ax: float, ay: float, bx: float, by: float) -> Any:  # noqa: ANN401
    """Whether a leg is clear; exact."""
    count, buckets = context
    count[0] += 1
    return leg_clear(ax, ay, bx, by, buckets)


@of_states(types.float64)
def leg_cost(context: _Costs, ax: float, ay: float, bx: float, by: float) -> Any:  # noqa: ANN401
    """Time of a leg by Eq. 4, which is fuel at constant thrust."""
    count, legs, _ = context
    count[0] += 1
    return leg_time(ax, ay, bx, by, legs)


@of_states(types.float64)
def least_cost(context: _Costs, ax: float, ay: float, bx: float, by: float) -> Any:  # noqa: ANN401
    """Least time that a leg can take: in the strongest current, all the way with it."""
    count, _, fastest = context
    count[0] += 1
    return math.hypot(bx - ax, by - ay) / fastest


def costs(calls: Calls, legs: LegTimes) -> _Costs:
    """Context of the costs of legs: calls, the legs' times, and the fastest speed over ground."""
    return calls.count, legs, legs.speed + legs.table.strongest


def fuel_objective(space: Space, current: renew.CurrentField, vessel: renew.Vessel) -> Any:  # noqa: ANN401
    """Time by Eq. 4 as OMPL's objective."""
    objective = ob.StateCostIntegralObjective(space.information, False)  # noqa: FBT003
    functions = {
        f"_ZNK4ompl4base26StateCostIntegralObjective10motionCost{TWO_STATES}": leg_cost,
        f"_ZNK4ompl4base21OptimizationObjective19motionCostHeuristic{TWO_STATES}": least_cost,
        # There and back differ in a current.
        "_ZNK4ompl4base21OptimizationObjective11isSymmetricEv": never,
    }
    legs = LegTimes.of(space.water.chart, current, vessel)
    override(objective, "StateCostIntegralObjective", functions, costs(space.calls, legs))
    return objective


def smoothed(space: Space, states: list[Any], rays: Rays, size: int) -> Candidate:
    """Simplify a path through states; `size` is that of the tree or roadmap it came from.

    simplifyMax shortens without regard to fuel, and may pull the path across an island.
    """
    started = time.process_time()
    path = og.PathGeometric(space.information)
    for state in states:
        path.append(state)
    before = rays.word(space.polyline(states))
    og.PathSimplifier(space.information).simplifyMax(path)
    after = space.polyline(path.getStates())
    seconds = time.process_time() - started
    return Candidate(after, size, True, rays.word(after) == before, seconds)  # noqa: FBT003


def with_smoothed(
    space: Space, points: FloatArray, rays: Rays, size: int, seconds: float
) -> list[Candidate]:
    """A polyline (n, 2), and the same simplified."""
    states = [space.state(point) for point in points]
    return [Candidate(points, size, seconds=seconds), smoothed(space, states, rays, size)]
