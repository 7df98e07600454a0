"""Fourth stage: one season's plan."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import renew
from pipeline.formats.shared.text import dated, season_text
from pipeline.model import SeasonPlan
from pipeline.stages.endpoints import is_shut_in
from pipeline.stages.speed_choices import largest_stretch, planned_in_time

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

    def planned(arrive_by_s: float) -> renew.Plan:
        return renew.plan(
            scene.chart,
            scene.currents[season],
            scene.vessel_in(season),
            scene.start,
            scene.goal,
            # A run chooses the clearance for a chart before; a plane's is 0 where it is left out.
            **{**options.model_dump(), "clearance": options.clearance or 0.0},
            min_lateness=MIN_LATENESS_S,
            **scene.itinerary(season),
            **scene.pace(season, arrive_by_s),
        )

    arrive_by_s = math.inf
    try:
        if season in scene.speeds:
            plan, arrive_by_s = planned_in_time(planned, scene, season)
        else:
            plan = planned(arrive_by_s)
    except renew.PlanningError as error:
        failure = " ".join(error.located(scene.place_text).split())
        stretch = largest_stretch(scene, season) if season in scene.speeds else 1.0
        failure = dated(failure, scene.departures.get(season), stretch)
        if KNOWN_UNTIL in failure:
            failure += (
                f"; {season_text(season)}: its currents end too early: give currents that reach "
                "further, raise its max_hours where they do, or depart earlier"
            )
        if "allow a smaller padding" in failure:
            failure += "; all are keys of [planner], and renew go has --clearance"
        is_shut = isinstance(error, renew.UnreachableError) and not is_shut_in(
            scene, [strait.gap for strait in error.straits]
        )
        return SeasonPlan(season, None, failure, time.perf_counter() - started, is_shut)
    seconds = time.perf_counter() - started
    return SeasonPlan(season, plan, "", seconds, arrive_by_s=arrive_by_s)
