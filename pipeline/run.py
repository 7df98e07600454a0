"""Runs a scenario's six stages in their order, its seasons as independent Dask tasks."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Literal

import renew
from pipeline import store as artefact
from pipeline.errors import RequestError, StageError
from pipeline.formats.shared.result import RunResult
from pipeline.geo.projection import Projection
from pipeline.model import Scene, SeasonPlan
from pipeline.stages import planar as plane
from pipeline.stages.fetch import Parts, fetch
from pipeline.stages.season_task import SeasonTask, Status, run_tasks
from pipeline.stages.simplify import SimplifiedLand, simplify_land
from pipeline.stages.write import output_directory, write
from pipeline.store import Store

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from pipeline.model import Evaluation, Simplified
    from pipeline.scenario.model import Scenario

Stage = Literal["fetch", "simplify", "project", "plan", "write"]
STAGES: tuple[Stage, ...] = ("fetch", "simplify", "project", "plan", "write")
"""What is told of: a season is evaluated in the task that planned it."""

_ARTEFACTS = ".artefacts"


@dataclass(frozen=True, slots=True)
class Event:
    """What a listener is told: a stage, or a season of it, began, ended or failed."""

    stage: Stage
    status: Literal["begun", "done", "failed", "note"]
    season: str = ""
    seconds: float = 0.0
    detail: str = ""


Listener = Callable[[Event], None]


def _unheard(event: Event) -> None:
    """Listen to nothing."""
    del event


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run came to; `fresh` is False where the results were there already."""

    scenario: Scenario
    directory: Path
    plans: tuple[SeasonPlan, ...]
    evaluation: Evaluation
    notes: tuple[str, ...]
    fresh: bool
    seconds: float

    @property
    def failures(self) -> tuple[str, ...]:
        """What did not go as asked, a line each."""
        seasons = [f"season {p.season!r}: {p.failure}" for p in self.plans if p.failure]
        over_land = [
            f"season {row.season!r}: route {row.rank} crosses {row.land_m:.0f} m of the original "
            "land; raise chart.margin_m"
            for row in self.evaluation.routes
            if row.land_m > 0
        ]
        return (*seasons, *over_land)

    @property
    def exit_code(self) -> int:
        """0 when all went as asked, else 1."""
        return 1 if self.failures else 0


def run(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool = False,
    scheduler: str | None = None,
    listen: Listener | None = None,
) -> Outcome:
    """Run a scenario and write its results to `output/<scenario>/`.

    Parameters
    ----------
    scenario
        What to run.
    output
        Folder of all results; the artefacts lie in it too, so that the next run finds them.
    offline
        Ask no source that needs the network.
    scheduler
        Address of a Dask scheduler that sees the same files; else this machine's cores.
    listen
        Told of every stage and season.

    Raises
    ------
    RequestError
        The request is wrong; nothing was written to the scenario's folder.
    StageError
        No season could be planned for another reason, or nothing can be written.
    """
    with _alone(scenario, output, listen) as this:
        return this.through(offline=offline, scheduler=scheduler)


def planned(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool = False,
    listen: Listener | None = None,
) -> RunResult:
    """Give a scenario's result without writing it: that of an earlier run, or planned now.

    Takes and raises what `run` does; nothing but the store is written to.
    """
    with _alone(scenario, output, listen) as this:
        return this.planned(offline=offline, scheduler=None)[0]


@contextlib.contextmanager
def _alone(scenario: Scenario, output: Path, listen: Listener | None) -> Iterator[_Run]:
    """Give a run that is the only one of its scenario in an output folder."""
    output = output.resolve()
    with (
        _leaving_nothing_if_refused(output),
        artefact.only_run(output / _ARTEFACTS / f"{scenario.name}.lock", scenario.name),
    ):
        directory = output_directory(output, scenario.name)
        yield _Run(scenario, directory, Store(output / _ARTEFACTS), listen or _unheard)


