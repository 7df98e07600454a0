"""Tasks that each do something for one case: in threads or processes here, or on a Dask scheduler.

A task has paths instead of arrays, because Dask can't transfer large arguments reliably. Results
are stored as soon as they are complete; the next run after a killed one loads them.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

from pipeline.errors import StageError, one_line
from pipeline.machine.cluster import fleet
from pipeline.machine.interpreters import cores
from pipeline.machine.store import load_artefact
from pipeline.machine.workers import LocalWorkers, WorkerTask
from pipeline.model import Case

# Number of tries of a task on a scheduler: lack of memory, for one, may occur on one worker only.
_TRIES = 2


class StoredTask(WorkerTask, Protocol):
    """A task that reads its case from a file of the store, and saves its result in the store."""

    @property
    def case(self) -> str:
        """The case's name."""
        ...

    @property
    def cases_path(self) -> Path:
        """The file that has the case, among others."""
        ...

    def result(self) -> Any:  # noqa: ANN401 - each kind of task has its own
        """Load the result from the store; None without one. It may have a `failure`."""
        ...


TaskT = TypeVar("TaskT", bound=StoredTask)


@dataclass(frozen=True, slots=True)
class Status:
    """How a case's task ended; `failure` is "" if the case has a plan.

    `crashed`: the task itself failed, so that the store has no result for the case.
    """

    case: str
    failure: str
    crashed: bool


def status_of(case: str, result: Callable[[], str]) -> Status:
    """Call `result` and return how the task ended; an exception becomes a failure."""
    try:
        return Status(case, result(), crashed=False)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other cases continue
        return Status(case, one_line(error), crashed=True)


def stored_case(task: StoredTask) -> Case:
    """Load a task's case; StageError if this machine can't read the file."""
    cases: tuple[Case, ...] | None = load_artefact(task.cases_path, tuple)
    if cases is None:
        raise StageError(
            f"this worker can't read {task.cases_path}: give all workers access to the same output "
            "folder"
        )
    return next(case for case in cases if case.name == task.case)


def run_tasks(
    tasks: Sequence[TaskT],
    scheduler: str | None,
    on_status: Callable[[Status], None],
    work: Callable[[TaskT], str],
    limit_s: float | None = None,
) -> None:
    """Run independent tasks, and report the status of each, in the caller's thread, as it ends.

    `scheduler` is the address of a Dask scheduler; default: DASK_SCHEDULER_ADDRESS. Without either,
    tasks run in threads of this process, because a new process would take as long to import as a
    plan takes; `work` does one, and returns its failure or "". Tasks with a time limit, `limit_s`,
    run in processes, because a process can be killed.

    If a scheduler or all its workers die, the unfinished tasks are reported as failed. Raises
    StageError if a scheduler can't be reached or has no workers, or a worker can't plan.
    """
    if not tasks:
        return
    import dask

    address = scheduler or dask.config.get("scheduler-address", None)
    limit = math.inf if limit_s is None else limit_s
    if address is not None:
        waiting = _Tasks(tasks, on_status, tries=_TRIES)
        with fleet(address, tasks[0].cases_path, limit) as fleet_of_workers:
            try:
                fleet_of_workers.run(waiting)
            except StageError as error:
                waiting.give_up(error)
    elif limit_s is not None:
        with LocalWorkers(min(len(tasks), cores()), limit_s=limit) as workers:
            workers.run(_Tasks(tasks, on_status, tries=1))
    else:
        # Even a single task runs in a thread: a signal handler may raise in the main one, and
        # compiled code, called from C, can't handle an exception.
        _run_in_threads(tasks, on_status, work)


def _run_in_threads(
    tasks: Sequence[TaskT], on_status: Callable[[Status], None], work: Callable[[TaskT], str]
) -> None:
    """Run tasks in threads of this process; a failure is returned as a status, not raised."""
    pool = ThreadPoolExecutor(min(len(tasks), cores()))
    try:
        runs = [pool.submit(status_of, task.case, partial(work, task)) for task in tasks]
        for run in as_completed(runs):
            on_status(run.result())
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # an interrupted run ends at once


class _Tasks:
    """The tasks of a run, as `pipeline.machine.workers.Work`."""

    def __init__(
        self, tasks: Sequence[StoredTask], on_status: Callable[[Status], None], *, tries: int
    ) -> None:
        self._waiting = deque(tasks)
        self._tries = dict.fromkeys([task.case for task in tasks], tries)
        self._open = {task.case: task for task in tasks}
        self._on_status = on_status

    def next_task(self, workers: int) -> StoredTask | None:
        """Return the next task, or None if all are handed out."""
        del workers
        return self._waiting.popleft() if self._waiting else None

    def done(self, task: StoredTask, result: Status) -> None:
        """Report how a task ended; one that crashed is tried again first."""
        self._tries[task.case] -= 1
        if result.crashed and self._tries[task.case]:
            self._waiting.append(task)
        else:
            self._end(result)

    def died(self, task: StoredTask, reason: str) -> None:
        """Report a task as crashed."""
        self._end(Status(task.case, reason, crashed=True))

    def failed(self, task: StoredTask, error: Exception) -> None:
        """Try a task again, or report its error."""
        self.done(task, Status(task.case, one_line(error), crashed=True))

    def give_up(self, error: StageError) -> None:
        """Report each open task: with its result if the store has one, otherwise as crashed."""
        for task in tuple(self._open.values()):
            found = task.result()
            failure = str(error) if found is None else getattr(found, "failure", "")
            self._end(Status(task.case, failure, crashed=found is None))

    def _end(self, status: Status) -> None:
        del self._open[status.case]
        self._on_status(status)
