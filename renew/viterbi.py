"""The quickest chain through rows of points, and shortcuts along a chain: compiled.

A state's cost is its arrival time. Each row of points is joined to the next by straight legs; a
leg's time is its length times the mean slowness at its ends (trapezoidal rule: rows stand close).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from renew.geometry import leg_is_clear

if TYPE_CHECKING:
    from renew._types import BoolArray, FloatArray, IntArray


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def quickest_chain(
    points: FloatArray,
    velocity: FloatArray,
    speed: float,
    crab: bool,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    near: IntArray,
    near_from: IntArray,
    left_out: BoolArray,
) -> tuple[float, IntArray]:
    """Arrival time (s) and the chosen point (r,) of each row; inf where no chain is clear.

    Parameters
    ----------
    points, velocity : (r, m, 2) metres, m/s; the first and the last row are one point each, at
        index 0.
    start, end, radius : capsules to stay out of, as in :func:`renew.geometry.leg_is_clear`.
    near, near_from : capsules near[near_from[i]:near_from[i + 1]] are tested from row i on.
    left_out : (r - 1, capsules) True where row i's legs need not mind a capsule.
    """
    rows, count = points.shape[:2]
    arrival = np.full((rows, count), np.inf)
    arrival[0, 0] = 0.0
    came_from = np.zeros((rows, count), dtype=np.int64)
    for row in range(rows - 1):
        chosen = near[near_from[row] : near_from[row + 1]]
        likely = 0
        for j in range(count if row < rows - 2 else 1):
            bx, by = points[row + 1, j]
            # What served the neighbour serves here too, most likely, and so most others needn't
            # be tested against the capsules.
            for k in range(count):
                i = (likely + k) % count
                if not arrival[row, i] < arrival[row + 1, j]:
                    continue
                ax, ay = points[row, i]
                total = arrival[row, i] + leg_time(
                    points[row, i],
                    points[row + 1, j],
                    velocity[row, i],
                    velocity[row + 1, j],
                    speed,
                    crab,
                )
                if total < arrival[row + 1, j] and leg_is_clear(
                    ax, ay, bx, by, start, end, radius, chosen, left_out[row]
                ):
                    arrival[row + 1, j] = total
                    came_from[row + 1, j] = i
            likely = came_from[row + 1, j]
    chain = np.zeros(rows, dtype=np.int64)
    for row in range(rows - 1, 0, -1):
        chain[row - 1] = came_from[row, chain[row]]
    return arrival[rows - 1, 0], chain
