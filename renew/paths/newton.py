"""Straighten a path by Newton's method, which moves all points at once, perpendicular to the path.

A dynamic programme over a few points on each transversal can't turn a long stretch by a small
angle, because its points are too far apart. The duration of a path, as a function of each point's
shift, has a tridiagonal second derivative. Solving that system moves long stretches as easily as
single points (a damped Newton method; Nocedal and Wright, Numerical Optimization, 2006, ch. 3 and
10.3).
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, reading_kernel
from renew._types import BoolArray, FloatArray
from renew.kernels.capsules import Segment, legs_are_clear
from renew.kernels.current_table import Site, site_of, velocity_there
from renew.kernels.viterbi import Stream, arrivals, leg_time, leg_time_from
from renew.paths.sections import WaterAround

# Step of the differences, as a share of the shorter leg beside a point.
_STEP = 0.05
# Shortest leg that counts for that step, as a share of the path.
_SHORTEST = 1e-6
# Largest number of iterations.
_ITERATIONS = 12
# Number of tries in each iteration, with more damping or more points held.
_TRIES = 6
# Damping of the first try, as a share of the mean second derivative.
_DAMPING = 0.05
# Factor of the damping from try to try.
_MORE = 8.0
# Share of the mean second derivative up to which damping becomes 0 when it falls.
_LEAST_DAMPING = 1e-4
# Gain of an iteration, as a share of the duration, below which it is the last one.
_GAIN = 3e-6


class _Quadratic(NamedTuple):
    """Derivatives of the arrival time with respect to each point's shift along its normal.

    `gradient` (n,) in s/m; second derivatives in s/m²: `diagonal` (n,), and `beside` (n,), mixed
    with the next point.
    """

    gradient: FloatArray
    diagonal: FloatArray
    beside: FloatArray


@kernel
def straightened(
    path: FloatArray, farthest: float, water: WaterAround, keep_whole: BoolArray
) -> FloatArray:
    """Return a path (n, 2), not slower, whose points have moved at most `farthest` m sideways.

    Points of legs that would touch a capsule stay. `keep_whole` (2,) says whether the first, and
    the last, leg stays unchanged.
    """
    stream = water.stream
    times = arrivals(path, stream)
    last = len(path) - 1
    movable = np.zeros(last + 1, dtype=np.bool_)
    for k in range(1, last):
        movable[k] = not (k == 1 and keep_whole[0]) and not (k == last - 1 and keep_whole[1])
    damping = _DAMPING
    for _ in range(_ITERATIONS):
        before = times[-1]
        normals = _normals(path)
        quadratic = _quadratic(path, normals, times, stream)
        for _ in range(_TRIES):
            shift, found = _newton_step(quadratic, damping, movable)
            if found:
                moved = _moved(path, normals, shift, farthest / _ITERATIONS)
                moved_times = arrivals(moved, stream)
                if moved_times[-1] <= before:
                    if not _hold(movable, path, moved, water):
                        path, times = moved, moved_times
                        damping = damping / _MORE if damping > _LEAST_DAMPING else 0.0
                        break
                    continue
            damping = max(_MORE * damping, _LEAST_DAMPING)
        if before - times[-1] <= _GAIN * (before - times[0]):
            break
    return path


@kernel
def _moved(path: FloatArray, normals: FloatArray, shift: FloatArray, most: float) -> FloatArray:
    """Return a path (n, 2) with points shifted (n,), m, along their normals, by at most `most` m.

    A step that is too long still leads towards the least duration.
    """
    largest = 0.0
    for one in shift:
        largest = max(largest, abs(one))
    share = min(1.0, most / max(largest, 1e-300))
    moved = np.empty(path.shape)
    for k in range(len(path)):
        for d in range(2):
            moved[k, d] = path[k, d] + shift[k] * share * normals[k, d]
    return moved


@kernel
def _normals(path: FloatArray) -> FloatArray:
    """Return unit vectors (n, 2) perpendicular to a path (n, 2), and 0 at its ends."""
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
    """Return derivatives by differences, given the times (n,), s, at which legs begin.

    A leg's weight is the delay of the arrival per second of delay of the leg; 1 in a steady
    current.
    """
    gradient, diagonal, beside = np.zeros(len(path)), np.zeros(len(path)), np.zeros(len(path))
    steps = _steps(path)
    weight = 1.0
    after = _around(path, normals, steps, len(path) - 1, times, stream)
    for k in range(len(path) - 2, -1, -1):
        begin = _around(path, normals, steps, k, times, stream)
        here = times[k + 1] - times[k]
        first = _time_between(begin[2], after[1], times[k], stream)
        first_back = _time_between(begin[0], after[1], times[k], stream)
        second = _time_between(begin[1], after[2], times[k], stream)
        second_back = _time_between(begin[1], after[0], times[k], stream)
        both = _time_between(begin[2], after[2], times[k], stream)
        both_back = _time_between(begin[0], after[0], times[k], stream)
        curvature, after_curvature = first + first_back - 2 * here, second + second_back - 2 * here
        h, after_h = steps[k], steps[k + 1]
        gradient[k] += weight * (first - first_back) / (2 * h)
        gradient[k + 1] += weight * (second - second_back) / (2 * after_h)
        diagonal[k] += weight * curvature / h**2
        diagonal[k + 1] += weight * after_curvature / after_h**2
        # Abramowitz and Stegun, Handbook of Mathematical Functions, 25.3.27.
        mixed = both + both_back - 2 * here - curvature - after_curvature
        beside[k] = weight * mixed / (2 * h * after_h)
        if len(stream.table.times) > 1:
            later = _STEP * here
            (ax, ay), (bx, by) = path[k], path[k + 1]
            ends = leg_time(ax, ay, bx, by, times[k] + later, stream)
            weight *= 1 + (ends - here) / later
        after = begin
    return _Quadratic(gradient, diagonal, beside)


@kernel
def _steps(path: FloatArray) -> FloatArray:
    """Return the shifts (n,), m, for the differences: a share of the shorter adjacent leg."""
    last, whole = len(path) - 1, 0.0
    legs, steps = np.empty(last), np.empty(last + 1)
    for k in range(last):
        legs[k] = math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        whole += legs[k]
    for k in range(last + 1):
        shorter = min(legs[max(k - 1, 0)], legs[min(k, last - 1)])
        steps[k] = _STEP * max(shorter, _SHORTEST * whole)
    return steps


class _Place(NamedTuple):
    """A point's position (m), its cell in the table, and the current at its passage (m/s)."""

    x: float
    y: float
    site: Site
    u: float
    v: float


