"""Plan one season."""

import math
import time

import renew
from pipeline.formats.shared.text import planner_text, season_text
from pipeline.model import Scene, SeasonPlan, plan_options
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.projecting.endpoints import is_shut_in
from pipeline.stages.projecting.speed_choices import largest_stretch, planned_in_time
from renew.errors import TooLateError

MIN_LATENESS_S = 3600.0
"""Minimum of the times by which turns are checked early and late in changing currents, s."""

# Share of the padding in the refused straits below which hardly any padding of a strait is.
_SURE = 0.8


def plan_season(scene: Scene, season: str, options: PlannerOptions) -> SeasonPlan:
    """Plan one season; if that is impossible, the result's `failure` has the reason."""
    started = time.perf_counter()
    asked = plan_options(options, min_lateness=MIN_LATENESS_S)

    def planned(arrive_by_s: float) -> renew.Plan:
        return renew.plan(
            scene.chart,
            scene.currents[season],
            scene.vessel_in(season),
            scene.start,
            scene.goal,
            options=asked,
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
        stretch = largest_stretch(scene, season) if season in scene.speeds else 1.0
        failure = planner_text(error.text, scene, season, stretch)
        causes = error.causes if isinstance(error, renew.UnreachableError) else ()
        are_late = [isinstance(cause, TooLateError) for cause in causes]
        if any(are_late):
            failure += (
                f"; {season_text(season)}: its currents end too early: give currents that reach "
                "further, raise its max_hours if they do, or depart earlier"
            )
        if not all(are_late):
            failure += "; these are keys of [planner]; renew go has the option --clearance"
        is_shut = isinstance(error, renew.UnreachableError) and not is_shut_in(
            scene, error.straits, _least_padding(error, scene, season, asked)
        )
        return SeasonPlan(season, None, failure, time.perf_counter() - started, is_shut)
    seconds = time.perf_counter() - started
    return SeasonPlan(season, plan, "", seconds, arrive_by_s=arrive_by_s)


def _least_padding(
    error: renew.UnreachableError, scene: Scene, season: str, options: renew.PlanOptions
) -> float:
    """Return a width, planar metres, that hardly any padding of the refused classes is below."""
    paddings = [max(one.padding_left, one.padding_right) for one in error.straits]
    likely = options.likely_width(scene.vessel_in(season).turning_radius)
    return max(likely, _SURE * min(paddings, default=0.0))
