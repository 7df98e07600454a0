"""The task of a baseline, and what it returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import renew
from experiments.kernels.water import PaddedWater
from renew._types import FloatArray
from renew.voyage.voyage import Voyage


class NoPathError(renew.PlanningError):
    """A baseline found no path within its budget."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A path (n, 2), m, and how it came about.

    Attributes
    ----------
    states : size of the tree, roadmap or grid that was searched.
    is_smoothed : whether it was simplified afterwards.
    is_class_kept : whether the simplified path is of the original's class; None for an original.
    seconds : CPU time of the search, or of the simplification for a simplified path.
    """

    path: FloatArray
    states: int
    is_smoothed: bool = False
    is_class_kept: bool | None = None
    seconds: float = 0.0


@dataclass(frozen=True)
class Budget:
    """How much a baseline may do: counted, not timed, so that results repeat.

    Attributes
    ----------
    classes : number of homotopy classes, for baselines that search by class.
    cell : size of a grid's cells, m.
    nodes : number of a roadmap's nodes.
    dubins_step : longest step of trees of poses, m.
    calls : number of calls of a tree's or an anytime planner's cost and collision functions.
    """

    classes: int = 16
    cell: float = 2.0
    nodes: int = 2000
    dubins_step: float = 14.0
    calls: int = 400_000


@dataclass(frozen=True, eq=False)
class Task:
    """The task of a baseline: a voyage in some water."""

    voyage: Voyage
    water: PaddedWater
    budget: Budget
    seed: int = 0


Baseline: TypeAlias = "Callable[[Task], list[Candidate]]"
