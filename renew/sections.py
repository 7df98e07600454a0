"""Sections across a channel, and the parts of them that lie outside the soft no-go zone.

Consecutive passing edges share a vertex, so a channel is a row of fans. Each fan is cut into
several sections from its pivot; a path visits one point of each section in turn, which lets it
bend inside large triangles where the current turns.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from renew.geometry import capsule_interval

if TYPE_CHECKING:
    from renew._types import BoolArray, FloatArray, IntArray
    from renew.channels import Channel
    from renew.padding import Hazards

# Sections of a fan stand at most this far apart in angle, so that a path which wraps the round
# end of a padded edge bends by little at each: its chords then stay within 0.3 % of the arc.
_MOST_ANGLE = math.radians(9)
# Free gaps shorter than this share of the section are no way through, only rounding.
_SLIVER = 1e-9


@dataclass(frozen=True, slots=True)
class Sections:
    """Sections from the left to the right bank, in sailing order.

    `left`, `right` are (s, 2) metres; `passing` (s,) marks passing edges; `fan` (s,) is the place
    in the channel of the triangle that holds the section, for a passing edge the one it leaves.
    """

    left: FloatArray
    right: FloatArray
    passing: BoolArray
    fan: IntArray

    def points(self, place: FloatArray) -> FloatArray:
        """Points (s, ..., 2) at places (s, ...) in [0, 1] from left to right."""
        extra = (1,) * (place.ndim - 1)
        left = self.left.reshape(len(self.left), *extra, 2)
        right = self.right.reshape(len(self.right), *extra, 2)
        return np.asarray(left + place[..., None] * (right - left))

    def select(self, keep: BoolArray) -> Sections:
        """Return only some of the sections."""
        return Sections(self.left[keep], self.right[keep], self.passing[keep], self.fan[keep])


def cut(channel: Channel, start: FloatArray, goal: FloatArray, spacing: float) -> Sections:
    """Cut a channel into sections at most `spacing` metres apart on the bank that moves.

    With an infinite spacing these are the passing edges alone.
    """
    lefts: list[FloatArray] = []
    rights: list[FloatArray] = []
    passing: list[bool] = []
    fans: list[int] = []
    gates = list(zip(channel.left, channel.right, strict=True))
    # The ends are fans too: the first gate shrinks to the start, the last one to the goal.
    banks = [(start, start), *gates, (goal, goal)]
    for fan, ((left, right), (next_left, next_right)) in enumerate(itertools.pairwise(banks)):
        count = _steps(left, right, next_left, next_right, spacing)
        for step in range(1, count + 1):
            lefts.append(left + (next_left - left) * step / count)
            rights.append(right + (next_right - right) * step / count)
            passing.append(step == count)
            fans.append(fan)
    return Sections(
        np.array(lefts[:-1]).reshape(-1, 2),
        np.array(rights[:-1]).reshape(-1, 2),
        np.array(passing[:-1], dtype=bool),
        np.array(fans[:-1], dtype=np.int64),
    )


def _steps(
    left: FloatArray,
    right: FloatArray,
    next_left: FloatArray,
    next_right: FloatArray,
    spacing: float,
) -> int:
    """How many steps lead from one gate to the next."""
    if math.isinf(spacing):
        return 1
    moved = max(math.dist(left, next_left), math.dist(right, next_right))
    a, b = left - right, next_left - next_right
    angle = abs(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))
    return max(1, math.ceil(moved / spacing), math.ceil(angle / _MOST_ANGLE))


def free_intervals(sections: Sections, hazards: Hazards) -> list[FloatArray]:
    """Free part of each section: (i, 2) intervals in [0, 1], in order; (0, 2) where none."""
    padded = hazards.padding > 0
    start, end, padding = hazards.start[padded], hazards.end[padded], hazards.padding[padded]
    enter, leave = capsule_interval(
        sections.left[:, None], sections.right[:, None], start, end, padding
    )
    return [_complement(a[a < b], b[a < b]) for a, b in zip(enter, leave, strict=True)]


def _complement(enter: FloatArray, leave: FloatArray) -> FloatArray:
    """Intervals (i, 2) of [0, 1] that none of the given ones covers."""
    order = np.argsort(enter)
    covered = np.maximum.accumulate(np.concatenate([[0.0], leave[order]]))
    begin = np.concatenate([enter[order], [1.0]])
    free = begin - covered > _SLIVER
    return np.column_stack([covered[free], begin[free]])
