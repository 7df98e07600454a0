"""Fourth stage: one season's plan."""

from __future__ import annotations

import dataclasses
import time
from typing import TYPE_CHECKING

import renew
from pipeline.model import SeasonPlan

if TYPE_CHECKING:
    from pipeline.model import Scene
    from pipeline.scenario.model import PlannerOptions


def plan_season(scene: Scene, season: str, options: PlannerOptions) -> SeasonPlan:
    """Plan one season; why it can't be planned, where it can't, is the result's `failure`.

    The plan's routes stand in the order of their rank: the one to take first (for the sampled
    method the choice is not always the least fuel), the others by fuel.
    """
    begun = time.perf_counter()
    try:
        plan = renew.plan(
            scene.chart,
            scene.currents[season],
            scene.vessel,
            scene.start,
            scene.goal,
            **options.model_dump(),
        )
    except renew.PlanningError as error:
        return SeasonPlan(season, None, " ".join(str(error).split()), time.perf_counter() - begun)
    others = [route for i, route in enumerate(plan.routes) if i != plan.chosen]
    ranked = dataclasses.replace(plan, routes=(plan.best, *others), chosen=0)
    return SeasonPlan(season, ranked, "", time.perf_counter() - begun)
