"""Plane primitives, compiled: segments against capsules (all points close to a segment).

The same code runs without the compiler under NUMBA_DISABLE_JIT=1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renew._types import BoolArray, FloatArray, IntArray

# A slope below this is level: dividing by it would overflow.
_LEVEL = 1e-300
# Points that follow each other are compared with segments so many at a time.
_BLOCK = 32


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
def capsule_bounds(start: FloatArray, end: FloatArray, radius: FloatArray) -> FloatArray:
    """Bounds (e, 4) of capsules: west, south, east, north; a radius below 0 is a bare edge."""
    bounds = np.empty((len(start), 4))
    for h in range(len(start)):
        reach = max(radius[h], 0.0)
        bounds[h, 0] = min(start[h, 0], end[h, 0]) - reach
        bounds[h, 1] = min(start[h, 1], end[h, 1]) - reach
        bounds[h, 2] = max(start[h, 0], end[h, 0]) + reach
        bounds[h, 3] = max(start[h, 1], end[h, 1]) + reach
    return bounds


@njit(cache=True, error_model="numpy")
def meets(bounds: FloatArray, h: int, west: float, south: float, east: float, north: float) -> bool:
    """Whether the h-th of some bounds meet others."""
    return bool(
        bounds[h, 0] <= east
        and bounds[h, 2] >= west
        and bounds[h, 1] <= north
        and bounds[h, 3] >= south
    )


@njit(cache=True, error_model="numpy")
def _meeting(bounds: FloatArray, boxes: FloatArray, chosen: IntArray) -> int:
    """Find which bounds (e, 4) meet that around all of some boxes (n, 4): the first of `chosen`."""
    west, south = boxes[:, 0].min(), boxes[:, 1].min()
    east, north = boxes[:, 2].max(), boxes[:, 3].max()
    count = 0
    for h in range(len(bounds)):
        if meets(bounds, h, west, south, east, north):
            chosen[count] = h
            count += 1
    return count


@njit(cache=True, error_model="numpy")
def boxes_near(path: FloatArray, distance: float, bounds: FloatArray) -> IntArray:
    """Which bounds (e, 4) meet those of a leg of a path (n, 2), widened by a distance: (k,)."""
    close = np.zeros(len(bounds), dtype=np.bool_)
    chosen = np.empty(len(bounds), dtype=np.int64)
    boxes = capsule_bounds(path[:-1], path[1:], np.full(len(path) - 1, distance))
    for first in range(0, len(boxes), _BLOCK):
        block = boxes[first : first + _BLOCK]
        for h in chosen[: _meeting(bounds, block, chosen)]:
            for k in range(len(block)):
                if close[h]:
                    break
                close[h] = meets(bounds, h, block[k, 0], block[k, 1], block[k, 2], block[k, 3])
    return np.flatnonzero(close)


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
    none_left_out = np.zeros(len(radius), dtype=np.bool_)
    chosen = np.empty(len(radius), dtype=np.int64)
    bounds, boxes = capsule_bounds(start, end, radius), capsule_bounds(a, b, np.zeros(len(a)))
    clear = np.empty(len(a), dtype=np.bool_)
    for first in range(0, len(a), _BLOCK):
        count = _meeting(bounds, boxes[first : first + _BLOCK], chosen)
        for i in range(first, min(first + _BLOCK, len(a))):
            clear[i] = leg_is_clear(
                a[i, 0],
                a[i, 1],
                b[i, 0],
                b[i, 1],
                start,
                end,
                radius,
                chosen[:count],
                none_left_out,
            )
    return clear


@njit(cache=True, error_model="numpy")
def near_segments(
    points: FloatArray, reach: FloatArray, start: FloatArray, end: FloatArray
) -> tuple[IntArray, IntArray]:
    """Segments (e, 2) within reach (n,) of each of points (n, 2) that follow each other.

    Point i's are near[first[i] : first[i + 1]].
    """
    first = np.zeros(len(points) + 1, dtype=np.int64)
    near = [np.int64(0)]
    near.clear()
    chosen = np.empty(len(start), dtype=np.int64)
    bounds = capsule_bounds(start, end, np.zeros(len(start)))
    for block in range(0, len(points), _BLOCK):
        last = min(block + _BLOCK, len(points))
        xs, ys, furthest = points[block:last, 0], points[block:last, 1], reach[block:last].max()
        west, east = xs.min() - furthest, xs.max() + furthest
        south, north = ys.min() - furthest, ys.max() + furthest
        count = 0
        for h in range(len(start)):
            if meets(bounds, h, west, south, east, north):
                chosen[count] = h
                count += 1
        for i in range(block, last):
            near += [h for h in chosen[:count] if _is_within(points[i], start[h], end[h], reach[i])]
            first[i + 1] = len(near)
    return first, np.array(near, dtype=np.int64)


@njit(cache=True, error_model="numpy")
def _is_within(point: FloatArray, p: FloatArray, q: FloatArray, reach: float) -> bool:
    """Whether a point lies within reach of the segment pq."""
    x, y = point
    ux, uy = q[0] - p[0], q[1] - p[1]
    square = ux * ux + uy * uy
    place = ((x - p[0]) * ux + (y - p[1]) * uy) / square if square > 0.0 else 0.0
    place = min(max(place, 0.0), 1.0)
    dx, dy = x - p[0] - place * ux, y - p[1] - place * uy
    return bool(dx * dx + dy * dy <= reach * reach)


@njit(cache=True, error_model="numpy")
def tracks_touch(
    tracks: FloatArray,
    first: IntArray,
    near: IntArray,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Which tracks (n, turns, steps, 2) come within a radius (n,) of which segments (e, 2).

    Those near point i are as :func:`near_segments` gives them. Returns pairs: the number of a track
    among all n x turns, and the segment.
    """
    touching, touched = [np.int64(0)], [np.int64(0)]
    touching.clear()
    touched.clear()
    turns = tracks.shape[1]
    bounds = capsule_bounds(start, end, np.zeros(len(start)))
    for i in range(len(tracks)):
        for turn in range(turns):
            xs, ys = tracks[i, turn, :, 0], tracks[i, turn, :, 1]
            west, east = xs.min() - radius[i], xs.max() + radius[i]
            south, north = ys.min() - radius[i], ys.max() + radius[i]
            for h in near[first[i] : first[i + 1]]:
                if meets(bounds, h, west, south, east, north) and _touches(
                    xs, ys, start[h], end[h], radius[i]
                ):
                    touching.append(np.int64(i * turns + turn))
                    touched.append(h)
    return np.array(touching, dtype=np.int64), np.array(touched, dtype=np.int64)


@njit(cache=True, error_model="numpy")
def _touches(xs: FloatArray, ys: FloatArray, p: FloatArray, q: FloatArray, radius: float) -> bool:
    """Whether a track (steps,) comes within radius of the segment pq."""
    for k in range(len(xs) - 1):
        enter, leave = capsule_interval(
            xs[k], ys[k], xs[k + 1], ys[k + 1], p[0], p[1], q[0], q[1], radius
        )
        if enter <= leave:
            return True
    return False


def segment_distance(points: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Distance (...) from points (..., 2) to segments pq (..., 2)."""
    axis = q - p
    square = (axis * axis).sum(-1)
    place = ((points - p) * axis).sum(-1) / np.where(square > 0, square, 1.0)
    nearest = p + np.clip(place, 0.0, 1.0)[..., None] * axis
    return np.asarray(np.linalg.norm(points - nearest, axis=-1))
