"""Run a scenario's six stages in order, its seasons as independent Dask tasks."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import chain, pairwise
from pathlib import Path
from typing import Literal

import renew
from pipeline.choices.coverage import require_covered
from pipeline.choices.offing import Offing
from pipeline.choices.region_search import search_region
from pipeline.errors import NoWayError, RequestError, StageError
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.safety_notes import safety_notes
from pipeline.formats.shared.text import season_text, seasons_text
from pipeline.formats.shared.trade_offs import speed_notes
from pipeline.geo.projection import Projection
from pipeline.model import Evaluation, Scene, SeasonPlan, Simplified
from pipeline.model.vessel import planner_vessel
from pipeline.outcome import Event, EventHandler, Outcome, Stage, ignore
from pipeline.scenario.model import Scenario
from pipeline.session import Origin, session
from pipeline.stages import planar
from pipeline.stages.avoided_areas import area_identities, shut_notes
from pipeline.stages.choose_departures import choose_departures
from pipeline.stages.fetch import FetchedParts, fetch
from pipeline.stages.overpowering_current import waiting_notes
from pipeline.stages.seasons.runner import run_tasks
from pipeline.stages.seasons.task import SeasonTask, Status
from pipeline.stages.second_shoreline import crossing_notes
from pipeline.stages.shut_straits import shut_straits
from pipeline.stages.side_bounds import side_bounds
from pipeline.stages.simplify import SimplifiedLand, simplify_land
from pipeline.stages.speed_choices import speed_choices
from pipeline.stages.unresolved_straits import unresolved_strait_notes
from pipeline.stages.way_names import with_way_names
from pipeline.stages.write import write
from pipeline.storage.store import Store, artefact_key, file_hash


def run(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool = False,
    strict: bool = False,
    scheduler: str | None = None,
    limit_s: float | None = None,
    origin: Origin | None = None,
    on_event: EventHandler | None = None,
) -> Outcome:
    """Run a scenario and write its results to `output/<scenario>/`.

    Parameters
    ----------
    scenario
        What to run.
    output
        Folder of all results; it also holds the store, where the next run finds the artefacts.
    offline
        Use no source that needs the network.
    strict
        Plan no season on another current than the one that the scenario asks for first.
    scheduler
        Address of a Dask scheduler whose workers see the same files; else this machine's cores.
    limit_s
        Time that a season may take, s; past it the season fails, and the others are written.
    origin
        The file that the scenario was loaded from: results of another file are not replaced.
    on_event
        Called for every stage and season.

    Raises
    ------
    RequestError
        The request is wrong; nothing was written to the scenario's folder.
    StageError
        No season could be planned for another reason, or nothing can be written.
    """
    require_covered(scenario)
    options = _Options(offline, strict, scheduler, limit_s)
    with session(scenario.name, output, origin) as held:
        staged = _StagedRun(scenario, held.directory, held.store, on_event or ignore, options)
        outcome = staged.run_and_write()
        held.record_origin()
        return outcome


@contextlib.contextmanager
def planned_scenario(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool = False,
    origin: Origin | None = None,
    on_event: EventHandler | None = None,
) -> Iterator[RunResult]:
    """Give a scenario's result without writing it: from an earlier run, or planned now.

    Takes and raises what `run` does; only the store is written to. In the block no other run
    replaces the scenario's folder.
    """
    require_covered(scenario)
    with session(scenario.name, output, origin) as held:
        options = _Options(offline=offline)
        staged = _StagedRun(scenario, held.directory, held.store, on_event or ignore, options)
        yield staged.run_stages()[0]


@dataclass(frozen=True, slots=True)
class _Options:
    """How a run is to be done, as `run` takes it."""

    offline: bool = False
    strict: bool = False
    scheduler: str | None = None
    limit_s: float | None = None


def _refuse_stand_ins(parts: FetchedParts) -> None:
    """Refuse to plan on other currents than those that the scenario asks for first."""
    faults = [
        f"{season_text(grid.season)} would be {grid.stand_in_notes[0]}, which is not its first "
        "choice" + "".join(f"; {passed.reason}" for passed in grid.passed_over)
        for grid in parts.fetched.currents
        if grid.is_stand_in
    ]
    faults += [f"{season_text(name)}: {why}" for name, why in parts.failures.items()]
    if faults:
        raise StageError("\n".join([*faults, "nothing was planned, as --strict asks"]))


def _reasons(plans: Sequence[SeasonPlan]) -> list[str]:
    """Say why seasons failed; those that failed for the same reason share a line."""
    seasons: dict[str, list[str]] = {}
    for plan in plans:
        seasons.setdefault(plan.failure, []).append(plan.season)
    return [f"{seasons_text(names)}: {failure}" for failure, names in seasons.items()]


@dataclass
class _StagedRun:
    """One run of all stages, each of which reuses its artefact where the store has it."""

    scenario: Scenario
    directory: Path
    store: Store
    on_event: EventHandler
    options: _Options
    timings: dict[str, float] = field(default_factory=dict)

    def run_and_write(self) -> Outcome:
        """Run all stages."""
        started = time.perf_counter()
        result, evaluated = self.run_stages()
        with self._stage("write"):
            stamp = artefact_key(
                "write",
                self.scenario.model_dump(mode="json"),
                evaluated,
                [(plan.season, plan.failure) for plan in result.plans],
                result.fetched.notes,
            )
            fresh = not self._is_written(stamp)
            if fresh:
                files = write(result, self.directory, self._say_file)
                self.store.save("write", stamp, {file.name: file_hash(file) for file in files})
        return Outcome(
            self.scenario,
            self.directory,
            result.plans,
            result.evaluation,
            result.fetched,
            fresh,
            time.perf_counter() - started,
            result.choices,
            result.straits,
        )

    def run_stages(self) -> tuple[RunResult, list[str]]:
        """Run all stages but the last; return the result, and the evaluations' file names."""
        if self.scenario.region is not None or self.scenario.is_planar:
            return self._run_in_region(self.scenario, ())
        return search_region(
            self.scenario, self.store, self._run_in_region, offline=self.options.offline
        )

    def _run_in_region(
        self, scenario: Scenario, region_notes: tuple[str, ...]
    ) -> tuple[RunResult, list[str]]:
        """Run all stages but the last for a scenario with a region, and notes on how it came by."""
        self.scenario = scenario
        with self._stage("fetch"):
            self._say("fetch", region_notes[-1:])
            parts = fetch(self.scenario, self.store, offline=self.options.offline)
            if self.options.strict:
                _refuse_stand_ins(parts)
            self._say("fetch", parts.fetched.notes)
        with self._stage("simplify"):
            simplified_key, land = self._simplify(parts)
            self._say("simplify", land.notes)
            simplified = land.simplified
        with self._stage("project"):
            scene_key, scene = self._project(parts, simplified_key, simplified)
            offing_notes = self._choose_offing(scene_key, scene, parts.fetched.land.accuracy_m)
            self._say("project", offing_notes)
            departed = choose_departures(
                self.scenario,
                parts,
                scene_key,
                scene,
                self.store,
                lambda note: self._say("project", (note,)),
            )
            self.scenario, parts, scene = departed.scenario, departed.parts, departed.scene
            if departed.scene_key != scene_key:
                scene_key = departed.scene_key
                self.store.load_or_make("project", scene_key, Scene, lambda: departed.scene)
            self._say("project", departed.notes)
            choices = (*region_notes, *offing_notes, *departed.notes)
            notes = (*choices, *parts.fetched.notes, *land.notes)
            fetched = replace(parts.fetched, notes=notes)
        with self._stage("plan"):
            tasks = self._season_tasks(parts, simplified_key, scene_key)
            plans, evaluation = self._plan_seasons(parts, tasks)
            evaluation = with_way_names(evaluation, scene, plans, parts.fetched.land.places)
            evaluated = [task.evaluation_path.name for task in tasks]
            sides = self.store.load_or_make(
                "sides",
                artefact_key("sides", evaluated, scene_key, self.scenario.planner.drift),
                tuple,
                lambda: side_bounds(scene, plans, evaluation, self.scenario.planner),
            )
            evaluation = replace(evaluation, side_bounds=sides)
            straits = self.store.load_or_make(
                "straits",
                artefact_key("straits", evaluated, scene_key, [plan.failure for plan in plans]),
                tuple,
                lambda: shut_straits(scene, simplified, plans, self.scenario.planner),
            )
            result = RunResult(
                self.scenario,
                fetched,
                simplified,
                scene,
                plans,
                evaluation,
                {},
                datetime.now(UTC),
                choices,
                straits,
                departed.choices,
            )
            speeds = speed_notes(result)
            result = replace(result, choices=(*choices, *speeds))
            shore_notes = crossing_notes(evaluation.shore_crossings)
            tides = unresolved_strait_notes(result)
            shut = (*shut_notes(scene, plans), *waiting_notes(scene, plans))
            notes = (*speeds, *safety_notes(result), *shut, *shore_notes, *tides, *result.unknowns)
            self._say("plan", notes)
        fetched = replace(fetched, notes=(*fetched.notes, *notes))
        return replace(result, fetched=fetched, timings=dict(self.timings)), evaluated

    def _say(self, stage: Stage, notes: Sequence[str]) -> None:
        """Report notes on a stage."""
        for note in notes:
            self.on_event(Event(stage, "note", detail=note))

    def _say_file(self, name: str) -> None:
        """Report the file that is written."""
        self.on_event(Event("write", "part", detail=name))

    @contextlib.contextmanager
    def _stage(self, stage: Stage) -> Iterator[None]:
        """Report a stage's begin and end, and time it."""
        started = time.perf_counter()
        self.on_event(Event(stage, "begun"))
        try:
            yield
        except Exception as error:
            self.on_event(Event(stage, "failed", detail=str(error).replace("\n", "; ")))
            raise
        self.timings[stage] = time.perf_counter() - started
        self.on_event(Event(stage, "done", seconds=self.timings[stage]))

    def _simplify(self, parts: FetchedParts) -> tuple[str, SimplifiedLand]:
        """Second stage: return its artefact's key, and the artefact."""
        names = {"region", "plane", "scale", "chart", "start", "goal", "via"}
        inputs = self.scenario.model_dump(mode="json", include=names)
        vessel = self.scenario.fastest_vessel
        key = artefact_key("simplify", parts.land_key, inputs, vessel.model_dump())
        land = parts.fetched.land
        if self.scenario.region is None:
            return key, SimplifiedLand(planar.unsimplified(land), ())
        region, chart = self.scenario.region, self.scenario.chart

        def make() -> SimplifiedLand:
            return simplify_land(
                land.polygons,
                region.shape,
                margin_m=chart.margin_m,
                accuracy_m=land.accuracy_m,
                tolerance_m=chart.tolerance_m,
                turning_radius_m=planner_vessel(vessel).turning_radius * self.scenario.scale,
                endpoints=tuple(chain(*pairwise(self.scenario.stops.values()))),
                projection=Projection.for_region(region.shape, 1.0, region.crs),
            )

        return key, self.store.load_or_make("simplify", key, SimplifiedLand, make)

    def _project(
        self, parts: FetchedParts, simplified_key: str, simplified: Simplified
    ) -> tuple[str, Scene]:
        """Third stage: return its artefact's key, and the artefact."""
        scenario = self.scenario
        key = artefact_key(
            "project",
            simplified_key,
            dict(parts.current_keys),
            self._scene_inputs(),
            speed_choices(scenario),
        )

        def make() -> Scene:
            from pipeline.stages.project import project

            try:
                return project(scenario, parts.fetched, simplified)
            except renew.PlanningError as error:
                raise RequestError([str(error)]) from error

        return key, self.store.load_or_make("project", key, Scene, make)

    def _choose_offing(self, scene_key: str, scene: Scene, accuracy_m: float) -> tuple[str, ...]:
        """Complete the planner's options by a clearance where it is left out; return a note."""
        scenario = self.scenario
        if scenario.planner.clearance is not None or scenario.is_planar:
            return ()
        key = artefact_key("offing", scene_key, accuracy_m, scenario.fastest_vessel.model_dump())
        offing = self.store.load_or_make(
            "offing", key, Offing, lambda: Offing.of(scene, scenario, accuracy_m)
        )
        options = scenario.planner.model_copy(update={"clearance": offing.planar_m})
        self.scenario = scenario.model_copy(update={"planner": options})
        return (offing.note,)

    def _scene_inputs(self) -> dict[str, object]:
        """Return the parts of the scenario, other than chart and currents, that a scene uses."""
        names = {"region", "plane", "vessel", "scale", "start", "goal", "via"}
        inputs = self.scenario.model_dump(mode="json", include=names)
        if not self.scenario.avoid:
            return inputs
        clocks = {season.name: season.first_departure for season in self.scenario.seasons}
        return {**inputs, "avoid": area_identities(self.scenario), "clocks": clocks}

    def _season_tasks(
        self, parts: FetchedParts, simplified_key: str, scene_key: str
    ) -> list[SeasonTask]:
        """Return a task for each season that has a current."""
        tasks = []
        options, explains_gap = self.scenario.planner, self.scenario.outputs.explain_gap
        for season, current_key in parts.current_keys.items():
            # Without the scene's key, which depends on the other seasons' currents too.
            plan_key = artefact_key(
                "plan",
                simplified_key,
                current_key,
                self._scene_inputs(),
                options.model_dump(mode="json"),
                speed_choices(self.scenario).get(season),
            )
            evaluation_key = artefact_key("evaluate", plan_key, parts.land_key, explains_gap)
            tasks.append(
                SeasonTask(
                    season=season,
                    scene_path=self.store.path("project", scene_key),
                    plan_path=self.store.path("plan", plan_key),
                    evaluation_path=self.store.path("evaluate", evaluation_key),
                    options=options,
                    scale=self.scenario.scale,
                    owner=self.store.owner,
                    limit_s=self.options.limit_s,
                    explains_gap=explains_gap,
                )
            )
        return tasks

    def _plan_seasons(
        self, parts: FetchedParts, tasks: Sequence[SeasonTask]
    ) -> tuple[tuple[SeasonPlan, ...], Evaluation]:
        """Fourth and fifth stage; each season succeeds or fails by itself."""
        from pipeline.stages.evaluate import combine_seasons

        done = {task.season: result for task in tasks if (result := task.result()) is not None}
        waiting = {task.season: task for task in tasks if task.season not in done}
        crashed = dict(parts.failures)

        def report(status: Status) -> None:
            if status.crashed:
                crashed[status.season] = status.failure
            ended: Literal["failed", "done"] = "failed" if status.failure else "done"
            self.on_event(Event("plan", ended, season=status.season, detail=status.failure))

        run_tasks(list(waiting.values()), self.options.scheduler, report)
        for season, task in waiting.items():
            result = None if season in crashed else task.result()
            if result is not None:
                done[season] = result
            else:
                crashed.setdefault(season, "its result is missing from the store; run again")
        plans = tuple(
            done[name][0] if name in done else SeasonPlan(name, None, crashed[name], 0.0)
            for name in (season.name for season in self.scenario.seasons)
        )
        if not any(plan.plan is not None for plan in plans):
            reasons = _reasons(plans)
            if crashed:
                raise StageError("; ".join(reasons))
            raise (NoWayError if any(plan.is_shut for plan in plans) else RequestError)(reasons)
        for plan in plans:
            self.timings[f"plan {plan.season}"] = plan.seconds
        return plans, combine_seasons(done[plan.season][1] for plan in plans if plan.season in done)

    def _is_written(self, stamp: str) -> bool:
        """Whether the run's folder already holds exactly the files that this run would write."""
        hashes = self.store.load("write", stamp, dict)
        if not hashes:
            return False
        return all(
            (self.directory / name).is_file() and file_hash(self.directory / name) == digest
            for name, digest in hashes.items()
        )
