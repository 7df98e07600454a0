"""Times over the legs of a roadmap: with the clock running, and the least at any time.

Whether a leg leads on to one of the k best paths is judged by the least time; in a steady current
that is the time itself.
"""

import math
from typing import TypeAlias

import numpy as np

from renew._compiled import kernel, small_kernel
from renew._types import FloatArray
from renew.kernels.capsules import Segment
from renew.kernels.current_table import CurrentTable, velocity
from renew.kernels.ground_speed import Polar, ground_speed

Extremes: TypeAlias = tuple[CurrentTable, CurrentTable, bool]
"""Tables of the least and of the largest velocity along x and y at any time; whether they agree."""

# Most columns or rows of the current's table that a leg crosses where Simpson's rule is used once:
# about half of the smallest eddy that the table holds.
_PANEL = 20.0
# Lowest speed over ground, as a share of the vessel's: a straight leg may lead against a current
# that the path itself avoids.
_MIN_SPEED = 0.1


@kernel
def time_along(leg: Segment, begin: float, table: CurrentTable, polar: Polar) -> float:
    """Time (s) along a leg that is begun at a time, by Simpson's rule."""
    dx, dy = leg.bx - leg.ax, leg.by - leg.ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0
    slowest = _MIN_SPEED * polar.speed
    halves = 2 * _panels(leg, table)
    total, slowness, now = 0.0, 0.0, begin
    for k in range(halves + 1):
        # When the vessel is there at the pace of the place before.
        now += slowness * length / halves
        u, v = velocity(table, leg.ax + k / halves * dx, leg.ay + k / halves * dy, now)
        slowness = 1.0 / max(slowest, ground_speed(u, v, dx / length, dy / length, polar))
        total += _simpson_weight(k, halves) * slowness
    return total * length / (3 * halves)


@small_kernel
def _panels(leg: Segment, table: CurrentTable) -> int:
    """Number of parts of a leg to each of which Simpson's rule is applied."""
    columns = abs(leg.bx - leg.ax) * (len(table.x) - 1) / (table.x[-1] - table.x[0])
    rows = abs(leg.by - leg.ay) * (len(table.y) - 1) / (table.y[-1] - table.y[0])
    return max(1, math.ceil(float(max(columns, rows)) / _PANEL))


@small_kernel
def _simpson_weight(k: int, halves: int) -> float:
    """Weight of point k of 0 to `halves` in Simpson's rule, which sums them to 3 `halves`."""
    if k in (0, halves):
        return 1.0
    return 4.0 if k % 2 else 2.0


@kernel
def currents_between(extremes: Extremes, points: FloatArray) -> FloatArray:
    """Least and largest velocities (n, 4), m/s, at points (n, 2): u, v and u, v."""
    least, largest, are_equal = extremes
    currents = np.empty((len(points), 4))
    for k in range(len(points)):
        u, v = velocity(least, points[k, 0], points[k, 1], 0.0)
        currents[k, 0], currents[k, 1] = u, v
        if not are_equal:
            u, v = velocity(largest, points[k, 0], points[k, 1], 0.0)
        currents[k, 2], currents[k, 3] = u, v
    return currents


@kernel
def least_times(
    leg: Segment, here: FloatArray, there: FloatArray, extremes: Extremes, polar: Polar
) -> tuple[float, float]:
    """Least times (s) along a leg and back, by Simpson's rule, at whatever time it is sailed.

    `here` and `there` (4,) are the least and the largest velocities at its ends.
    """
    dx, dy = leg.bx - leg.ax, leg.by - leg.ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0, 0.0
    tx, ty = dx / length, dy / length
    slowest = _MIN_SPEED * polar.speed
    least, largest, are_equal = extremes
    halves = 2 * _panels(leg, least)
    time, back = 0.0, 0.0
    for k in range(halves + 1):
        if k in (0, halves):
            u, v, more_u, more_v = here if k == 0 else there
        else:
            x, y = leg.ax + k / halves * dx, leg.ay + k / halves * dy
            u, v = velocity(least, x, y, 0.0)
            more_u, more_v = (u, v) if are_equal else velocity(largest, x, y, 0.0)
        weight = _simpson_weight(k, halves)
        time += weight / max(slowest, _fastest(u, v, more_u, more_v, tx, ty, polar))
        back += weight / max(slowest, _fastest(u, v, more_u, more_v, -tx, -ty, polar))
    scale = length / (3 * halves)
    return time * scale, back * scale


@kernel
def _fastest(
    low_u: float, low_v: float, high_u: float, high_v: float, tx: float, ty: float, polar: Polar
) -> float:
    """Largest speed over ground (m/s) along the unit tangent t in currents between two extremes.

    No current is as helpful along t as the one taken, and none lies less across it.
    """
    along = max(tx * low_u, tx * high_u) + max(ty * low_v, ty * high_v)
    low = min(tx * low_v, tx * high_v) - max(ty * low_u, ty * high_u)
    high = max(tx * low_v, tx * high_v) - min(ty * low_u, ty * high_u)
    across = low if low > 0.0 else min(0.0, high)
    return ground_speed(along * tx - across * ty, along * ty + across * tx, tx, ty, polar)
