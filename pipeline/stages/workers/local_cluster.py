"""A Dask cluster on this machine: processes with one thread and a memory limit each."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from pipeline.errors import StageError
from pipeline.machine.interpreters import ignoring_working_directory
from pipeline.stages.workers.connection import quiet, within

if TYPE_CHECKING:
    from distributed import LocalCluster

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


def _started(workers: int, memory_gb: float, tries: int = _TRIES) -> LocalCluster:
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


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
