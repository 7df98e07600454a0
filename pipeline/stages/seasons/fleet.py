"""Hand out tasks to the workers of a Dask scheduler and monitor them; every wait has a time limit.

A worker gets one task per thread at a time, so a task that kills its worker takes no waiting task
with it. If a worker dies, its task is reported to the `Work`, which decides whether to repeat it.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from pipeline.errors import StageError
from pipeline.stages.seasons import connection

if TYPE_CHECKING:
    from distributed import Client, Future


# Time limits for an answer of the scheduler, for workers to appear, and for an orderly end, s.
_ANSWER_S, _WORKERS_S, _CLOSE_S = 20.0, 120.0, 3.0
# Times between two checks of the tasks, and between two checks of the scheduler, s.
_PAUSE_S, _HEARTBEAT_S = 0.05, 5.0
_REMEDY = "check the address, or leave --scheduler out"


class DiedBeforeError(Exception):
    """A worker has died of this task before."""


class Task(Protocol):
    """A task for a worker."""

    @property
    def identity(self) -> str:
        """Identity of the code and libraries of the job."""
        ...

    def make(self) -> Any:  # noqa: ANN401 - each kind of task has its own
        """Do the task."""
        ...


class Work(Protocol):
    """A queue of tasks that are handed out one at a time; it receives results and failures."""

    def next_task(self, workers: int) -> Task | None:
        """Return the next task, or None if none is ready; one may be ready later."""
        ...

    def done(self, task: Any, result: Any) -> None:  # noqa: ANN401 - as `Task.make`
        """Receive a task's result."""
        ...

    def died(self, task: Any) -> None:  # noqa: ANN401 - any task
        """Handle a task during which its worker died."""
        ...

    def failed(self, task: Any, error: Exception) -> None:  # noqa: ANN401 - any task
        """Handle a task that failed, or raise its error."""
        ...


def make(task: Task) -> Any:  # noqa: ANN401 - as `Task.make`
    """Do a task on a worker; raise StageError if the job has another version."""
    connection.refuse_other_version(task.identity)
    return task.make()


@contextlib.contextmanager
def fleet(address: str, shared: Path, *, attempts: int = 1) -> "Iterator[Fleet]":
    """Connect to a scheduler, and yield its workers.

    Parameters
    ----------
    address
        The scheduler's address.
    shared
        A file that all workers must be able to read.
    attempts
        Number of times that the workers are checked, because a worker may die during a check.

    Raises
    ------
    StageError
        The scheduler can't be reached or has no workers, or a worker can't plan.
    """
    with connection.quiet(), _client(address) as client:
        connected = Fleet(address, client)
        connected.wait_for_workers()
        for attempt in range(1, attempts + 1):
            try:
                connection.refuse_unfit_workers(client, address, shared)
            except StageError:
                if attempt == attempts:
                    raise
                time.sleep(_HEARTBEAT_S)
                connected.wait_for_workers()
            else:
                break
        yield connected


class Fleet:
    """A scheduler's workers."""

    def __init__(self, address: str, client: "Client") -> None:
        self.client = client
        self._address = address
        self._slots = 0
        self._answered = self._had_workers = self._asked = time.monotonic()

    def run(self, work: Work, check: Callable[[], None] = lambda: None) -> None:
        """Hand out all tasks; `check` is called regularly, and may end the work with an error.

        Raises
        ------
        StageError
            The scheduler has died, or has had no workers for _WORKERS_S.
        """
        at_work: dict[Future[Any], Task] = {}
        try:
            while True:
                while len(at_work) < self._slots:
                    task = work.next_task(self._slots)
                    if task is None:
                        break
                    future = self.client.submit(make, task, pure=False, retries=0)
                    at_work[future] = task
                if not at_work:
                    return
                for future in [future for future in at_work if future.done()]:
                    self._settle(work, future, at_work.pop(future))
                check()
                self._check_alive()
                time.sleep(_PAUSE_S)
        finally:
            if at_work:
                with contextlib.suppress(Exception):
                    connection.within(
                        _CLOSE_S, partial(self.client.cancel, list(at_work), force=True)
                    )

    def wait_for_workers(self) -> None:
        """Wait until the scheduler has a worker, at most _WORKERS_S."""
        while not self._ask():
            self._check_workers_since()
            time.sleep(10 * _PAUSE_S)

    def _settle(self, work: Work, future: "Future[Any]", task: Task) -> None:
        """Report to `work` how a task ended."""
        from distributed.scheduler import KilledWorker

        if future.cancelled() or future.status == "lost":
            raise self._dead()
        # A task that ends or dies had a worker, even if that worker has gone since.
        self._had_workers = time.monotonic()
        try:
            result = connection.within(_ANSWER_S, future.result)
        except (KilledWorker, DiedBeforeError):
            work.died(task)
        except TimeoutError:
            raise self._dead() from None
        except Exception as error:  # noqa: BLE001 - `work` decides what to do
            work.failed(task, error)
        else:
            work.done(task, result)

    def _check_alive(self) -> None:
        """Ask the scheduler every _HEARTBEAT_S; raise StageError after _ANSWER_S without answer."""
        if time.monotonic() - self._asked < _HEARTBEAT_S:
            return
        try:
            self._ask()
        except StageError:
            if time.monotonic() - self._answered > _ANSWER_S:
                raise
        else:
            self._check_workers_since()

    def _ask(self) -> int:
        """Ask the scheduler for its workers, and return their number."""
        self._asked = time.monotonic()
        try:
            found = connection.scheduler_workers(self._address, _ANSWER_S)
        except Exception as error:
            raise self._dead() from error
        self._answered = time.monotonic()
        if found:
            self._had_workers = self._answered
            self._slots = sum(int(worker["nthreads"]) for worker in found.values())
        return len(found)

    def _check_workers_since(self) -> None:
        """Raise StageError if there have been no workers for _WORKERS_S."""
        if time.monotonic() - self._had_workers > _WORKERS_S:
            raise StageError(
                f"the Dask scheduler at {self._address!r} has had no workers for {_WORKERS_S:g} s; "
                "start some (`dask worker`), or leave --scheduler out"
            )

    def _dead(self) -> StageError:
        """Return the error for a scheduler that has died."""
        return StageError(
            f"the Dask scheduler at {self._address!r} no longer answers; all that was done is "
            "kept: start it and run again to continue, or leave --scheduler out"
        )


@contextlib.contextmanager
def _client(address: str) -> "Iterator[Client]":
    """Connect a client; a client that can't be closed in time stays open until the program ends."""
    from distributed import Client

    connect = partial(Client, address, timeout=_ANSWER_S, set_as_default=False)
    try:
        connection.scheduler_workers(address, _ANSWER_S)  # a client would try to connect for long
        client = connection.within(2 * _ANSWER_S, connect)
    except Exception as error:
        reason = " ".join(str(error).split()) or f"no answer within {_ANSWER_S:g} s"
        raise StageError(
            f"no Dask scheduler answers at {address!r} ({reason}); {_REMEDY}"
        ) from error
    try:
        yield client
    finally:
        with contextlib.suppress(Exception):
            connection.within(_CLOSE_S, partial(client.close, timeout=_CLOSE_S))
