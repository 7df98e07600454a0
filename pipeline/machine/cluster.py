"""The workers of a Dask scheduler on other machines: check them, hand out tasks and monitor them.

A worker gets one task per thread at a time, so a task that kills its worker takes no waiting task
with it. If workers die of a task, it is reported to the `Work`, which decides whether to repeat it.
"""

import asyncio
import contextlib
import logging
import math
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import StageError
from pipeline.machine.interpreters import begun
from pipeline.machine.store import artefact_key
from pipeline.machine.workers import Work, WorkerEndedError, WorkerTask, call_in_process, make_task
from pipeline.texts import clean

if TYPE_CHECKING:
    from distributed import Client, Future

# Time limit for the answers of all workers, s: a worker imports the planner before it answers.
_WORKERS_ANSWER_S = 60.0
_OTHER_VERSION = "another version of RENEW or of its libraries; install the same on all machines"
# Time limit for an answer of the scheduler, s.
_ANSWER_S = 20.0
# Time for workers to appear, s.
_WORKERS_S = 120.0
# Time for an orderly end, s; after it, the program goes on without one.
_CLOSE_S = 3.0
# Time between two checks of the tasks, s.
_PAUSE_S = 0.05
# Time between two checks of the scheduler, s.
_HEARTBEAT_S = 5.0
_REMEDY = "check the address, or leave --scheduler out"


def scheduler_workers(address: str, limit_s: float) -> dict[str, Any]:
    """Ask a scheduler for its workers, without a client, which would try to connect for long.

    Raises any exception if no scheduler answers within the limit.
    """
    from distributed import rpc
    from distributed.security import Security

    async def ask() -> dict[str, Any]:
        arguments = Security().get_connection_args("client")
        scheduler = rpc(address, timeout=limit_s, connection_args=arguments)
        try:
            answer = await asyncio.wait_for(scheduler.identity(), limit_s)
        finally:
            await scheduler.close_rpc()
        workers: dict[str, Any] = answer["workers"]
        return workers

    return begun(lambda: asyncio.run(ask())).result(limit_s)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silence Dask's log lines and warnings inside the `with` block."""
    import distributed

    del distributed  # imported because it then sets the levels of its loggers
    loggers = [
        logging.getLogger(name)
        for name in logging.root.manager.loggerDict
        if name.partition(".")[0] in {"distributed", "tornado", "asyncio"}
    ]
    levels = [logger.level for logger in loggers]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for logger in loggers:
            logger.setLevel(logging.CRITICAL + 1)
        try:
            yield
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)


def own_identity() -> str:
    """Return a hash of all code and libraries that plans depend on."""
    return artefact_key("evaluate")


def worker_fault(identity: str, path: str) -> str:
    """Return why this worker can't plan for a job with this code identity, or ""."""
    if own_identity() != identity:
        return f"runs {_OTHER_VERSION}"
    if not Path(path).is_file():
        return f"can't read {path}; give all workers access to the same output folder"
    return ""


def refuse_unfit_workers(client: "Client", address: str, path: Path) -> None:
    """Raise a StageError that names the workers that can't plan, read a path or answer."""
    ask = partial(client.run, worker_fault, own_identity(), str(path), on_error="return")
    try:
        answers = begun(ask).result(_WORKERS_ANSWER_S)
    except Exception as error:
        reason = clean(str(error)) or f"no answer within {_WORKERS_ANSWER_S:g} s"
        raise StageError(
            f"workers of the Dask scheduler at {address!r} do not answer ({reason}); restart them"
        ) from error
    faults: dict[str, list[str]] = {}
    for worker, answer in answers.items():
        if isinstance(answer, BaseException):
            answer = (  # noqa: PLW2901
                f"can't run RENEW ({type(answer).__name__}: {clean(str(answer))}); "
                "install the same version on all machines"
            )
        if answer:
            faults.setdefault(answer, []).append(worker)
    if faults:
        lines = [f"Dask worker {', '.join(names)} {fault}" for fault, names in faults.items()]
        raise StageError("; ".join(lines))


