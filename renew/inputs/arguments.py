"""What is asked of a plan, checked at the door."""

from __future__ import annotations

import math

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import (
    CurrentTooStrongError,
    GoalInNoGoError,
    ParameterError,
    PlanningError,
    StartInNoGoError,
)
from renew.inputs.chart import Chart
from renew.inputs.checks import is_count, is_size
from renew.inputs.current import CurrentField
from renew.inputs.vessel import Vessel


def check_counts(classes: int, samples: int, seed: int, distinct_by: float) -> None:
    """Refuse what is no count and no size; all faults at once."""
    faults = [
        f"{name} = {value!r} must be a whole number of at least {least}"
        for name, value, least in (
            ("classes", classes, 1),
            ("samples", samples, 1),
            ("seed", seed, 0),
        )
        if not is_count(value, least)
    ]
    if not is_size(distinct_by):
        faults.append(f"distinct_by = {distinct_by!r} m must be finite and at least 0")
    if faults:
        raise ParameterError("; ".join(faults))


def as_point(name: str, value: FloatArray | tuple[float, float]) -> FloatArray:
    """Take a start or goal as an array (2,)."""
    try:
        point = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        point = np.empty(0)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ParameterError(f"{name} = {value!r} must be two finite numbers (m)")
    return point


def check_ends(
    chart: Chart, field: CurrentField, vessel: Vessel, start: FloatArray, goal: FloatArray
) -> None:
    """Refuse ends that are not in the water, or where the current outruns the vessel."""
    kinds: tuple[tuple[str, FloatArray, type[PlanningError]], ...] = (
        ("start", start, StartInNoGoError),
        ("goal", goal, GoalInNoGoError),
    )
    for name, point, error in kinds:
        here = shapely.Point(point)
        # Water is snapped to the chart's grid: a point on its edge may lie just outside.
        if not shapely.dwithin(chart.water, here, 4 * chart.precision):
            nearest = shapely.get_coordinates(shapely.shortest_line(here, chart.water))[-1].round(3)
            where = "in the no-go zone" if shapely.covers(chart.extent, here) else "off the chart"
            raise error(
                f"{name} ({point[0]:.10g}, {point[1]:.10g}) m lies {where}, "
                f"{math.dist(point, nearest):.4g} m from the nearest water at "
                f"({nearest[0]:.10g}, {nearest[1]:.10g}) m; move it there or beyond"
            )
    if math.dist(start, goal) <= chart.precision:
        raise ParameterError(
            f"start and goal are the same point ({start[0]:.10g}, {start[1]:.10g}) m; move one"
        )
    for name, point in (("start", start), ("goal", goal)):
        strength = float(np.linalg.norm(field(point)))
        if strength >= vessel.speed:
            raise CurrentTooStrongError(
                f"the current at the {name} runs at {strength:.3g} m/s; the vessel makes "
                f"{vessel.speed:.3g} m/s through water. Take a faster vessel or another {name}"
            )
