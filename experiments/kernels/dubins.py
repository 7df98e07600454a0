"""Dubins paths (Dubins, 1957): the shortest path of bounded curvature between two poses, compiled.

The six words LSL, RSR, LSR, RSL, RLR and LRL in Shkel and Lumelsky's (2001) normalised form.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.kernels.compiled import compiled
from experiments.kernels.water import Buckets, leg_clear
from renew._types import BoolArray, FloatArray, IntArray

# Turns of the six words: 1 is left, -1 right, 0 straight.
_WORDS = np.array([(1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (-1, 1, -1), (1, -1, 1)])
# Largest angle (rad) between points of an arc: chords leave it by 0.1 % of the radius.
_ARC_STEP = math.radians(5)
# An angle this close to a full turn counts as 0: rounding makes it of a straight path.
_FULL_TURN = 1e-9
# Largest error (radii, rad) at the end of a word that counts as one.
_CLOSED = 1e-6


@compiled
def _angle(value: float) -> float:
    """An angle in [0, 2π)."""
    angle = value % (2 * math.pi)
    return 0.0 if angle > 2 * math.pi - _FULL_TURN else angle


@compiled
def shortest(one: FloatArray, other: FloatArray, radius: float) -> tuple[int, FloatArray]:
    """Number of the shortest word between poses (3,) x, y, heading, and its parts (3,).

    Turns are in radians, the straight part in radii. There is always one.
    """
    dx, dy = other[0] - one[0], other[1] - one[1]
    d = math.hypot(dx, dy) / radius
    course = math.atan2(dy, dx)
    a, b = _angle(one[2] - course), _angle(other[2] - course)
    sa, sb, ca, cb = math.sin(a), math.sin(b), math.cos(a), math.cos(b)
    best, least, parts = -1, math.inf, np.zeros(3)
    trial = np.zeros(3)
    for word in range(6):
        if word == 0:
            square = 2 + d * d - 2 * math.cos(a - b) + 2 * d * (sa - sb)
            turn = math.atan2(cb - ca, d + sa - sb)
            trial[0], trial[2] = _angle(turn - a), _angle(b - turn)
        elif word == 1:
            square = 2 + d * d - 2 * math.cos(a - b) + 2 * d * (sb - sa)
            turn = math.atan2(ca - cb, d - sa + sb)
            trial[0], trial[2] = _angle(a - turn), _angle(turn - b)
        elif word == 2:
            square = -2 + d * d + 2 * math.cos(a - b) + 2 * d * (sa + sb)
            straight = math.sqrt(max(square, 0.0))
            turn = math.atan2(-ca - cb, d + sa + sb) - math.atan2(-2.0, straight)
            trial[0], trial[2] = _angle(turn - a), _angle(turn - b)
        elif word == 3:
            square = -2 + d * d + 2 * math.cos(a - b) - 2 * d * (sa + sb)
            straight = math.sqrt(max(square, 0.0))
            turn = math.atan2(ca + cb, d - sa - sb) - math.atan2(2.0, straight)
            trial[0], trial[2] = _angle(a - turn), _angle(b - turn)
        else:
            sign = 1.0 if word == 4 else -1.0
            cosine = (6 - d * d + 2 * math.cos(a - b) + sign * 2 * d * (sa - sb)) / 8
            square = 1 - cosine * cosine
            middle = _angle(2 * math.pi - math.acos(min(max(cosine, -1.0), 1.0)))
            if word == 4:
                turn = math.atan2(ca - cb, d - sa + sb)
                trial[0] = _angle(a - turn + middle / 2)
                trial[2] = _angle(a - b - trial[0] + middle)
            else:
                turn = math.atan2(ca - cb, d + sa - sb)
                trial[0] = _angle(-a - turn + middle / 2)
                trial[2] = _angle(b - a - trial[0] + middle)
            trial[1] = middle
        if square < 0.0:
            continue
        if word < 4:
            trial[1] = math.sqrt(square)
        length = trial[0] + trial[1] + trial[2]
        if length < least and _leads_to(word, trial, a, b, d):
            best, least = word, length
            parts[:] = trial
    return best, parts


@compiled
def _leads_to(word: int, parts: FloatArray, a: float, b: float, d: float) -> bool:
    """Whether a word from (0, 0, a) ends at (d, 0, b), in radii."""
    x, y, heading = 0.0, 0.0, a
    for k in range(3):
        x, y, heading = _moved(x, y, heading, _WORDS[word, k], parts[k])
    return math.hypot(x - d, y) < _CLOSED and _apart(heading, b) < _CLOSED


@compiled
def _apart(one: float, other: float) -> float:
    """Angle between two headings, rad."""
    return abs((one - other + math.pi) % (2 * math.pi) - math.pi)


@compiled
def _moved(
    x: float, y: float, heading: float, turn: int, part: float
) -> tuple[float, float, float]:
    """Pose after a part of a word, in radii."""
    if turn == 0:
        return x + part * math.cos(heading), y + part * math.sin(heading), heading
    ahead = heading + turn * part
    return (
        x + turn * (math.sin(ahead) - math.sin(heading)),
        y - turn * (math.cos(ahead) - math.cos(heading)),
        ahead,
    )


@compiled
def dubins_length(one: FloatArray, other: FloatArray, radius: float) -> float:
    """Length (m) of the shortest path between poses (3,)."""
    _, parts = shortest(one, other, radius)
    return float(radius * parts.sum())


@compiled
def dubins_path(one: FloatArray, other: FloatArray, radius: float) -> FloatArray:
    """Points (n, 2) along the shortest path between poses (3,), both ends among them; m."""
    word, parts = shortest(one, other, radius)
    counts = np.ones(3, dtype=np.int64)
    for k in range(3):
        if _WORDS[word, k] != 0:
            counts[k] = max(1, math.ceil(parts[k] / _ARC_STEP))
    points = np.empty((counts.sum() + 1, 2))
    points[0] = one[:2]
    x, y, heading, n = 0.0, 0.0, one[2], 1
    for k in range(3):
        for _ in range(counts[k]):
            x, y, heading = _moved(x, y, heading, _WORDS[word, k], parts[k] / counts[k])
            points[n, 0], points[n, 1] = one[0] + radius * x, one[1] + radius * y
            n += 1
    points[-1] = other[:2]
    return points


@compiled
def dubins_clear(one: FloatArray, other: FloatArray, radius: float, buckets: Buckets) -> bool:
    """Whether the shortest path between poses keeps out of all padded edges."""
    points = dubins_path(one, other, radius)
    for k in range(len(points) - 1):
        here, there = points[k], points[k + 1]
        if not leg_clear(here[0], here[1], there[0], there[1], buckets):
            return False
    return True


@compiled
def dubins_motions(
    poses: FloatArray, pairs: IntArray, radius: float, buckets: Buckets
) -> tuple[FloatArray, BoolArray]:
    """Lengths (p,), m, and whether they are clear, of the paths between pairs (p, 2) of poses."""
    lengths = np.empty(len(pairs))
    clear = np.empty(len(pairs), dtype=np.bool_)
    for k in range(len(pairs)):
        one, other = poses[pairs[k, 0]], poses[pairs[k, 1]]
        lengths[k] = dubins_length(one, other, radius)
        clear[k] = dubins_clear(one, other, radius, buckets)
    return lengths, clear
