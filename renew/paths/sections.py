"""Sections across a channel, and their parts outside the soft no-go zone.

Consecutive passing edges share a vertex, so a channel is a row of fans. Each fan is cut into
several sections from its pivot. A path visits one point of each section in turn, so it can bend
inside large triangles where the current turns.
"""

from dataclasses import dataclass

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.dual_graph import Channel
from renew.kernels.capsules import (
    Capsules,
    Segment,
    capsule_bounds,
    capsule_interval,
    intersects,
)

# Shortest free gap, as a share of its section; a shorter one is a rounding error.
_SLIVER = 1e-9
# Approximate maximum number of sections of a channel: if a midline is much shorter than the edges
# that it crosses, there would be millions.
_MAX_SECTIONS = 5000


@dataclass(frozen=True, slots=True)
class Sections:
    """Sections from the left to the right bank, in sailing order.

    `left`, `right` are (s, 2) metres; `passing` (s,) marks passing edges. `place` (s,) is the
    channel's index of the triangle that a section crosses or a passing edge ends.
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
class FreeParts:
    """The parts of each section outside the soft no-go zone V, as intervals of [0, 1].

    The first `count` (s,) intervals in each row of `intervals` (s, n, 2) are valid, and in order.
    """

    intervals: FloatArray
    count: IntArray

    @property
    def blocked(self) -> BoolArray:
        """Whether each section (s,) has no free part."""
        return np.asarray(self.count == 0)

    def select(self, keep: BoolArray | IntArray) -> "FreeParts":
        """Return only the free parts of some of the sections."""
        return FreeParts(self.intervals[keep], self.count[keep])

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


def free_parts(sections: Sections, capsules: Capsules) -> FreeParts:
    """Return the parts of each section outside all capsules."""
    return FreeParts(*free_intervals(sections.left, sections.right, capsules))


@kernel
def free_intervals(
    left: FloatArray, right: FloatArray, capsules: Capsules
) -> tuple[FloatArray, IntArray]:
    """Return the intervals (s, n, 2) of :class:`FreeParts`, and their number in each row."""
    start, end, radius = capsules
    bounds = capsule_bounds(capsules)
    near = np.zeros(len(left), dtype=np.int64)
    for i in range(len(left)):
        west, east = min(left[i, 0], right[i, 0]), max(left[i, 0], right[i, 0])
        south, north = min(left[i, 1], right[i, 1]), max(left[i, 1], right[i, 1])
        for h in range(len(start)):
            near[i] += intersects(bounds, h, west, south, east, north)
    most = near.max() if len(near) else 0
    intervals = np.zeros((len(left), most + 1, 2))
    count = np.zeros(len(left), dtype=np.int64)
    covered = np.empty((most, 2))
    for i in range(len(left)):
        found = 0
        west, east = min(left[i, 0], right[i, 0]), max(left[i, 0], right[i, 0])
        south, north = min(left[i, 1], right[i, 1]), max(left[i, 1], right[i, 1])
        for h in range(len(start)):
            if not intersects(bounds, h, west, south, east, north):
                continue
            section = Segment(left[i, 0], left[i, 1], right[i, 0], right[i, 1])
            axis = Segment(start[h, 0], start[h, 1], end[h, 0], end[h, 1])
            enter, leave = capsule_interval(section, axis, radius[h])
            if enter < leave:
                _insert(covered, found, enter, leave)
                found += 1
        behind = 0.0
        for h in range(found):
            if covered[h, 0] - behind > _SLIVER:
                intervals[i, count[i], 0], intervals[i, count[i], 1] = behind, covered[h, 0]
                count[i] += 1
            behind = max(behind, covered[h, 1])
        if 1.0 - behind > _SLIVER:
            intervals[i, count[i], 0], intervals[i, count[i], 1] = behind, 1.0
            count[i] += 1
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
    """Return places (s, points) over the intervals of each row; see :meth:`FreeParts.spread`."""
    places = np.zeros((len(count), points))
    for i in range(len(count)):
        total = 0.0
        for k in range(count[i]):
            total += intervals[i, k, 1] - intervals[i, k, 0]
        first, behind = 0, 0.0
        for k in range(count[i]):
            low, high = intervals[i, k]
            behind += high - low
            # Each interval gets its share of the points, at least two while there are enough
            # points.
            last = round(points * behind / total) if k < count[i] - 1 else points
            last = min(max(last, first + 2), points - 2 * (count[i] - 1 - k))
            for j in range(first, last):
                places[i, j] = low + (high - low) * (j - first) / max(last - first - 1, 1)
            first = max(last, first)
    return places
