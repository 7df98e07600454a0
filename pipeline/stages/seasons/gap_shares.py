"""What a route's optimality gap is made of: the chart's share, the padding's, the bound's own.

The bound on fuel holds off the land itself, for any vessel. So two more plans lie between it and
the route: the best route off the land itself, and the best that keeps off the chart with its margin
and the offing, both without padding, and by a vessel that turns on the spot: close to land many
ways have no room for a turning circle. The chart's share is what the second needs more than the
first; the padding's, with the circle's, what the route needs more than the second; what the first
needs more than the bound is the bound's own: no route is so good.
"""

from __future__ import annotations

from dataclasses import replace

import shapely

import renew
from pipeline.model import GapShares, Scene, SeasonPlan
from pipeline.model.for_planner import plan_options
from pipeline.scenario.model import PlannerOptions

# How many times as fast as the vessel one turns that turns on the spot.
_ON_THE_SPOT = 100.0
# Number of classes that the two plans look into: only their best route is used.
_CLASSES = 4


def gap_shares(scene: Scene, season: SeasonPlan, options: PlannerOptions) -> GapShares | None:
    """Take a season's gap apart; None where it was not planned. Takes about as long as its plan."""
    if season.plan is None:
        return None
    best = season.plan.best
    kept = _least_fuel(scene, scene.chart, season, options, options.clearance or 0.0)
    free = _least_fuel(scene, _land_alone(scene.chart), season, options, 0.0)
    # Each is the best of what was found: what may be done with less freedom may be done with more.
    kept = min(kept, best.fuel)
    free = min(free, kept)
    bound = best.fuel / (1 + best.optimality_gap)
    return GapShares(
        season=season.season,
        chart=(kept - free) / bound,
        padding=(best.fuel - kept) / bound,
        bound=(free - bound) / bound,
    )


def _least_fuel(
    scene: Scene, chart: renew.Chart, season: SeasonPlan, options: PlannerOptions, clearance: float
) -> float:
    """Least fuel off a chart without padding, `clearance` planar metres off it; inf without one."""
    asked = options.model_copy(
        update={
            "padding": "none",
            "risk_at": "route",  # the other one needs adaptive padding
            "clearance": clearance,
            "classes": _CLASSES,
            "method": "optimal",
        }
    )
    vessel = scene.vessel_in(season.season)
    try:
        plan = renew.plan(
            chart,
            scene.currents[season.season],
            replace(vessel, turn_rate=_ON_THE_SPOT * vessel.turn_rate),
            scene.start,
            scene.goal,
            options=plan_options(asked),
            **scene.itinerary(season.season),
            **scene.pace(season.season, season.arrive_by_s),
        )
    except renew.PlanningError:
        return float("inf")
    return plan.best.fuel


def _land_alone(chart: renew.Chart) -> renew.Chart:
    """The chart of the land that the bound is taken on."""
    land = shapely.difference(chart.extent, chart.open_water)
    return renew.Chart(chart.extent, [land])
