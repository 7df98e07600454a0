"""What it is worth to know how the current changes: other plans, sailed in the changing current.

Each is what one would plan without a clock: on the current as it is at departure, on its mean over
the voyage, or on none at all, which is the shortest safe path. All begin at the same time and keep
the same padding rules.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

import renew
from pipeline.model import ClockWorth

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.model import Scene, SeasonPlan
    from pipeline.scenario.model import PlannerOptions

    FloatArray = npt.NDArray[np.float64]

# Number of classes that the other plans look into: only their best route is used.
_CLASSES = 4


def clock_worth(scene: Scene, season: SeasonPlan, options: PlannerOptions) -> ClockWorth | None:
    """Sail other plans in a season's current; None where it does not change, or has no plan."""
    current = scene.currents[season.season]
    if season.plan is None or not isinstance(current, renew.VaryingCurrent):
        return None
    best = season.plan.best
    frozen, mean, shortest = (
        _sailed(scene, season.season, planned_in, options)
        for planned_in in (
            weighted(current, hat_weights(current.slice_times, 0.0)),
            weighted(current, mean_weights(current.slice_times, float(best.times[-1]))),
            renew.UniformCurrent(0.0, 0.0),
        )
    )
    bound = best.fuel / (1 + best.optimality_gap)
    return ClockWorth(season.season, best.fuel, frozen, mean, shortest, bound)


def hat_weights(times: FloatArray, moment: float) -> FloatArray:
    """Weights (nt,) of slices that make up the current at a moment, linear between them."""
    return np.array([np.interp(moment, times, one) for one in np.eye(len(times))])


def mean_weights(times: FloatArray, end: float) -> FloatArray:
    """Weights (nt,) of slices that make up the mean of the current from 0 to `end`, s."""
    knots = np.unique(np.concatenate([[0.0, end], times[(times > 0) & (times < end)]]))
    shares = np.zeros(len(knots))
    shares[1:] += np.diff(knots) / 2
    shares[:-1] += np.diff(knots) / 2
    each = np.array([np.interp(knots, times, one) for one in np.eye(len(times))])
    return np.asarray(each @ shares / end)


def weighted(current: renew.VaryingCurrent, weights: FloatArray) -> renew.GriddedCurrent:
    """The sum of a current's slices with some weights, as a steady current."""
    grids = [one for one in current.slices if isinstance(one, renew.GriddedCurrent)]
    used = [(grid, weight) for grid, weight in zip(grids, weights, strict=True) if weight > 0]
    uv = sum((weight * grid.uv for grid, weight in used), np.zeros(grids[0].uv.shape))
    return renew.GriddedCurrent(grids[0].x, grids[0].y, uv[..., 0], uv[..., 1])


def _sailed(
    scene: Scene, season: str, planned_in: renew.CurrentField, options: PlannerOptions
) -> float:
    """Fuel in a season's current of the best route planned in another; inf without one."""
    asked = options.model_copy(update={"classes": _CLASSES})
    try:
        plan = renew.plan(
            scene.chart,
            planned_in,
            scene.vessel,
            scene.start,
            scene.goal,
            **{**asked.model_dump(), "clearance": options.clearance or 0.0},
            **scene.itinerary(season),
        )
    except renew.PlanningError:
        return math.inf
    return renew.fuel(plan.best.path, scene.currents[season], scene.vessel, drift=options.drift)
