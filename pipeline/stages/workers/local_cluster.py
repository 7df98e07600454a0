"""A Dask cluster of this machine: processes with one thread and a memory limit each."""

from __future__ import annotations

import contextlib
import logging
import os
from functools import partial
from typing import TYPE_CHECKING

from pipeline.stages.workers.connection import quiet, within

if TYPE_CHECKING:
    from collections.abc import Iterator

# Time for an orderly end, s.
_CLOSE_S = 3.0
# A worker is ended at its limit; until then its memory is its own. And the cluster does not give
# up a worker that dies a second time within the time in which it looks into the first.
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
    """Start a cluster; give its scheduler's address.

    Parameters
    ----------
    workers
        Number of processes; None for one a core.
    memory_gb
        Memory at which a process is ended, GB.
    """
    import dask
    from distributed import LocalCluster

    with quiet(), dask.config.set(_SETTINGS):
        cluster = LocalCluster(
            n_workers=workers or cores(),
            threads_per_worker=1,
            processes=True,
            memory_limit=int(memory_gb * 1e9),
            host="127.0.0.1",
            dashboard_address=":0",  # any free port: with none it takes the common one all the same
            silence_logs=logging.CRITICAL + 1,
        )
        try:
            yield str(cluster.scheduler_address)
        finally:
            with contextlib.suppress(Exception):
                within(2 * _CLOSE_S, partial(cluster.close, timeout=_CLOSE_S))


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
