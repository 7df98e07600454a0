"""Plan and measure a case as one task, for a thread, a process or a Dask worker.

A task has paths instead of arrays, because Dask can't transfer large arguments reliably. Results
are stored as soon as they are complete; the next run after a killed one loads them.
"""

import json
import math
import os
import pickle
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import renew
from pipeline.errors import StageError, one_line
from pipeline.machine.interpreters import end_with_parent, run_python
from pipeline.machine.store import load_artefact, save_artefact
from pipeline.model import Case, CaseResult, Measures
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.measure import clock_worth, gap_shares, measured
from pipeline.stages.plan_case import OnStep, ignore_step, planned

_PLAN = "from pipeline.stages.seasons.task import plan_from_stdin; plan_from_stdin()"
# Largest length of a process's last output in a message, in characters.
_MAX_SHOWN = 200


@dataclass(frozen=True, slots=True)
class CaseTask:
    """The inputs and result paths to plan and measure one case of those in a file.

    `owner` is the scenario's name, `limit_s` the task's time limit or None. With `explains_gap` the
    optimality gap is split into its causes. Under way the vessel turns off to one of the `havens`
    if no way leads on.
    """

    season: str
    scene_path: Path
    plan_path: Path
    measures_path: Path
    options: PlannerOptions
    owner: str = ""
    limit_s: float | None = None
    explains_gap: bool = False
    havens: tuple[renew.Haven, ...] = ()

    def result(self) -> CaseResult | None:
        """Load the result from the store; None if a part is missing or damaged."""
        plan = load_artefact(self.plan_path, CaseResult)
        measures = load_artefact(self.measures_path, Measures)
        return None if plan is None or measures is None else replace(plan, measures=measures)

    def stored_failure(self) -> str | None:
        """Return why the stored plan has no route, or ""; None if the store has no result."""
        found = self.result()
        return None if found is None else found.failure

    def make(self, stop: threading.Event | None = None) -> "Status":
        """Plan the case; if it has a time limit, in a process that is killed after it."""
        if self.limit_s is None:
            return Status(self.season, self.planned(stored_case(self)).failure, crashed=False)
        return status_in_process(self, stop)

    def planned(self, case: Case, on_step: OnStep = ignore_step) -> CaseResult:
        """Plan and measure the task's case, and store both parts of the result."""
        result = load_artefact(self.plan_path, CaseResult)
        if result is None:
            result = planned(case, self.options, on_step, self.havens)
            save_artefact(self.plan_path, result, self.owner)
        shares = gap_shares(case, result, self.options) if self.explains_gap else None
        worth = clock_worth(case, result, self.options)
        measures = replace(
            measured(case, result, self.options), gap_shares=shares, clock_worth=worth
        )
        save_artefact(self.measures_path, measures, self.owner)
        return replace(result, measures=measures)


class StoredCase(Protocol):
    """A task for one case of those in a file of the store."""

    @property
    def season(self) -> str:
        """The case's name."""
        ...

    @property
    def scene_path(self) -> Path:
        """The file of the cases."""
        ...


def stored_case(task: StoredCase) -> Case:
    """Load a task's case; StageError if this machine can't read the file."""
    cases: tuple[Case, ...] | None = load_artefact(task.scene_path, tuple)
    if cases is None:
        raise StageError(
            f"this worker can't read {task.scene_path}: give all workers access to the same output "
            "folder"
        )
    return next(case for case in cases if case.name == task.season)


@dataclass(frozen=True, slots=True)
class Status:
    """How a case's task ended; `failure` is "" if the case has a plan.

    `crashed`: the task itself failed, so that the store has no result for the case.
    """

    season: str
    failure: str
    crashed: bool


def status_of(season: str, result: Callable[[], str]) -> Status:
    """Call `result` and return how the task ended; an exception becomes a failure."""
    try:
        return Status(season, result(), crashed=False)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other cases continue
        return Status(season, one_line(error), crashed=True)


def status_in_process(task: CaseTask, stop: threading.Event | None = None) -> Status:
    """Plan and measure a case in a process that is killed after its limit, or at `stop`."""
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


def plan_from_stdin() -> None:
    """Plan the pickled task of standard input; print its failure, and whether it crashed."""
    end_with_parent(int(sys.argv[1]))
    given = bytes.fromhex(sys.stdin.read())
    task = pickle.loads(given)  # noqa: S301 - written by the process that started this
    answer, sys.stdout = sys.stdout, sys.stderr  # keeps libraries' output out of the answer
    status = status_of(task.season, lambda: task.planned(stored_case(task)).failure)
    answer.write(json.dumps([status.failure, status.crashed]))
