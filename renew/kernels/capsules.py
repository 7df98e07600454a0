"""Plane primitives: segments against capsules (all points closer to a segment than a radius).

The same code runs without the compiler under NUMBA_DISABLE_JIT=1.
"""

import math
from typing import NamedTuple, TypeVar

import numpy as np
from numba.extending import register_jitable

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray

# Smallest slope (no unit) used as a divisor; a line with a smaller one counts as level.
_MIN_SLOPE = 1e-300
# Factor on a squared distance beyond which rounding can't matter.
_FOR_CERTAIN = 1 + 1e-9
# Number of consecutive legs or points that are compared with capsules by one common bounding box.
_BLOCK = 32


class Segment(NamedTuple):
    """A straight segment from a to b, m."""

    ax: float
    ay: float
    bx: float
    by: float


class Capsules(NamedTuple):
    """Capsules around segments `start` to `end` (c, 2), m, with radii (c,), m.

    A radius of 0 means no capsule; a negative radius means a bare edge, which a leg must not touch.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray

    def select(self, keep: BoolArray | IntArray) -> "Capsules":
        """Return some of the capsules."""
        return Capsules(self.start[keep], self.end[keep], self.radius[keep])


@kernel
def capsule_interval(leg: Segment, axis: Segment, radius: float) -> tuple[float, float]:
    """Return the interval (enter, leave) of s in [0, 1] where a + s (b - a) is in the capsule.

    It is empty if enter > leave. A capsule is convex, so there is one interval: the hull of the
    intervals in its two discs and in the rectangle between them.
    """
    ax, ay, bx, by = leg
    px, py, qx, qy = axis
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


@small_kernel
def _between(value: float, slope: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of s where low <= value + s slope <= high; (inf, -inf) if empty."""
    if abs(slope) < _MIN_SLOPE:
        if low <= value <= high:
            return -math.inf, math.inf
        return math.inf, -math.inf
    first, second = (low - value) / slope, (high - value) / slope
    return min(first, second), max(first, second)


@kernel
def extremes(values: FloatArray) -> tuple[float, float]:
    """Return the least and the largest of one or more numbers.

    Numba takes several times as long to compile NumPy's functions for this.
    """
    least = most = values[0]
    for value in values:
        least = min(least, value)
        most = max(most, value)
    return least, most


@kernel
def capsule_bounds(capsules: Capsules) -> FloatArray:
    """Return the bounding boxes (c, 4) of capsules: west, south, east, north."""
    start, end, radius = capsules
    bounds = np.empty((len(start), 4))
    for h in range(len(start)):
        reach = max(radius[h], 0.0)
        bounds[h, 0] = min(start[h, 0], end[h, 0]) - reach
        bounds[h, 1] = min(start[h, 1], end[h, 1]) - reach
        bounds[h, 2] = max(start[h, 0], end[h, 0]) + reach
        bounds[h, 3] = max(start[h, 1], end[h, 1]) + reach
    return bounds


@small_kernel
def intersects(
    bounds: FloatArray, h: int, west: float, south: float, east: float, north: float
) -> bool:
    """Whether the h-th of some bounding boxes (c, 4) intersects another box."""
    return bool(
        bounds[h, 0] <= east
        and bounds[h, 2] >= west
        and bounds[h, 1] <= north
        and bounds[h, 3] >= south
    )


@kernel
def _intersecting(bounds: FloatArray, boxes: FloatArray, chosen: IntArray) -> int:
    """Fill `chosen` with the bounds that intersect the hull of boxes; return their number."""
    west, south = extremes(boxes[:, 0])[0], extremes(boxes[:, 1])[0]
    east, north = extremes(boxes[:, 2])[1], extremes(boxes[:, 3])[1]
    count = 0
    for h in range(len(bounds)):
        if intersects(bounds, h, west, south, east, north):
            chosen[count] = h
            count += 1
    return count


