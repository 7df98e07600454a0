"""Questions to a Dask scheduler that may never answer, and its library kept from the terminal."""

import asyncio
import concurrent.futures
import contextlib
import logging
import threading
import warnings
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

ValueT = TypeVar("ValueT")


def scheduler_workers(address: str, limit_s: float) -> dict[str, Any]:
    """Ask a scheduler for its workers, without a client, which would try to connect for long.

    Any exception means that there is none that answers in time.
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
    """Call a function that may never return: in a thread that is left behind past the limit."""
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
    """Keep the library from writing its own log lines and warnings between this program's."""
    import distributed

    del distributed  # sets the levels of its loggers when it is imported
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
