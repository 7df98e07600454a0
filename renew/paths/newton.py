"""A path straightened by Newton's method: all its points move square to it at once.

A dynamic programme over a few points on each transversal sees no gain in turning a long stretch of
the path by a little: from one leg to the next its points are too far apart for that. The time of a
path, as a function of how far each point is moved, has a tridiagonal second derivative, and solving
that system moves long stretches as easily as single points (a damped Newton method; Nocedal and
Wright, Numerical Optimization, 2006, ch. 3 and 10.3).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray
from renew.kernels.capsules import legs_are_clear
from renew.kernels.viterbi import Stream, arrivals, leg_time
from renew.paths.refinement import Water

# Step of the differences, as a share of a leg.
_STEP = 0.05
# Iterations, and tries with ever more damping, or more points held, in each of them.
_ITERATIONS, _TRIES = 8, 6
# Damping of the first try, as a share of the mean second derivative, its factor from try to try,
# and the share below which there is none.
_DAMPING, _MORE, _LEAST_DAMPING = 0.05, 8.0, 1e-4
# Gain of an iteration, as a share of the time under way, below which it is the last.
_GAIN = 3e-6


class _Quadratic(NamedTuple):
    """Derivatives of the arrival time by how far each point (n,) is moved along its normal.

    `gradient` (n,) in s/m; second derivatives in s/m²: `diagonal` (n,), and `beside` (n,), with the
    next point.
    """

    gradient: FloatArray
    diagonal: FloatArray
    beside: FloatArray


@kernel
def straightened(
    path: FloatArray, farthest: float, water: Water, keep_whole: BoolArray
) -> FloatArray:
    """Path (n, 2), no slower, whose points have moved square to it, by `farthest` m at most.

    Points of legs that would touch a capsule stay where they are. `keep_whole` (2,) says whether
    the first, and the last, leg stays as it is.
    """
    stream = water.stream
    times = arrivals(path, stream)
    movable = np.ones(len(path), dtype=np.bool_)
    movable[0] = movable[-1] = False
    if len(path) > 2:
        movable[1] &= not keep_whole[0]
        movable[-2] &= not keep_whole[1]
    damping = _DAMPING
    for _ in range(_ITERATIONS):
        before = times[-1]
        normals = _normals(path)
        quadratic = _quadratic(path, normals, times, stream)
        for _ in range(_TRIES):
            shift, found = _newton_step(quadratic, damping, movable)
            if found and np.abs(shift).max() <= farthest / _ITERATIONS:
                moved = path + shift.reshape(-1, 1) * normals
                moved_times = arrivals(moved, stream)
                if moved_times[-1] <= before:
                    held = _held(path, moved, water)
                    if not (held & movable).any():
                        path, times = moved, moved_times
                        damping = damping / _MORE if damping > _LEAST_DAMPING else 0.0
                        break
                    movable &= ~held
                    continue
            damping = max(_MORE * damping, _LEAST_DAMPING)
        if before - times[-1] <= _GAIN * (before - times[0]):
            break
    return path


@kernel
def _normals(path: FloatArray) -> FloatArray:
    """Unit vectors (n, 2) square to a path (n, 2); at its ends they are 0."""
    normals = np.zeros(path.shape)
    for k in range(1, len(path) - 1):
        dx, dy = path[k + 1, 0] - path[k - 1, 0], path[k + 1, 1] - path[k - 1, 1]
        length = max(math.hypot(dx, dy), 1e-300)
        normals[k, 0], normals[k, 1] = -dy / length, dx / length
    return normals


@kernel
def _quadratic(
    path: FloatArray, normals: FloatArray, times: FloatArray, stream: Stream
) -> _Quadratic:
    """Derivatives by differences, with the times (n,), s, at which each leg is begun.

    A leg's weight is by how much later she arrives for each second that she ends it later; 1 where
    the current is steady.
    """
    gradient, diagonal, beside = np.zeros(len(path)), np.zeros(len(path)), np.zeros(len(path))
    weight = 1.0
    for k in range(len(path) - 2, -1, -1):
        h = _STEP * math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        if h == 0.0:
            continue
        here = _leg_time(path, normals, k, 0.0, 0.0, times[k], stream)
        first = _leg_time(path, normals, k, h, 0.0, times[k], stream)
        first_back = _leg_time(path, normals, k, -h, 0.0, times[k], stream)
        second = _leg_time(path, normals, k, 0.0, h, times[k], stream)
        second_back = _leg_time(path, normals, k, 0.0, -h, times[k], stream)
        both = _leg_time(path, normals, k, h, h, times[k], stream)
        both_back = _leg_time(path, normals, k, -h, -h, times[k], stream)
        curvature, next_curvature = first + first_back - 2 * here, second + second_back - 2 * here
        gradient[k] += weight * (first - first_back) / (2 * h)
        gradient[k + 1] += weight * (second - second_back) / (2 * h)
        diagonal[k] += weight * curvature / h**2
        diagonal[k + 1] += weight * next_curvature / h**2
        # Abramowitz and Stegun, Handbook of Mathematical Functions, 25.3.27.
        mixed = both + both_back - 2 * here - curvature - next_curvature
        beside[k] = weight * mixed / (2 * h**2)
        if len(stream.table.times) > 1:
            later = _STEP * here
            ends = _leg_time(path, normals, k, 0.0, 0.0, times[k] + later, stream)
            weight *= 1 + (ends - here) / later
    return _Quadratic(gradient, diagonal, beside)


@kernel
def _leg_time(
    path: FloatArray,
    normals: FloatArray,
    k: int,
    shift: float,
    next_shift: float,
    begin: float,
    stream: Stream,
) -> float:
    """Time (s) over the leg from point k, begun at a time (s), with both ends moved (m)."""
    return leg_time(
        path[k, 0] + shift * normals[k, 0],
        path[k, 1] + shift * normals[k, 1],
        path[k + 1, 0] + next_shift * normals[k + 1, 0],
        path[k + 1, 1] + next_shift * normals[k + 1, 1],
        begin,
        stream,
    )


@kernel
def _newton_step(
    quadratic: _Quadratic, damping: float, movable: BoolArray
) -> tuple[FloatArray, bool]:
    """How far (n,), m, to move each point, and whether that is towards a least time.

    By Cholesky's method for tridiagonal systems; `damping` is a share of the mean of the diagonal.
    """
    gradient, diagonal, beside = quadratic
    mean = np.abs(diagonal).mean()
    shift, carried = np.zeros(len(diagonal)), np.zeros(len(diagonal))
    for k in range(1, len(diagonal) - 1):
        if not movable[k]:
            continue
        before = beside[k - 1] if movable[k - 1] else 0.0
        pivot = diagonal[k] + damping * mean - before * carried[k - 1]
        if not pivot > 0.0:
            return shift, False
        carried[k] = beside[k] / pivot if movable[k + 1] else 0.0
        shift[k] = (-gradient[k] - before * shift[k - 1]) / pivot
    for k in range(len(diagonal) - 3, 0, -1):
        shift[k] -= carried[k] * shift[k + 1]
    return shift, True


@kernel
def _held(path: FloatArray, moved: FloatArray, water: Water) -> BoolArray:
    """Points (n,) whose way from a path to the moved one, or a leg there, touches a capsule."""
    held = ~legs_are_clear(path, moved, water.capsules)
    clear = legs_are_clear(moved[:-1], moved[1:], water.capsules)
    held[:-1] |= ~clear
    held[1:] |= ~clear
    return held
