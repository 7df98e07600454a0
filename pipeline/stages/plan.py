"""Fifth stage: plan every case and measure its routes, each in an independent task."""

from collections.abc import Callable, Iterator, Sequence

import renew
from pipeline.errors import NoWayError, RequestError, StageError
from pipeline.findings.text import seasons_text
from pipeline.findings.way_names import class_names_text
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import CaseResult
from pipeline.stages.choose import Chosen
from pipeline.stages.cover import havens_in
from pipeline.stages.plan_case import OnStep, ignore_step
from pipeline.stages.project import scene_inputs
from pipeline.stages.seasons.running import run_tasks
from pipeline.stages.seasons.task import CaseTask, Status
from pipeline.stages.simplify import SimplifiedLand


def plan_cases(
    chosen: Chosen,
    land: Artefact[SimplifiedLand],
    store: Store,
    on_case: Callable[[Status], None],
    *,
    scheduler: str | None = None,
    limit_s: float | None = None,
    meanwhile: Callable[[], object] = lambda: None,
    on_step: OnStep = ignore_step,
) -> Artefact[tuple[CaseResult, ...]]:
    """Plan each case and measure its routes; a case that fails does not stop the others.

    Returns the results of all seasons of the scenario, in its order.

    Parameters
    ----------
    chosen
        The complete scenario, its data and its cases.
    land
        The simplified land.
    on_case
        Called at the end of each case whose result was not in the store.
    scheduler, limit_s
        Where the tasks run, see `run_tasks`, and the time limit of each, s.
    meanwhile
        Called before planning, unless the store has all results; it starts work for other threads.
    on_step
        Called with the steps of the cases that are planned in threads of this process.

    Raises
    ------
    PipelineError
        No case has a plan; NoWayError if a wider region might have a way.
    """
    tasks = list(_tasks(chosen, land, store))
    cases = {case.name: case for case in chosen.cases.value}
    done = {task.season: result for task in tasks if (result := task.result()) is not None}
    waiting = [task for task in tasks if task.season not in done]
    crashed = dict(chosen.data.failures)

    def report(status: Status) -> None:
        if status.crashed:
            crashed[status.season] = status.failure
        on_case(status)

    def work(task: CaseTask) -> str:
        done[task.season] = task.planned(cases[task.season].copy(), on_step)
        return done[task.season].failure

    if waiting:
        meanwhile()
    run_tasks(waiting, scheduler, report, work, limit_s)
    for task in waiting:
        if task.season in crashed or task.season in done:
            continue
        if (result := task.result()) is not None:
            done[task.season] = result
        else:
            crashed[task.season] = "its result is missing from the store; run again"
    names = [season.name for season in chosen.scenario.seasons]
    results = tuple(
        done[name] if name in done else CaseResult(name, None, crashed[name], 0.0) for name in names
    )
    if not any(result.plan is not None for result in results):
        raise _no_plan(results, chosen, is_crash=bool(crashed))
    key = artefact_key(
        "planned", [task.measures_path.name for task in tasks], [one.failure for one in results]
    )
    return Artefact(key, results)


def _no_plan(results: Sequence[CaseResult], chosen: Chosen, *, is_crash: bool) -> Exception:
    """Return the error that no case has a plan."""
    reasons = _reasons(results)
    if is_crash:
        return StageError("; ".join(reasons))
    if chosen.scenario.under_way is not None:  # at sea it is an answer, not a wrong request
        return StageError(f"no way from here: {'; '.join(reasons)}")
    names = [name for result in results for name in result.class_names]
    reasons += class_names_text(names, chosen.cases.value[0].water)
    return (NoWayError if any(one.is_shut for one in results) else RequestError)(reasons)


def _tasks(chosen: Chosen, land: Artefact[SimplifiedLand], store: Store) -> Iterator[CaseTask]:
    """Yield a task for each case."""
    scenario, parts = chosen.scenario, chosen.data
    options, explains_gap = scenario.planner, scenario.outputs.explain_gap
    havens: tuple[renew.Haven, ...] = ()
    if scenario.havens is not None and scenario.under_way is not None:
        havens = tuple(havens_in(scenario, chosen.cases.value[0].water)[0])
    # The file of the havens may change, so their places count.
    places = [(one.name, *one.place.tolist()) for one in havens]
    for case in chosen.cases.value:
        if case.name not in parts.current_keys:
            continue  # no departure was found for it
        # The key of all cases is not used: it depends on the other cases' currents, too.
        plan_key = artefact_key(
            "plan",
            land.key,
            parts.current_keys[case.name],
            scene_inputs(scenario),
            options.model_dump(mode="json"),
            case.speeds,
            places,
        )
        measures_key = artefact_key("evaluate", plan_key, parts.land_key, explains_gap)
        yield CaseTask(
            season=case.name,
            scene_path=store.path("project", chosen.cases.key),
            plan_path=store.path("plan", plan_key),
            measures_path=store.path("evaluate", measures_key),
            options=options,
            owner=store.owner,
            explains_gap=explains_gap,
            havens=havens,
        )


def _reasons(results: Sequence[CaseResult]) -> list[str]:
    """Return one line for each reason of failure, with the cases that failed for it."""
    cases: dict[str, list[str]] = {}
    for result in results:
        cases.setdefault(result.failure, []).append(result.name)
    return [f"{seasons_text(names)}: {failure}" for failure, names in cases.items()]