@contextlib.contextmanager
def _leaving_nothing_if_refused(output: Path) -> Iterator[None]:
    """Take a new store, and a new output folder, away again where the request was wrong."""
    made = [folder for folder in (output / _ARTEFACTS, output) if not folder.exists()]
    try:
        yield
    except RequestError:
        for folder in made:
            # The store goes whole; the folder around it only if nothing else is in it.
            if folder.name == _ARTEFACTS:
                shutil.rmtree(folder, ignore_errors=True)
            else:
                with contextlib.suppress(OSError):
                    folder.rmdir()
        raise


def _unsafe(evaluation: Evaluation, scenario: Scenario) -> tuple[str, ...]:
    """Say of which seasons' best routes the vessel could not turn away everywhere."""
    return tuple(
        f"not safe everywhere: {row.season}, {row.collisions:,} of {row.trials:,} hard-over turns "
        f"along the best route meet land; it was planned with padding = "
        f'{scenario.planner.padding!r}, and only "adaptive" is proved'
        for row in evaluation.routes
        if row.rank == 1 and row.collisions
    )


@dataclass
class _Run:
    """One run on its way through the stages."""

    scenario: Scenario
    directory: Path
    store: Store
    listen: Listener
    timings: dict[str, float] = field(default_factory=dict)

    def through(self, *, offline: bool, scheduler: str | None) -> Outcome:
        """All stages."""
        begun = time.perf_counter()
        result, evaluated = self.planned(offline=offline, scheduler=scheduler)
        with self._stage("write"):
            stamp = artefact.key(
                "write",
                self.scenario.model_dump(mode="json"),
                evaluated,
                [(plan.season, plan.failure) for plan in result.plans],
                result.fetched.notes,
            )
            fresh = not self._written(stamp)
            if fresh:
                files = write(result, self.directory)
                self.store.save(
                    "write", stamp, {file.name: artefact.file_hash(file) for file in files}
                )
        return Outcome(
            self.scenario,
            self.directory,
            result.plans,
            result.evaluation,
            result.fetched.notes,
            fresh,
            time.perf_counter() - begun,
        )

    def planned(self, *, offline: bool, scheduler: str | None) -> tuple[RunResult, list[str]]:
        """All stages but the last: their result, and the names of the seasons' evaluations."""
        with self._stage("fetch"):
            parts = fetch(self.scenario, self.store, offline=offline)
            for note in parts.fetched.notes:
                self.listen(Event("fetch", "note", detail=note))
        with self._stage("simplify"):
            simplified_key, land = self._simplified(parts)
            for note in land.notes:
                self.listen(Event("simplify", "note", detail=note))
            simplified = land.simplified
            fetched = replace(parts.fetched, notes=(*parts.fetched.notes, *land.notes))
        with self._stage("project"):
            scene_key, scene = self._scene(parts, simplified_key, simplified)
        with self._stage("plan"):
            tasks = self._tasks(parts, simplified_key, scene_key)
            plans, evaluation = self._seasons(parts, tasks, scheduler)
            unsafe = _unsafe(evaluation, self.scenario)
            for note in unsafe:
                self.listen(Event("plan", "note", detail=note))
            fetched = replace(fetched, notes=(*fetched.notes, *unsafe))
        result = RunResult(
            self.scenario,
            fetched,
            simplified,
            scene,
            plans,
            evaluation,
            dict(self.timings),
            datetime.now(UTC),
        )
        return result, [task.evaluation_path.name for task in tasks]

    @contextlib.contextmanager
    def _stage(self, stage: Stage) -> Iterator[None]:
        """Tell of a stage, and time it."""
        begun = time.perf_counter()
        self.listen(Event(stage, "begun"))
        try:
            yield
        except Exception as error:
            self.listen(Event(stage, "failed", detail=str(error).replace("\n", "; ")))
            raise
        self.timings[stage] = time.perf_counter() - begun
        self.listen(Event(stage, "done", seconds=self.timings[stage]))

    def _simplified(self, parts: Parts) -> tuple[str, SimplifiedLand]:
        """Second stage."""
        wanted = {"region", "plane", "scale", "chart", "start", "goal"}
        asked = self.scenario.model_dump(mode="json", include=wanted)
        key = artefact.key("simplify", parts.land_key, asked)
        land = parts.fetched.land
        if self.scenario.region is None:
            return key, SimplifiedLand(plane.unsimplified(land), 0.0, ())
        region, chart = self.scenario.region, self.scenario.chart

        def make() -> SimplifiedLand:
            return simplify_land(
                land.polygons,
                region.shape,
                margin_m=chart.margin_m,
                accuracy_m=land.accuracy_m,
                join_gap_m=chart.join_gap_m,
                tolerance_m=chart.tolerance_m,
                vertex_budget=chart.vertex_budget,
                keep_water=(self.scenario.start, self.scenario.goal),
                projection=Projection.for_region(region.shape, 1.0, region.crs),
            )

        return key, self.store.made("simplify", key, SimplifiedLand, make)

    def _scene(
        self, parts: Parts, simplified_key: str, simplified: Simplified
    ) -> tuple[str, Scene]:
        """Third stage."""
        scenario = self.scenario
        key = artefact.key("project", simplified_key, dict(parts.current_keys), self._world())

        def make() -> Scene:
            from pipeline.stages.project import project

            try:
                return project(scenario, parts.fetched, simplified)
            except renew.PlanningError as error:
                raise RequestError([str(error)]) from error

        return key, self.store.made("project", key, Scene, make)

    def _world(self) -> dict[str, object]:
        """What of the scenario the planner's world depends on, beside charts and currents."""
        wanted = {"region", "plane", "vessel", "scale", "start", "goal"}
        return self.scenario.model_dump(mode="json", include=wanted)

    def _tasks(self, parts: Parts, simplified_key: str, scene_key: str) -> list[SeasonTask]:
        """One task for each season that has a current."""
        tasks = []
        options = self.scenario.planner
        for season, current_key in parts.current_keys.items():
            # Not by the scene's key: another season's current is nothing to this one.
            plan_key = artefact.key(
                "plan", simplified_key, current_key, self._world(), options.model_dump(mode="json")
            )
            evaluation_key = artefact.key("evaluate", plan_key, parts.land_key)
            tasks.append(
                SeasonTask(
                    season=season,
                    scene_path=self.store.path("project", scene_key),
                    plan_path=self.store.path("plan", plan_key),
                    evaluation_path=self.store.path("evaluate", evaluation_key),
                    options=options,
                    scale=self.scenario.scale,
                )
            )
        return tasks

    def _seasons(
        self, parts: Parts, tasks: Sequence[SeasonTask], scheduler: str | None
    ) -> tuple[tuple[SeasonPlan, ...], Evaluation]:
        """Fourth and fifth stage; every season with its own status."""
        from pipeline.stages.evaluate import joined

        done = {task.season: result for task in tasks if (result := task.result()) is not None}
        waiting = {task.season: task for task in tasks if task.season not in done}
        broken = dict(parts.failures)

        def tell(status: Status) -> None:
            if status.broken:
                broken[status.season] = status.failure
            ended: Literal["failed", "done"] = "failed" if status.failure else "done"
            self.listen(Event("plan", ended, season=status.season, detail=status.failure))

        run_tasks(list(waiting.values()), scheduler, tell)
        for season, task in waiting.items():
            result = None if season in broken else task.result()
            if result is not None:
                done[season] = result
            else:
                broken.setdefault(season, "its result is gone from the store; run again")
        plans = tuple(
            done[name][0] if name in done else SeasonPlan(name, None, broken[name], 0.0)
            for name in (season.name for season in self.scenario.seasons)
        )
        if not any(plan.plan is not None for plan in plans):
            reasons = [f"season {plan.season!r}: {plan.failure}" for plan in plans]
            raise StageError("; ".join(reasons)) if broken else RequestError(reasons)
        for plan in plans:
            self.timings[f"plan {plan.season}"] = plan.seconds
        return plans, joined(done[plan.season][1] for plan in plans if plan.season in done)

    def _written(self, stamp: str) -> bool:
        """Whether the run's folder holds the very files that this run would write."""
        hashes = self.store.load("write", stamp, dict)
        if not hashes:
            return False
        return all(
            (self.directory / name).is_file()
            and artefact.file_hash(self.directory / name) == digest
            for name, digest in hashes.items()
        )
