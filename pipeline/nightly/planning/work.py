"""Cut a night's cases into batches of about 40 seconds; a batch that kills its worker is halved.

The duration of a case is measured on the first batch of its chart. Results do not depend on how
the cases are cut.
"""

import contextlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.machine.cluster import Fleet, fleet
from pipeline.machine.interpreters import cores
from pipeline.machine.workers import LocalWorkers
from pipeline.nightly.planning.worker import BatchReport, PlanBatch

# Target and minimum duration of a batch, s, and its largest share of one worker's part of the
# remaining work. Batches are short because a killed job loses the unfinished ones, and because at
# the end no worker should wait long for another.
_TARGET_S, _LEAST_S, _SHARE = 40.0, 2.0, 1 / 8
# Number of cases in a batch until the duration of a case is known.
_FIRST_CASES = 1
# Number of workers that a single case may kill before it is recorded as broken.
_DEATHS = 2
# Each local worker has one core.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


@dataclass
class _Waiting:
    """Waiting cases of one chart as ranges, and the seconds per case (None: not known yet)."""

    ranges: deque[tuple[int, int]]
    seconds: float | None = None

    @property
    def count(self) -> int:
        """Number of waiting cases."""
        return sum(end - first for first, end in self.ranges)


@dataclass
class BatchWork:
    """The batches of a night, as the fleet's `Work`.

    Parameters
    ----------
    charts
        The ranges of cases to plan on each chart.
    batch
        Returns the batch of a range of cases.
    on_broken
        Called with the index of a case that has killed _DEATHS workers.
    on_done
        Called with each batch's report.
    """

    charts: Sequence[Sequence[tuple[int, int]]]
    batch: Callable[[int, int], PlanBatch]
    on_broken: Callable[[int], None]
    on_done: Callable[[BatchReport], None]
    _waiting: list[_Waiting] = field(init=False)
    _deaths: dict[int, int] = field(default_factory=dict)
    # Halves of batches whose worker died.
    _suspects: deque[tuple[int, int]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        """Queue all cases."""
        self._waiting = [_Waiting(deque(ranges)) for ranges in self.charts]

    def next_task(self, workers: int) -> PlanBatch | None:
        """Return the next batch; halves of a batch that killed its worker come first."""
        if self._suspects:
            return self.batch(*self._suspects.popleft())
        for waiting in self._waiting:
            if waiting.ranges:
                return self.batch(*_cut(waiting, workers))
        return None

    def done(self, task: PlanBatch, result: BatchReport) -> None:
        """Update the seconds per case from a finished batch, and report the batch."""
        count = task.end - task.first
        if result.seconds > 0:
            for waiting, ranges in zip(self._waiting, self.charts, strict=True):
                if any(first <= task.first < end for first, end in ranges):
                    waiting.seconds = result.seconds / count
        self.on_done(result)

    def died(self, task: PlanBatch, reason: str) -> None:
        """Halve a batch; a single case is tried once more, and then recorded as broken."""
        del reason  # the row says what it may have been
        if task.end - task.first > 1:
            middle = (task.first + task.end) // 2
            self._suspects.extend([(task.first, middle), (middle, task.end)])
            return
        self._deaths[task.first] = self._deaths.get(task.first, 0) + 1
        if self._deaths[task.first] < _DEATHS:
            self._suspects.append((task.first, task.end))
        else:
            self.on_broken(task.first)

    def failed(self, task: PlanBatch, error: Exception) -> None:
        """End the night: a batch fails for reasons such as a full disk, not because of a case."""
        del task
        raise error


def _cut(waiting: _Waiting, workers: int) -> tuple[int, int]:
    """Remove a range of cases for the next batch from the waiting ones."""
    count = _FIRST_CASES
    if waiting.seconds is not None:
        share_s = _SHARE * waiting.count * waiting.seconds / max(workers, 1)
        count = max(1, round(max(_LEAST_S, min(_TARGET_S, share_s)) / max(waiting.seconds, 1e-6)))
    first, end = waiting.ranges.popleft()
    middle = min(end, first + count)
    if middle < end:
        waiting.ranges.appendleft((middle, end))
    return first, middle


@contextlib.contextmanager
def night_workers(
    scheduler: str | None, *, workers: int | None, memory_gb: float, shared: Path
) -> Iterator[Fleet | LocalWorkers]:
    """Yield the workers of a scheduler or of this machine.

    Parameters
    ----------
    scheduler
        Address of a Dask scheduler; default: DASK_SCHEDULER_ADDRESS, or else processes of this
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
    if address is not None:
        with fleet(address, shared) as dask_workers:
            yield dask_workers
    else:
        memory = int(memory_gb * 1e9)
        with LocalWorkers(
            workers or cores(), resident_bytes=memory, variables=_ONE_THREAD
        ) as local_workers:
            yield local_workers
