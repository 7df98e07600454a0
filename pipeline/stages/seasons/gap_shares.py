"""Splits a route's optimality gap into the shares of the chart, the padding and the bound itself.

The lower bound on fuel is taken on the original land, for any vessel. Two more plans lie between
the bound and the route: (1) the best route on the original land, and (2) the best one on the chart
with its margin and offing. Both have no padding, and a vessel that turns on the spot, as close to
land many ways have no room for a turning circle. The chart's share is the fuel of (2) above (1);
the share of padding and turning circle is the fuel of the route above (2); the bound's own share is
the fuel of (1) above the bound, which no route reaches.
"""

from dataclasses import replace

import shapely

import renew
from pipeline.model import GapShares, Scene, SeasonPlan
from pipeline.model.for_planner import plan_options
from pipeline.scenario.model import PlannerOptions

# Factor on the turn rate of a vessel that turns on the spot.
_ON_THE_SPOT = 100.0
# Number of classes of the two plans: only their best route is used.
_CLASSES = 4


def gap_shares(scene: Scene, season: SeasonPlan, options: PlannerOptions) -> GapShares | None:
    """Split a season's gap; None if it was not planned. Takes about as long as its plan."""
    if season.plan is None:
        return None
    best = season.plan.best
    kept = _least_fuel(scene, scene.chart, season, options, options.clearance or 0.0)
    free = _least_fuel(scene, _land_alone(scene.chart), season, options, 0.0)
    # Each is the best of the routes found: a route allowed with less freedom is allowed with more.
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
    """Least fuel at `clearance` planar metres off a chart, without padding; inf without a route."""
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
    """Return the chart of the original land, on which the bound is taken."""
    land = shapely.difference(chart.extent, chart.open_water)
    return renew.Chart(chart.extent, [land])
