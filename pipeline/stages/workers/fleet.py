"""Hands out tasks to the workers of a Dask scheduler and watches them; every wait has a limit.

Each worker has one task at a time, so that no task waits in a worker that another task kills. If a
worker dies, its task is reported and not repeated: the owner of the work decides about it.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from pipeline.errors import StageError
from pipeline.stages.workers.connection import (
    quiet,
    refuse_other_version,
    refuse_unfit_workers,
    scheduler_workers,
    within,
)

if TYPE_CHECKING:
    from distributed import Client, Future

# Times within which a scheduler must answer, workers must be there, and an end is orderly, s.
_ANSWER_S, _WORKERS_S, _CLOSE_S = 20.0, 120.0, 3.0
# Times between two looks at tasks, and between two questions whether the scheduler lives, s.
_PAUSE_S, _HEARTBEAT_S = 0.05, 5.0
_REMEDY = "check the address, or leave --scheduler out"


class DiedBeforeError(Exception):
    """A worker has died of this very task."""


class Task(Protocol):
    """A task for a worker."""

    @property
    def identity(self) -> str:
        """Identity of the code that asks for it."""
        ...

    def make(self) -> Any:  # noqa: ANN401 - each kind of task has its own
        """Do the task."""
        ...


class Work(Protocol):
    """Tasks to hand out one at a time; it receives their results and failures."""

    def next_task(self, workers: int) -> Task | None:
        """Return the next task, or None where there is none now; there may be one later."""
        ...

    def done(self, task: Any, result: Any) -> None:  # noqa: ANN401 - as `Task.make`
        """Take a task's result."""
        ...

    def died(self, task: Any) -> None:  # noqa: ANN401 - any task
        """Handle the death of a worker by a task."""
        ...

    def failed(self, task: Any, error: Exception) -> None:  # noqa: ANN401 - any task
        """Handle a task that failed, or raise its error."""
        ...


def make(task: Task) -> Any:  # noqa: ANN401 - as `Task.make`
    """Do a task on a worker."""
    refuse_other_version(task.identity)
    return task.make()


@contextlib.contextmanager
def fleet(address: str, shared: Path, *, attempts: int = 1) -> Iterator[Fleet]:
    """Provide the workers of a scheduler.

    Parameters
    ----------
    address
        Of the scheduler.
    shared
        A file that all workers must be able to read.
    attempts
        Number of times that workers are looked at, as they may die just then.

    Raises
    ------
    StageError
        It can't be reached, has no workers, or some can't do the work.
    """
    with quiet(), _client(address) as client:
        connected = Fleet(address, client)
        connected.wait_for_workers()
        for attempt in range(1, attempts + 1):
            try:
                refuse_unfit_workers(client, address, shared)
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

    def __init__(self, address: str, client: Client) -> None:
        self.client = client
        self._address = address
        self._slots = 0
        self._answered = self._had_workers = self._asked = time.monotonic()

    def run(self, work: Work, check: Callable[[], None] = lambda: None) -> None:
        """Hand out all tasks; `check` is called regularly, and may end the work by an error.

        Raises
        ------
        StageError
            The scheduler has died, or has had no workers for long; or a task failed for good.
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
                    within(_CLOSE_S, partial(self.client.cancel, list(at_work), force=True))

    def wait_for_workers(self) -> None:
        """Wait until there is a worker."""
        while not self._ask():
            self._check_workers_since()
            time.sleep(10 * _PAUSE_S)

    def _settle(self, work: Work, future: Future[Any], task: Task) -> None:
        """Report how a task ended."""
        from distributed.scheduler import KilledWorker

        if future.cancelled() or future.status == "lost":
            raise self._dead()
        # A task ends, or dies, on a worker, which may be gone again at the next question.
        self._had_workers = time.monotonic()
        try:
            result = within(_ANSWER_S, future.result)
        except (KilledWorker, DiedBeforeError):
            work.died(task)
        except TimeoutError:
            raise self._dead() from None
        except Exception as error:  # noqa: BLE001 - what to make of it is its owner's
            work.failed(task, error)
        else:
            work.done(task, result)

    def _check_alive(self) -> None:
        """Ask the scheduler now and then; give up when it has not answered for long."""
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
        """Ask the scheduler for its workers; return how many tasks they can do at a time."""
        self._asked = time.monotonic()
        try:
            found = scheduler_workers(self._address, _ANSWER_S)
        except Exception as error:
            raise self._dead() from error
        self._answered = time.monotonic()
        if found:
            self._had_workers = self._answered
            self._slots = sum(int(worker["nthreads"]) for worker in found.values())
        return len(found)

    def _check_workers_since(self) -> None:
        """Give up when there have been no workers for long."""
        if time.monotonic() - self._had_workers > _WORKERS_S:
            raise StageError(
                f"the Dask scheduler at {self._address!r} has had no workers for {_WORKERS_S:g} s; "
                "start some (`dask worker`), or leave --scheduler out"
            )

    def _dead(self) -> StageError:
        """Return the error that the scheduler has died."""
        return StageError(
            f"the Dask scheduler at {self._address!r} no longer answers; all that was done is "
            "kept: start it and run again to continue, or leave --scheduler out"
        )


@contextlib.contextmanager
def _client(address: str) -> Iterator[Client]:
    """Connect a client; if it can't be closed in time, it stays open until the program ends."""
    from distributed import Client

    connect = partial(Client, address, timeout=_ANSWER_S, set_as_default=False)
    try:
        scheduler_workers(address, _ANSWER_S)  # a client would try to connect for long
        client = within(2 * _ANSWER_S, connect)
    except Exception as error:
        reason = " ".join(str(error).split()) or f"no answer within {_ANSWER_S:g} s"
        raise StageError(
            f"no Dask scheduler answers at {address!r} ({reason}); {_REMEDY}"
        ) from error
    try:
        yield client
    finally:
        with contextlib.suppress(Exception):
            within(_CLOSE_S, partial(client.close, timeout=_CLOSE_S))
