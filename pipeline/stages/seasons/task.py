"""Plan and evaluate a season as one task, for a thread, a process or a Dask worker.

A task has paths instead of arrays, because Dask can't transfer large arguments reliably. Results
are stored as soon as they are complete; the next run after a killed one loads them.
"""

import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.errors import PipelineError, StageError
from pipeline.machine.store import load_artefact, save_artefact
from pipeline.model import Scene, SeasonPlan
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.seasons.clock_worth import clock_worth
from pipeline.stages.seasons.evaluate_season import SeasonEvaluation, evaluate_season
from pipeline.stages.seasons.gap_shares import gap_shares
from pipeline.stages.seasons.plan_season import plan_season


@dataclass(frozen=True, slots=True)
class SeasonTask:
    """The inputs and result paths to plan and evaluate one season.

    `owner` is the scenario's name, `limit_s` the task's time limit or None. With `explains_gap` the
    evaluation splits the optimality gap into its causes.
    """

    season: str
    scene_path: Path
    plan_path: Path
    evaluation_path: Path
    options: PlannerOptions
    scale: float
    owner: str = ""
    limit_s: float | None = None
    explains_gap: bool = False

    def result(self) -> tuple[SeasonPlan, SeasonEvaluation] | None:
        """Load plan and evaluation from the store; None if one is missing or damaged."""
        plan = load_artefact(self.plan_path, SeasonPlan)
        evaluation = load_artefact(self.evaluation_path, SeasonEvaluation)
        return None if plan is None or evaluation is None else (plan, evaluation)


def plan_and_evaluate(task: SeasonTask) -> str:
    """Plan and evaluate a season, and store both; return why it could not be planned, or ""."""
    scene = load_artefact(task.scene_path, Scene)
    if scene is None:
        raise StageError(
            f"this worker can't read {task.scene_path}: give all workers access to the same output "
            "folder"
        )
    plan = load_artefact(task.plan_path, SeasonPlan)
    if plan is None:
        plan = plan_season(scene, task.season, task.options)
        save_artefact(task.plan_path, plan, task.owner)
    options = task.options
    evaluation = evaluate_season(
        scene, plan, task.scale, options.seed, options.drift, options.lateness
    )
    if task.explains_gap:
        evaluation = replace(evaluation, gap_shares=gap_shares(scene, plan, options))
    evaluation = replace(evaluation, clock_worth=clock_worth(scene, plan, options))
    save_artefact(task.evaluation_path, evaluation, task.owner)
    return plan.failure


@dataclass(frozen=True, slots=True)
class Status:
    """How a season's task ended; `failure` is "" if the season has a plan.

    `crashed`: the task itself failed, so that the store has no result for the season.
    """

    season: str
    failure: str
    crashed: bool


def status_of(season: str, result: Callable[[], str]) -> Status:
    """Call `result` and return how the task ended; an exception becomes a failure."""
    try:
        return Status(season, result(), crashed=False)
    except PipelineError as error:
        return Status(season, " ".join(str(error).split()), crashed=True)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other seasons continue
        reason = " ".join(str(error).split())
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
        return Status(season, f"{type(error).__name__}: {reason}{where}", crashed=True)
