"""The quickest chain through rows of points, and shortcuts along a chain.

A state's cost is its arrival time. Each row of points is joined to the next by straight legs; a
leg's time is its length times the mean slowness at its ends (trapezoidal rule: rows stand close).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import Capsules, Segment, capsule_bounds, intersects, leg_is_clear
from renew.kernels.ground_speed import Polar, ground_speed

# Current's share of the vessel's speed, squared, from which water counts as too strong at a point:
# between two points on a leg it may be a little stronger.
TOO_STRONG = 0.97**2
# Least way made (m²/s: length times speed over ground); it keeps an inverse finite.
_MIN_WAY = 1e-300


@kernel
def slowness(cx: float, cy: float, tx: float, ty: float, polar: Polar) -> float:
    """Seconds a metre along the unit tangent t in the current c; inf where no way is made.

    A current as strong as the vessel is no-go for it, whichever way it flows.
    """
    if cx * cx + cy * cy >= polar.speed * polar.speed:
        return math.inf
    speed = ground_speed(cx, cy, tx, ty, polar)
    return 1.0 / speed if speed > 0.0 else math.inf


@kernel
def leg_time(
    a: FloatArray, b: FloatArray, velocity_a: FloatArray, velocity_b: FloatArray, polar: Polar
) -> float:
    """Time (s) over a straight leg a -> b (2,) by the trapezoidal rule; inf where impassable."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0
    tx, ty = dx / length, dy / length
    here = slowness(velocity_a[0], velocity_a[1], tx, ty, polar)
    there = slowness(velocity_b[0], velocity_b[1], tx, ty, polar)
    return length * (here + there) / 2


@kernel
def shortcut(
    path: FloatArray, velocity: FloatArray, polar: Polar, capsules: Capsules, longest: float
) -> BoolArray:
    """Points (n,) of a path to keep so that no short leg past one is clear and no slower.

    Legs up to `longest` metres are tried, in one pass along the path; `velocity` (n, 2) is the
    current at the path's points.
    """
    every = np.arange(len(capsules.radius))
    none_exempt = np.zeros(len(capsules.radius), dtype=np.bool_)
    kept = np.zeros(len(path), dtype=np.int64)
    count = 1
    for new in range(1, len(path)):
        while count >= 2:
            a, b = kept[count - 2], kept[count - 1]
            dx, dy = path[new, 0] - path[a, 0], path[new, 1] - path[a, 1]
            if dx * dx + dy * dy > longest * longest:
                break
            direct = leg_time(path[a], path[new], velocity[a], velocity[new], polar)
            via = leg_time(path[a], path[b], velocity[a], velocity[b], polar)
            via += leg_time(path[b], path[new], velocity[b], velocity[new], polar)
            leg = Segment(path[a, 0], path[a, 1], path[new, 0], path[new, 1])
            if direct > via or not leg_is_clear(leg, capsules, every, none_exempt):
                break
            count -= 1
        kept[count] = new
        count += 1
    keep = np.zeros(len(path), dtype=np.bool_)
    keep[kept[:count]] = True
    return keep


class _Row(NamedTuple):
    """One row of points (m,): coordinates (m), currents (m/s), and the arrival times there (s).

    One array each, so that the inner loop can be vectorised.
    """

    x: FloatArray
    y: FloatArray
    u: FloatArray
    v: FloatArray
    arrival: FloatArray


