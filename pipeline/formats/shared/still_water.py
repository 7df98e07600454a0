"""Speed and fuel of a way in still water."""

import numpy as np

from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import speed_over_ground
from pipeline.model import RouteMetrics


def still_speed_m_s(result: RunResult, metrics: RouteMetrics) -> float:
    """Speed at which a way is sailed in still water, m/s.

    Where speeds are chosen, it is the mean speed over ground of the way as planned, kept within the
    speeds that may be chosen.
    """
    choice = result.scene.speeds.get(metrics.season)
    if choice is None:
        return result.scene.vessel.speed
    return float(np.clip(speed_over_ground(metrics), choice.least, choice.most))


def still_fuel_per_metre(result: RunResult, metrics: RouteMetrics) -> float:
    """Fuel a planner's metre of a way in still water."""
    vessel = result.scene.vessel
    speed = still_speed_m_s(result, metrics)
    return float(vessel.fuel_coefficient * speed ** (vessel.fuel_exponent - 1))
