"""BIT* (Gammell et al., 2015) with Eq. 4 as its objective, as in the experiments, among eddies.

Its path is not rounded, so it may be a little cheaper than one that can be steered.
"""

from __future__ import annotations

import importlib.util
import itertools
import math
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import renew
from renew.inputs.current import as_field
from renew.voyage.voyage import Voyage, Waters
from tests.bench.figure import Figure
from tests.eddies import SCENES, eddy_scene
from tests.strategies import PAPER_VESSEL

RUNS, CALLS = 5, 18_000_000
"""Seeds a scene, and calls of the cost and collision functions in each: some 30 s."""

# Of the scenes of eddies, one in so many is taken.
_EVERY = 4


def figures() -> Iterator[Figure]:
    """How far BIT* gets below the best route, as a share of that; at most 0.01 % is asked."""
    chosen = range(0, len(SCENES), _EVERY)
    name = f"BIT*, {CALLS:,} calls, {RUNS} seeds, {len(chosen)} scenes of eddies"
    if importlib.util.find_spec("ompl") is None:
        yield Figure(name, "never below ours by 0.01 %", "skipped: ompl is not installed")
        return
    below = []
    # OMPL's random numbers can be seeded once in a process; it complains where one is shut down.
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(1, context, max_tasks_per_child=1) as pool:
        runs = list(itertools.product(chosen, range(RUNS)))
        fuels = zip(runs, pool.map(_bit_star_fuel, *zip(*runs, strict=True)), strict=True)
        for scene, found in itertools.groupby(fuels, key=lambda run: run[0][0]):
            ours = eddy_scene(*SCENES[scene]).plan(padding="none").best.fuel
            theirs = min(fuel for _, fuel in found)
            below.append(1 - theirs / ours)
            share = f"{100 * (theirs / ours - 1):+.3f} %"
            yield Figure(f"BIT*, scene {scene}, beside ours", "", f"{theirs:.2f} ({share})")
    text = f"{100 * max(below):.3f} % below"
    yield Figure(name, "never below ours by 0.01 %", text, max(below) <= 1e-4)


def _bit_star_fuel(scene: int, seed: int) -> float:
    """Fuel of the best path that BIT* finds in a scene; inf if it finds none."""
    # Modules that import ompl.
    from experiments.baselines.candidate import Budget, NoPathError, Task
    from experiments.baselines.with_fuel import bit_star
    from experiments.kernels.water import BARE, PaddedWater

    waters = eddy_scene(*SCENES[scene])
    water = PaddedWater.of(waters.chart, BARE)
    ends = np.asarray(waters.start, dtype=float), np.asarray(waters.goal, dtype=float)
    charted = Waters(waters.chart, as_field(waters.current))
    voyage = Voyage(charted, PAPER_VESSEL, *ends, "projected")
    try:
        (candidate,) = bit_star(Task(voyage, water, Budget(calls=CALLS), seed))
    except NoPathError:
        return math.inf
    return renew.fuel(candidate.path, waters.current, PAPER_VESSEL)
