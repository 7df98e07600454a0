"""The workers of a night: from a Dask scheduler, or from a cluster on this machine."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from pipeline.stages.workers.fleet import Fleet, fleet
from pipeline.stages.workers.local_cluster import local_cluster

# Number of times that local workers are checked, because a worker may die while it starts.
_ATTEMPTS = 3


@contextlib.contextmanager
def night_workers(
    scheduler: str | None, *, workers: int | None, memory_gb: float, shared: Path
) -> Iterator[Fleet]:
    """Yield the workers of a scheduler or of a local cluster.

    Parameters
    ----------
    scheduler
        Address of a Dask scheduler; default: DASK_SCHEDULER_ADDRESS, or else a cluster on this
        machine.
    workers
        Number of local workers; default: one per core.
    memory_gb
        Memory limit of a local worker, GB.
    shared
        A file in the output folder that all workers must be able to read.

    Raises
    ------
    StageError
        There are no workers, or a worker can't plan.
    """
    import dask

    address = scheduler or dask.config.get("scheduler-address", None)
    with contextlib.ExitStack() as held:
        if address is not None:
            yield held.enter_context(fleet(address, shared))
        else:
            address = held.enter_context(local_cluster(workers, memory_gb))
            yield held.enter_context(fleet(address, shared, attempts=_ATTEMPTS))
