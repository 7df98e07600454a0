"""Runs the seasons' tasks: in threads, in processes, or on a Dask scheduler's workers."""

from collections.abc import Callable, Sequence
from functools import partial

from pipeline.stages.seasons.task import SeasonTask, Status, plan_and_evaluate, status_of
from pipeline.stages.workers.local_cluster import cores


def run_tasks(
    tasks: Sequence[SeasonTask], scheduler: str | None, on_status: Callable[[Status], None]
) -> None:
    """Run tasks, and report the status of each as it ends.

    Parameters
    ----------
    tasks
        Independent of each other.
    scheduler
        Address of a Dask scheduler. Without it, the one in DASK_SCHEDULER_ADDRESS; without that,
        threads of this process: a plan takes seconds, and a new process as long to import. Tasks
        with a limit run in processes, which can be killed.
    on_status
        Called in this thread.
    """
    if not tasks:
        return
    import dask

    address = scheduler or dask.config.get("scheduler-address", None)
    if address is not None:
        from pipeline.stages.seasons.cluster import run_on_scheduler

        run_on_scheduler(tasks, address, on_status)
    elif any(task.limit_s is not None for task in tasks):
        from pipeline.stages.seasons.process import run_in_processes

        run_in_processes(tasks, cores(), on_status)
    else:
        # A single one, too: an exception raised by a signal in the main thread must not meet
        # compiled code, whose caller in C does not expect it.
        _run_in_threads(tasks, on_status)


def _run_in_threads(tasks: Sequence[SeasonTask], on_status: Callable[[Status], None]) -> None:
    """Run tasks in threads of this process. None of them raises, so that none stops the others."""
    from dask.callbacks import Callback
    from dask.threaded import get

    names = {f"season-{i}": task for i, task in enumerate(tasks)}
    graph = {
        name: (status_of, task.season, partial(plan_and_evaluate, task))
        for name, task in names.items()
    }

    def posttask(key: str, result: Status, *rest: object) -> None:
        del key, rest
        on_status(result)

    with Callback(posttask=posttask):  # type: ignore[no-untyped-call]
        get(graph, list(names), num_workers=min(len(tasks), cores()))
