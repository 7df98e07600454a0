"""Plan and evaluate a season as one task, for a thread, a process or a Dask worker.

A task has paths instead of arrays, because Dask can't transfer large arguments reliably. Results
are stored as soon as they are complete; the next run after a killed one loads them.
"""

import json
import math
import os
import pickle
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from pipeline.errors import StageError, one_line
from pipeline.machine.interpreters import run_python
from pipeline.machine.store import load_artefact, save_artefact
from pipeline.model import Scene, SeasonPlan
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.seasons.connection import own_identity
from pipeline.stages.seasons.fleet import fleet
from pipeline.stages.seasons.one_season import SeasonEvaluation, evaluate_season, plan_season
from pipeline.stages.seasons.other_plans import clock_worth, gap_shares

# Time between two checks of a process whether its parent still runs, s.
_PARENT_S = 0.5
_PLAN = "from pipeline.stages.seasons.task import plan_from_stdin; plan_from_stdin()"
# Largest length of a process's last output in a message, in characters.
_MAX_SHOWN = 200
# Number of tries of a season, because an error such as lack of memory may occur on one worker only.
_TRIES = 2


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
    except Exception as error:  # noqa: BLE001 - whatever it is, the other seasons continue
        return Status(season, one_line(error), crashed=True)


def status_in_process(task: SeasonTask, stop: threading.Event | None = None) -> Status:
    """Plan and evaluate a season in a process that is killed after its limit, or at `stop`."""
    result = run_python(
        ["-c", _PLAN, str(os.getpid())],
        pickle.dumps(task).hex(),
        math.inf if task.limit_s is None else task.limit_s,
        stop,
    )
    if result.exit_code is None:
        reason = f"took longer than the limit of {task.limit_s:g} s"
        return Status(task.season, reason, crashed=True)
    try:
        failure, crashed = json.loads(result.stdout)
    except ValueError:
        last = next(filter(None, map(str.strip, reversed(result.stderr.split("\n")))), "")
        words = f": {last[:_MAX_SHOWN]}" if last else " (out of memory?)"
        failure, crashed = f"its process ended with code {result.exit_code}{words}", True
    return Status(task.season, str(failure), bool(crashed))


def _end_with(parent: int) -> None:
    """End this process after its parent has ended, for whatever reason."""
    while os.getppid() == parent:
        time.sleep(_PARENT_S)
    os._exit(1)


def plan_from_stdin() -> None:
    """Plan the pickled task of standard input; print its failure, and whether it crashed."""
    threading.Thread(target=_end_with, args=(int(sys.argv[1]),), daemon=True).start()
    given = bytes.fromhex(sys.stdin.read())
    task = pickle.loads(given)  # noqa: S301 - written by the process that started this
    answer, sys.stdout = sys.stdout, sys.stderr  # keeps libraries' output out of the answer
    status = status_of(task.season, partial(plan_and_evaluate, task))
    answer.write(json.dumps([status.failure, status.crashed]))


def run_on_scheduler(
    tasks: Sequence[SeasonTask], address: str, on_status: Callable[[Status], None]
) -> None:
    """Run tasks on a scheduler's workers.

    If the scheduler or all workers die, the unfinished tasks are reported as failed.

    Raises
    ------
    StageError
        The scheduler can't be reached or has no workers, or a worker can't plan.
    """
    seasons = _Seasons(tasks, own_identity(), on_status)
    with fleet(address, tasks[0].scene_path) as workers:
        try:
            workers.run(seasons)
        except StageError as error:
            seasons.give_up(error)


@dataclass(frozen=True, slots=True)
class _OnWorker:
    """A season for a worker, as `pipeline.stages.seasons.fleet.Task`."""

    season: SeasonTask
    identity: str

    def make(self) -> Status:
        """Plan the season; if it has a time limit, in a process that is killed after it."""
        task = self.season
        if task.limit_s is None:
            return Status(task.season, plan_and_evaluate(task), crashed=False)
        return status_in_process(task)


class _Seasons:
    """The seasons of a run, as `pipeline.stages.seasons.fleet.Work`."""

    def __init__(
        self, tasks: Sequence[SeasonTask], identity: str, on_status: Callable[[Status], None]
    ) -> None:
        self._waiting = deque(_OnWorker(task, identity) for task in tasks)
        self._tries = {task.season: _TRIES for task in tasks}
        self._open = {task.season: task for task in tasks}
        self._on_status = on_status

    def next_task(self, workers: int) -> _OnWorker | None:
        """Return the next season, or None if all are handed out."""
        del workers
        return self._waiting.popleft() if self._waiting else None

    def done(self, task: _OnWorker, result: Status) -> None:
        """Report how a season ended."""
        del task
        self._end(result)

    def died(self, task: _OnWorker) -> None:
        """Report a season as crashed because several workers died while planning it."""
        reason = "its workers died (out of memory, or a crash of the interpreter)"
        self._end(Status(task.season.season, reason, crashed=True))

    def failed(self, task: _OnWorker, error: Exception) -> None:
        """Try a season again, or report its error."""
        season = task.season.season
        self._tries[season] -= 1
        if self._tries[season]:
            self._waiting.append(task)
            return

        def fail() -> str:
            raise error

        self._end(status_of(season, fail))

    def give_up(self, error: StageError) -> None:
        """Report each open season: with its result if the store has one, otherwise as crashed."""
        for task in tuple(self._open.values()):
            result = task.result()
            self._end(
                Status(task.season, str(error), crashed=True)
                if result is None
                else Status(task.season, result[0].failure, crashed=False)
            )

    def _end(self, status: Status) -> None:
        """Report a season's status."""
        del self._open[status.season]
        self._on_status(status)
