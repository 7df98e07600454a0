"""Split a route's optimality gap into the shares of the chart, the padding and the bound itself.

The lower bound on fuel holds on the original land, for any vessel. The fuel of two more plans lies
between the bound and the route: (1) the best route on the original land, and (2) the best route on
the chart with its margin and offing. Both plans have no padding and a vessel that turns on the
spot, because many ways close to land have no room for a turning circle. The chart's share is the
fuel of (2) minus (1). The share of padding and turning circle is the fuel of the route minus (2).
The bound's own share, which no route can save, is the fuel of (1) minus the bound.
"""

from dataclasses import replace

import shapely

import renew
from pipeline.model import GapShares, Scene, SeasonPlan, plan_options
from pipeline.scenario.model import PlannerOptions

# Factor on the turn rate of a vessel that turns on the spot.
_ON_THE_SPOT = 100.0
# Number of classes of the two plans; only their best route is used.
_CLASSES = 4


def gap_shares(scene: Scene, season: SeasonPlan, options: PlannerOptions) -> GapShares | None:
    """Split the gap of a season's best route; None without a plan. Takes as long as planning."""
    if season.plan is None:
        return None
    best = season.plan.best
    kept = _least_fuel(scene, scene.chart, season, options, options.clearance or 0.0)
    free = _least_fuel(scene, _land_alone(scene.chart), season, options, 0.0)
    # A search may miss the best route; but each route is also a route of the less limited problem.
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
    """Return the least fuel at `clearance` planar metres off a chart, without padding, or inf."""
    asked = options.model_copy(
        update={
            "padding": "none",
            "risk_at": "route",  # "point" needs adaptive padding
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
    """Return the chart of the original land, for which the bound is computed."""
    land = shapely.difference(chart.extent, chart.open_water)
    return renew.Chart(chart.extent, [land])
