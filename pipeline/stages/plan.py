"""Fifth stage: every season's plan and evaluation, as independent tasks."""

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial

from pipeline.errors import NoWayError, RequestError, StageError
from pipeline.formats.shared.text import seasons_text
from pipeline.machine.storage.store import Made, Store, artefact_key
from pipeline.model import Evaluation, SeasonPlan
from pipeline.stages.choosing.departures import Chosen
from pipeline.stages.project import scene_inputs
from pipeline.stages.projecting.speed_choices import speed_choices
from pipeline.stages.seasons.evaluate_season import combine_seasons
from pipeline.stages.seasons.task import SeasonTask, Status, plan_and_evaluate, status_of
from pipeline.stages.simplify import SimplifiedLand
from pipeline.stages.workers.local_cluster import cores


@dataclass(frozen=True, slots=True)
class Planned:
    """The plans of all seasons, in the scenario's order, and what was measured of their routes."""

    plans: tuple[SeasonPlan, ...]
    evaluation: Evaluation


def plan_seasons(
    chosen: Chosen,
    land: Made[SimplifiedLand],
    store: Store,
    on_season: Callable[[Status], None],
    *,
    scheduler: str | None = None,
    limit_s: float | None = None,
    meanwhile: Callable[[], None] = lambda: None,
) -> Made[Planned]:
    """Plan each season and evaluate its routes; each succeeds or fails by itself.

    Parameters
    ----------
    chosen
        The complete scenario, its data and its scene.
    land
        The simplified land.
    on_season
        Called when a season ends that was not in the store.
    scheduler, limit_s
        Where the tasks are run, and how long each may take; see `run_tasks`.
    meanwhile
        Called in a thread of its own while plans are made, if any are.

    Raises
    ------
    PipelineError
        No season has a plan: NoWayError where a wider region might have a way.
    """
    tasks = list(_tasks(chosen, land, store, limit_s))
    done = {task.season: result for task in tasks if (result := task.result()) is not None}
    waiting = [task for task in tasks if task.season not in done]
    crashed = dict(chosen.parts.failures)

    def report(status: Status) -> None:
        if status.crashed:
            crashed[status.season] = status.failure
        on_season(status)

    if waiting:
        threading.Thread(target=meanwhile).start()
    run_tasks(waiting, scheduler, report)
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
        raise (NoWayError if any(plan.is_shut for plan in plans) else RequestError)(reasons)
    key = artefact_key(
        "planned", [task.evaluation_path.name for task in tasks], [plan.failure for plan in plans]
    )
    return Made(
        key, Planned(plans, combine_seasons(done[name][1] for name in names if name in done))
    )


def _tasks(
    chosen: Chosen, land: Made[SimplifiedLand], store: Store, limit_s: float | None
) -> Iterator[SeasonTask]:
    """Yield a task for each season that has a current."""
    scenario, parts = chosen.scenario, chosen.parts
    options, explains_gap = scenario.planner, scenario.outputs.explain_gap
    for season, current_key in parts.current_keys.items():
        # Without the scene's key, which depends on the other seasons' currents too.
        plan_key = artefact_key(
            "plan",
            land.key,
            current_key,
            scene_inputs(scenario),
            options.model_dump(mode="json"),
            speed_choices(scenario).get(season),
        )
        evaluation_key = artefact_key("evaluate", plan_key, parts.land_key, explains_gap)
        yield SeasonTask(
            season=season,
            scene_path=store.path("project", chosen.scene.key),
            plan_path=store.path("plan", plan_key),
            evaluation_path=store.path("evaluate", evaluation_key),
            options=options,
            scale=scenario.scale,
            owner=store.owner,
            limit_s=limit_s,
            explains_gap=explains_gap,
        )


def _reasons(plans: Sequence[SeasonPlan]) -> list[str]:
    """Say why seasons failed; those that failed for the same reason share a line."""
    seasons: dict[str, list[str]] = {}
    for plan in plans:
        seasons.setdefault(plan.failure, []).append(plan.season)
    return [f"{seasons_text(names)}: {failure}" for failure, names in seasons.items()]


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
    pool = ThreadPoolExecutor(min(len(tasks), cores()))
    try:
        runs = [
            pool.submit(status_of, one.season, partial(plan_and_evaluate, one)) for one in tasks
        ]
        for run in as_completed(runs):
            on_status(run.result())
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # a signal waits for no plan
