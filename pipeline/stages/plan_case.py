"""Plan one case; `plan_case` measures the routes as well."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import renew
from pipeline import model
from pipeline.findings.text import number, planner_text
from pipeline.model.case import MIN_LATENESS_S
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.lanes import keeping_lanes
from pipeline.stages.measure import measured, refusal
from pipeline.stages.places import is_shut_in
from renew.errors import Duration, InfeasibleError, Length, ShutStartError, Text, TooLateError
from renew.request import Request
from renew.results import Step, watched

OnStep = Callable[[str, Step], None]
"""Called with a case's name and a step of its plan, in the thread that plans."""


def ignore_step(case: str, step: Step) -> None:
    """Ignore a step."""
    del case, step


# Hardly any strait has less padding than this share of the least padding of the refused straits.
_SURE = 0.95


def plan_case(
    case: model.Case,
    options: PlannerOptions,
    on_step: OnStep = ignore_step,
    havens: Sequence[renew.Haven] = (),
) -> model.CaseResult:
    """Plan a case and measure its routes; if there is no plan, `failure` has the reason.

    On a chart, the `options` have the clearance that the run has chosen. `on_step` is called with
    the case's name and each step of its plan, whose path is in lon/lat degrees. Under way the
    reason says which of the `havens` to turn off to.
    """
    result = planned(case, options, on_step, havens)
    return replace(result, measures=measured(case, result, options))


def planned(
    case: model.Case,
    options: PlannerOptions,
    on_step: OnStep = ignore_step,
    havens: Sequence[renew.Haven] = (),
) -> model.CaseResult:
    """Plan a case, without the measures of its routes; see `plan_case`."""
    return keeping_lanes(case, lambda one: _planned(one, options, on_step, havens))


def _planned(
    case: model.Case, options: PlannerOptions, on_step: OnStep, havens: Sequence[renew.Haven]
) -> model.CaseResult:
    started = time.perf_counter()
    scale, arrive_by_s = case.projection.scale, math.inf
    asked = model.plan_options(options, scale, min_lateness=MIN_LATENESS_S)
    ensemble = again = None
    planned_by = partial(case.planned, asked)

    def tell(step: Step) -> None:
        path = None if step.path is None else case.projection.to_lonlat(step.path)
        on_step(case.name, replace(step, path=path))

    try:
        with watched(tell):
            if case.before is not None:
                plan, again = _replanned(case, case.before, asked, havens)
            elif case.speeds is not None:
                arrive_by_s = case.speeds.within_s / scale
                plan = planned_by(arrive_by_s)
            elif case.members is not None:
                found = case.planned_ensemble(case.members, asked)
                plan = found.plan
                ensemble = model.EnsembleFigures.of(
                    found, lambda reason: planner_text(reason, case)
                )
            else:
                plan = planned_by(arrive_by_s)
    except renew.PlanningError as error:
        return _failed(case, error, asked, time.perf_counter() - started)
    result = model.CaseResult(
        case.name,
        plan,
        "",
        time.perf_counter() - started,
        arrive_by_s=arrive_by_s,
        ensemble=ensemble,
        replanned=again,
    )
    failure = refusal(case.water, result)
    return model.CaseResult(case.name, None, failure, result.seconds) if failure else result


# What begins the list of remedies in an error that names the reasons of all classes.
_REMEDIES = "To find a route"


def _failed(
    case: model.Case, error: renew.PlanningError, options: renew.PlanOptions, seconds: float
) -> model.CaseResult:
    # In a wider region ways are longer, so a vessel that comes too late comes later still.
    is_shut = (
        isinstance(error, renew.UnreachableError)
        and not isinstance(error, ShutStartError)
        and not any(isinstance(cause, TooLateError) for cause in error.causes)
        and not is_shut_in(case, error.straits, _smallest_padding(error, case, options))
    )
    reason = reason_text(error, case, refuses=options.shortfall == "refuse")
    return model.CaseResult(case.name, None, reason, seconds, is_shut)


