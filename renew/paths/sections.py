"""Sections across a channel, and transversals across a path, on which the path is refined.

Consecutive passing edges share a vertex, so a channel is a row of fans. Each fan is cut into
several sections from its pivot. A path visits one point of each section in turn, so it can bend
inside large triangles where the current turns.

Transversals are perpendicular to the path, from V to V. So the path can bend between them, and
bulge out of its channel over open water.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.dual_graph import Channel
from renew.kernels.capsules import (
    Capsules,
    Segment,
    boxes_met,
    capsule_bounds,
    capsule_interval,
    wrapped,
)
from renew.kernels.viterbi import Stream, quickest_chain, shortcut

# Shortest free gap, as a share of its section; a shorter one is a rounding error.
_SLIVER = 1e-9
# Approximate maximum number of sections of a channel: if a midline is much shorter than the edges
# that it crosses, there would be millions.
_MAX_SECTIONS = 5000


@dataclass(frozen=True, slots=True)
class Sections:
    """Sections from the left to the right bank, in sailing order.

    `left`, `right` are (s, 2) metres; `passing` (s,) marks passing edges. `place` (s,) is the index
    in the channel of the triangle that a section crosses, or that ends with a passing edge.
    """

    left: FloatArray
    right: FloatArray
    passing: BoolArray
    place: IntArray

    def points(self, share: FloatArray) -> FloatArray:
        """Return points (s, ..., 2) at shares (s, ...) of sections, left 0 to right 1."""
        extra = (1,) * (share.ndim - 1)
        left = self.left.reshape(len(self.left), *extra, 2)
        right = self.right.reshape(len(self.right), *extra, 2)
        return np.asarray(left + share[..., None] * (right - left))

    def select(self, keep: BoolArray | IntArray) -> "Sections":
        """Return only some of the sections."""
        return Sections(self.left[keep], self.right[keep], self.passing[keep], self.place[keep])


def sections_of(
    channel: Channel, start: FloatArray, goal: FloatArray, spacing: float, angle: float
) -> Sections:
    """Cut a channel into sections at most `spacing` metres and `angle` radians apart.

    The spacing is measured on the bank where sections are further apart. If both are infinite,
    the sections are the passing edges alone.
    """
    # The first fan begins, and the last one ends, with a passing edge of length 0: start, goal.
    left = np.vstack([start, channel.left, goal])
    right = np.vstack([start, channel.right, goal])
    count = _steps(left, right, spacing, angle)
    fan = np.repeat(np.arange(len(count)), count)
    step = np.arange(1, len(fan) + 1) - np.repeat(np.cumsum(count) - count, count)
    place = (step / count[fan])[:, None]
    sections = Sections(
        left[fan] + place * (left[fan + 1] - left[fan]),
        right[fan] + place * (right[fan + 1] - right[fan]),
        step == count[fan],
        fan,
    )
    return sections.select(np.arange(len(fan)) < len(fan) - 1)  # the last is the goal


def _steps(left: FloatArray, right: FloatArray, spacing: float, angle: float) -> IntArray:
    """Return the number of steps (g - 1,) from each passing edge (g, 2) to the next."""
    moved = np.maximum(
        np.linalg.norm(np.diff(left, axis=0), axis=1),
        np.linalg.norm(np.diff(right, axis=0), axis=1),
    )
    across = left - right
    one, other = across[:-1], across[1:]
    turned = np.abs(
        np.arctan2(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0], (one * other).sum(axis=1))
    )
    spacing = max(spacing, moved.sum() / _MAX_SECTIONS)
    steps = np.maximum(np.ceil(moved / spacing), np.ceil(turned / angle))
    return np.asarray(np.maximum(steps, 1), dtype=np.int64)


@dataclass(frozen=True, slots=True)
class FreeIntervals:
    """The parts of each section outside the soft no-go zone V, as intervals of [0, 1].

    The first `count` (s,) intervals in each row of `intervals` (s, n, 2) are valid, and in order.
    """

    intervals: FloatArray
    count: IntArray

    @property
    def blocked(self) -> BoolArray:
        """Whether each section (s,) has no free part."""
        return np.asarray(self.count == 0)

    def select(self, keep: BoolArray | IntArray) -> "FreeIntervals":
        """Return only the free parts of some of the sections."""
        return FreeIntervals(self.intervals[keep], self.count[keep])

    def spread(self, points: int) -> FloatArray:
        """Return places (s, points), evenly over the free length, with all ends of intervals."""
        return np.asarray(_spread(self.intervals, self.count, points))

    def draw(self, points: int, rng: np.random.Generator) -> FloatArray:
        """Return places (s, points), uniformly distributed over the free parts."""
        within = np.arange(self.intervals.shape[1]) < self.count[:, None]
        lengths = np.where(within, self.intervals[..., 1] - self.intervals[..., 0], 0.0)
        ends = np.cumsum(lengths, axis=1)
        along = rng.random((len(ends), points)) * ends[:, -1:]
        chosen = np.minimum((along[..., None] >= ends[:, None]).sum(-1), self.count[:, None] - 1)
        row = np.arange(len(ends))[:, None]
        return np.asarray(self.intervals[row, chosen, 1] - (ends[row, chosen] - along))


def free_intervals(sections: Sections, capsules: Capsules) -> FreeIntervals:
    """Return the parts of each section outside all capsules."""
    return FreeIntervals(*intervals_outside(sections.left, sections.right, capsules))


@kernel
def intervals_outside(
    left: FloatArray, right: FloatArray, capsules: Capsules
) -> tuple[FloatArray, IntArray]:
    """Return the intervals (s, n, 2) of :class:`FreeIntervals`, and their number in each row."""
    start, end, radius = capsules
    boxes = capsule_bounds(Capsules(left, right, np.zeros(len(left))))
    first, near = boxes_met(capsule_bounds(capsules), boxes)
    # All intervals one after the other: few sections have many.
    every, begin = np.empty((len(near) + len(left), 2)), 0
    count, covered = np.zeros(len(left), dtype=np.int64), np.empty((len(near), 2))
    for i in range(len(left)):
        found = 0
        section = Segment(left[i, 0], left[i, 1], right[i, 0], right[i, 1])
        for h in near[first[i] : first[i + 1]]:
            axis = Segment(start[h, 0], start[h, 1], end[h, 0], end[h, 1])
            enter, leave = capsule_interval(section, axis, radius[h])
            if enter < leave:
                _insert(covered, found, enter, leave)
                found += 1
        behind = 0.0
        for h in range(found):
            if covered[h, 0] - behind > _SLIVER:
                every[begin + count[i], 0], every[begin + count[i], 1] = behind, covered[h, 0]
                count[i] += 1
            behind = max(behind, covered[h, 1])
        if 1.0 - behind > _SLIVER:
            every[begin + count[i], 0], every[begin + count[i], 1] = behind, 1.0
            count[i] += 1
        begin += count[i]
    most = 1
    for number in count:
        most = max(most, int(number))
    intervals, begin = np.zeros((len(left), most, 2)), 0
    for i in range(len(left)):
        intervals[i, : count[i]] = every[begin : begin + count[i]]
        begin += count[i]
    return intervals, count


@kernel
def _insert(intervals: FloatArray, count: int, enter: float, leave: float) -> None:
    """Insert an interval into the first `count` of (n, 2) intervals, which are sorted by start."""
    place = count
    while place > 0 and intervals[place - 1, 0] > enter:
        intervals[place, 0], intervals[place, 1] = intervals[place - 1]
        place -= 1
    intervals[place, 0], intervals[place, 1] = enter, leave


@kernel
def _spread(intervals: FloatArray, count: IntArray, points: int) -> FloatArray:
    """Return places (s, points) over the intervals of each row; see `FreeIntervals`."""
    places = np.zeros((len(count), points))
    for i in range(len(count)):
        total = 0.0
        for k in range(count[i]):
            total += intervals[i, k, 1] - intervals[i, k, 0]
        first, behind = 0, 0.0
        for k in range(count[i]):
            low, high = intervals[i, k]
            behind += high - low
            # Each interval gets its share of the points, at least two while enough are left.
            last = round(points * behind / total) if k < count[i] - 1 else points
            last = min(max(last, first + 2), points - 2 * (count[i] - 1 - k))
            for j in range(first, last):
                places[i, j] = low + (high - low) * (j - first) / max(last - first - 1, 1)
            first = max(last, first)
    return places


class WaterAround(NamedTuple):
    """The water in which a path is refined: a current, and capsules to avoid."""

    stream: Stream
    capsules: Capsules

    def near(self, chosen: IntArray) -> "WaterAround":
        """Return this water with only some of the capsules."""
        return WaterAround(self.stream, self.capsules.select(chosen))


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
    """Return points (n, count, 2) on transversals of a path (n, 2), n >= 3; at its ends, copies.

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
    intervals, found = intervals_outside(left, right, capsules)
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


