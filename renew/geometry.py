"""Plane primitives, compiled: segments against capsules (all points close to a segment).

The same code runs without the compiler under NUMBA_DISABLE_JIT=1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from renew._types import BoolArray, FloatArray, IntArray

# A slope below this is level: dividing by it would overflow.
_LEVEL = 1e-300


@njit(cache=True, error_model="numpy")
def capsule_interval(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    px: float,
    py: float,
    qx: float,
    qy: float,
    radius: float,
) -> tuple[float, float]:
    """Interval (enter, leave) of s in [0, 1] where a + s (b - a) lies within radius of pq.

    Empty if enter > leave. A capsule is convex, so there is one interval: the hull of those of
    its two discs and of the rectangle between them.
    """
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    enter, leave = math.inf, -math.inf
    for cx, cy in ((px, py), (qx, qy)):
        fx, fy = ax - cx, ay - cy
        rest = fx * fx + fy * fy - radius * radius
        if square == 0.0:
            if rest <= 0.0:
                return 0.0, 1.0
            continue
        along = fx * dx + fy * dy
        root = along * along - square * rest
        if root >= 0.0:
            half = math.sqrt(root)
            enter = min(enter, (-along - half) / square)
            leave = max(leave, (-along + half) / square)
    ux, uy = qx - px, qy - py
    length = math.sqrt(ux * ux + uy * uy)
    if length > 0.0:
        ux, uy = ux / length, uy / length
        fx, fy = ax - px, ay - py
        low, high = _between(fx * ux + fy * uy, dx * ux + dy * uy, 0.0, length)
        low_2, high_2 = _between(fy * ux - fx * uy, dy * ux - dx * uy, -radius, radius)
        low, high = max(low, low_2), min(high, high_2)
        if low <= high:
            enter, leave = min(enter, low), max(leave, high)
    return max(enter, 0.0), min(leave, 1.0)


@njit(cache=True, error_model="numpy")
def _between(value: float, slope: float, low: float, high: float) -> tuple[float, float]:
    """Interval of s where low <= value + s slope <= high; (inf, -inf) where nowhere."""
    if abs(slope) < _LEVEL:
        if low <= value <= high:
            return -math.inf, math.inf
        return math.inf, -math.inf
    first, second = (low - value) / slope, (high - value) / slope
    return min(first, second), max(first, second)


@njit(cache=True, error_model="numpy")
def leg_is_clear(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    chosen: IntArray,
    left_out: BoolArray,
) -> bool:
    """Whether the leg a -> b stays out of the chosen capsules, those left out aside.

    A radius of 0 is no capsule; one below 0 is a bare edge, which the leg may not even touch.
    """
    west, east = min(ax, bx), max(ax, bx)
    south, north = min(ay, by), max(ay, by)
    for h in chosen:
        if radius[h] == 0.0 or left_out[h]:
            continue
        reach = max(radius[h], 0.0)
        if (
            max(start[h, 0], end[h, 0]) + reach < west
            or min(start[h, 0], end[h, 0]) - reach > east
            or max(start[h, 1], end[h, 1]) + reach < south
            or min(start[h, 1], end[h, 1]) - reach > north
        ):
            continue
        enter, leave = capsule_interval(
            ax,
            ay,
            bx,
            by,
            start[h, 0],
            start[h, 1],
            end[h, 0],
            end[h, 1],
            reach,
        )
        if enter < leave or (radius[h] < 0.0 and enter == leave):
            return False
    return True


@njit(cache=True, error_model="numpy")
def legs_are_clear(
    a: FloatArray, b: FloatArray, start: FloatArray, end: FloatArray, radius: FloatArray
) -> BoolArray:
    """Whether each leg a -> b (n, 2) stays out of all capsules: (n,)."""
    every = np.arange(len(radius))
    none_left_out = np.zeros(len(radius), dtype=np.bool_)
    clear = np.empty(len(a), dtype=np.bool_)
    for i in range(len(a)):
        clear[i] = leg_is_clear(
            a[i, 0], a[i, 1], b[i, 0], b[i, 1], start, end, radius, every, none_left_out
        )
    return clear


@njit(cache=True, error_model="numpy")
def tracks_touch(
    tracks: FloatArray, start: FloatArray, end: FloatArray, radius: float
) -> BoolArray:
    """Whether each track (n, steps, 2) comes within radius of each segment (e, 2): (n, e)."""
    touched = np.zeros((len(tracks), len(start)), dtype=np.bool_)
    for i in range(len(tracks)):
        xs, ys = tracks[i, :, 0], tracks[i, :, 1]
        west, east = xs.min() - radius, xs.max() + radius
        south, north = ys.min() - radius, ys.max() + radius
        for h in range(len(start)):
            if (
                max(start[h, 0], end[h, 0]) < west
                or min(start[h, 0], end[h, 0]) > east
                or max(start[h, 1], end[h, 1]) < south
                or min(start[h, 1], end[h, 1]) > north
            ):
                continue
            for k in range(len(xs) - 1):
                enter, leave = capsule_interval(
                    xs[k],
                    ys[k],
                    xs[k + 1],
                    ys[k + 1],
                    start[h, 0],
                    start[h, 1],
                    end[h, 0],
                    end[h, 1],
                    radius,
                )
                if enter <= leave:
                    touched[i, h] = True
                    break
    return touched


def segment_distance(points: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Distance (...) from points (..., 2) to segments pq (..., 2)."""
    axis = q - p
    square = (axis * axis).sum(-1)
    place = ((points - p) * axis).sum(-1) / np.where(square > 0, square, 1.0)
    nearest = p + np.clip(place, 0.0, 1.0)[..., None] * axis
    return np.asarray(np.linalg.norm(points - nearest, axis=-1))
