"""The quickest chain through rows of points, and shortcuts along a chain: compiled.

A state's cost is its arrival time. Each row of points is joined to the next by straight legs; a
leg's time is its length times the mean slowness at its ends (trapezoidal rule: rows stand close).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import capsule_bounds, leg_is_clear, meets

# A current of this share of the vessel's speed (squared) is too strong: between two points on a
# leg it may be a little stronger.
TOO_STRONG = 0.97**2
# Where less way is made than this (m²/s: length times speed over ground), none is.
_NO_WAY = 1e-300


@njit(cache=True, error_model="numpy")
def slowness(cx: float, cy: float, tx: float, ty: float, speed: float, crab: bool) -> float:
    """Seconds a metre along a unit tangent in a current; inf where no way is made.

    Water that outruns the vessel is no-go for it, whichever way it flows.
    """
    if cx * cx + cy * cy >= speed * speed:
        return math.inf
    ground = cx * tx + cy * ty
    if crab:
        across = cy * tx - cx * ty
        ground += math.sqrt(speed * speed - across * across)
    else:
        ground += speed
    return 1.0 / ground if ground > 0.0 else math.inf


@njit(cache=True, error_model="numpy")
def leg_time(
    a: FloatArray,
    b: FloatArray,
    velocity_a: FloatArray,
    velocity_b: FloatArray,
    speed: float,
    crab: bool,
) -> float:
    """Time (s) over a straight leg a -> b (2,) by the trapezoidal rule; inf where impassable."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0
    tx, ty = dx / length, dy / length
    here = slowness(velocity_a[0], velocity_a[1], tx, ty, speed, crab)
    there = slowness(velocity_b[0], velocity_b[1], tx, ty, speed, crab)
    return length * (here + there) / 2


@njit(cache=True, error_model="numpy")
def without_detours(
    path: FloatArray,
    velocity: FloatArray,
    speed: float,
    crab: bool,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    longest: float,
) -> BoolArray:
    """Points (n,) of a path to keep so that no short shortcut past one is clear and no slower.

    Shortcuts up to `longest` metres are tried, in one pass along the path.
    """
    every = np.arange(len(radius))
    left_out = np.zeros(len(radius), dtype=np.bool_)
    kept = np.zeros(len(path), dtype=np.int64)
    count = 1
    for new in range(1, len(path)):
        while count >= 2:
            a, b = kept[count - 2], kept[count - 1]
            dx, dy = path[new, 0] - path[a, 0], path[new, 1] - path[a, 1]
            if dx * dx + dy * dy > longest * longest:
                break
            direct = leg_time(path[a], path[new], velocity[a], velocity[new], speed, crab)
            via = leg_time(path[a], path[b], velocity[a], velocity[b], speed, crab)
            via += leg_time(path[b], path[new], velocity[b], velocity[new], speed, crab)
            if direct > via or not leg_is_clear(
                path[a, 0],
                path[a, 1],
                path[new, 0],
                path[new, 1],
                start,
                end,
                radius,
                every,
                left_out,
            ):
                break
            count -= 1
        kept[count] = new
        count += 1
    keep = np.zeros(len(path), dtype=np.bool_)
    keep[kept[:count]] = True
    return keep


