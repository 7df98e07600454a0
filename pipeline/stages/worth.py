"""What a case's fuel is made of: causes of the optimality gap, and the worth of the clock."""

import math
from dataclasses import replace

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.model import (
    Case,
    CaseResult,
    ClockWorth,
    Current,
    GapShares,
    SpeedChoice,
    plan_options,
)
from pipeline.scenario.model import PlannerOptions
from renew.inputs.options import Drift
from renew.voyage.fuel import passage

# Factor on the turn rate of a vessel that turns on the spot.
_ON_THE_SPOT = 100.0
# Number of classes in the other plans, of which only the best route is used.
_CLASSES = 4
# Number of bisections for the factor on speeds.
_HALVINGS = 30


def gap_shares(case: Case, result: CaseResult, options: PlannerOptions) -> GapShares | None:
    """Split the gap of a case's best route; None without a plan. Takes as long as planning.

    The lower bound on fuel holds on the original land, for any vessel, with tidal water open at all
    times. The fuel of more plans lies between the bound and the route: (1) the best route on the
    original land, and (2) the best route on the chart with its margin and offing. These plans have
    no padding and a vessel that turns on the spot, because many ways close to land have no room for
    a turning circle. The chart's share is the fuel of (2) minus (1). The share of padding and
    turning circle is the fuel of the route minus (2). With a tide, the plan (0) is that of (1) with
    tidal water open at all times, and the tide's share is the fuel of (1) minus (0). The bound's
    own share, which no route can save, is the fuel of (0), or else of (1), minus the bound.
    """
    if result.plan is None:
        return None
    best, by_s = result.plan.best, result.arrive_by_s
    kept = _least_fuel(case, options, options.clearance or 0.0, by_s)
    on_land = replace(case, water=replace(case.water, chart=_land_alone(case.chart)))
    free = _least_fuel(on_land, options, 0.0, by_s)
    # A search may miss the best route. But a route of a more limited problem is also a route of a
    # less limited one, so its fuel counts there as well.
    kept = min(kept, best.fuel)
    free = min(free, kept)
    depth, opened = case.tidal_depth, free
    if depth is not None:
        areas = (*case.areas, *depth.never_open)
        tideless = replace(on_land, areas=areas, tidal_depth=None)
        opened = min(free, _least_fuel(tideless, options, 0.0, by_s))
    bound = best.fuel / (1 + best.optimality_gap)
    return GapShares(
        chart=(kept - free) / bound,
        padding=(best.fuel - kept) / bound,
        bound=(opened - bound) / bound,
        tide=(free - opened) / bound,
    )


def _least_fuel(case: Case, options: PlannerOptions, clearance: float, arrive_by_s: float) -> float:
    """Return the least fuel at `clearance` planar metres off land, without padding, or inf."""
    asked = options.model_copy(
        update={
            "padding": "none",
            "risk_at": "route",  # "point" needs adaptive padding
            "clearance": clearance,
            "classes": _CLASSES,
            "method": "optimal",
        }
    )
    nimble = replace(case.vessel, turn_rate=_ON_THE_SPOT * case.vessel.turn_rate)
    try:
        return replace(case, vessel=nimble).planned(plan_options(asked), arrive_by_s).best.fuel
    except renew.PlanningError:
        return math.inf


def _land_alone(chart: renew.Chart) -> renew.Chart:
    """Return the chart of the original land, for which the bound is computed."""
    land = shapely.difference(chart.extent, chart.open_water)
    return renew.Chart(chart.extent, [land])


def clock_worth(case: Case, result: CaseResult, options: PlannerOptions) -> ClockWorth | None:
    """Compare a case's fuel with other plans; None for a steady current or without a plan.

    They use the current at departure, its mean over the voyage, or no current, which gives the
    shortest safe path. All are sailed in the changing current, with the same departure and padding
    rules. If speeds are chosen, a plan's speeds are multiplied by a factor so that it is in time.
    """
    current = case.current
    if result.plan is None or not isinstance(current, renew.VaryingCurrent):
        return None
    best = result.plan.best
    frozen, mean, shortest = (
        _sailed(case, result, planned_in, options)
        for planned_in in (
            weighted(current, hat_weights(current.slice_times, 0.0)),
            weighted(current, mean_weights(current.slice_times, float(best.times[-1]))),
            renew.UniformCurrent(0.0, 0.0),
        )
    )
    bound = best.fuel / (1 + best.optimality_gap)
    return ClockWorth(best.fuel, frozen, mean, shortest, bound, in_time=case.speeds is not None)


def hat_weights(times: FloatArray, moment: float) -> FloatArray:
    """Return weights (nt,) of a current's slices that interpolate linearly to a moment, s."""
    return np.array([np.interp(moment, times, one) for one in np.eye(len(times))])


def mean_weights(times: FloatArray, end: float) -> FloatArray:
    """Return weights (nt,) of a current's slices for its mean from 0 to `end`, s."""
    knots = np.unique(np.concatenate([[0.0, end], times[(times > 0) & (times < end)]]))
    shares = np.zeros(len(knots))
    shares[1:] += np.diff(knots) / 2
    shares[:-1] += np.diff(knots) / 2
    each = np.array([np.interp(knots, times, one) for one in np.eye(len(times))])
    return np.asarray(each @ shares / end)


def weighted(current: renew.VaryingCurrent, weights: FloatArray) -> renew.GriddedCurrent:
    """Return the weighted sum of a current's slices as a steady current."""
    grids = [one for one in current.slices if isinstance(one, renew.GriddedCurrent)]
    used = [(grid, weight) for grid, weight in zip(grids, weights, strict=True) if weight > 0]
    uv = sum((weight * grid.uv for grid, weight in used), np.zeros(grids[0].uv.shape))
    return renew.GriddedCurrent(grids[0].x, grids[0].y, uv[..., 0], uv[..., 1])


def _sailed(case: Case, result: CaseResult, planned_in: Current, options: PlannerOptions) -> float:
    """Return the fuel in a case's current of the best route planned in `planned_in`, or inf."""
    asked = options.model_copy(update={"classes": _CLASSES})
    try:
        plan = replace(case, current=planned_in).planned(plan_options(asked), result.arrive_by_s)
    except renew.PlanningError:
        return math.inf
    speeds: FloatArray | None = plan.best.speeds
    if case.speeds is not None:
        speeds = speeds_in_time(
            plan.best, case.current, case.speeds, result.arrive_by_s, options.drift
        )
        if speeds is None:
            return math.inf
    return renew.fuel(plan.best.path, case.current, case.vessel, drift=options.drift, speeds=speeds)


def speeds_in_time(
    route: renew.Route, current: Current, choice: SpeedChoice, arrive_by_s: float, drift: Drift
) -> FloatArray | None:
    """Return a route's speeds (n - 1,), m/s, times the least factor with which it is in time.

    Speeds are clipped to the range of the choice. Returns None if the highest are too slow.
    """
    vessel = renew.Vessel(choice.most, turn_rate=1.0)

    def speeds(factor: float) -> FloatArray:
        return np.clip(factor * route.speeds, choice.least, choice.most)

    def is_late(factor: float) -> bool:
        own = speeds(factor)
        arrivals = passage(route.path, current, vessel, drift=drift, speeds=own).times
        return bool(arrivals[-1] > arrive_by_s)

    low, high = choice.least / choice.most, choice.most / choice.least
    if is_late(high):
        return None
    for _ in range(_HALVINGS):
        factor = math.sqrt(low * high)
        low, high = (factor, high) if is_late(factor) else (low, factor)
    return speeds(high)
