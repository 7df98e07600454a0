"""Plan a season again from where the vessel is, as part of its task."""

import math
from collections.abc import Sequence
from dataclasses import replace

import renew
from pipeline.findings.text import number, planner_text
from pipeline.model import Replanned, Scene, VoyageBefore
from renew.errors import Duration, Text
from renew.planner.plan import given_options, task_of


def replanned(
    scene: Scene,
    before: VoyageBefore,
    season: str,
    options: renew.PlanOptions,
    havens: Sequence[renew.Haven] = (),
) -> tuple[renew.Plan, Replanned]:
    """Return the plan from the scene's start on, and what it changes.

    Raises
    ------
    renew.PlanningError
        There is no way to the goal, with the ways to havens; or the vessel can't be where it is
        said to be.
    """
    current = scene.currents[season]
    begun = {"departure": float(before.plan.best.times[0]), "arrive_by": None, "speed": None}
    task = task_of(
        scene.chart,
        current if before.current is None else before.current,
        scene.vessel,
        (before.start, scene.goal),
        before.via,
        scene.areas.get(season, ()),
        scene.tidal_depths.get(season),
        given_options(options, {}) | begun,
    )
    found = renew.replan(
        replace(before.plan, voyage=task),
        scene.start,
        0.0,
        heading=before.heading_rad,
        current=None if before.current is None else current,
        switch_above=before.switch_above,
        havens=havens,
    )
    if found.plan is None or found.turn_offs:
        cause = found.cause or renew.UnreachableError("no way leads on from {0}", scene.start)
        raise cause if not found.turn_offs else _turns_off(found.turn_offs, cause)
    kept, scale = found.kept, scene.projection.scale
    reason = found.rejected[0] if kept is None and found.rejected else None
    return found.plan, Replanned(
        answer="kept" if found.answer == "kept" else "switched",
        fuel=found.fuel,
        kept_fuel=math.nan if kept is None else kept.fuel,
        kept_reason="" if reason is None else planner_text(reason.text, scene, season),
        off_m=scale * found.off,
        moved_m=scale * found.moved,
        late_s=found.late,
        planned_fuel=before.plan.best.fuel,
        burnt=found.burnt,
        by_drift=found.by_drift,
        by_forecast=found.by_forecast,
        saved=found.saved,
        has_new_current=before.current is not None,
    )


def _turns_off(ways: Sequence[renew.TurnOff], cause: renew.PlanningError) -> renew.PlanningError:
    """Return the error that names the havens that are in reach, and why no way leads on."""
    named = [
        Text(
            f"{{0}} ({number(way.fuel)} of fuel, in {{1}})",
            (Text(way.haven.name), Duration(way.arrival)),
        )
        for way in ways
    ]
    error = renew.UnreachableError(
        "turn off to {0}; no way leads on: {1}", Text.joined(", or ", named), cause.text
    )
    if isinstance(cause, renew.UnreachableError):
        error.causes, error.straits = cause.causes, cause.straits
    return error