@kernel
def boxes_met(bounds: FloatArray, boxes: FloatArray) -> tuple[IntArray, IntArray]:
    """Return which bounds (c, 4) each of consecutive boxes (n, 4), near each other, meets.

    Those of box i are met[first[i] : first[i + 1]], in order.
    """
    first = np.zeros(len(boxes) + 1, dtype=np.int64)
    met = [np.int64(0)]
    met.clear()
    chosen = np.empty(len(bounds), dtype=np.int64)
    for block in range(0, len(boxes), _BLOCK):
        some = chosen[: _intersecting(bounds, boxes[block : block + _BLOCK], chosen)]
        for i in range(block, min(block + _BLOCK, len(boxes))):
            west, south, east, north = boxes[i]
            met += [h for h in some if intersects(bounds, h, west, south, east, north)]
            first[i + 1] = len(met)
    return first, np.array(met, dtype=np.int64)


@kernel
def capsules_near(capsules: Capsules, path: FloatArray, distance: float) -> IntArray:
    """Return the indices of capsules that may be within a distance (m) of a path (n, 2).

    Their bounding boxes are within that distance of the box of at least one leg.
    """
    bounds = capsule_bounds(capsules)
    close = np.zeros(len(bounds), dtype=np.bool_)
    chosen = np.empty(len(bounds), dtype=np.int64)
    boxes = capsule_bounds(Capsules(path[:-1], path[1:], np.full(len(path) - 1, distance)))
    for first in range(0, len(boxes), _BLOCK):
        block = boxes[first : first + _BLOCK]
        for h in chosen[: _intersecting(bounds, block, chosen)]:
            for k in range(len(block)):
                if close[h]:
                    break
                close[h] = intersects(bounds, h, block[k, 0], block[k, 1], block[k, 2], block[k, 3])
    return np.flatnonzero(close)


@reading_kernel
def leg_is_clear(leg: Segment, capsules: Capsules, chosen: IntArray, exempt: BoolArray) -> bool:
    """Whether a leg stays out of the chosen capsules, except the exempt ones (c,)."""
    ax, ay, bx, by = leg
    start, end, radius = capsules
    west, east = min(ax, bx), max(ax, bx)
    south, north = min(ay, by), max(ay, by)
    for h in chosen:
        if radius[h] == 0.0 or exempt[h]:
            continue
        reach = max(radius[h], 0.0)
        if (
            max(start[h, 0], end[h, 0]) + reach < west
            or min(start[h, 0], end[h, 0]) - reach > east
            or max(start[h, 1], end[h, 1]) + reach < south
            or min(start[h, 1], end[h, 1]) - reach > north
        ):
            continue
        axis = Segment(start[h, 0], start[h, 1], end[h, 0], end[h, 1])
        if _lies_beside(axis, leg, reach) or _lies_beside(leg, axis, reach):
            continue
        enter, leave = capsule_interval(leg, axis, reach)
        if enter < leave or (radius[h] < 0.0 and enter == leave):
            return False
    return True


@small_kernel
def _lies_beside(segment: Segment, line: Segment, distance: float) -> bool:
    """Whether a segment surely lies on one side of another's line, further off than a distance."""
    dx, dy = line.bx - line.ax, line.by - line.ay
    one = dx * (segment.ay - line.ay) - dy * (segment.ax - line.ax)
    other = dx * (segment.by - line.ay) - dy * (segment.bx - line.ax)
    nearer = min(abs(one), abs(other))
    far = _FOR_CERTAIN * distance * distance * (dx * dx + dy * dy)
    return one * other > 0.0 and nearer * nearer > far


@kernel
def legs_are_clear(a: FloatArray, b: FloatArray, capsules: Capsules) -> BoolArray:
    """Return whether each leg a -> b (n, 2) stays out of all capsules."""
    none_exempt = np.zeros(len(capsules.radius), dtype=np.bool_)
    chosen = np.empty(len(capsules.radius), dtype=np.int64)
    bounds = capsule_bounds(capsules)
    boxes = capsule_bounds(Capsules(a, b, np.zeros(len(a))))
    clear = np.empty(len(a), dtype=np.bool_)
    for first in range(0, len(a), _BLOCK):
        count = _intersecting(bounds, boxes[first : first + _BLOCK], chosen)
        for i in range(first, min(first + _BLOCK, len(a))):
            leg = Segment(a[i, 0], a[i, 1], b[i, 0], b[i, 1])
            clear[i] = leg_is_clear(leg, capsules, chosen[:count], none_exempt)
    return clear


