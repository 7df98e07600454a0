"""Prepare the charts and currents of a night, and then plan its cases in batches.

Batches last about 40 seconds; one that kills its worker is halved. The duration of a case is
measured on the batches of its chart. Results do not depend on how the cases are cut.
"""

import contextlib
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from pipeline.errors import MachineError, PipelineError, StageError
from pipeline.geo.projection import GEOD
from pipeline.machine.cluster import Fleet, fleet
from pipeline.machine.interpreters import cores
from pipeline.machine.store import Store, artefact_key, read_checked
from pipeline.machine.workers import LocalWorkers
from pipeline.nightly import worker
from pipeline.nightly.cases import NightCase, sources_of
from pipeline.nightly.currents import ComeAgainError, Newest
from pipeline.nightly.cycles import Partial, Row
from pipeline.nightly.records import EarlierRoute
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Currents, Season
from pipeline.scenario.strict import Point
from pipeline.stages.fetch import on_clock
from pipeline.texts import clean

# Duration of a batch, s: a job that is killed loses its unfinished batches.
_TARGET_S = 40.0
# A batch has at most this share of the work that remains for each worker: so at the end no worker
# waits long for another.
_SHARE = 1 / 8
# Shortest duration of a batch, s: to hand out a batch takes time, too.
_LEAST_S = 2.0
# Number of cases in a batch until the duration of a case is known.
_FIRST_CASES = 1
# Number of workers that a single case may kill before it is recorded as broken.
_DEATHS = 2
# Each local worker has one core.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
# Begins the reason of a failure of a worker or of the program, not of the data.
_BROKEN = "broken: "
_DIED = (
    "its worker died (out of memory, which memory_gb limits for local workers, or a crash of the "
    "interpreter)"
)


