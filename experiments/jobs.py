"""One planner on one case with one seed, as a task for a process of its own.

A process each, because OMPL's random numbers can be seeded once in a process only: so each result
depends on its seed alone, and not on what ran before.
"""

from __future__ import annotations

import math
import pickle
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

import renew
from experiments.baselines.candidate import Budget, Candidate, Task
from experiments.baselines.registry import PLANNERS
from experiments.environments.loading import Environment
from experiments.kernels.water import PaddedWater
from experiments.referee.equal_padding import equal_padding
from experiments.referee.referee import Judgement, judged
from renew._types import FloatArray
from renew.voyage.voyage import Voyage

Water = Literal["bare", "padded"]

# Samples a class of the sampled method, as published.
_SAMPLES = 500
# Further options of our planners that sample; the paper's classes come from a depth-first search.
_SAMPLED = {
    "RENEW sampled": {},
    "RENEW as published": {"order": "depth-first"},
}


@dataclass(frozen=True)
class Job:
    """What to plan: `water` says whether a baseline has to keep our padding.

    `options` are further ones of `renew.plan`, or `calls` of an anytime planner's budget.
    """

    environment: str
    case: str
    planner: str
    seed: int = 0
    water: Water = "bare"
    options: tuple[tuple[str, Any], ...] = ()

    @property
    def name(self) -> str:
        """Name for the progress report."""
        extra = "".join(f" {key}={value}" for key, value in self.options)
        return f"{self.environment} {self.case}: {self.planner}, seed {self.seed}{extra}"


@dataclass(frozen=True)
class Judged:
    """A candidate with its judgement; of `classes` smoothed paths, `kept` stayed in their class.

    `side` is that on which it passes the environment's island.
    """

    candidate: Candidate
    judgement: Judgement
    classes: int = 1
    kept: int | None = None
    side: str = ""


@dataclass(frozen=True)
class Result:
    """What a job gave: the least-fuel path as planned, and the one as smoothed; or why none."""

    job: Job
    paths: tuple[Judged, ...] = ()
    failure: str = ""
    padding: FloatArray = field(default_factory=lambda: np.empty((0, 5)))
    routes: int = 0
    cpu_seconds: float = 0.0

    @property
    def best(self) -> Judged | None:
        """The path of least fuel; None if the job failed."""
        return min(self.paths, key=lambda one: one.judgement.fuel, default=None)


def run_job(job: Job, environment_file: Path, padding_file: Path) -> Result:
    """Plan, and judge; a failure of the planner becomes the result's."""
    started = time.process_time()
    result = _judged_result(job, environment_file, padding_file)
    return replace(result, cpu_seconds=time.process_time() - started)


def _judged_result(job: Job, environment_file: Path, padding_file: Path) -> Result:
    """Result of a job, whose time is not known yet."""
    environment: Environment = pickle.loads(environment_file.read_bytes())  # noqa: S301 - our own file
    case = environment.spec.case(job.case)
    voyage = environment.voyage(case)
    try:
        if PLANNERS[job.planner].group == "ours":
            return _ours(job, voyage, environment, environment.options(case))
        padding = _padding(job, environment, padding_file)
        return _theirs(job, voyage, padding, environment)
    except renew.PlanningError as error:
        return Result(job, failure=" ".join(str(error).split()))


def _ours(job: Job, voyage: Voyage, environment: Environment, options: dict[str, object]) -> Result:
    """Plan by one of our methods."""
    options |= dict(job.options)
    if job.planner in _SAMPLED:
        options |= {"method": "sampled", "samples": _SAMPLES, "seed": job.seed}
        options |= _SAMPLED[job.planner]
    started = time.process_time()
    ends = voyage.start, voyage.goal
    plan = renew.plan(voyage.chart, voyage.current, voyage.vessel, *ends, **options)  # type: ignore[arg-type]
    seconds = time.process_time() - started
    # Its states are the vertices of the triangles of all channels that were planned in.
    corners = np.concatenate([route.corners.reshape(-1, 2) for route in plan.routes])
    size = len(np.unique(corners, axis=0))
    candidate = Candidate(plan.best.path, size, is_smoothed=True, seconds=seconds)
    trajectory = plan.best.trajectory
    station = environment.spec.station_m
    judgement = judged(
        plan.best.path, voyage, spacing=station, seed=job.seed, trajectory=trajectory
    )
    side = environment.side(plan.best.path)
    return Result(
        job,
        (Judged(candidate, judgement, len(plan.routes), side=side),),
        padding=_equal_padding(job, plan, voyage, options),
        routes=len(plan.routes),
    )


def _equal_padding(
    job: Job, plan: renew.Plan, voyage: Voyage, options: Mapping[str, object]
) -> FloatArray:
    """Padding (e, 5) that rivals have to keep beside a case's plan; else the best route's own."""
    if job.planner != "RENEW" or job.options or options["padding"] != "triangle":
        return plan.best.padding_used
    return equal_padding(plan, voyage, float(str(options["clearance"])))


def _padding(job: Job, environment: Environment, padding_file: Path) -> float | FloatArray:
    """Padding that a baseline has to keep: none, a width on all land, or what our routes kept."""
    case = environment.spec.case(job.case)
    if job.water == "bare":
        return 0.0
    if case.padding == "adaptive":
        return np.asarray(np.load(padding_file))
    width = 0.0 if case.padding == "none" else float(case.padding)
    return max(width, case.clearance)


def _theirs(
    job: Job, voyage: Voyage, padding: float | FloatArray, environment: Environment
) -> Result:
    """Plan by a baseline, and judge the best path of each kind."""
    planner, spec = PLANNERS[job.planner], environment.spec
    calls = int(dict(job.options).get("calls", planner.calls))
    water = PaddedWater.of(voyage.chart, padding, np.stack([voyage.start, voyage.goal]))
    budget = Budget(spec.classes, spec.cell_m, spec.nodes, spec.dubins_step_m, calls)
    found = planner.load()(Task(voyage, water, budget, job.seed))
    paths = []
    for is_smoothed in (False, True):
        alike = [one for one in found if one.is_smoothed == is_smoothed]
        if not alike:
            continue
        best = min(alike, key=lambda one: voyage.fuel(one.path))
        kept = sum(bool(one.is_class_kept) for one in alike) if is_smoothed else None
        judgement = judged(best.path, voyage, spacing=spec.station_m, seed=job.seed)
        side = environment.side(best.path)
        paths.append(Judged(best, judgement, len(alike), kept, side))
    if all(math.isinf(one.judgement.fuel) for one in paths):
        return Result(job, tuple(paths), failure="every path leads through too strong a current")
    return Result(job, tuple(paths))
