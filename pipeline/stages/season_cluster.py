"""Seasons on a Dask scheduler's workers: every wait has a limit, a dead scheduler is noticed."""

from __future__ import annotations

import contextlib
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import StageError
from pipeline.stages.scheduler_connection import quiet, scheduler_workers, within
from pipeline.stages.season_process import run_in_processes
from pipeline.stages.season_task import Status, plan_and_evaluate, status_of
from pipeline.storage.code_identity import code_hash
from pipeline.storage.store import artefact_key

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from distributed import Client, Future

    from pipeline.stages.season_task import SeasonTask

# Number of retries: an error on one worker, say for lack of memory, need not happen on another.
_RETRIES = 1
# Time within which a scheduler, or a worker's answer, must come, s.
_ANSWER_S = 20.0
# Time for which a scheduler may be without workers, s: a cluster may still be starting them.
_WORKERS_S = 60.0
# Times between two looks at tasks, and between two questions whether the scheduler lives, s.
_PAUSE_S, _HEARTBEAT_S = 0.1, 5.0
# Time for an orderly end, s.
_CLOSE_S = 2.0
_REMEDY = "check the address, or leave --scheduler out"


def run_on_scheduler(
    tasks: Sequence[SeasonTask], address: str, on_status: Callable[[Status], None]
) -> None:
    """Run tasks on a scheduler's workers: a worker that dies does not end the tasks of the others.

    Where the scheduler or all workers die, the tasks that are not done have failed.

    Raises
    ------
    StageError
        The scheduler can't be reached, has no workers, or some can't do the work.
    """
    with quiet():
        cluster = _Cluster(address)
        cluster.wait_for_workers()
        with cluster.client() as client:
            refuse_unfit_workers(client, address, tasks[0].scene_path)
            waiting = {
                client.submit(plan_on_worker, task, pure=False, retries=_RETRIES): task
                for task in tasks
            }
            try:
                while waiting:
                    for future in [future for future in waiting if future.done()]:
                        status = cluster.status(future, waiting[future])
                        del waiting[future]
                        on_status(status)
                    cluster.check_alive()
                    time.sleep(_PAUSE_S)
            except StageError as error:
                for task in waiting.values():
                    on_status(_status_without_scheduler(task, error))
            finally:
                with contextlib.suppress(Exception):
                    within(_CLOSE_S, partial(client.cancel, list(waiting), force=True))


def _status_without_scheduler(task: SeasonTask, error: StageError) -> Status:
    """Return a task's status by the store: it may have been done before the scheduler died."""
    result = task.result()
    if result is None:
        return Status(task.season, str(error), crashed=True)
    return Status(task.season, result[0].failure, crashed=False)


def plan_on_worker(task: SeasonTask) -> Status:
    """Run a task on a worker: with a limit, in a process that is killed when its time is up."""
    if task.limit_s is None:
        return Status(task.season, plan_and_evaluate(task), crashed=False)
    ended: list[Status] = []
    run_in_processes([task], 1, ended.append)
    return ended[0]


def worker_fault(identity: str, scene_path: str) -> str:
    """Say why this worker can't plan, by the asker's own identity; empty when it can."""
    if own_identity() != identity:
        return "runs another version of RENEW or of its libraries; install the same on all machines"
    if not Path(scene_path).is_file():
        return f"can't read {scene_path}; give all workers access to the same output folder"
    return ""


def own_identity() -> str:
    """Return a hash of all code and libraries that plans depend on."""
    return artefact_key("evaluate", code_hash("plan"))


def refuse_unfit_workers(client: Client, address: str, path: Path) -> None:
    """Refuse workers that can't do the work, or read a path; one that is silent, too.

    Raises
    ------
    StageError
        One line that names them.
    """
    ask = partial(client.run, worker_fault, own_identity(), str(path), on_error="return")
    try:
        answers = within(_WORKERS_S, ask)  # they import what plans first
    except Exception as error:
        reason = " ".join(str(error).split()) or f"no answer within {_WORKERS_S:g} s"
        raise StageError(
            f"workers of the Dask scheduler at {address!r} do not answer ({reason}); restart them"
        ) from error
    faults: dict[str, list[str]] = {}
    for worker, answer in answers.items():
        if isinstance(answer, BaseException):
            answer = (  # noqa: PLW2901
                f"can't run RENEW ({type(answer).__name__}: {' '.join(str(answer).split())}); "
                "install the same version on all machines"
            )
        if answer:
            faults.setdefault(answer, []).append(worker)
    if faults:
        lines = [f"Dask worker {', '.join(names)} {fault}" for fault, names in faults.items()]
        raise StageError("; ".join(lines))


class _Cluster:
    """A scheduler, and when it last answered and last had workers."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._answered = self._had_workers = self._asked = time.monotonic()

    def wait_for_workers(self) -> None:
        """Wait until there is a worker."""
        try:
            while not self._workers():
                self._check_workers_since()
                time.sleep(_PAUSE_S)
        except StageError:
            raise
        except Exception as error:
            reason = " ".join(str(error).split()) or f"no answer within {_ANSWER_S:g} s"
            raise StageError(
                f"no Dask scheduler answers at {self._address!r} ({reason}); {_REMEDY}"
            ) from error

    @contextlib.contextmanager
    def client(self) -> Iterator[Client]:
        """Connect; a client that can't be closed in time is left to the end of the program."""
        from distributed import Client

        connect = partial(Client, self._address, timeout=_ANSWER_S, set_as_default=False)
        try:
            client = within(2 * _ANSWER_S, connect)
        except Exception as error:
            raise StageError(
                f"no Dask scheduler answers at {self._address!r} ({error}); {_REMEDY}"
            ) from error
        try:
            yield client
        finally:
            with contextlib.suppress(Exception):
                within(_CLOSE_S, partial(client.close, timeout=_CLOSE_S))

    def status(self, future: Future[Status], task: SeasonTask) -> Status:
        """Return how a task ended."""
        if future.cancelled():
            raise self._dead()
        ended: list[Status] = []

        def result() -> str:
            ended.append(within(_ANSWER_S, future.result))
            return ""

        status = status_of(task.season, result)
        return ended[0] if ended else status

    def check_alive(self) -> None:
        """Ask the scheduler now and then; give up when it has not answered for long."""
        if time.monotonic() - self._asked < _HEARTBEAT_S:
            return
        try:
            self._workers()
        except Exception as error:
            if time.monotonic() - self._answered > _ANSWER_S:
                raise self._dead() from error
        else:
            self._check_workers_since()

    def _workers(self) -> bool:
        """Ask the scheduler whether it has workers."""
        self._asked = time.monotonic()
        has_workers = bool(scheduler_workers(self._address, _ANSWER_S))
        self._answered = time.monotonic()
        if has_workers:
            self._had_workers = self._answered
        return has_workers

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
            f"the Dask scheduler at {self._address!r} no longer answers; all seasons that were "
            "done are kept: start it and run again to continue, or leave --scheduler out"
        )
