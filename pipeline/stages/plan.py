"""Fifth stage: plan every case and measure its routes, each in an independent task."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import renew
from pipeline.errors import NoPlanError, NoWayError, StageError
from pipeline.findings.text import seasons_text
from pipeline.machine.store import Artefact, Store, artefact_key, load_artefact, save_artefact
from pipeline.model import Case, CaseResult, Measures, SimplifiedLand
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.choose import Chosen
from pipeline.stages.cover import havens_in
from pipeline.stages.measure import measured
from pipeline.stages.plan_case import OnStep, ignore_step, planned
from pipeline.stages.project import scene_inputs
from pipeline.stages.tasks import Status, run_tasks, status_of, stored_case


@dataclass(frozen=True, slots=True)
class CaseTask:
    """The inputs and result paths to plan and measure one case of those in a file.

    `owner` is the scenario's name.
    Under way the vessel turns off to one of the `havens` if no way leads on.
    """

    case: str
    cases_path: Path
    plan_path: Path
    measures_path: Path
    options: PlannerOptions
    owner: str = ""
    havens: tuple[renew.Haven, ...] = ()

    def result(self) -> CaseResult | None:
        """Load the result from the store; None if a part is missing or damaged."""
        plan = load_artefact(self.plan_path, CaseResult)
        measures = load_artefact(self.measures_path, Measures)
        return None if plan is None or measures is None else replace(plan, measures=measures)

    def make(self) -> Status:
        """Plan and measure the case; an error becomes a failure."""
        return status_of(self.case, lambda: self.planned(stored_case(self)).failure)

    def planned(self, case: Case, on_step: OnStep = ignore_step) -> CaseResult:
        """Plan and measure the task's case, and store both parts of the result."""
        result = load_artefact(self.plan_path, CaseResult)
        if result is None:
            result = planned(case, self.options, on_step, self.havens)
            save_artefact(self.plan_path, result, self.owner)
            # As read back it holds nothing of the search, whose roadmaps take most of the memory.
            result = load_artefact(self.plan_path, CaseResult) or result
        measures = measured(case, result, self.options)
        save_artefact(self.measures_path, measures, self.owner)
        return replace(result, measures=measures)


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

    Returns the results of all cases, in the scenario's order. Raises PipelineError if no case has a
    plan; NoWayError if a wider region might have a way.

    `on_case` is called at the end of each case whose result was not in the store; `scheduler` and
    `limit_s` are as in `run_tasks`. `meanwhile` is called before planning, unless the store has all
    results; it starts work for other threads. `on_step` is called with the steps of the cases that
    are planned in threads of this process.
    """
    tasks = list(_tasks(chosen, land, store))
    cases = {case.name: case for case in chosen.cases.value}
    done = {task.case: result for task in tasks if (result := task.result()) is not None}
    waiting = [task for task in tasks if task.case not in done]
    crashed = dict(chosen.fetched.failures)

    def report(status: Status) -> None:
        if status.crashed:
            crashed[status.case] = status.failure
        on_case(status)

    def work(task: CaseTask) -> str:
        done[task.case] = task.planned(cases[task.case].copy(), on_step)
        return done[task.case].failure

    if waiting:
        meanwhile()
    run_tasks(waiting, scheduler, report, work, limit_s)
    for task in waiting:
        if task.case in crashed or task.case in done:
            continue
        if (result := task.result()) is not None:
            done[task.case] = result
        else:
            crashed[task.case] = "its result is missing from the store; run again"
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
    """Return the error that no case has a plan, with the cases of each reason."""
    cases: dict[str, list[str]] = {}
    for result in results:
        cases.setdefault(result.failure, []).append(result.name)
    reasons = [f"{seasons_text(names)}: {failure}" for failure, names in cases.items()]
    if is_crash:
        return StageError("; ".join(reasons))
    if chosen.scenario.under_way is not None:  # at sea it is an answer, not a wrong request
        return StageError(f"no way from here: {'; '.join(reasons)}")
    return (NoWayError if any(one.is_shut for one in results) else NoPlanError)(reasons)


def _tasks(chosen: Chosen, land: Artefact[SimplifiedLand], store: Store) -> Iterator[CaseTask]:
    scenario, fetched = chosen.scenario, chosen.fetched
    options = scenario.planner
    scene = scene_inputs(scenario)
    havens: tuple[renew.Haven, ...] = ()
    if scenario.havens is not None and scenario.under_way is not None:
        havens = tuple(havens_in(scenario, chosen.cases.value[0].water)[0])
    # The file of the havens may change, so their places count.
    places = [(one.name, *one.place.tolist()) for one in havens]
    for case in chosen.cases.value:
        if case.name not in fetched.current_keys:
            continue  # no departure was found for it
        # The key of all cases is not used: it depends on the other cases' currents, too.
        plan_key = artefact_key(
            "plan",
            land.key,
            fetched.current_keys[case.name],
            scene,
            options.model_dump(mode="json"),
            case.speeds,
            places,
        )
        measures_key = artefact_key("evaluate", plan_key, fetched.land_key)
        yield CaseTask(
            case=case.name,
            cases_path=store.path("project", chosen.cases.key),
            plan_path=store.path("plan", plan_key),
            measures_path=store.path("evaluate", measures_key),
            options=options,
            owner=store.owner,
            havens=havens,
        )