@reading_kernel
def _around(
    path: FloatArray,
    normals: FloatArray,
    steps: FloatArray,
    k: int,
    times: FloatArray,
    stream: Stream,
) -> tuple[_Place, _Place, _Place]:
    """Return point k shifted back along its normal by its step (m), unshifted, and forward."""
    dx, dy = steps[k] * normals[k, 0], steps[k] * normals[k, 1]
    x, y = path[k]
    return (
        _place(x - dx, y - dy, times[k], stream),
        _place(x, y, times[k], stream),
        _place(x + dx, y + dy, times[k], stream),
    )


@reading_kernel
def _place(x: float, y: float, time: float, stream: Stream) -> _Place:
    """Return the place of a point that is passed at a given time (s)."""
    site = site_of(stream.table, x, y)
    u, v = velocity_there(stream.table, site, time)
    return _Place(x, y, site, u, v)


@reading_kernel
def _time_between(a: _Place, b: _Place, begin: float, stream: Stream) -> float:
    """Return the time (s) over a leg, which begins at a given time (s)."""
    leg = Segment(a.x, a.y, b.x, b.y)
    return leg_time_from(leg, a.u, a.v, b.site, begin, stream)


@kernel
def _newton_step(
    quadratic: _Quadratic, damping: float, movable: BoolArray
) -> tuple[FloatArray, bool]:
    """Return the shift (n,), m, of each point, and whether it leads towards a minimum.

    By Cholesky's method for tridiagonal systems; `damping` is a share of the mean diagonal.
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
    # Beside a current that shuts the way derivatives are infinite.
    return shift, bool(np.isfinite(shift).all())


@kernel
def _hold(movable: BoolArray, path: FloatArray, moved: FloatArray, water: WaterAround) -> bool:
    """Mark as immovable each point (n,) whose shift, or a leg there, touches a capsule.

    Returns whether any point was newly marked.
    """
    on_way = legs_are_clear(path, moved, water.capsules)
    on_legs = legs_are_clear(moved[:-1], moved[1:], water.capsules)
    last, found = len(path) - 1, False
    for k in range(last + 1):
        clear = on_way[k] and on_legs[max(k - 1, 0)] and on_legs[min(k, last - 1)]
        if movable[k] and not clear:
            movable[k], found = False, True
    return found
