"""Prepare the charts and currents of a night, and then plan its cases in batches.

Batches last about 40 seconds; one that kills its worker is halved. The duration of a case is
measured on the first batch of its chart. Results do not depend on how the cases are cut.
"""

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from pipeline.errors import MachineError, PipelineError, StageError
from pipeline.machine.cluster import Fleet, fleet
from pipeline.machine.interpreters import cores
from pipeline.machine.store import Store, artefact_key, read_checked
from pipeline.machine.workers import LocalWorkers
from pipeline.nightly import worker
from pipeline.nightly.cases import Cases, NightCase
from pipeline.nightly.charts import STAGE, ChartTask, CurrentTask, chart_key
from pipeline.nightly.cycles import Partial, Row
from pipeline.nightly.forecasts import Forecasts
from pipeline.nightly.newest_currents import Newest, named_currents
from pipeline.nightly.outcome import ComeAgainError
from pipeline.nightly.records import EarlierRoute
from pipeline.nightly.worker import NightCaseTask, PlanBatch
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import CYCLES, Currents, Season
from pipeline.scenario.strict import Point
from pipeline.stages.fetch import with_max_hours
from pipeline.texts import clean

# Duration at which a batch aims, s: a killed job loses the batches that are unfinished.
_TARGET_S = 40.0
# Largest share of one worker's part of the remaining work in a batch: at the end no worker should
# wait long for another.
_SHARE = 1 / 8
# Least duration at which a batch aims, s: handing it out costs some of it.
_LEAST_S = 2.0
# Number of cases in a batch until the duration of a case is known.
_FIRST_CASES = 1
# Number of workers that a single case may kill before it is recorded as broken.
_DEATHS = 2
# Each local worker has one core.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
# What begins a failure that is not about the data.
_BROKEN = "broken: "
_DIED = (
    "its worker died (out of memory, which memory_gb limits for local workers, or a crash of the "
    "interpreter)"
)


@dataclass
class Preparation:
    """Charts or currents to make, as the fleet's `Work`; `failures` are keyed by path."""

    tasks: Iterable[ChartTask | CurrentTask]
    on_done: Callable[[], None]
    failures: dict[Path, str]

    def __post_init__(self) -> None:
        """Queue all tasks."""
        self._waiting = deque(self.tasks)
        self._tried = set[Path]()

    def next_task(self, workers: int) -> ChartTask | CurrentTask | None:
        """Return the next task, or None."""
        del workers
        return self._waiting.popleft() if self._waiting else None

    def done(self, task: ChartTask | CurrentTask, result: None) -> None:
        """Report a finished task."""
        del task, result
        self.on_done()

    def died(self, task: ChartTask | CurrentTask, reason: str) -> None:
        """Try a task again whose worker died; record the failure of one that killed two."""
        del reason  # the row says what it may have been
        if task.path not in self._tried:
            self._tried.add(task.path)
            self._waiting.append(task)
            return
        kind = "chart" if isinstance(task, ChartTask) else "current"
        self.failures[task.path] = f"{_BROKEN}preparing its {kind} failed: {_DIED}"
        self.on_done()

    def failed(self, task: ChartTask | CurrentTask, error: Exception) -> None:
        """Record why a chart or current can't be made; a failure of the machine ends the night."""
        if isinstance(error, MachineError):
            raise error
        kind = "" if isinstance(error, PipelineError) else f"{_BROKEN}{type(error).__name__}: "
        self.failures[task.path] = kind + clean(str(error))
        self.on_done()


