"""Prepare the charts and currents of a night, and then plan its cases in batches."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from pipeline.errors import MachineError, PipelineError, StageError
from pipeline.machine.cluster import Fleet
from pipeline.machine.store import Store, artefact_key, read_checked
from pipeline.machine.workers import LocalWorkers
from pipeline.nightly.cycle.forecasts import Forecasts
from pipeline.nightly.cycle.part_files import Partial, gaps, part_path, write_part
from pipeline.nightly.cycle.results import EarlierRoutes
from pipeline.nightly.outcome import ComeAgainError
from pipeline.nightly.planning import worker
from pipeline.nightly.planning.chart import STAGE, ChartTask, CurrentTask, chart_key
from pipeline.nightly.planning.work import BatchWork
from pipeline.nightly.request.cases import Case, Cases
from pipeline.nightly.request.newest_currents import Newest, named_currents
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import CYCLES, Currents, Season
from pipeline.scenario.strict import Point
from pipeline.stages.fetch import with_max_hours
from pipeline.texts import clean

# Largest number of cases in a slice; neighbours stay together, because they share a current.
_LARGEST_SLICE = 64
# What begins a failure that is not about the data.
_BROKEN = "broken: "
_DIED = (
    "its worker died (out of memory, which memory_gb limits for local workers, or a crash of the "
    "interpreter)"
)


@dataclass(frozen=True, slots=True)
class Share:
    """One job's share of a night: every `of`-th slice from `number` on, with `slice` cases each."""

    number: int
    of: int
    slice: int

    @classmethod
    def of_night(cls, count: int, number: int = 1, of: int = 1) -> "Share":
        """Return a share of `count` cases; slices are so small that all shares have equal size."""
        return cls(number, of, max(1, min(_LARGEST_SLICE, count // (4 * of))))

    def has(self, index: int) -> bool:
        """Whether a case belongs to the share."""
        return index // self.slice % self.of == self.number - 1


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
    """Prepares the charts and currents of a night's cases, and plans the cases in batches."""

    cases: Cases
    newest: Newest
    store: Store
    partial: Partial
    rules: worker.Rules
    earlier: EarlierRoutes | None
    forecasts: Forecasts
    on_progress: Callable[[int, int], None]
    check: Callable[[], None]
    failures: dict[Path, str] = field(default_factory=dict)
    planning_s: float = 0.0
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

    def plan(self, workers: Fleet | LocalWorkers, share: Share) -> None:
        """Plan the cases of a share that no part file contains yet."""
        parts = self.partial.parts()
        charts = [
            [piece for gap in gaps(parts, first, end) for piece in _pieces(*gap, share)]
            for first, end in self.cases.chart_ranges()
        ]
        total = sum(end - first for ranges in charts for first, end in ranges)
        done = 0

        def progress(report: worker.BatchReport) -> None:
            nonlocal done
            done += report.end - report.first
            self.planning_s += report.planning_s
            self.batches_s += report.seconds
            self.on_progress(done, total)

        workers.run(BatchWork(charts, self._batch, self._write_broken, progress), self.check)

    def chart_path(self, case: Case) -> Path:
        """Return the path of a case's chart."""
        if case.chart not in self._chart_paths:
            path = self.store.path("night-chart", chart_key(_scenario(case), _ends(case)))
            self._chart_paths[case.chart] = path
        return self._chart_paths[case.chart]

    def current_path(self, case: Case) -> Path:
        """Return the path of a case's current; all runs of a cycle use the same file."""
        chart = self.chart_path(case)
        key = (chart, case.current)
        if key not in self._current_paths:
            made_from = (self.newest.digest, chart.name, self.season(case).model_dump(mode="json"))
            self._current_paths[key] = self.store.path(
                "night-current", artefact_key(STAGE, *made_from)
            )
        return self._current_paths[key]

    def season(self, case: Case) -> Season:
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

    def leaves(self, case: Case) -> datetime | None:
        """Return a case's departure; None if neither the night nor the season gives one."""
        if case.departure is None:
            return case.season.departure
        start = self.newest.departures_from
        return None if start is None else case.departure.after(start)

    def _usable_currents(self, case: Case) -> tuple[Currents, ...]:
        """Return the sources of a case's currents, without those dated in the future."""
        named = named_currents(case.season, case.member)
        return tuple(one for one in named if one not in self.newest.ahead)

    def _current_examples(self) -> list[Case]:
        """Return one case for each current of each chart."""
        found: dict[Path, Case] = {}
        for first, end in self.cases.chart_ranges():
            pairs = len(self.cases[first].block.pairs)
            for index in range(first, end, pairs):
                found.setdefault(self.current_path(self.cases[index]), self.cases[index])
        return list(found.values())

    def _batch(self, first: int, end: int) -> worker.PlanBatch:
        """Return the batch of a range of cases."""
        cases = [self.cases[index] for index in range(first, end)]
        return worker.PlanBatch(
            tuple(map(self._case_task, cases)),
            self.chart_path(cases[0]),
            part_path(self.partial.parts_folder, first, end),
            self.rules,
            self.earlier,
        )

    def _case_task(self, case: Case) -> worker.CaseTask:
        """Return the task of a case."""
        pair, current, chart = case.pair, self.current_path(case), self.chart_path(case)
        return worker.CaseTask(
            case.index,
            case.name,
            case.names,
            current,
            None if pair is None else pair.start,
            None if pair is None else pair.goal,
            self.leaves(case),
            -1 if self.earlier is None else self.earlier.row(case.name),
            failure=self.failures.get(chart) or self.failures.get(current) or "",
        )

    def _write_broken(self, index: int) -> None:
        """Write the part file of a case that killed its workers."""
        batch = self._batch(index, index + 1)
        earlier = {} if self.earlier is None else self.earlier.read([batch.cases[0].earlier_row])
        row = worker.failed_row(
            batch.cases[0],
            f"broken: {_DIED}, twice",
            self.rules,
            earlier.get(batch.cases[0].earlier_row),
            status=worker.BROKEN,
        )
        write_part(batch.part_path, [row])
        self.on_progress(0, 0)


def _scenario(case: Case) -> Scenario:
    """Return a case's scenario with the case's vessel."""
    scenario = case.block.scenario
    return scenario if case.vessel is None else scenario.model_copy(update={"vessel": case.vessel})


def _ends(case: Case) -> tuple[Point, ...]:
    """Return start and goal of all pairs on a case's chart; the chart keeps them in water."""
    pairs = (pair for pair in case.block.pairs if pair is not None)
    return tuple(end for pair in pairs for end in (pair.start, pair.goal))


def _longest(case: Case) -> Scenario:
    """Return a case's scenario with the pair of its block that lies farthest apart."""
    scenario, pairs = _scenario(case), [one for one in case.block.pairs if one is not None]
    if not pairs:
        return scenario
    import pyproj

    starts, goals = (np.array([getattr(one, name) for one in pairs]) for name in ("start", "goal"))
    farthest = pairs[int(pyproj.Geod(ellps="WGS84").inv(*starts.T, *goals.T)[2].argmax())]
    return scenario.model_copy(update={"start": farthest.start, "goal": farthest.goal})


def _pieces(first: int, end: int, share: Share) -> Iterator[tuple[int, int]]:
    """Yield the parts of a range that belong to a share; adjoining slices are joined."""
    begin: int | None = None
    at = first
    while at < end:
        if share.has(at):
            begin = at if begin is None else begin
        elif begin is not None:
            yield begin, at
            begin = None
        at = min(end, (at // share.slice + 1) * share.slice)
    if begin is not None:
        yield begin, end
