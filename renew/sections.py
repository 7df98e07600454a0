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
from numba import njit

from renew.geometry import capsule_interval

if TYPE_CHECKING:
    from renew._types import BoolArray, FloatArray, IntArray
    from renew.channels import Channel
    from renew.padding import Hazards

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

    def places(self, path: FloatArray) -> FloatArray:
        """Places (s,) in [0, 1] where a path (n, 2) that crosses each section first does so."""
        legs = np.diff(path, axis=0)
        across = self.right - self.left
        gap = path[:-1] - self.left[:, None]
        turn = _cross(across[:, None], legs)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = _cross(gap, across[:, None]) / turn  # place on the leg
            place = _cross(gap, legs) / turn  # place on the section
        # Legs end on sections: the one that misses it least counts.
        miss = np.maximum.reduce([-along, along - 1, -place, place - 1])
        leg = np.nan_to_num(miss, nan=np.inf).argmin(axis=1)
        return np.asarray(np.clip(place[np.arange(len(leg)), leg], 0.0, 1.0))

    def select(self, keep: BoolArray) -> Sections:
        """Return only some of the sections."""
        return Sections(self.left[keep], self.right[keep], self.passing[keep], self.fan[keep])


def cut(
    channel: Channel, start: FloatArray, goal: FloatArray, spacing: float, angle: float
) -> Sections:
    """Cut a channel into sections at most `spacing` metres and `angle` radians apart.

    The spacing holds on the bank that moves. Where both are infinite, these are the passing
    edges alone.
    """
    lefts: list[FloatArray] = []
    rights: list[FloatArray] = []
    passing: list[bool] = []
    fans: list[int] = []
    gates = list(zip(channel.left, channel.right, strict=True))
    # The ends are fans too: the first gate shrinks to the start, the last one to the goal.
    banks = [(start, start), *gates, (goal, goal)]
    for fan, ((left, right), (next_left, next_right)) in enumerate(itertools.pairwise(banks)):
        count = _steps(left, right, next_left, next_right, spacing, angle)
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
    angle: float,
) -> int:
    """How many steps lead from one gate to the next."""
    moved = max(math.dist(left, next_left), math.dist(right, next_right))
    a, b = left - right, next_left - next_right
    turned = abs(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))
    return max(1, math.ceil(moved / spacing), math.ceil(turned / angle))


def free_intervals(sections: Sections, hazards: Hazards, distance: FloatArray) -> list[FloatArray]:
    """Parts of each section further than `distance` (e,) from the hazards' edges.

    Arrays (i, 2) of intervals in [0, 1], in order; (0, 2) where V takes the whole section.
    """
    covered = _covered(sections.left, sections.right, hazards.start, hazards.end, distance)
    return [_complement(pairs[pairs[:, 0] < pairs[:, 1]]) for pairs in covered]


@njit(cache=True)
def _covered(
    left: FloatArray, right: FloatArray, start: FloatArray, end: FloatArray, padding: FloatArray
) -> FloatArray:
    """Interval (s, h, 2) of each section inside each padded edge; enter > leave where none."""
    intervals = np.ones((len(left), len(start), 2))
    for i in range(len(left)):
        for h in range(len(start)):
            if padding[h] > 0.0:
                intervals[i, h] = capsule_interval(
                    left[i, 0],
                    left[i, 1],
                    right[i, 0],
                    right[i, 1],
                    start[h, 0],
                    start[h, 1],
                    end[h, 0],
                    end[h, 1],
                    padding[h],
                )
    return intervals


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product (...) of plane vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _complement(covered: FloatArray) -> FloatArray:
    """Intervals (i, 2) of [0, 1] that none of the given ones (n, 2) covers."""
    if not len(covered):
        return np.array([[0.0, 1.0]])
    covered = covered[np.argsort(covered[:, 0])]
    behind = np.maximum.accumulate(np.append(0.0, covered[:, 1]))
    ahead = np.append(covered[:, 0], 1.0)
    free = ahead - behind > _SLIVER
    return np.column_stack([behind[free], ahead[free]])