def make(task: WorkerTask, identity: str, limit_s: float) -> Any:  # noqa: ANN401 - as `WorkerTask.make`
    """Do a task on a Dask worker; with a time limit, in a process that is killed after it.

    Raises StageError if the job has another code identity; WorkerEndedError if the process with the
    time limit has ended.
    """
    if own_identity() != identity:
        raise StageError(f"a Dask worker runs {_OTHER_VERSION}")
    if math.isinf(limit_s):
        return task.make()
    return call_in_process(make_task, task, limit_s=limit_s)


@contextlib.contextmanager
def fleet(address: str, shared: Path, limit_s: float = math.inf) -> "Iterator[Fleet]":
    """Connect to a scheduler, and yield its workers; `limit_s` is the time limit of a task, s.

    Raises StageError if the scheduler can't be reached or has no workers, or a worker can't plan or
    read the file `shared`.
    """
    with quiet(), _client(address) as client:
        connected = Fleet(address, client, limit_s)
        connected.wait_for_workers()
        refuse_unfit_workers(client, address, shared)
        yield connected


class Fleet:
    """A scheduler's workers."""

    def __init__(self, address: str, client: "Client", limit_s: float) -> None:
        self.client = client
        self._address, self._limit_s = address, limit_s
        self._slots = 0
        self._answered = self._had_workers = self._asked = time.monotonic()

    def run(self, work: Work, check: Callable[[], None] = lambda: None) -> None:
        """Hand out all tasks; `check` is called regularly, and may end the work with an error.

        Raises StageError if the scheduler has died, or has had no workers for _WORKERS_S.
        """
        at_work: dict[Future[Any], WorkerTask] = {}
        identity = own_identity()
        try:
            while True:
                while len(at_work) < self._slots:
                    task = work.next_task(self._slots)
                    if task is None:
                        break
                    future = self.client.submit(
                        make, task, identity, self._limit_s, pure=False, retries=0
                    )
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
                    cancel = partial(self.client.cancel, list(at_work), force=True)
                    begun(cancel).result(_CLOSE_S)

    def wait_for_workers(self) -> None:
        """Wait until the scheduler has a worker, at most _WORKERS_S."""
        while not self._ask():
            self._check_workers_since()
            time.sleep(10 * _PAUSE_S)

    def _settle(self, work: Work, future: "Future[Any]", task: WorkerTask) -> None:
        """Report to `work` how a task ended."""
        from distributed.scheduler import KilledWorker

        if future.cancelled() or future.status == "lost":
            raise self._dead()
        # A task that ends or dies had a worker, even if that worker has gone since.
        self._had_workers = time.monotonic()
        try:
            result = begun(future.result).result(_ANSWER_S)
        except KilledWorker:
            work.died(task, "its workers died (out of memory, or a crash of the interpreter)")
        except WorkerEndedError as ended:
            work.died(task, str(ended))
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
            workers = scheduler_workers(self._address, _ANSWER_S)
        except Exception as error:
            raise self._dead() from error
        self._answered = time.monotonic()
        if workers:
            self._had_workers = self._answered
            self._slots = sum(int(worker["nthreads"]) for worker in workers.values())
        return len(workers)

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
        scheduler_workers(address, _ANSWER_S)  # a client would try to connect for long
        client = begun(connect).result(2 * _ANSWER_S)
    except Exception as error:
        reason = clean(str(error)) or f"no answer within {_ANSWER_S:g} s"
        raise StageError(
            f"no Dask scheduler answers at {address!r} ({reason}); {_REMEDY}"
        ) from error
    try:
        yield client
    finally:
        with contextlib.suppress(Exception):
            begun(partial(client.close, timeout=_CLOSE_S)).result(_CLOSE_S)
