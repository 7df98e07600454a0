"""Imported once by the fork server: compiles all kernels, so that no job waits for that.

Nothing of OMPL is touched that draws random numbers: each job seeds them itself.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util

import numpy as np
from shapely import box

import renew
from experiments.baselines.candidate import Budget, Task
from experiments.baselines.energy_graph import energy_graph
from experiments.baselines.isochrone import isochrone
from experiments.kernels.dubins import dubins_clear, dubins_motions
from experiments.kernels.leg_time import LegTimes, leg_time
from experiments.kernels.water import PaddedWater, leg_clear
from renew.voyage.voyage import Voyage, Waters
from renew.warming import REHEARSALS, rehearse


def _warm() -> None:
    """Call every kernel once with the types of a job."""
    for _ in rehearse():
        pass
    chart = renew.Chart(box(0, 0, 40, 40), [box(10, 10, 14, 14)])
    vessel = renew.Vessel(speed=1.0, turn_rate=0.6)
    water, start, goal = PaddedWater.of(chart, 1.0), np.array([2.0, 2.0]), np.array([30.0, 30.0])
    pose, other = np.array([2.0, 2.0, 0.0]), np.array([30.0, 30.0, 0.5])
    leg_clear(2.0, 2.0, 30.0, 30.0, water.buckets)
    dubins_clear(pose, other, 1.6, water.buckets)
    dubins_motions(np.stack([pose, other]), np.array([[0, 1]]), 1.6, water.buckets)
    currents = [one for _, one, _ in REHEARSALS[:3] if isinstance(one, renew.CurrentField)]
    for current in currents:
        leg_time(2.0, 2.0, 30.0, 30.0, LegTimes.of(chart, current, vessel))
        voyage = Voyage(Waters(chart, current), vessel, start, goal, "projected")
        for planner in (isochrone, energy_graph):
            planner(Task(voyage, water, Budget()))
    # Jobs need these modules, and get them from the fork server.
    for name in ("jobs", "environments.loading"):
        importlib.import_module(f"experiments.{name}")
    if importlib.util.find_spec("ompl") is not None:
        for name in ("trees", "roadmaps", "grid_a_star", "with_fuel"):
            importlib.import_module(f"experiments.baselines.{name}")
        spaces = importlib.import_module("experiments.baselines.spaces")
        space = spaces.Space(water)
        for current in currents:
            spaces.fuel_objective(space, current, vessel)


with contextlib.suppress(renew.PlanningError):
    _warm()
