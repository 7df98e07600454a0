"""The quickest chain through rows of points: a Viterbi pass, compiled.

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
def slowness(cx: float, cy: float, tx: float, ty: float, speed: float, crab: bool) -> float:  # noqa: FBT001
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
def quickest_chain(
    points: FloatArray,
    velocity: FloatArray,
    speed: float,
    crab: bool,  # noqa: FBT001
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
                dx, dy = bx - ax, by - ay
                length = math.sqrt(dx * dx + dy * dy)
                total = arrival[row, i]
                if length > 0.0:
                    tx, ty = dx / length, dy / length
                    here = slowness(velocity[row, i, 0], velocity[row, i, 1], tx, ty, speed, crab)
                    there = slowness(
                        velocity[row + 1, j, 0], velocity[row + 1, j, 1], tx, ty, speed, crab
                    )
                    total += length * (here + there) / 2
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