def refined_on_transversals(
    path: FloatArray,
    window: float,
    count: int,
    longest: float,
    water: WaterAround,
    exempt: BoolArray,
) -> FloatArray:
    """Return the fastest path (n', 2) over `count` points per transversal, within `window` m.

    `exempt` is as in :func:`renew.kernels.viterbi.quickest_chain`. Detours that a shortcut of up to
    `longest` m avoids are removed. If no chain of points is clear, the path is returned unchanged.
    """
    if len(path) < 3:
        return path
    points = points_beside(path, window, count, water.capsules)
    arrival, chain = quickest_chain(points, water.stream, water.capsules, exempt)
    if not math.isfinite(arrival):
        return path
    # Transversals that cross beside a bend may make the path go back and forth.
    return np.asarray(without_detours(points[np.arange(len(points)), chain], longest, water))


@kernel
def without_detours(path: FloatArray, longest: float, water: WaterAround) -> FloatArray:
    """Remove the points of a path that a shortcut of up to `longest` m passes no slower."""
    return path[shortcut(path, water.stream, water.capsules, longest)]


@kernel
def _around_middle(intervals: FloatArray) -> tuple[float, float]:
    """Return the ends of the interval around or nearest to 0.5; 0.5 twice if there is none."""
    low, high, nearest = 0.5, 0.5, np.inf
    for k in range(len(intervals)):
        away = max(intervals[k, 0] - 0.5, 0.5 - intervals[k, 1])
        if away < nearest:
            low, high, nearest = intervals[k, 0], intervals[k, 1], away
    return low, high
