"""Fourth stage: one season's plan."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import renew
from pipeline.formats.shared.text import dated
from pipeline.model import SeasonPlan

if TYPE_CHECKING:
    from pipeline.model import Scene
    from pipeline.scenario.model import PlannerOptions

MIN_LATENESS_S = 3600.0
"""Time by which a vessel may be early or late at least, in currents that change."""

# What the planner says of a class that would arrive after the end of the currents.
KNOWN_UNTIL = "the current is known until"


def plan_season(scene: Scene, season: str, options: PlannerOptions) -> SeasonPlan:
    """Plan one season; where that is impossible, the result's `failure` says why."""
    started = time.perf_counter()
    try:
        plan = renew.plan(
            scene.chart,
            scene.currents[season],
            scene.vessel,
            scene.start,
            scene.goal,
            # A run chooses the clearance for a chart before; a plane's is 0 where it is left out.
            **{**options.model_dump(), "clearance": options.clearance or 0.0},
            min_lateness=MIN_LATENESS_S,
            **scene.itinerary(season),
        )
    except renew.PlanningError as error:
        failure = " ".join(error.located(scene.place_text).split())
        failure = dated(failure, scene.departures.get(season))
        if KNOWN_UNTIL in failure:
            failure += (
                f"; season {season!r} ends too early: give currents that reach further, raise its "
                "max_hours where they do, or depart earlier"
            )
        is_shut = isinstance(error, renew.UnreachableError)
        return SeasonPlan(season, None, failure, time.perf_counter() - started, is_shut)
    return SeasonPlan(season, plan, "", time.perf_counter() - started)
