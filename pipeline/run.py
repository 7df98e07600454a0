"""Run the stages of a scenario in order; its cases are planned as independent tasks."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

from pipeline._types import FloatArray
from pipeline.errors import Faults, NoWayError, PipelineError, RequestError, StageError
from pipeline.findings.note_words import note_text, note_texts
from pipeline.findings.result import RunResult, addressed
from pipeline.findings.text import clearance, environment, fuel, season_name, season_text
from pipeline.geo.projection import position_text
from pipeline.machine.interpreters import give_back_memory
from pipeline.machine.store import Artefact, Store, artefact_key, file_hash
from pipeline.machine.workers import first_compilation
from pipeline.model import CaseResult, Fetched, Note, Say, SimplifiedLand
from pipeline.scenario.catalogue import ScenarioFile
from pipeline.scenario.model import Scenario, UnderWay
from pipeline.session import session
from pipeline.stages.choose import Chosen, choose
from pipeline.stages.compare import bounds_of_sides, compare
from pipeline.stages.cover import cover, havens_in
from pipeline.stages.ends import in_water
from pipeline.stages.fetch import fetch, with_weather
from pipeline.stages.plan import plan_cases
from pipeline.stages.plan_case import OnStep, ignore_step
from pipeline.stages.project import projected
from pipeline.stages.region import (
    MAX_WIDENINGS,
    best_paths,
    chosen_region,
    edge_notes,
    opened_region,
    require_covered,
    wider_region,
)
from pipeline.stages.simplify import simplify
from pipeline.stages.tasks import Status
from pipeline.stages.under_way import PlanSailed, case_sailed, scenario_before
from pipeline.texts import clean
from pipeline.write import load_libraries, write

Stage = Literal["fetch", "simplify", "project", "choose", "plan", "compare", "cover", "write"]
STAGES: tuple[Stage, ...] = get_args(Stage)
"""The stages that events report; a season is evaluated in the task that plans it. Without havens
there is nothing to cover."""


@dataclass(frozen=True, slots=True)
class Event:
    """What happens in a stage, or to one season in it: begin, progress, end, failure or a note."""

    stage: Stage
    status: Literal["begun", "part", "done", "failed", "note"]
    season: str = ""
    seconds: float = 0.0
    detail: str = ""
    note: Note | None = None


EventHandler = Callable[[Event], None]


def ignore(found: Event | RunResult) -> None:
    """Ignore an event or a result."""
    del found


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a run; `fresh` is False if its files existed already."""

    # Left out of the text of an outcome, because the text would contain the whole chart.
    result: RunResult = field(repr=False)
    directory: Path
    fresh: bool
    seconds: float
    late_faults: tuple[str, ...] = field(default=(), repr=False)

    @property
    def scenario(self) -> Scenario:
        """The complete scenario, with all values that were chosen."""
        return self.result.scenario

    @property
    def choices(self) -> tuple[str, ...]:
        """Sentences on the values that were chosen because the scenario leaves them out."""
        return tuple(note_texts(self.result.choices))

    @property
    def fetched(self) -> Fetched:
        """Land and currents, with all notes."""
        return self.result.fetched

    @property
    def failures(self) -> tuple[str, ...]:
        """One line for each failed season, each route over the original land, and late fault."""
        without_plan, over_land = list[str](), list[str]()
        for case in self.result.cases:
            where = season_text(case.name)
            without_plan += [f"{where}: {case.result.failure}"] * bool(case.result.failure)
            over_land += [
                f"{where}: route {row.rank} crosses {row.land_m:.0f} m of the original "
                f"{row.no_go_name}, the most at {position_text(row.land_lon, row.land_lat)}; raise "
                "chart.margin_m"
                for row in case.measures.routes
                if row.land_m > 0
            ]
        return (*without_plan, *over_land, *self.late_faults)

    @property
    def exit_code(self) -> int:
        """Exit code: 0 without failures, else 1."""
        return 1 if self.failures else 0

    def _repr_html_(self) -> str:
        """Return the routes as a table for a notebook."""
        template = environment("pipeline.formats.report").get_template("outcome.html.jinja")
        words = {"season_name": season_name, "clearance": clearance, "fuel": fuel}
        return template.render(outcome=self, **words)


