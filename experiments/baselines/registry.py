"""All planners by name: what each is, and how often it runs."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Literal, cast

from experiments.baselines.candidate import Baseline

Group = Literal["ours", "paper", "fuel"]

# Calls after which a tree of points gives up.
_TREE = 200_000
# Calls after which a tree of poses gives up. OMPL has no index of poses, so the time of such a tree
# grows with its square: RRT*-D needs 3 to 20 s up to its first solution on real charts, 2,700 to
# 10,300 calls; with all of these some 25 s.
_DUBINS_TREE = 12_000


@dataclass(frozen=True, slots=True)
class Planner:
    """A planner that is compared.

    Attributes
    ----------
    name : its label in tables, in the column `planner`.
    group : ours, one of the paper's baselines, or a rival with fuel as its objective.
    module, function : where it is; empty for ours.
    runs : number of seeds in a full run; 1 where nothing is drawn.
    calls : budget of a tree or of an anytime planner, in calls of its functions: 1 to 4 s of one
        core, or for a tree more than it mostly needs to its first solution; 0 for others.
    """

    name: str
    group: Group
    module: str = ""
    function: str = ""
    runs: int = 1
    calls: int = 0

    def load(self) -> Baseline:
        """Import the baseline."""
        module = importlib.import_module(f"experiments.baselines.{self.module}")
        return cast("Baseline", getattr(module, self.function))


PLANNERS = {
    planner.name: planner
    for planner in (
        Planner("RENEW", "ours"),
        Planner("RENEW sampled", "ours", runs=10),
        Planner("RENEW as published", "ours", runs=10),
        Planner("RRT", "paper", "trees", "rrt", 10, _TREE),
        Planner("RRT-D", "paper", "trees", "rrt_dubins", 10, _DUBINS_TREE),
        Planner("RRT*", "paper", "trees", "rrt_star", 10, _TREE),
        Planner("RRT*-D", "paper", "trees", "rrt_star_dubins", 10, _DUBINS_TREE),
        Planner("PRM", "paper", "roadmaps", "prm", 10),
        Planner("PRM-D", "paper", "roadmaps", "prm_dubins", 10),
        Planner("A*", "paper", "grid_a_star", "a_star"),
        Planner("A*-D", "paper", "grid_a_star", "a_star_dubins"),
        Planner("BIT*", "fuel", "with_fuel", "bit_star", 3, 8_000_000),
        Planner("RRT* Eq. 4", "fuel", "with_fuel", "rrt_star_fuel", 3, 1_600_000),
        Planner("PRM*", "fuel", "with_fuel", "prm_star_fuel", 3, 850_000),
        Planner("isochrone", "fuel", "isochrone", "isochrone"),
        Planner("energy graph", "fuel", "energy_graph", "energy_graph"),
    )
}