@dataclass
class Planning:
    """Prepares the charts and currents of a night's cases, and plans the cases in batches.

    `earlier` has yesterday's routes by the case; `look_percent` and `stale` are those of
    `PlanBatch`. `on_progress` is called with the numbers of tasks or cases that are done, and of
    all; `check` is called regularly and may end the night.
    """

    cases: Cases
    newest: Newest
    store: Store
    partial: Partial
    earlier: dict[str, EarlierRoute]
    look_percent: float
    stale: str
    forecasts: Forecasts
    on_progress: Callable[[int, int], None]
    check: Callable[[], None]
    failures: dict[Path, str] = field(default_factory=dict)
    batches_s: float = 0.0
    _chart_paths: dict[tuple[int, str], Path] = field(default_factory=dict)
    _current_paths: dict[tuple[Path, object], Path] = field(default_factory=dict)

    def prepare(self, workers: Fleet | LocalWorkers) -> None:
        """Make all charts and currents that are not stored yet.

        Raises
        ------
        ComeAgainError
            No current is available yet.
        StageError
            No current could be prepared, for other reasons than its data.
        """
        examples = [self.cases[first] for first, _ in self.cases.chart_ranges()]
        charts = [
            ChartTask(_scenario(one), _ends(one), self.store.root, self.chart_path(one))
            for one in examples
        ]
        currents = [
            CurrentTask(
                one.name,
                self.season(one),
                self.chart_path(one),
                self.store.root,
                self.current_path(one),
            )
            for one in self._current_examples()
        ]
        total, done = len(charts) + len(currents), 0

        def progress() -> None:
            nonlocal done
            done += 1
            self.on_progress(done, total)

        def make(tasks: Iterable[ChartTask | CurrentTask]) -> None:
            missing = [one for one in tasks if read_checked(one.path) is None]
            workers.run(Preparation(missing, progress, self.failures), self.check)

        make(charts)
        self.failures |= {
            self.current_path(case): "; ".join(
                self.newest.ahead[one] for one in named_currents(case.season, case.member)
            )
            for case in self._current_examples()
            if not case.block.scenario.is_planar and not self._usable_currents(case)
        }
        failed = self.failures.keys()
        make(one for one in currents if not {one.path, one.chart_path} & failed)
        if currents and all(one.path in self.failures for one in currents):
            reasons = "; ".join(dict.fromkeys(self.failures[one.path] for one in currents))
            if _BROKEN in reasons:
                raise StageError(f"no current could be prepared: {reasons}")
            raise ComeAgainError(f"no currents are there yet: {reasons}")

    def plan(self, workers: Fleet | LocalWorkers) -> None:
        """Plan the cases that have no rows yet."""
        charts = [self.partial.missing(first, end) for first, end in self.cases.chart_ranges()]
        total = sum(end - first for ranges in charts for first, end in ranges)
        done = 0

        def keep(batch: PlanBatch, rows: list[Row], seconds: float) -> None:
            nonlocal done
            self.partial.add(batch.first, batch.end, rows)
            done += batch.end - batch.first
            self.batches_s += seconds
            self.on_progress(done, total)

        workers.run(BatchWork(charts, self._batch, self._keep_broken, keep), self.check)

    def chart_path(self, case: NightCase) -> Path:
        """Return the path of a case's chart."""
        if case.chart not in self._chart_paths:
            path = self.store.path("night-chart", chart_key(_scenario(case), _ends(case)))
            self._chart_paths[case.chart] = path
        return self._chart_paths[case.chart]

    def current_path(self, case: NightCase) -> Path:
        """Return the path of a case's current; all runs of a cycle use the same file."""
        chart = self.chart_path(case)
        key = (chart, case.current)
        if key not in self._current_paths:
            made_from = (self.newest.digest, chart.name, self.season(case).model_dump(mode="json"))
            self._current_paths[key] = self.store.path(
                "night-current", artefact_key(STAGE, *made_from)
            )
        return self._current_paths[key]

    def season(self, case: NightCase) -> Season:
        """Return a case's season, with the case's departure and usable currents."""
        update: dict[str, object] = {}
        if case.member is not None or self.newest.ahead:
            update["currents"] = self._usable_currents(case)
        members = case.season.members
        if members is not None and members.are_kept:
            kept = self.forecasts.members(case.season, self._usable_currents(case))
            along = members.model_copy(update={"along": CYCLES})
            update |= {"currents": kept, "members": along} if kept else {"members": None}
        leaves = self.leaves(case)
        if case.departure is not None and leaves is not None and not case.block.scenario.is_planar:
            update["departure"] = leaves
            if not case.season.is_changing:
                update["valid"] = leaves.strftime("%Y-%m-%dT%H:%MZ")
            if case.season.time_method == "mean":
                update["time_method"] = None
        season = case.season.model_copy(update=update)
        return with_max_hours(season, _longest(case)) if season.is_changing else season

    def leaves(self, case: NightCase) -> datetime | None:
        """Return a case's departure; None if neither the night nor the season gives one."""
        if case.departure is None:
            return case.season.departure
        start = self.newest.departures_from
        return None if start is None else case.departure.after(start)

    def _usable_currents(self, case: NightCase) -> tuple[Currents, ...]:
        """Return the sources of a case's currents, without those dated in the future."""
        named = named_currents(case.season, case.member)
        return tuple(one for one in named if one not in self.newest.ahead)

    def _current_examples(self) -> list[NightCase]:
        """Return one case for each current of each chart."""
        found: dict[Path, NightCase] = {}
        for first, end in self.cases.chart_ranges():
            pairs = len(self.cases[first].block.pairs)
            for index in range(first, end, pairs):
                found.setdefault(self.current_path(self.cases[index]), self.cases[index])
        return list(found.values())

    def _batch(self, first: int, end: int) -> PlanBatch:
        """Return the batch of a range of cases."""
        cases = [self.cases[index] for index in range(first, end)]
        tasks = tuple(map(self._case_task, cases))
        return PlanBatch(tasks, self.chart_path(cases[0]), self.look_percent, self.stale)

    def _case_task(self, case: NightCase) -> NightCaseTask:
        """Return the task of a case."""
        pair, current, chart = case.pair, self.current_path(case), self.chart_path(case)
        return NightCaseTask(
            case.index,
            case.name,
            case.names,
            current,
            None if pair is None else pair.start,
            None if pair is None else pair.goal,
            self.leaves(case),
            self.earlier.get(case.name),
            failure=self.failures.get(chart) or self.failures.get(current) or "",
        )

    def _keep_broken(self, index: int) -> None:
        """Keep the row of a case that killed its workers."""
        task = self._case_task(self.cases[index])
        reason = f"broken: {_DIED}, twice"
        row = worker.failed_row(task, reason, self.stale, status=worker.BROKEN)
        self.partial.add(index, index + 1, [row])
        self.on_progress(0, 0)