@dataclass
class Preparation:
    """Charts or currents to make, as `Work` of the workers; `failures` are keyed by path."""

    tasks: Iterable[worker.ChartTask | worker.CurrentTask]
    on_done: Callable[[], None]
    failures: dict[Path, str]

    def __post_init__(self) -> None:
        """Queue all tasks."""
        self._waiting = deque(self.tasks)
        self._tried = set[Path]()

    def next_task(self, workers: int) -> worker.ChartTask | worker.CurrentTask | None:
        """Return the next task, or None."""
        del workers
        return self._waiting.popleft() if self._waiting else None

    def done(self, task: worker.ChartTask | worker.CurrentTask, result: None) -> None:
        """Report a finished task."""
        del task, result
        self.on_done()

    def died(self, task: worker.ChartTask | worker.CurrentTask, reason: str) -> None:
        """Try a task again whose worker died; record the failure of one that killed two."""
        del reason  # the case's row names what may have been the reason
        if task.path not in self._tried:
            self._tried.add(task.path)
            self._waiting.append(task)
            return
        kind = "chart" if isinstance(task, worker.ChartTask) else "current"
        self.failures[task.path] = f"{_BROKEN}preparing its {kind} failed: {_DIED}"
        self.on_done()

    def failed(self, task: worker.ChartTask | worker.CurrentTask, error: Exception) -> None:
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
    `PlanBatch`. The folder `output` has the forecasts of earlier nights. `on_progress` is called
    with the numbers of tasks or cases that are done, and of all; `check` is called regularly and
    may end the night.
    """

    cases: Sequence[NightCase]
    newest: Newest
    store: Store
    partial: Partial
    earlier: dict[str, EarlierRoute]
    look_percent: float
    stale: str
    output: Path
    on_progress: Callable[[int, int], None]
    check: Callable[[], None]
    failures: dict[Path, str] = field(default_factory=dict)
    _chart_paths: dict[tuple[int, str], Path] = field(default_factory=dict)
    _current_paths: dict[tuple[Path, object], Path] = field(default_factory=dict)

    def prepare(self, workers: Fleet | LocalWorkers) -> None:
        """Make all charts and currents that are not stored yet.

        Raises ComeAgainError if no current is available yet; StageError if no current could be
        prepared, for other reasons than its data.
        """
        of_charts = dict[Path, NightCase]()
        of_currents = dict[Path, NightCase]()
        for case in self.cases:
            of_charts.setdefault(self.chart_path(case), case)
            of_currents.setdefault(self.current_path(case), case)
        charts = [
            worker.ChartTask(_scenario(case), _ends(case), self.store.root, path)
            for path, case in of_charts.items()
        ]
        currents = [
            worker.CurrentTask(self.season(case), self.chart_path(case), self.store.root, path)
            for path, case in of_currents.items()
        ]
        total, done = len(charts) + len(currents), 0

        def progress() -> None:
            nonlocal done
            done += 1
            self.on_progress(done, total)

        def make(tasks: Iterable[worker.ChartTask | worker.CurrentTask]) -> None:
            missing = [task for task in tasks if read_checked(task.path) is None]
            workers.run(Preparation(missing, progress, self.failures), self.check)

        make(charts)
        self.failures |= {
            path: "; ".join(self.newest.ahead[one] for one in sources_of(case.season, case.member))
            for path, case in of_currents.items()
            if not case.block.scenario.is_planar and not self._usable_currents(case)
        }
        failed = self.failures.keys()
        make(task for task in currents if not {task.path, task.chart_path} & failed)
        if currents and all(path in self.failures for path in of_currents):
            reasons = "; ".join(dict.fromkeys(self.failures[path] for path in of_currents))
            if _BROKEN in reasons:
                raise StageError(f"no current could be prepared: {reasons}")
            raise ComeAgainError(f"no currents are there yet: {reasons}")

    def plan(self, workers: Fleet | LocalWorkers) -> None:
        """Plan the cases that have no rows yet."""
        waiting = [case for case in self.cases if case.index not in self.partial.rows]
        charts: dict[Path, list[NightCase]] = {}
        for case in waiting:
            charts.setdefault(self.chart_path(case), []).append(case)
        done = 0

        def keep(rows: list[Row]) -> None:
            nonlocal done
            self.partial.add(rows)
            done += sum(not row["rank"] for row in rows)
            self.on_progress(done, len(waiting))

        def keep_broken(task: worker.NightCaseTask) -> None:
            reason = f"broken: {_DIED}, twice"
            keep([worker.failed_row(task, reason, self.stale, status=worker.BROKEN)])

        workers.run(BatchWork(charts, self._batch, keep_broken, keep), self.check)

    def chart_path(self, case: NightCase) -> Path:
        """Return the path of a case's chart."""
        if case.chart not in self._chart_paths:
            path = self.store.path("night-chart", worker.chart_key(_scenario(case), _ends(case)))
            self._chart_paths[case.chart] = path
        return self._chart_paths[case.chart]

    def current_path(self, case: NightCase) -> Path:
        """Return the path of a case's current; all runs of a cycle use the same file."""
        chart = self.chart_path(case)
        key = (chart, case.current)
        if key not in self._current_paths:
            made_from = (self.newest.digest, chart.name, self.season(case).model_dump(mode="json"))
            self._current_paths[key] = self.store.path(
                "night-current", artefact_key(worker.STAGE, *made_from)
            )
        return self._current_paths[key]

    def season(self, case: NightCase) -> Season:
        """Return a case's season, with the case's departure and usable currents."""
        update: dict[str, object] = {}
        if case.member is not None or self.newest.ahead:
            update["currents"] = self._usable_currents(case)
        leaves = self.leaves(case)
        if case.departure is not None and leaves is not None and not case.block.scenario.is_planar:
            update["departure"] = leaves
            if not case.season.is_changing:
                update["valid"] = leaves.strftime("%Y-%m-%dT%H:%MZ")
            if case.season.time_method == "mean":
                update["time_method"] = None
        season = case.season.model_copy(update=update)
        if not season.is_changing and case.block.scenario.limits is None:
            return season
        return season.model_copy(update={"max_hours": on_clock(season, _longest(case)).max_hours})

    def leaves(self, case: NightCase) -> datetime | None:
        """Return a case's departure; None if neither the night nor the season gives one."""
        if case.departure is None:
            return case.season.departure
        start = self.newest.departures_from
        return None if start is None else case.departure.after(start)

    def _usable_currents(self, case: NightCase) -> tuple[Currents, ...]:
        """Return the sources of a case's currents, without those dated in the future."""
        sources = sources_of(case.season, case.member)
        return tuple(source for source in sources if source not in self.newest.ahead)

    def _batch(self, cases: Sequence[NightCase]) -> worker.PlanBatch:
        """Return a batch of cases on one chart."""
        tasks = tuple(map(self._case_task, cases))
        return worker.PlanBatch(tasks, self.chart_path(cases[0]), self.look_percent, self.stale)

    def _case_task(self, case: NightCase) -> worker.NightCaseTask:
        pair, current, chart = case.pair, self.current_path(case), self.chart_path(case)
        return worker.NightCaseTask(
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
    scenario, pairs = _scenario(case), [pair for pair in case.block.pairs if pair is not None]
    if not pairs:
        return scenario
    starts = np.array([pair.start for pair in pairs])
    goals = np.array([pair.goal for pair in pairs])
    farthest = pairs[int(GEOD.inv(*starts.T, *goals.T)[2].argmax())]
    return scenario.model_copy(update={"start": farthest.start, "goal": farthest.goal})


@dataclass
class BatchWork:
    """The batches of a night, as `Work` of the workers.

    `charts` are the cases to plan on each chart, by its path; `batch` returns the batch of some
    cases. `on_broken` is called with a case that has killed _DEATHS workers, and `on_done` with the
    rows of each batch.
    """

    charts: Mapping[Path, Iterable[NightCase]]
    batch: Callable[[Sequence[NightCase]], worker.PlanBatch]
    on_broken: Callable[[worker.NightCaseTask], None]
    on_done: Callable[[list[Row]], None]
    # Seconds per case on a chart, once a batch on it has ended.
    _seconds: dict[Path, float] = field(default_factory=dict)
    _deaths: Counter[int] = field(default_factory=Counter)
    # Halves of batches whose worker died.
    _suspects: deque[worker.PlanBatch] = field(default_factory=deque)

    def __post_init__(self) -> None:
        """Queue all cases."""
        self._waiting = {path: deque(cases) for path, cases in self.charts.items()}

    def next_task(self, workers: int) -> worker.PlanBatch | None:
        """Return the next batch; halves of a batch that killed its worker come first."""
        if self._suspects:
            return self._suspects.popleft()
        for path, waiting in self._waiting.items():
            if waiting:
                count = _batch_size(len(waiting), self._seconds.get(path), workers)
                return self.batch([waiting.popleft() for _ in range(count)])
        return None

    def done(self, task: worker.PlanBatch, result: list[Row]) -> None:
        """Update the seconds per case from a finished batch, and keep its rows."""
        seconds = sum(row["seconds"] for row in result if "seconds" in row)
        self._seconds[task.chart_path] = seconds / len(task.cases)
        self.on_done(result)

    def died(self, task: worker.PlanBatch, reason: str) -> None:
        """Halve a batch; a single case is tried once more, and then recorded as broken."""
        del reason  # the case's row names what may have been the reason
        if (count := len(task.cases)) > 1:
            halves = task.cases[: count // 2], task.cases[count // 2 :]
            self._suspects.extend(replace(task, cases=half) for half in halves)
            return
        (case,) = task.cases
        self._deaths[case.index] += 1
        if self._deaths[case.index] < _DEATHS:
            self._suspects.append(task)
        else:
            self.on_broken(case)

    def failed(self, task: worker.PlanBatch, error: Exception) -> None:
        """End the night: a batch fails for reasons such as a full disk, not because of a case."""
        del task
        raise error


def _batch_size(waiting: int, seconds: float | None, workers: int) -> int:
    """Return the number of cases in the next batch of those that wait on a chart.

    `seconds` is the duration of a case; None if it is not known yet.
    """
    if seconds is None:
        return _FIRST_CASES
    share_s = _SHARE * waiting * seconds / max(workers, 1)
    aim_s = max(_LEAST_S, min(_TARGET_S, share_s))
    return min(waiting, max(1, round(aim_s / max(seconds, 1e-6))))


@contextlib.contextmanager
def night_workers(
    scheduler: str | None, *, workers: int | None, memory_gb: float, shared: Path
) -> Iterator[Fleet | LocalWorkers]:
    """Yield the workers of a scheduler or of this machine, which can read the file `shared`.

    The scheduler's address is by default DASK_SCHEDULER_ADDRESS; without either, workers are
    processes of this machine, by default one per core, with a memory limit, GB, for each. Raises
    StageError if there are no workers, or a worker can't plan.
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