def run(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool = False,
    strict: bool = False,
    scheduler: str | None = None,
    limit_s: float | None = None,
    origin: ScenarioFile | None = None,
    on_event: EventHandler | None = None,
    on_step: OnStep = ignore_step,
    on_result: Callable[[RunResult], None] | None = None,
    said: Sequence[str] = (),
) -> Outcome:
    """Run a scenario and write its results to `output/<scenario>/`.

    Raises RequestError if the request is wrong: nothing was written to the scenario's folder;
    StageError if no season could be planned for another reason, or the results can't be written.

    Parameters
    ----------
    output : folder of all results, and of the store with the artefacts that the next run reuses.
    offline : use no source that needs the network.
    strict : plan nothing if a season's first choice of currents can't be used.
    scheduler : address of a Dask scheduler whose workers have access to the same files; default:
        DASK_SCHEDULER_ADDRESS, or else the cores of this machine.
    limit_s : time limit of a season, s; one that takes longer fails, and the others are written.
    origin : the file that the scenario was loaded from; results of another file are not replaced.
    on_event : called with the events of every stage and season.
    on_step : called with a season and each step of its plan, path in degrees, in the thread that
        plans.
    on_result : called with the result in each region tried, and at the end with the bounds on other
        sides.
    said : how the request was read where it could be read otherwise; results say it, too.
    """
    require_covered(scenario)
    started = time.perf_counter()
    with session(scenario.name, output, origin) as held, ThreadPoolExecutor(1) as beside:
        with first_compilation() as compiled:
            stages = _Stages(
                held.store,
                beside,
                on_event or ignore,
                compiled,
                offline=offline,
                strict=strict,
                scheduler=scheduler,
                limit_s=limit_s,
                on_step=on_step,
                on_result=on_result or ignore,
                read=tuple(Note.of("as-read", said=text) for text in said),
            )
            result = stages.result(scenario)
        bounds = beside.submit(bounds_of_sides, result, held.store, stages.late)
        result = replace(result, value=replace(result.value, side_bounds=bounds.result))
        fresh = stages.write(result, held.directory)
        stages.on_result(result.value)
        held.record_origin()
        took, late = time.perf_counter() - started, tuple(stages.late.lines)
        return Outcome(result.value, held.directory, fresh, took, late)


def prepare(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool = False,
    holding: FloatArray | None = None,
    on_event: EventHandler = ignore,
) -> tuple[Chosen, Artefact[SimplifiedLand]]:
    """Do what a run does before it plans, for a scenario without a region; the store keeps it.

    The region also holds a line `holding` (n, 2), degrees, as far as the currents reach.
    """
    with session(scenario.name, output) as held, ThreadPoolExecutor(1) as beside:
        region = chosen_region(scenario, held.store, offline=offline)
        if holding is not None:
            region = region.with_line(holding)
        stages = _Stages(held.store, beside, on_event, lambda: None, offline)
        return stages.chosen(region.complete(scenario), region.notes)


@contextlib.contextmanager
def planned_scenario(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool = False,
    origin: ScenarioFile | None = None,
    on_event: EventHandler | None = None,
) -> Iterator[RunResult]:
    """Yield a scenario's result, from an earlier run or planned now, without writing its files.

    It lacks the bounds on ways on other sides, which only reports show.

    Parameters and errors are as in `run`. Artefacts are saved in the store. During the `with` block
    no other run replaces the scenario's folder.
    """
    require_covered(scenario)
    with session(scenario.name, output, origin) as held, ThreadPoolExecutor(1) as beside:
        with first_compilation() as compiled:
            stages = _Stages(held.store, beside, on_event or ignore, compiled, offline)
            result = stages.result(scenario)
        if stages.late.lines:
            raise StageError("\n".join(stages.late.lines))
        yield result.value


