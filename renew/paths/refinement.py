"""A path bettered across rungs: points to either side of it, in a window that narrows, compiled.

Rungs stand across the path from V to V, so that the path can bend between them, and bulge out of
its channel over open water.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renew._types import BoolArray, FloatArray
from renew.inputs.current_table import Table, velocities
from renew.kernels.viterbi import quickest_chain, without_detours
from renew.paths.sections import free_intervals


@njit(cache=True, error_model="numpy")
def with_rungs(
    path: FloatArray, spacing: float, bend: float, closest: float, whole: BoolArray
) -> FloatArray:
    """Path with points added (n', 2), at most `spacing` m apart, and one on each leg at a bend.

    A bend turns by more than `bend` rad; legs beside it that are longer than twice `closest` m
    are halved. The first and the last leg are left as they are where `whole` (2,) says so.
    """
    kept, legs = _without_repeats(path)
    course, length = np.empty(legs), np.empty(legs)
    pieces = np.empty(legs, dtype=np.int64)
    for k in range(legs):
        dx, dy = kept[k + 1, 0] - kept[k, 0], kept[k + 1, 1] - kept[k, 1]
        course[k], length[k] = math.atan2(dy, dx), math.hypot(dx, dy)
        pieces[k] = max(1, math.ceil(length[k] / spacing))
    for k in range(1, legs):
        turn = (course[k] - course[k - 1] + math.pi) % (2 * math.pi) - math.pi
        if abs(turn) > bend:
            for leg in (k - 1, k):
                if pieces[leg] == 1 and length[leg] > 2 * closest:
                    pieces[leg] = 2
    if legs and whole[0]:
        pieces[0] = 1
    if legs and whole[1]:
        pieces[-1] = 1
    result = np.empty((pieces.sum() + 1, 2))
    at = 0
    for k in range(legs):
        for piece in range(pieces[k]):
            result[at] = kept[k] + piece / pieces[k] * (kept[k + 1] - kept[k])
            at += 1
    result[at] = kept[legs]
    return result


@njit(cache=True, error_model="numpy")
def _without_repeats(path: FloatArray) -> tuple[FloatArray, int]:
    """Path (n', 2) without points that repeat the one before, and how many legs it has."""
    kept = np.empty(path.shape)
    kept[0] = path[0]
    legs = 0
    for k in range(1, len(path)):
        if path[k, 0] != kept[legs, 0] or path[k, 1] != kept[legs, 1]:
            legs += 1
            kept[legs] = path[k]
    return kept[: legs + 1], legs


@njit(cache=True, error_model="numpy")
def across_rungs(
    path: FloatArray,
    window: float,
    count: int,
    longest: float,
    table: Table,
    speed: float,
    crab: bool,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    left_out: BoolArray,
) -> FloatArray:
    """Quickest path (n', 2) over `count` points on rungs across a path, `window` m to either side.

    Capsules and `left_out` are those of :func:`renew.kernels.viterbi.quickest_chain`. Detours that
    a shortcut of up to `longest` m spares are cut; the path is returned as it is where no chain of
    points is clear.
    """
    rows = len(path)
    if rows < 3:
        return path
    left, right = np.empty((rows - 2, 2)), np.empty((rows - 2, 2))
    for k in range(rows - 2):
        dx, dy = path[k + 2, 0] - path[k, 0], path[k + 2, 1] - path[k, 1]
        scale = window / max(math.hypot(dx, dy), 1e-300)
        left[k] = path[k + 1, 0] - dy * scale, path[k + 1, 1] + dx * scale
        right[k] = path[k + 1, 0] + dy * scale, path[k + 1, 1] - dx * scale
    intervals, found = free_intervals(left, right, start, end, radius)
    points = np.empty((rows, count, 2))
    points[0], points[-1] = path[0], path[-1]
    for k in range(rows - 2):
        low, high = _around_middle(intervals[k, : found[k]])
        for j in range(count - 1):
            place = low + (high - low) * j / (count - 2)
            points[k + 1, j] = left[k] + place * (right[k] - left[k])
        # The path's own point stays among them, so that no pass is worse than the one before.
        points[k + 1, count - 1] = path[k + 1]
    velocity = velocities(table, points.reshape(-1, 2)).reshape(points.shape)
    arrival, chain = quickest_chain(points, velocity, speed, crab, start, end, radius, left_out)
    if arrival == np.inf:
        return path
    chosen = np.empty((rows, 2))
    for k in range(rows):
        chosen[k] = points[k, chain[k]]
    # Rungs that cross beside a bend may be visited back and forth.
    return cut_short(chosen, longest, table, speed, crab, start, end, radius)


@njit(cache=True, error_model="numpy")
def cut_short(
    path: FloatArray,
    longest: float,
    table: Table,
    speed: float,
    crab: bool,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
) -> FloatArray:
    """Path (n', 2) less the points that a shortcut of up to `longest` m passes no slower."""
    current = velocities(table, path)
    return path[without_detours(path, current, speed, crab, start, end, radius, longest)]


@njit(cache=True, error_model="numpy")
def _around_middle(intervals: FloatArray) -> tuple[float, float]:
    """Ends of the interval (n, 2) that holds, or is nearest to, 0.5; both 0.5 if there is none."""
    low, high, nearest = 0.5, 0.5, np.inf
    for k in range(len(intervals)):
        away = max(intervals[k, 0] - 0.5, 0.5 - intervals[k, 1])
        if away < nearest:
            low, high, nearest = intervals[k, 0], intervals[k, 1], away
    return low, high
