"""Runs jobs in processes of their own, forked from a server in which all code is compiled.

`multiprocessing`'s fork server: a job begins within milliseconds, with the kernels compiled once a
run; and ends without the interpreter's shutdown, at which OMPL complains of objects still alive.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext

from experiments.jobs import Job, Result
from pipeline.errors import StageError
from pipeline.machine.interpreters import ignoring_working_directory

WARM_MODULE = "experiments.warm"


def begin_warming() -> ForkServerContext:
    """Start the fork server, if it doesn't run yet: it compiles while other things are done."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([WARM_MODULE])
    with ignoring_working_directory():
        forkserver.ensure_running()
    return context


def results_of(
    jobs: Sequence[Job], work: Callable[[Job], Result], workers: int
) -> Iterator[Result]:
    """Give each job's result as it is done.

    Raises
    ------
    StageError
        A process was killed: out of memory, or a crash in a library.
    """
    context = begin_warming()
    with ProcessPoolExecutor(workers, context, max_tasks_per_child=1) as pool:
        waiting = {pool.submit(work, job): job for job in jobs}
        try:
            while waiting:
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    job = waiting.pop(future)
                    try:
                        yield future.result()
                    except OSError as error:
                        raise StageError(f"{job.name}: {error}; free some space") from error
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            if type(error).__name__ == "BrokenProcessPool":
                raise StageError(
                    "a process of an experiment was killed; free some memory, or run fewer at "
                    "once with --workers 1"
                ) from error
            raise


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0))