def _scenario(case: NightCase) -> Scenario:
    """Return a case's scenario with the case's vessel."""
    scenario = case.block.scenario
    return scenario if case.vessel is None else scenario.model_copy(update={"vessel": case.vessel})


def _ends(case: NightCase) -> tuple[Point, ...]:
    """Return start and goal of all pairs on a case's chart; the chart keeps them in water."""
    pairs = (pair for pair in case.block.pairs if pair is not None)
    return tuple(end for pair in pairs for end in (pair.start, pair.goal))


def _longest(case: NightCase) -> Scenario:
    """Return a case's scenario with the pair of its block that lies farthest apart."""
    scenario, pairs = _scenario(case), [one for one in case.block.pairs if one is not None]
    if not pairs:
        return scenario
    import pyproj

    starts, goals = (np.array([getattr(one, name) for one in pairs]) for name in ("start", "goal"))
    farthest = pairs[int(pyproj.Geod(ellps="WGS84").inv(*starts.T, *goals.T)[2].argmax())]
    return scenario.model_copy(update={"start": farthest.start, "goal": farthest.goal})


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
        Called with each batch, its rows, and its duration, s.
    """

    charts: Sequence[Sequence[tuple[int, int]]]
    batch: Callable[[int, int], PlanBatch]
    on_broken: Callable[[int], None]
    on_done: Callable[[PlanBatch, list[Row], float], None]
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

    def done(self, task: PlanBatch, result: tuple[list[Row], float]) -> None:
        """Update the seconds per case from a finished batch, and report the batch."""
        rows, seconds = result
        for waiting, ranges in zip(self._waiting, self.charts, strict=True):
            if any(first <= task.first < end for first, end in ranges):
                waiting.seconds = seconds / (task.end - task.first)
        self.on_done(task, rows, seconds)

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
