"""A season's plan and evaluation as one task that any Dask worker can take.

A task carries paths, not arrays: big arguments fail in transit, and what it makes lies in the
store the moment it is done, one whole file each, so a run that was killed goes on there.
"""

from __future__ import annotations

import os
import traceback
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import store as artefact
from pipeline.errors import StageError
from pipeline.model import Scene, SeasonPlan
from pipeline.stages.evaluate import SeasonEvaluation, evaluate_season
from pipeline.stages.plan import plan_season

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pipeline.scenario.model import PlannerOptions

# A worker that is killed (out of memory, say) takes its task with it; once more may do.
_RETRIES = 1
_CONNECT_S = 30


@dataclass(frozen=True, slots=True)
class SeasonTask:
    """What a worker needs to plan and evaluate one season."""

    season: str
    scene_path: Path
    plan_path: Path
    evaluation_path: Path
    options: PlannerOptions
    scale: float

    def result(self) -> tuple[SeasonPlan, SeasonEvaluation] | None:
        """Plan and evaluation from the store; None where one is missing or damaged."""
        plan = artefact.load(self.plan_path, SeasonPlan)
        evaluation = artefact.load(self.evaluation_path, SeasonEvaluation)
        return None if plan is None or evaluation is None else (plan, evaluation)


def season_task(task: SeasonTask) -> str:
    """Plan and evaluate a season, keep both; return why it could not be planned, or nothing."""
    scene = artefact.load(task.scene_path, Scene)
    if scene is None:
        raise StageError(
            f"{task.scene_path} is not to be seen by this worker: all workers need the same output "
            "folder"
        )
    plan = artefact.load(task.plan_path, SeasonPlan)
    if plan is None:
        plan = plan_season(scene, task.season, task.options)
        artefact.save(task.plan_path, plan)
    evaluation = evaluate_season(scene, plan, task.scale, task.options.seed)
    artefact.save(task.evaluation_path, evaluation)
    return plan.failure


@dataclass(frozen=True, slots=True)
class Status:
    """How a season's task ended; `failure` is empty where it was planned.

    `broken` says that the task itself failed, and not the plan.
    """

    season: str
    failure: str
    broken: bool


def run_tasks(
    tasks: Sequence[SeasonTask], scheduler: str | None, tell: Callable[[Status], None]
) -> None:
    """Run tasks and tell of each as it ends.

    Parameters
    ----------
    tasks
        Independent of each other.
    scheduler
        Address of a Dask scheduler; else what DASK_SCHEDULER_ADDRESS says; else threads here, as a
        plan takes seconds and a process needs as long to load what it works with.
    tell
        Called in this thread.
    """
    if not tasks:
        return
    if len(tasks) == 1 and scheduler is None:
        tell(_status(tasks[0].season, partial(season_task, tasks[0])))
        return
    import dask

    address = scheduler or dask.config.get("scheduler-address", None)
    if address is None:
        _run_here(tasks, tell)
    else:
        _run_there(tasks, address, tell)


def _run_here(tasks: Sequence[SeasonTask], tell: Callable[[Status], None]) -> None:
    """Run tasks in threads. None of them raises, so that none stops the others."""
    from dask.callbacks import Callback
    from dask.threaded import get

    names = {f"season-{i}": task for i, task in enumerate(tasks)}
    graph = {
        name: (_status, task.season, partial(season_task, task)) for name, task in names.items()
    }

    def posttask(key: str, result: Status, *rest: object) -> None:
        del key, rest
        tell(result)

    with Callback(posttask=posttask):  # type: ignore[no-untyped-call]
        get(graph, list(names), num_workers=min(len(tasks), _cores()))


def _run_there(tasks: Sequence[SeasonTask], address: str, tell: Callable[[Status], None]) -> None:
    """Run tasks on the workers of a scheduler, which may die under one without ending the rest."""
    from distributed import Client, as_completed

    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise StageError(
            f"no Dask scheduler answers at {address!r} ({error}); check the address, or leave "
            "--scheduler out"
        ) from error
    with client:
        futures = {
            client.submit(season_task, task, pure=False, retries=_RETRIES): task for task in tasks
        }
        for future in as_completed(futures):
            tell(_status(futures[future].season, future.result))


def _status(season: str, result: Callable[[], str]) -> Status:
    """Turn a task's end into a status: a season that breaks must not take the others with it."""
    try:
        return Status(season, result(), broken=False)
    except Exception as error:  # noqa: BLE001 - whatever it was, the other seasons go on
        reason = " ".join(str(error).split())
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
        return Status(season, f"{type(error).__name__}: {reason}{where}", broken=True)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