def reason_text(error: renew.PlanningError, case: model.Case, *, refuses: bool = False) -> str:
    """Return the reason why there is no plan: of those of many classes one, with one remedy.

    A plan that `refuses` may be asked for with as much padding as there is room for.
    """
    spelled = partial(planner_text, case=case)
    causes = error.causes if isinstance(error, renew.UnreachableError) else ()
    if not isinstance(error, renew.UnreachableError) or not (
        causes and _REMEDIES in error.text.template
    ):
        return spelled(error.text)
    if late := next((one for one in causes if isinstance(one, TooLateError)), None):
        return (
            f"every way takes too long: {spelled(late.text)}. Its currents end too early: give "
            "currents that reach further, in a scenario raise its max_hours, or depart earlier"
        )
    why = causes[0].text
    straits = [one.strait for one in causes if isinstance(one, InfeasibleError) and one.strait]
    if straits:
        lacks = [one.padding_left + one.padding_right - one.width for one in straits]
        # A gap that lacks nothing lies along a strait, which the padding of its banks shuts.
        best = min(range(len(lacks)), key=lambda at: (lacks[at] <= 0, lacks[at]))
        gap = straits[best]
        needed = Length(gap.padding_left + gap.padding_right, gap.gap)
        what = "the gap at {0} is {1} wide, and {2} are needed"
        if lacks[best] <= 0:
            what = "the strait at {0} is shut by the padding along its banks"
        why = Text(what, (gap.gap.mean(axis=0), Length(gap.width, gap.gap), needed))
    # The planner's text ends with what it tried.
    tried = error.text.values[-1]
    remedies = tried.values if isinstance(tried, Text) else ()
    found = (str(one).partition(" would leave one") for one in remedies)
    would = next((what for what, leaves, _ in found if leaves), "")
    would += " and clearance = 0" * would.startswith("padding = ")
    remedy = "no other padding or risk leaves one"
    if would:
        typed = " (--padding, --clearance)" * would.startswith("padding = ")
        if would.startswith("clearance = "):
            typed = f" (--clearance {float(would.split()[2]) * case.projection.scale:g}m)"
        remedy = f"in a scenario, {would} under [planner]{typed} would leave one"
    if refuses:
        remedy += '; shortfall = "least" (--shortfall least) keeps as much as there is room for'
    return f"no way has room: {spelled(why)}; {remedy}"


def _smallest_padding(
    error: renew.UnreachableError, case: model.Case, options: renew.PlanOptions
) -> float:
    """Return a width, planar metres; hardly any padding of the refused classes is narrower."""
    paddings = [max(one.padding_left, one.padding_right) for one in error.straits]
    likely = options.likely_width(case.vessel.turning_radius)
    return max(likely, _SURE * min(paddings, default=0.0))


def _replanned(
    case: model.Case,
    before: model.VoyageBefore,
    options: renew.PlanOptions,
    havens: Sequence[renew.Haven] = (),
) -> tuple[renew.Plan, model.ReplanFigures]:
    """Return the plan from where the vessel is on, and what it changes.

    Raises renew.PlanningError if there is no way to the goal, with the ways to havens; or the
    vessel can't be where it is said to be.
    """
    asked = Request.of(
        case.chart,
        case.current if before.current is None else before.current,
        case.vessel,
        (before.start, case.goal),
        options=options,
        departure=float(before.plan.best.times[0]),
        via=before.via,
        avoid=case.areas,
        depth=case.tidal_depth,
    )
    found = renew.replan(
        replace(before.plan, voyage=asked),
        case.start,
        0.0,
        heading=before.heading_rad,
        current=None if before.current is None else case.current,
        switch_above=before.switch_above,
        havens=havens,
    )
    if found.plan is None or found.turn_offs:
        cause = found.cause or renew.UnreachableError("no way leads on from {0}", case.start)
        raise cause if not found.turn_offs else _turns_off(found.turn_offs, cause, case.energy)
    kept, scale = found.kept, case.projection.scale
    reason = found.rejected[0] if kept is None and found.rejected else None
    return found.plan, model.ReplanFigures(
        answer="kept" if found.answer == "kept" else "switched",
        fuel=found.fuel,
        kept_fuel=math.nan if kept is None else kept.fuel,
        kept_reason="" if reason is None else planner_text(reason.text, case),
        off_m=scale * found.off,
        moved_m=scale * found.moved,
        late_s=found.late,
        planned_fuel=before.plan.best.fuel,
        burnt=found.burnt,
        by_drift=found.by_drift,
        by_forecast=found.by_forecast,
        saved=found.saved,
        has_new_current=before.current is not None,
        energy=case.energy,
    )


def _turns_off(
    ways: Sequence[renew.TurnOff], cause: renew.PlanningError, energy: model.Energy | None
) -> renew.PlanningError:
    """Return the error that names the havens that are in reach, and why no way leads on."""
    needs = [f"{number(way.fuel * energy.units)} {energy.unit}, " if energy else "" for way in ways]
    named = [
        Text(f"{{0}} ({need}in {{1}})", (Text(way.haven.name), Duration(way.arrival)))
        for way, need in zip(ways, needs, strict=True)
    ]
    error = renew.UnreachableError(
        "turn off to {0}; no way leads on: {1}", Text.joined(", or ", named), cause.text
    )
    if isinstance(cause, renew.UnreachableError):
        error.causes, error.straits = cause.causes, cause.straits
    return error
