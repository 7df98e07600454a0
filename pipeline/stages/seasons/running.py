"""Run tasks of seasons: in threads or processes here, or on the workers of a Dask scheduler."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

from pipeline.errors import StageError, one_line
from pipeline.machine.cluster import fleet
from pipeline.machine.interpreters import cores
from pipeline.machine.workers import LocalWorkers, WorkerTask
from pipeline.stages.seasons.task import Status, status_of

# Number of tries of a season on a scheduler: lack of memory, for one, may occur on one worker only.
_TRIES = 2


class StoredTask(WorkerTask, Protocol):
    """A task of a season that reads its case from the store, and saves its result there."""

    @property
    def season(self) -> str:
        """The season's name."""
        ...

    @property
    def scene_path(self) -> Path:
        """The file of its case."""
        ...

    def stored_failure(self) -> str | None:
        """Return the failure in the store's result, "" for a success; None without a result."""
        ...


TaskT = TypeVar("TaskT", bound=StoredTask)


def run_tasks(
    tasks: Sequence[TaskT],
    scheduler: str | None,
    on_status: Callable[[Status], None],
    work: Callable[[TaskT], str],
    limit_s: float | None = None,
) -> None:
    """Run tasks, and report the status of each as it ends.

    Parameters
    ----------
    tasks
        Independent of each other.
    scheduler
        Address of a Dask scheduler; default: DASK_SCHEDULER_ADDRESS. Without either, tasks run in
        threads of this process, because a new process would take as long to import as a plan
        takes. Tasks with a time limit run in processes, because a process can be killed.
    on_status
        Called in the caller's thread.
    work
        Does a task in a thread of this process, and returns its failure or "".
    limit_s
        Time limit of a task, s.
    """
    if not tasks:
        return
    import dask

    address = scheduler or dask.config.get("scheduler-address", None)
    limit = math.inf if limit_s is None else limit_s
    if address is not None:
        _run_on_scheduler(tasks, address, on_status, limit)
    elif limit_s is not None:
        with LocalWorkers(min(len(tasks), cores()), limit_s=limit) as workers:
            workers.run(_Seasons(tasks, on_status, tries=1))
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
        runs = [pool.submit(status_of, task.season, partial(work, task)) for task in tasks]
        for run in as_completed(runs):
            on_status(run.result())
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # an interrupted run ends at once


def _run_on_scheduler(
    tasks: Sequence[StoredTask],
    address: str,
    on_status: Callable[[Status], None],
    limit_s: float,
) -> None:
    """Run tasks on a scheduler's workers.

    If the scheduler or all workers die, the unfinished tasks are reported as failed.

    Raises
    ------
    StageError
        The scheduler can't be reached or has no workers, or a worker can't plan.
    """
    seasons = _Seasons(tasks, on_status, tries=_TRIES)
    with fleet(address, tasks[0].scene_path, limit_s) as workers:
        try:
            workers.run(seasons)
        except StageError as error:
            seasons.give_up(error)


class _Seasons:
    """The seasons of a run, as `pipeline.machine.workers.Work`."""

    def __init__(
        self, tasks: Sequence[StoredTask], on_status: Callable[[Status], None], *, tries: int
    ) -> None:
        self._waiting = deque(tasks)
        self._tries = dict.fromkeys([task.season for task in tasks], tries)
        self._open = {task.season: task for task in tasks}
        self._on_status = on_status

    def next_task(self, workers: int) -> StoredTask | None:
        """Return the next season, or None if all are handed out."""
        del workers
        return self._waiting.popleft() if self._waiting else None

    def done(self, task: StoredTask, result: Status) -> None:
        """Report how a season ended; one that crashed is tried again first."""
        self._tries[task.season] -= 1
        if result.crashed and self._tries[task.season]:
            self._waiting.append(task)
        else:
            self._end(result)

    def died(self, task: StoredTask, reason: str) -> None:
        """Report a season as crashed."""
        self._end(Status(task.season, reason, crashed=True))

    def failed(self, task: StoredTask, error: Exception) -> None:
        """Try a season again, or report its error."""
        self.done(task, Status(task.season, one_line(error), crashed=True))

    def give_up(self, error: StageError) -> None:
        """Report each open season: with its result if the store has one, otherwise as crashed."""
        for task in tuple(self._open.values()):
            failure = task.stored_failure()
            self._end(
                Status(task.season, str(error), crashed=True)
                if failure is None
                else Status(task.season, failure, crashed=False)
            )

    def _end(self, status: Status) -> None:
        """Report a season's status."""
        del self._open[status.season]
        self._on_status(status)