@kernel
def segments_near(
    points: FloatArray, reach: FloatArray, start: FloatArray, end: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return the segments (e, 2) within reach (n,) of each of consecutive points (n, 2).

    The segments of point i are near[first[i] : first[i + 1]].
    """
    bounds = capsule_bounds(Capsules(start, end, np.zeros(len(start))))
    begin, met = boxes_met(bounds, capsule_bounds(Capsules(points, points, reach)))
    first, near = np.zeros(len(points) + 1, dtype=np.int64), np.empty(len(met), dtype=np.int64)
    count = 0
    for i in range(len(points)):
        for h in met[begin[i] : begin[i + 1]]:
            if _is_within(points[i], start[h], end[h], reach[i]):
                near[count] = h
                count += 1
        first[i + 1] = count
    return first, near[:count]


@kernel
def distances_within(
    points: FloatArray, reach: float, start: FloatArray, end: FloatArray
) -> FloatArray:
    """Return the distances (n,), m, of consecutive points from segments; inf beyond reach."""
    least = np.full(len(points), np.inf)
    bounds = capsule_bounds(Capsules(start, end, np.zeros(len(start))))
    boxes = capsule_bounds(Capsules(points, points, np.full(len(points), reach)))
    chosen = np.empty(len(start), dtype=np.int64)
    for first in range(0, len(points), _BLOCK):
        near = chosen[: _intersecting(bounds, boxes[first : first + _BLOCK], chosen)]
        for i in range(first, min(first + _BLOCK, len(points))):
            for h in near:
                edge = Segment(start[h, 0], start[h, 1], end[h, 0], end[h, 1])
                least[i] = min(least[i], square_off(points[i, 0], points[i, 1], edge))
            least[i] = math.sqrt(least[i]) if least[i] <= reach * reach else np.inf
    return least


@reading_kernel
def _is_within(point: FloatArray, p: FloatArray, q: FloatArray, reach: float) -> bool:
    """Whether a point lies within reach of the segment pq."""
    x, y = point
    ux, uy = q[0] - p[0], q[1] - p[1]
    square = ux * ux + uy * uy
    place = ((x - p[0]) * ux + (y - p[1]) * uy) / square if square > 0.0 else 0.0
    place = min(max(place, 0.0), 1.0)
    dx, dy = x - p[0] - place * ux, y - p[1] - place * uy
    return bool(dx * dx + dy * dy <= reach * reach)


@kernel
def tracks_touch(
    tracks: FloatArray,
    first: IntArray,
    near: IntArray,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Return which tracks (n, turns, steps, 2) come within a radius (n,) of which segments (e, 2).

    The tracks of point i are compared with the segments near[first[i] : first[i + 1]]; see
    :func:`segments_near`. Returns pairs: a track's number among all n x turns, and a segment.
    """
    touching, touched = [np.int64(0)], [np.int64(0)]
    touching.clear()
    touched.clear()
    turns = tracks.shape[1]
    bounds = capsule_bounds(Capsules(start, end, np.zeros(len(start))))
    for i in range(len(tracks)):
        for turn in range(turns):
            xs, ys = tracks[i, turn, :, 0], tracks[i, turn, :, 1]
            (west, east), (south, north) = extremes(xs), extremes(ys)
            west, east = west - radius[i], east + radius[i]
            south, north = south - radius[i], north + radius[i]
            for h in near[first[i] : first[i + 1]]:
                axis = Segment(start[h, 0], start[h, 1], end[h, 0], end[h, 1])
                if intersects(bounds, h, west, south, east, north) and _touches(
                    xs, ys, axis, radius[i]
                ):
                    touching.append(np.int64(i * turns + turn))
                    touched.append(h)
    return np.array(touching, dtype=np.int64), np.array(touched, dtype=np.int64)


@reading_kernel
def _touches(xs: FloatArray, ys: FloatArray, axis: Segment, radius: float) -> bool:
    """Whether a track (steps,) comes within a radius of a segment."""
    for k in range(len(xs) - 1):
        leg = Segment(xs[k], ys[k], xs[k + 1], ys[k + 1])
        enter, leave = capsule_interval(leg, axis, radius)
        if enter <= leave:
            return True
    return False


@kernel
def track_distances(
    tracks: FloatArray,
    first: IntArray,
    near: IntArray,
    start: FloatArray,
    end: FloatArray,
    most: float,
) -> FloatArray:
    """Return the least distance (p,), m, of tracks (n, turns, steps, 2) from segments (e, 2).

    The tracks of point i are compared with the segments near[first[i] : first[i + 1]]; see
    :func:`segments_near`. It is -1 for a segment that a track crosses, and `most` for one that no
    track comes as near.
    """
    least = np.full(len(near), most * most)
    for i in range(len(tracks)):
        for turn in range(tracks.shape[1]):
            xs, ys = tracks[i, turn, :, 0], tracks[i, turn, :, 1]
            (west, east), (south, north) = extremes(xs), extremes(ys)
            for p in range(first[i], first[i + 1]):
                h = near[p]
                ax, bx = min(start[h, 0], end[h, 0]), max(start[h, 0], end[h, 0])
                ay, by = min(start[h, 1], end[h, 1]), max(start[h, 1], end[h, 1])
                dx, dy = max(ax - east, west - bx, 0.0), max(ay - north, south - by, 0.0)
                if dx * dx + dy * dy > least[p]:
                    continue
                axis = Segment(start[h, 0], start[h, 1], end[h, 0], end[h, 1])
                for k in range(len(xs) - 1):
                    leg = Segment(xs[k], ys[k], xs[k + 1], ys[k + 1])
                    least[p] = min(least[p], _square_apart(leg, axis))
    # The square of a crossing is -1. These compile in a tenth of the time of np.where.
    apart: FloatArray = np.sign(least) * np.sqrt(np.abs(least))
    return apart


@small_kernel
def _square_apart(one: Segment, other: Segment) -> float:
    """Return the squared distance of two segments, m²; -1 if they cross."""
    ux, uy, vx, vy = one.bx - one.ax, one.by - one.ay, other.bx - other.ax, other.by - other.ay
    before = ux * (other.ay - one.ay) - uy * (other.ax - one.ax)
    after = ux * (other.by - one.ay) - uy * (other.bx - one.ax)
    behind = vx * (one.ay - other.ay) - vy * (one.ax - other.ax)
    beyond = vx * (one.by - other.ay) - vy * (one.bx - other.ax)
    if before * after < 0.0 and behind * beyond < 0.0:
        return -1.0
    return min(
        square_off(one.ax, one.ay, other),
        square_off(one.bx, one.by, other),
        square_off(other.ax, other.ay, one),
        square_off(other.bx, other.by, one),
    )


@small_kernel
def square_off(x: float, y: float, segment: Segment) -> float:
    """Return the squared distance of a point from a segment, m²."""
    ux, uy = segment.bx - segment.ax, segment.by - segment.ay
    square = ux * ux + uy * uy
    place = ((x - segment.ax) * ux + (y - segment.ay) * uy) / square if square > 0.0 else 0.0
    place = min(max(place, 0.0), 1.0)
    dx, dy = x - segment.ax - place * ux, y - segment.ay - place * uy
    return dx * dx + dy * dy


def segment_distance(points: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Return the distances (...) from points (..., 2) to segments pq (..., 2)."""
    return np.asarray(np.linalg.norm(points - nearest_on_segments(points, p, q), axis=-1))


def nearest_on_segments(points: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Return the points (..., 2) of segments pq (..., 2) nearest to points (..., 2)."""
    axis = q - p
    square = (axis * axis).sum(-1)
    place = ((points - p) * axis).sum(-1) / np.where(square > 0, square, 1.0)
    return np.asarray(p + np.clip(place, 0.0, 1.0)[..., None] * axis)


AngleT = TypeVar("AngleT", float, np.float64, FloatArray)


@register_jitable
def wrapped(angle: AngleT) -> AngleT:
    """Return angles (rad), a number or an array, folded into [-π, π); for NumPy and kernels."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
