"""A season's plan and evaluation as one task that any Dask worker can execute.

A task holds paths, not arrays: large arguments fail in transit. Its results are in the store as
soon as they are complete, so that a killed run continues from there.
"""

from __future__ import annotations

import os
import traceback
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import StageError
from pipeline.model import Scene, SeasonPlan
from pipeline.stages.evaluate import SeasonEvaluation, evaluate_season
from pipeline.stages.plan import plan_season
from pipeline.store import load_artefact, save_artefact

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pipeline.scenario.model import PlannerOptions

# Number of retries on a scheduler: a worker that is killed, say for lack of memory, loses its task.
_RETRIES = 1
# Time to wait for a scheduler's answer, s.
_CONNECT_S = 30


@dataclass(frozen=True, slots=True)
class SeasonTask:
    """All that a worker needs to plan and evaluate one season."""

    season: str
    scene_path: Path
    plan_path: Path
    evaluation_path: Path
    options: PlannerOptions
    scale: float

    def result(self) -> tuple[SeasonPlan, SeasonEvaluation] | None:
        """Load plan and evaluation from the store; None where one is missing or damaged."""
        plan = load_artefact(self.plan_path, SeasonPlan)
        evaluation = load_artefact(self.evaluation_path, SeasonEvaluation)
        return None if plan is None or evaluation is None else (plan, evaluation)


def plan_and_evaluate(task: SeasonTask) -> str:
    """Plan and evaluate a season, store both; return why it could not be planned, or ""."""
    scene = load_artefact(task.scene_path, Scene)
    if scene is None:
        raise StageError(
            f"this worker can't read {task.scene_path}: give all workers access to the same output "
            "folder"
        )
    plan = load_artefact(task.plan_path, SeasonPlan)
    if plan is None:
        plan = plan_season(scene, task.season, task.options)
        save_artefact(task.plan_path, plan)
    evaluation = evaluate_season(scene, plan, task.scale, task.options.seed)
    save_artefact(task.evaluation_path, evaluation)
    return plan.failure


@dataclass(frozen=True, slots=True)
class Status:
    """How a season's task ended; `failure` is empty where it was planned.

    `crashed` says that the task itself failed: there is no plan to say why.
    """

    season: str
    failure: str
    crashed: bool


def run_tasks(
    tasks: Sequence[SeasonTask], scheduler: str | None, on_status: Callable[[Status], None]
) -> None:
    """Run tasks, and report the status of each as it ends.

    Parameters
    ----------
    tasks
        Independent of each other.
    scheduler
        Address of a Dask scheduler. Without it, the one in DASK_SCHEDULER_ADDRESS; without that,
        threads of this process: a plan takes seconds, and a new process as long to import.
    on_status
        Called in this thread.
    """
    if not tasks:
        return
    if len(tasks) == 1 and scheduler is None:
        on_status(_status(tasks[0].season, partial(plan_and_evaluate, tasks[0])))
        return
    import dask

    address = scheduler or dask.config.get("scheduler-address", None)
    if address is None:
        _run_in_threads(tasks, on_status)
    else:
        _run_on_scheduler(tasks, address, on_status)


def _run_in_threads(tasks: Sequence[SeasonTask], on_status: Callable[[Status], None]) -> None:
    """Run tasks in threads of this process. None of them raises, so that none stops the others."""
    from dask.callbacks import Callback
    from dask.threaded import get

    names = {f"season-{i}": task for i, task in enumerate(tasks)}
    graph = {
        name: (_status, task.season, partial(plan_and_evaluate, task))
        for name, task in names.items()
    }

    def posttask(key: str, result: Status, *rest: object) -> None:
        del key, rest
        on_status(result)

    with Callback(posttask=posttask):  # type: ignore[no-untyped-call]
        get(graph, list(names), num_workers=min(len(tasks), _cores()))


def _run_on_scheduler(
    tasks: Sequence[SeasonTask], address: str, on_status: Callable[[Status], None]
) -> None:
    """Run tasks on a scheduler's workers: one that dies does not end the tasks of the others."""
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
            client.submit(plan_and_evaluate, task, pure=False, retries=_RETRIES): task
            for task in tasks
        }
        for future in as_completed(futures):
            on_status(_status(futures[future].season, future.result))


def _status(season: str, result: Callable[[], str]) -> Status:
    """Return how a task ended; an exception in one season must not stop the others."""
    try:
        return Status(season, result(), crashed=False)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other seasons continue
        reason = " ".join(str(error).split())
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
        return Status(season, f"{type(error).__name__}: {reason}{where}", crashed=True)


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