@njit(cache=True, error_model="numpy")
def quickest_chain(
    points: FloatArray,
    velocity: FloatArray,
    speed: float,
    crab: bool,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    left_out: BoolArray,
) -> tuple[float, IntArray]:
    """Arrival time (s) and the chosen point (r,) of each row; inf where no chain is clear.

    Parameters
    ----------
    points, velocity : (r, m, 2) metres, m/s; the first and the last row are one point each, at
        index 0.
    start, end, radius : capsules to stay out of, as in :func:`renew.kernels.capsules.leg_is_clear`.
    left_out : (2, capsules) True where the first, or the last, leg need not mind a capsule.
    """
    rows, count = points.shape[:2]
    # One array each for what the inner loop reads, so that it can be vectorised.
    x, y = points[..., 0].copy(), points[..., 1].copy()
    u, v = velocity[..., 0].copy(), velocity[..., 1].copy()
    arrival = np.full((rows, count), np.inf)
    arrival[0, 0] = 0.0
    came_from = np.zeros((rows, count), dtype=np.int64)
    totals = np.empty(count)
    bounds = capsule_bounds(start, end, radius)
    minds_all = np.zeros(len(radius), dtype=np.bool_)
    for row in range(rows - 1):
        width = 1 if row == 0 else count
        following = 1 if row == rows - 2 else count
        near = _near_rows(
            x[row, :width], y[row, :width], x[row + 1, :following], y[row + 1, :following], bounds
        )
        out = left_out[0] if row == 0 else left_out[1] if row == rows - 2 else minds_all
        for j in range(following):
            bx, by, bu, bv = x[row + 1, j], y[row + 1, j], u[row + 1, j], v[row + 1, j]
            if bu * bu + bv * bv >= TOO_STRONG * speed * speed:
                continue
            _arrivals(
                x[row],
                y[row],
                u[row],
                v[row],
                arrival[row],
                bx,
                by,
                bu,
                bv,
                speed,
                crab,
                width,
                totals,
            )
            while True:
                i = 0
                for k in range(1, width):
                    if totals[k] < totals[i]:
                        i = k
                if totals[i] == np.inf:
                    break
                if leg_is_clear(x[row, i], y[row, i], bx, by, start, end, radius, near, out):
                    arrival[row + 1, j] = totals[i]
                    came_from[row + 1, j] = i
                    break
                totals[i] = np.inf
    chain = np.zeros(rows, dtype=np.int64)
    for row in range(rows - 1, 0, -1):
        chain[row - 1] = came_from[row, chain[row]]
    return arrival[rows - 1, 0], chain


@njit(cache=True, error_model="numpy")
def _arrivals(
    x: FloatArray,
    y: FloatArray,
    u: FloatArray,
    v: FloatArray,
    departure: FloatArray,
    bx: float,
    by: float,
    bu: float,
    bv: float,
    speed: float,
    crab: bool,
    count: int,
    totals: FloatArray,
) -> None:
    """Arrival times at one point from each of a row: :func:`leg_time` without its branches.

    With d the leg and g its slowness' denominator, a time is |d|² / (|d| g): no unit vector is
    needed. Nowhere is the current as strong as the vessel, but where the departure is inf.
    """
    for i in range(count):
        dx, dy = bx - x[i], by - y[i]
        square = dx * dx + dy * dy
        here, there = u[i] * dx + v[i] * dy, bu * dx + bv * dy
        if crab:
            across, across_there = v[i] * dx - u[i] * dy, bv * dx - bu * dy
            most = speed * speed * square
            here += math.sqrt(max(most - across * across, 0.0))
            there += math.sqrt(max(most - across_there * across_there, 0.0))
        else:
            way = speed * math.sqrt(square)
            here += way
            there += way
        # Between points that coincide the time is 0.
        totals[i] = departure[i] + 0.5 * square * (
            1.0 / max(here, _NO_WAY) + 1.0 / max(there, _NO_WAY)
        )


@njit(cache=True, error_model="numpy")
def _near_rows(
    x: FloatArray,
    y: FloatArray,
    next_x: FloatArray,
    next_y: FloatArray,
    bounds: FloatArray,
) -> IntArray:
    """Capsules whose bounds (e, 4) meet those of two rows of points: others are out of the way."""
    west, east = min(x.min(), next_x.min()), max(x.max(), next_x.max())
    south, north = min(y.min(), next_y.min()), max(y.max(), next_y.max())
    near = np.empty(len(bounds), dtype=np.int64)
    count = 0
    for h in range(len(bounds)):
        if meets(bounds, h, west, south, east, north):
            near[count] = h
            count += 1
    return near[:count]
