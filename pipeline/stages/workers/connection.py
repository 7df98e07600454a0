"""Ask a Dask scheduler for its workers, with time limits, and check that they can plan."""

from __future__ import annotations

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
from pipeline.machine.store import artefact_key

if TYPE_CHECKING:
    from distributed import Client

ValueT = TypeVar("ValueT")
# Time limit for the answers of all workers, s: a worker imports the planner before it answers.
_ANSWER_S = 60.0
_OTHER_VERSION = "another version of RENEW or of its libraries; install the same on all machines"


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


def refuse_unfit_workers(client: Client, address: str, path: Path) -> None:
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
