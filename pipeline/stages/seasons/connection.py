"""Dask clusters: start one on this machine, ask a scheduler for its workers, and check these."""

import asyncio
import concurrent.futures
import contextlib
import logging
import threading
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.errors import StageError
from pipeline.machine.interpreters import cores, ignoring_working_directory
from pipeline.machine.store import artefact_key

if TYPE_CHECKING:
    from distributed import Client, LocalCluster


ValueT = TypeVar("ValueT")
# Time limit for the answers of all workers, s: a worker imports the planner before it answers.
_ANSWER_S = 60.0
_OTHER_VERSION = "another version of RENEW or of its libraries; install the same on all machines"
# Time limit for an orderly end, s, and number of tries to start.
_CLOSE_S, _TRIES = 3.0, 3
# A worker is ended at its memory limit, and neither spills nor pauses before. With the long timeout
# the cluster still replaces a worker that dies again shortly after its first death.
_SETTINGS = {
    "distributed.deploy.lost-worker-timeout": "7 days",
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.scheduler.work-stealing": False,
}


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

    return within(limit_s, lambda: asyncio.run(ask()))


def within(seconds: float, function: Callable[[], ValueT]) -> ValueT:
    """Call a function that may never return, in a thread that is abandoned after the time limit."""
    outcome: concurrent.futures.Future[ValueT] = concurrent.futures.Future()

    def call() -> None:
        try:
            outcome.set_result(function())
        except BaseException as error:  # noqa: BLE001 - raised again in the caller's thread
            outcome.set_exception(error)

    threading.Thread(target=call, daemon=True).start()
    return outcome.result(timeout=seconds)


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


def refuse_other_version(identity: str) -> None:
    """Raise StageError if this worker's code or libraries differ from those of the job."""
    if own_identity() != identity:
        raise StageError(f"a Dask worker runs {_OTHER_VERSION}")


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
        answers = within(_ANSWER_S, ask)
    except Exception as error:
        reason = " ".join(str(error).split()) or f"no answer within {_ANSWER_S:g} s"
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


@contextlib.contextmanager
def local_cluster(workers: int | None, memory_gb: float) -> Iterator[str]:
    """Start a cluster, and yield its scheduler's address.

    Parameters
    ----------
    workers
        Number of processes; default: one per core.
    memory_gb
        Memory limit of a process, GB; a process that exceeds it is ended.

    Raises
    ------
    StageError
        The cluster could not be started.
    """
    import dask

    with quiet(), dask.config.set(_SETTINGS), ignoring_working_directory():
        cluster = _started(workers or cores(), memory_gb)
        try:
            yield str(cluster.scheduler_address)
        finally:
            with contextlib.suppress(Exception):
                within(2 * _CLOSE_S, partial(cluster.close, timeout=_CLOSE_S))


def _started(workers: int, memory_gb: float, tries: int = _TRIES) -> "LocalCluster":
    """Start a cluster; if that fails, for example because a process dies, try again."""
    from distributed import LocalCluster

    try:
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=int(memory_gb * 1e9),
            host="127.0.0.1",
            dashboard_address=":0",  # any free port; with None, Dask uses its default port
            silence_logs=logging.CRITICAL + 1,
        )
    except Exception as error:
        if tries > 1:
            return _started(workers, memory_gb, tries - 1)
        raise StageError(
            f"can't start {workers} worker processes ({error}); check this machine's free memory: "
            f"each may take {memory_gb:g} GB"
        ) from error