@dataclass(frozen=True)
class _Stages:
    """The stages of a run (see `run`); each loads its artefact if the store has it."""

    store: Store
    beside: Executor  # a thread for what only files need
    on_event: EventHandler
    compiled: Callable[[], None]  # waits for the compilation of the planner
    offline: bool = False
    strict: bool = False
    scheduler: str | None = None
    limit_s: float | None = None
    on_step: OnStep = ignore_step
    on_result: Callable[[RunResult], None] = ignore
    read: tuple[Note, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)
    late: Faults = field(default_factory=Faults)

    def result(self, asked: Scenario) -> Artefact[RunResult]:
        """Run all stages except "write", in the scenario's region or in a chosen one."""
        if asked.region is not None or asked.is_planar:
            made = self._in_region(asked, ())
        else:
            made = self._in_chosen_region(asked)
        if asked.havens is not None:
            with self._stage("cover", asked) as say, self.late.kept("the cover"):
                made = cover(made, self.store, say)
        return made

    def _in_chosen_region(self, asked: Scenario) -> Artefact[RunResult]:
        """Choose a region, and widen it until it has a way, and no best route nears its edge.

        The search ends at the first wider region that fails, and returns the last result. If no
        region has a way from start to goal, the error is that of the widest one.
        """
        self.on_event(Event("choose", "part", detail="the region"))
        region = chosen_region(asked, self.store, offline=self.offline)
        failed: NoWayError | None = None
        for openings in range(MAX_WIDENINGS + 1):
            try:
                made = self._in_region(region.complete(asked), region.notes)
                break
            except NoWayError as error:
                failed = error
                opened = opened_region(region) if openings < MAX_WIDENINGS else None
                if opened is None:
                    raise
                region = opened
            except RequestError as error:
                # Files, or stations of the tide, may not reach as far as a wider region.
                if failed is None or not (asked.limits or asked.tide):
                    raise
                raise failed from error
        for _ in range(MAX_WIDENINGS):
            wider = None
            with self.late.kept("the choice of a wider region"):
                wider = wider_region(region, best_paths(made.value))
            if wider is None:
                break
            last = region
            with contextlib.suppress(PipelineError), self.late.kept("planning in a wider region"):
                made = self._in_region(wider.complete(asked), wider.notes)
                region = wider
            if region is last:
                break
        edges = edge_notes(region, best_paths(made.value))
        return replace(made, value=made.value.with_choices(edges))

    def _in_region(self, scenario: Scenario, region_notes: tuple[Note, ...]) -> Artefact[RunResult]:
        """Run all stages except "write" in the scenario's region, with notes on its choice."""
        sailed = self._sailed(scenario.under_way)
        if sailed is not None:
            scenario = sailed.ahead(scenario)
        chosen, land = self.chosen(scenario, region_notes, sailed)
        with self._stage("plan", chosen.scenario):
            planned = self.planned(chosen, land)
        for case in planned.value:
            self.timings[f"plan {case.name}"] = case.seconds
        with self._stage("compare", chosen.scenario) as say:
            made = compare(chosen, land, planned, self.store, say, self.late)
        self.on_result(made.value)
        return made

    def _sailed(self, voyage: UnderWay | None) -> PlanSailed | None:
        """Return the voyage that the vessel is on, from the store or made again; None if none.

        It may itself be a plan made under way, so all plans are made from the first one on.
        """
        quiet = replace(self, on_event=ignore, on_step=ignore_step, timings={})
        plans = list[tuple[UnderWay, Scenario]]()
        while voyage is not None:
            before = scenario_before(voyage)
            plans.append((voyage, before))
            voyage = before.under_way
        sailed: PlanSailed | None = None
        for way, scenario in reversed(plans):
            asked = scenario if sailed is None else sailed.ahead(scenario)
            chosen, land = quiet.chosen(asked, (), sailed)
            own = case_sailed(way, chosen)
            planned = quiet.planned(own, land)
            sailed = PlanSailed(way, own, land, planned.value[0], planned.key)
        return sailed

    def chosen(
        self,
        scenario: Scenario,
        region_notes: tuple[Note, ...] = (),
        sailed: PlanSailed | None = None,
    ) -> tuple[Chosen, Artefact[SimplifiedLand]]:
        """Run the stages before "plan"; of a voyage that is sailed, use what its plan used."""
        store = self.store
        with self._stage("fetch", scenario) as say:
            for note in region_notes[-1:]:
                say(note)
            if sailed is not None and sailed.voyage.same_currents:
                fetched = sailed.data(scenario)
            else:
                fetched = fetch(scenario, store, offline=self.offline, strict=self.strict)
            fetched = with_weather(fetched, scenario)
            fetched = fetched if sailed is None else sailed.keyed(scenario, fetched)
            scenario, moved = in_water(scenario, fetched.land)
            fetched = replace(fetched, notes=(*fetched.notes, *moved))
            for note in fetched.notes:
                say(note)
        if store.has_made:
            # Something new was made, so the run will plan and write. Until "plan" a core is idle,
            # and can load the libraries that planning and writing need.
            self.beside.submit(load_libraries)
        with self._stage("simplify", scenario) as say:
            charted = Artefact(fetched.land_key, fetched.land)
            land = sailed.land if sailed else simplify(scenario, charted, store)
            for note in land.value.notes:
                say(note)
        with self._stage("project", scenario):
            before = None if sailed is None else sailed.before(scenario)
            cases = projected(scenario, fetched, land, store, before)
            havens_in(scenario, cases.value[0].water)  # refused before planning
        with self._stage("choose", scenario) as say:
            given = Chosen(scenario, fetched, cases, notes=(*self.read, *region_notes))
            return choose(given, store, say, self.scheduler), land

    def planned(
        self, chosen: Chosen, land: Artefact[SimplifiedLand]
    ) -> Artefact[tuple[CaseResult, ...]]:
        """Plan all cases, when the planner is compiled."""
        self.compiled()
        return plan_cases(
            chosen,
            land,
            self.store,
            self._say_case,
            scheduler=self.scheduler,
            limit_s=self.limit_s,
            meanwhile=lambda: self.beside.submit(load_libraries),
            on_step=self.on_step,
        )

    def write(self, result: Artefact[RunResult], directory: Path) -> bool:
        """Write all files unless the folder has them already; return whether they were written."""
        with self._stage("write", result.value.scenario):
            written = artefact_key(
                "write",
                result.key,
                result.value.scenario.model_dump(mode="json"),
                result.value.fetched.notes,
            )
            if self._is_written(written, directory):
                return False
            timed = replace(result.value, timings=dict(self.timings))
            files = write(timed, directory, self._say_file, self.late)
            if not self.late.lines:
                self.store.save("write", written, {file.name: file_hash(file) for file in files})
            return True

    @contextlib.contextmanager
    def _stage(self, stage: Stage, scenario: Scenario) -> Iterator[Say]:
        """Report the begin and end of a stage, and measure its time; yield a function for notes."""

        def say(note: Note) -> None:
            for one in addressed([note], scenario):
                self.on_event(Event(stage, "note", detail=note_text(one), note=one))

        started = time.perf_counter()
        give_back_memory()  # what the stage before has freed: else both count at the peak
        self.on_event(Event(stage, "begun"))
        try:
            yield say
        except Exception as error:
            self.on_event(Event(stage, "failed", detail=clean(str(error).replace("\n", "; "))))
            raise
        self.timings[stage] = time.perf_counter() - started
        self.on_event(Event(stage, "done", seconds=self.timings[stage]))

    def _say_case(self, status: Status) -> None:
        ended: Literal["failed", "done"] = "failed" if status.failure else "done"
        self.on_event(Event("plan", ended, season=status.case, detail=status.failure))

    def _say_file(self, name: str) -> None:
        self.on_event(Event("write", "part", detail=name))

    def _is_written(self, key: str, directory: Path) -> bool:
        """Whether a folder already has the unchanged files that this run would write."""
        hashes = self.store.load("write", key, dict)
        return hashes is not None and all(
            (directory / name).is_file() and file_hash(directory / name) == digest
            for name, digest in hashes.items()
        )
