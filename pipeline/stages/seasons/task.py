"""Plan and measure a case as one task, for a thread, a process or a Dask worker.

A task has paths instead of arrays, because Dask can't transfer large arguments reliably. Results
are stored as soon as they are complete; the next run after a killed one loads them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import renew
from pipeline.errors import StageError, one_line
from pipeline.machine.store import load_artefact, save_artefact
from pipeline.model import Case, CaseResult, Measures
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.measure import clock_worth, gap_shares, measured
from pipeline.stages.plan_case import OnStep, ignore_step, planned


@dataclass(frozen=True, slots=True)
class CaseTask:
    """The inputs and result paths to plan and measure one case of those in a file.

    `owner` is the scenario's name. With `explains_gap` the optimality gap is split into its causes.
    Under way the vessel turns off to one of the `havens` if no way leads on.
    """

    season: str
    scene_path: Path
    plan_path: Path
    measures_path: Path
    options: PlannerOptions
    owner: str = ""
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

    def make(self) -> "Status":
        """Plan and measure the case; an error becomes a failure."""
        return status_of(self.season, lambda: self.planned(stored_case(self)).failure)

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
