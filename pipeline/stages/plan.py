"""Fifth stage: plan and evaluate every season, each in an independent task."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import renew
from pipeline.errors import NoWayError, RequestError, StageError
from pipeline.findings.text import seasons_text
from pipeline.findings.way_names import class_names_text
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import Evaluation, SeasonPlan
from pipeline.model.planning import speed_choices
from pipeline.stages.choosing.chosen import Chosen
from pipeline.stages.cover import havens_in
from pipeline.stages.project import scene_inputs
from pipeline.stages.seasons.one_season import OnStep, combine_seasons, ignore_step
from pipeline.stages.seasons.running import run_tasks
from pipeline.stages.seasons.task import SeasonTask, Status, plan_and_evaluate
from pipeline.stages.simplify import SimplifiedLand


@dataclass(frozen=True, slots=True)
class Planned:
    """The plans of all seasons, in the scenario's order, and the measurements of their routes."""

    plans: tuple[SeasonPlan, ...]
    evaluation: Evaluation


def plan_seasons(
    chosen: Chosen,
    land: Artefact[SimplifiedLand],
    store: Store,
    on_season: Callable[[Status], None],
    *,
    scheduler: str | None = None,
    limit_s: float | None = None,
    meanwhile: Callable[[], object] = lambda: None,
    on_step: OnStep = ignore_step,
) -> Artefact[Planned]:
    """Plan each season and evaluate its routes; a season that fails does not stop the others.

    Parameters
    ----------
    chosen
        The complete scenario, its data and its scene.
    land
        The simplified land.
    on_season
        Called at the end of each season whose result was not in the store.
    scheduler, limit_s
        Where the tasks run, see `run_tasks`, and the time limit of each, s.
    meanwhile
        Called before planning, unless the store has all results; it starts work for other threads.
    on_step
        Called with the steps of the seasons that are planned in threads of this process.

    Raises
    ------
    PipelineError
        No season has a plan; NoWayError if a wider region might have a way.
    """
    tasks = list(_tasks(chosen, land, store, limit_s))
    done = {task.season: result for task in tasks if (result := task.result()) is not None}
    waiting = [task for task in tasks if task.season not in done]
    crashed = dict(chosen.data.failures)

    def report(status: Status) -> None:
        if status.crashed:
            crashed[status.season] = status.failure
        on_season(status)

    if waiting:
        meanwhile()
    run_tasks(waiting, scheduler, report, lambda task: plan_and_evaluate(task, on_step))
    for task in waiting:
        result = None if task.season in crashed else task.result()
        if result is not None:
            done[task.season] = result
        else:
            crashed.setdefault(task.season, "its result is missing from the store; run again")
    names = [season.name for season in chosen.scenario.seasons]
    plans = tuple(
        done[name][0] if name in done else SeasonPlan(name, None, crashed[name], 0.0)
        for name in names
    )
    if not any(plan.plan is not None for plan in plans):
        reasons = _reasons(plans)
        if crashed:
            raise StageError("; ".join(reasons))
        if chosen.scenario.under_way is not None:  # at sea it is an answer, not a wrong request
            raise StageError(f"no way from here: {'; '.join(reasons)}")
        names = [name for plan in plans for name in plan.class_names]
        reasons += class_names_text(names, chosen.scene.value)
        raise (NoWayError if any(plan.is_shut for plan in plans) else RequestError)(reasons)
    key = artefact_key(
        "planned", [task.evaluation_path.name for task in tasks], [plan.failure for plan in plans]
    )
    return Artefact(
        key, Planned(plans, combine_seasons(done[name][1] for name in names if name in done))
    )


def _tasks(
    chosen: Chosen, land: Artefact[SimplifiedLand], store: Store, limit_s: float | None
) -> Iterator[SeasonTask]:
    """Yield a task for each season that has a current."""
    scenario, parts = chosen.scenario, chosen.data
    options, explains_gap = scenario.planner, scenario.outputs.explain_gap
    havens: tuple[renew.Haven, ...] = ()
    if scenario.havens is not None and scenario.under_way is not None:
        havens = tuple(havens_in(scenario, chosen.scene.value)[0])
    # The file of the havens may change, so their places count.
    places = [(one.name, *one.place.tolist()) for one in havens]
    for season, current_key in parts.current_keys.items():
        # The scene's key is not used: it depends on the other seasons' currents, too.
        plan_key = artefact_key(
            "plan",
            land.key,
            current_key,
            scene_inputs(scenario),
            options.model_dump(mode="json"),
            speed_choices(scenario).get(season),
            places,
        )
        evaluation_key = artefact_key("evaluate", plan_key, parts.land_key, explains_gap)
        yield SeasonTask(
            season=season,
            scene_path=store.path("project", chosen.scene.key),
            plan_path=store.path("plan", plan_key),
            evaluation_path=store.path("evaluate", evaluation_key),
            options=options,
            owner=store.owner,
            limit_s=limit_s,
            explains_gap=explains_gap,
            havens=havens,
        )


def _reasons(plans: Sequence[SeasonPlan]) -> list[str]:
    """Return one line for each reason of failure, with the seasons that failed for it."""
    seasons: dict[str, list[str]] = {}
    for plan in plans:
        seasons.setdefault(plan.failure, []).append(plan.season)
    return [f"{seasons_text(names)}: {failure}" for failure, names in seasons.items()]
