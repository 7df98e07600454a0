"""BIT* (Gammell et al., 2015) as OMPL has it, with Eq. 4 as its objective, on scenes of eddies.

OMPL is no dependency of ours: `pip install ompl` into an environment beside it, or skip this.
Python callbacks cost it time, so the cost of a leg is compiled; its path isn't smoothed, nor
rounded, so it may be a little cheaper than one that can be steered.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import time
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import shapely

import renew
from tests.bench.figure import Figure
from tests.compiler import compiled
from tests.eddies import PEAK_M_S, SCENES, eddy_scene
from tests.strategies import PAPER_VESSEL

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from renew._types import FloatArray
    from tests.eddies import Eddies, Scene

    State: TypeAlias = Sequence[float]
    LegTime: TypeAlias = Callable[[float, float, float, float], float]

RUNS, BUDGET_S = 2, 30.0
"""Runs a scene, and the time of each on the processor."""

# Of the scenes of eddies, one in so many is taken.
_EVERY = 4
# Gauss-Legendre nodes and weights of a piece of a leg, and pieces for each half-wave of the eddies.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_PIECES = 2


def figures() -> Iterator[Figure]:
    """How far BIT* gets below the best route, as a share of that; at most 0.01 % is asked."""
    chosen = SCENES[::_EVERY]
    name = f"BIT*, {BUDGET_S:g} s, {RUNS} runs, {len(chosen)} scenes of eddies"
    if importlib.util.find_spec("ompl") is None:
        yield Figure(name, "never below ours by 0.01 %", "skipped: ompl is not installed")
        return
    # Once a process: the next runs go on with the same stream.
    importlib.import_module("ompl.util").RNG.setSeed(1)
    below = []
    for spec in chosen:
        scene = eddy_scene(*spec)
        ours = scene.plan(padding="none").best.fuel
        theirs = min(_bitstar_fuel(scene, spec[1]) for _ in range(RUNS))
        below.append(1 - theirs / ours)
        share = f"{100 * (theirs / ours - 1):+.3f} %"
        yield Figure(f"BIT*, scene {spec[0]}, beside ours", "", f"{theirs:.2f} ({share})")
    text = f"{100 * max(below):.3f} % below"
    yield Figure(name, "never below ours by 0.01 %", text, max(below) <= 1e-4)


def _bitstar_fuel(scene: Scene, waves: int) -> float:
    """Fuel of the best path that BIT* finds in its time; inf if it finds none."""
    base: Any = importlib.import_module("ompl.base")
    geometric: Any = importlib.import_module("ompl.geometric")
    util: Any = importlib.import_module("ompl.util")
    util.setLogLevel(util.LOG_ERROR)
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for axis in (0, 1):
        bounds.setLow(axis, scene.chart.bounds[axis])
        bounds.setHigh(axis, scene.chart.bounds[axis + 2])
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    leg_time = _leg_time_of(scene.current, waves)
    edges, land = _edges(scene.chart), shapely.union_all(np.array(scene.chart.no_go, dtype=object))
    shapely.prepare(land)
    _is_clear(edges, 0.0, 0.0, 1.0, 1.0)
    information.setStateValidityChecker(
        lambda state: not shapely.intersects_xy(land, state[0], state[1])
    )

    class Clear(base.MotionValidator):  # type: ignore[misc]
        """Legs are tested exactly."""

        def checkMotion(self, a: State, b: State, _last: object = None) -> bool:  # noqa: N802
            return bool(_is_clear(edges, a[0], a[1], b[0], b[1]))

    class Time(base.OptimizationObjective):  # type: ignore[misc]
        """Time by Eq. 4, which is fuel at constant thrust."""

        def stateCost(self, _state: State) -> object:  # noqa: N802
            return base.Cost(0.0)

        def motionCost(self, a: State, b: State) -> object:  # noqa: N802
            return base.Cost(leg_time(a[0], a[1], b[0], b[1]))

        def motionCostHeuristic(self, a: State, b: State) -> object:  # noqa: N802
            fastest = PAPER_VESSEL.speed * (1 + PEAK_M_S)
            return base.Cost(math.hypot(b[0] - a[0], b[1] - a[1]) / fastest)

    validator = Clear(information)
    information.setMotionValidator(validator)
    information.setup()
    start, goal = space.allocState(), space.allocState()
    for state, point in ((start, scene.start), (goal, scene.goal)):
        state[0], state[1] = map(float, point)
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(start, goal)
    objective = Time(information)
    problem.setOptimizationObjective(objective)
    planner = geometric.BITstar(information)
    planner.setProblemDefinition(problem)
    planner.setup()
    # The time of the process: other programs on the machine cost BIT* none of its budget.
    end = time.process_time() + BUDGET_S
    planner.solve(base.PlannerTerminationCondition(lambda: time.process_time() > end))
    if not problem.hasExactSolution():
        return math.inf
    states = problem.getSolutionPath().getStates()
    path = np.array([[state[0], state[1]] for state in states])
    return float(renew.fuel(path, scene.current, PAPER_VESSEL))


def _leg_time_of(current: Eddies, waves: int) -> LegTime:
    """Time (s) of a leg by Eq. 4 in some eddies, compiled: a function of its ends' coordinates."""
    terms, side, factor = current.terms, current.side, current.factor
    speed, piece = PAPER_VESSEL.speed, current.side / waves / _PIECES

    @compiled
    def leg_time(ax: float, ay: float, bx: float, by: float) -> float:
        length = math.hypot(bx - ax, by - ay)
        if length == 0.0:
            return 0.0
        tx, ty = (bx - ax) / length, (by - ay) / length
        pieces = math.ceil(length / piece)
        total = 0.0
        for k in range(pieces * len(_NODES)):
            node = k % len(_NODES)
            place = (k // len(_NODES) + (_NODES[node] + 1) / 2) / pieces
            x, y = ax + place * (bx - ax), ay + place * (by - ay)
            along = 0.0
            for term in range(len(terms)):
                strength, a, phase_x, b, phase_y = terms[term]
                east = a * math.pi / side * x + phase_x
                north = b * math.pi / side * y + phase_y
                along -= factor * strength * b * math.sin(east) * math.cos(north) * tx
                along += factor * strength * a * math.cos(east) * math.sin(north) * ty
            total += _WEIGHTS[node] / 2 / pieces * length / (speed + along)
        return total

    # Compiled before the budget starts.
    leg_time(0.0, 0.0, 1.0, 1.0)
    return leg_time


def _edges(chart: renew.Chart) -> FloatArray:
    """Edges (e, 4) of the land, m."""
    rings = [np.asarray(polygon.exterior.coords) for polygon in chart.no_go]
    legs = [np.hstack([ring[:-1], ring[1:]]) for ring in rings]
    return np.vstack([np.empty((0, 4)), *legs])


@compiled
def _is_clear(edges: FloatArray, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether a leg crosses none of some edges (e, 4)."""
    for k in range(len(edges)):
        px, py, qx, qy = edges[k]
        p = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
        q = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
        a = (qx - px) * (ay - py) - (qy - py) * (ax - px)
        b = (qx - px) * (by - py) - (qy - py) * (bx - px)
        if p * q <= 0.0 and a * b <= 0.0:
            return False
    return True