@kernel
def quickest_chain(
    points: FloatArray, velocity: FloatArray, polar: Polar, capsules: Capsules, exempt: BoolArray
) -> tuple[float, IntArray]:
    """Arrival time (s) and the chosen point (r,) of each row; inf where no chain is clear.

    Parameters
    ----------
    points, velocity : (r, m, 2) metres, m/s; the first and the last row are one point each, at
        index 0.
    capsules : what legs stay out of, as in :func:`renew.kernels.capsules.leg_is_clear`.
    exempt : (2, capsules) True where the first, or the last, leg may enter a capsule.
    """
    rows, count = points.shape[:2]
    x, y = points[..., 0].copy(), points[..., 1].copy()
    u, v = velocity[..., 0].copy(), velocity[..., 1].copy()
    arrival = np.full((rows, count), np.inf)
    arrival[0, 0] = 0.0
    came_from = np.zeros((rows, count), dtype=np.int64)
    bounds = capsule_bounds(capsules)
    none_exempt = np.zeros(len(capsules.radius), dtype=np.bool_)
    for row in range(rows - 1):
        width = 1 if row == 0 else count
        following = 1 if row == rows - 2 else count
        here = _Row(
            x[row, :width], y[row, :width], u[row, :width], v[row, :width], arrival[row, :width]
        )
        after = row + 1
        there = _Row(
            x[after, :following],
            y[after, :following],
            u[after, :following],
            v[after, :following],
            arrival[after, :following],
        )
        near = _capsules_between(here, there, bounds)
        free = exempt[0] if row == 0 else exempt[1] if row == rows - 2 else none_exempt
        _advance(here, there, came_from[after], polar, capsules, near, free)
    chain = np.zeros(rows, dtype=np.int64)
    for row in range(rows - 1, 0, -1):
        chain[row - 1] = came_from[row, chain[row]]
    return arrival[rows - 1, 0], chain


@kernel
def _advance(
    here: _Row,
    there: _Row,
    came_from: IntArray,
    polar: Polar,
    capsules: Capsules,
    near: IntArray,
    exempt: BoolArray,
) -> None:
    """Fill in the arrival times of the next row, and from which point of this row each comes."""
    totals = np.empty(len(here.x))
    for j in range(len(there.x)):
        u, v = there.u[j], there.v[j]
        if u * u + v * v >= TOO_STRONG * polar.speed * polar.speed:
            continue
        _arrivals(here, there.x[j], there.y[j], u, v, polar, totals)
        while True:
            i = 0
            for k in range(1, len(totals)):
                if totals[k] < totals[i]:
                    i = k
            if totals[i] == np.inf:
                break
            leg = Segment(here.x[i], here.y[i], there.x[j], there.y[j])
            if leg_is_clear(leg, capsules, near, exempt):
                there.arrival[j] = totals[i]
                came_from[j] = i
                break
            totals[i] = np.inf


@kernel
def _arrivals(
    here: _Row, bx: float, by: float, bu: float, bv: float, polar: Polar, totals: FloatArray
) -> None:
    """Arrival times (m,) at one point from each of a row: :func:`leg_time` without its branches.

    With d the leg and g its slowness' denominator, a time is |d|² / (|d| g): no unit vector is
    needed. Where the current is as strong as the vessel, `here.arrival` is inf.
    """
    x, y, u, v, departure = here
    speed = polar.speed
    for i in range(len(totals)):
        dx, dy = bx - x[i], by - y[i]
        square = dx * dx + dy * dy
        first, second = u[i] * dx + v[i] * dy, bu * dx + bv * dy
        if polar.crab:
            across, across_there = v[i] * dx - u[i] * dy, bv * dx - bu * dy
            most = speed * speed * square
            first += math.sqrt(max(most - across * across, 0.0))
            second += math.sqrt(max(most - across_there * across_there, 0.0))
        else:
            way = speed * math.sqrt(square)
            first += way
            second += way
        # Between points that coincide the time is 0.
        totals[i] = departure[i] + 0.5 * square * (
            1.0 / max(first, _MIN_WAY) + 1.0 / max(second, _MIN_WAY)
        )


@kernel
def _capsules_between(here: _Row, there: _Row, bounds: FloatArray) -> IntArray:
    """Indices of capsules whose bounds (c, 4) intersect the box around two rows of points."""
    west, east = min(here.x.min(), there.x.min()), max(here.x.max(), there.x.max())
    south, north = min(here.y.min(), there.y.min()), max(here.y.max(), there.y.max())
    near = np.empty(len(bounds), dtype=np.int64)
    count = 0
    for h in range(len(bounds)):
        if intersects(bounds, h, west, south, east, north):
            near[count] = h
            count += 1
    return near[:count]
