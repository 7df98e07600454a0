"""Plan seasons on a Dask scheduler's workers; if a worker dies, the other seasons continue."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.errors import StageError
from pipeline.stages.seasons.process import run_in_processes
from pipeline.stages.seasons.task import SeasonTask, Status, plan_and_evaluate, status_of
from pipeline.stages.workers.connection import own_identity
from pipeline.stages.workers.fleet import fleet

# Number of tries of a season, because an error such as lack of memory may occur on one worker only.
_TRIES = 2


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


def plan_on_worker(task: SeasonTask) -> Status:
    """Run a task on a worker; if it has a time limit, in a process that is killed after it."""
    if task.limit_s is None:
        return Status(task.season, plan_and_evaluate(task), crashed=False)
    ended: list[Status] = []
    run_in_processes([task], 1, ended.append)
    return ended[0]


@dataclass(frozen=True, slots=True)
class _OnWorker:
    """A season for a worker, as `pipeline.stages.workers.fleet.Task`."""

    season: SeasonTask
    identity: str

    def make(self) -> Status:
        """Plan the season."""
        return plan_on_worker(self.season)


class _Seasons:
    """The seasons of a run, as `pipeline.stages.workers.fleet.Work`."""

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
