"""Refine a path on transversals: points on both sides of the path, in a narrowing window.

Transversals are perpendicular to the path, from V to V. So the path can bend between them, and
bulge out of its channel over open water.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import Capsules, wrapped
from renew.kernels.viterbi import Stream, quickest_chain, shortcut
from renew.paths.sections import free_intervals


class Water(NamedTuple):
    """The water of a path's refinement: a current, and capsules to avoid."""

    stream: Stream
    capsules: Capsules

    def near(self, chosen: IntArray) -> "Water":
        """Return this water with only some of the capsules."""
        return Water(self.stream, self.capsules.select(chosen))


@kernel
def with_transversals(
    path: FloatArray, spacing: float, bend: float, closest: float, keep_whole: BoolArray
) -> FloatArray:
    """Return a path (n', 2) with points added, one per transversal, at most `spacing` m apart.

    A bend turns by more than `bend` rad; legs beside it that are longer than twice `closest` m
    are halved. `keep_whole` (2,) says whether the first, and the last, leg stays unchanged.
    """
    kept, legs = _without_repeats(path)
    course, length = np.empty(legs), np.empty(legs)
    pieces = np.empty(legs, dtype=np.int64)
    for k in range(legs):
        dx, dy = kept[k + 1, 0] - kept[k, 0], kept[k + 1, 1] - kept[k, 1]
        course[k], length[k] = math.atan2(dy, dx), math.hypot(dx, dy)
        pieces[k] = max(1, math.ceil(length[k] / spacing))
    for k in range(1, legs):
        if abs(wrapped(course[k] - course[k - 1])) > bend:
            for leg in (k - 1, k):
                if pieces[leg] == 1 and length[leg] > 2 * closest:
                    pieces[leg] = 2
    if legs and keep_whole[0]:
        pieces[0] = 1
    if legs and keep_whole[1]:
        pieces[-1] = 1
    result = np.empty((pieces.sum() + 1, 2))
    at = 0
    for k in range(legs):
        for piece in range(pieces[k]):
            share = piece / pieces[k]
            result[at, 0] = kept[k, 0] + share * (kept[k + 1, 0] - kept[k, 0])
            result[at, 1] = kept[k, 1] + share * (kept[k + 1, 1] - kept[k, 1])
            at += 1
    result[at, 0], result[at, 1] = kept[legs]
    return result


@kernel
def _without_repeats(path: FloatArray) -> tuple[FloatArray, int]:
    """Return a path (n', 2) without repeated points, and the number of its legs."""
    kept = np.empty(path.shape)
    kept[0, 0], kept[0, 1] = path[0]
    legs = 0
    for k in range(1, len(path)):
        if path[k, 0] != kept[legs, 0] or path[k, 1] != kept[legs, 1]:
            legs += 1
            kept[legs, 0], kept[legs, 1] = path[k]
    return kept[: legs + 1], legs


@kernel
def points_beside(path: FloatArray, window: float, count: int, capsules: Capsules) -> FloatArray:
    """Return points (n, count, 2) on the transversals of a path (n, 2), n >= 3; its ends repeat.

    They lie up to `window` m to either side, outside capsules; the last one of each row is the
    path's own point.
    """
    rows = len(path)
    left, right = np.empty((rows - 2, 2)), np.empty((rows - 2, 2))
    for k in range(rows - 2):
        dx, dy = path[k + 2, 0] - path[k, 0], path[k + 2, 1] - path[k, 1]
        scale = window / max(math.hypot(dx, dy), 1e-300)
        x, y = path[k + 1, 0], path[k + 1, 1]
        left[k, 0], left[k, 1] = x - dy * scale, y + dx * scale
        right[k, 0], right[k, 1] = x + dy * scale, y - dx * scale
    intervals, found = free_intervals(left, right, capsules)
    points = np.empty((rows, count, 2))
    for j in range(count):
        points[0, j, 0], points[0, j, 1] = path[0]
        points[-1, j, 0], points[-1, j, 1] = path[-1]
    for k in range(rows - 2):
        low, high = _around_middle(intervals[k, : found[k]])
        for j in range(count - 1):
            place = low + (high - low) * j / (count - 2)
            for d in range(2):
                points[k + 1, j, d] = left[k, d] + place * (right[k, d] - left[k, d])
        # With the path's own point no pass makes the path worse.
        points[k + 1, count - 1, 0], points[k + 1, count - 1, 1] = path[k + 1]
    return points


@kernel
def refined_on_transversals(
    path: FloatArray,
    window: float,
    count: int,
    longest: float,
    water: Water,
    exempt: BoolArray,
) -> FloatArray:
    """Return the fastest path (n', 2) over `count` points per transversal, within `window` m.

    `exempt` is as in :func:`renew.kernels.viterbi.quickest_chain`. Detours that a shortcut of up to
    `longest` m avoids are removed. If no chain of points is clear, the path is returned unchanged.
    """
    rows = len(path)
    if rows < 3:
        return path
    points = points_beside(path, window, count, water.capsules)
    arrival, chain = quickest_chain(points, water.stream, water.capsules, exempt)
    if arrival == np.inf:
        return path
    chosen = np.empty((rows, 2))
    for k in range(rows):
        chosen[k, 0], chosen[k, 1] = points[k, chain[k]]
    # Transversals that cross beside a bend may make the path go back and forth.
    return without_detours(chosen, longest, water)


@kernel
def without_detours(path: FloatArray, longest: float, water: Water) -> FloatArray:
    """Remove the points of a path that a shortcut of up to `longest` m passes no slower."""
    return path[shortcut(path, water.stream, water.capsules, longest)]


@kernel
def _around_middle(intervals: FloatArray) -> tuple[float, float]:
    """Return the interval's ends that contain or are nearest to 0.5; both 0.5 if there is none."""
    low, high, nearest = 0.5, 0.5, np.inf
    for k in range(len(intervals)):
        away = max(intervals[k, 0] - 0.5, 0.5 - intervals[k, 1])
        if away < nearest:
            low, high, nearest = intervals[k, 0], intervals[k, 1], away
    return low, high
