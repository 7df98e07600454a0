"""The least-fuel path in one homotopy class, outside its soft no-go zone V.

A dynamic programme in two parts. The first runs over sections of the channel: few sections with
many points each, to find the right way round. The second refines this path on transversals, which
are perpendicular lines from V to V, in ever narrower windows. So the path can bend, and bulge out
of its channel: the least-fuel path of a class may leave its row of triangles across open water and
come back.

Before the last pass, Newton's method moves all points at once, perpendicular to the path. A dynamic
programme over a few points on each transversal can't turn a long stretch by a small angle, because
its points are too far apart. The duration of a path, as a function of each point's shift, has a
tridiagonal second derivative. Solving that system moves long stretches as easily as single points
(a damped Newton method; Nocedal and Wright, Numerical Optimization, 2006, ch. 3 and 10.3).
"""

import contextlib
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from renew._compiled import kernel, small_kernel
from renew._types import BoolArray, FloatArray
from renew.errors import InfeasibleError, Length
from renew.kernels.capsules import Segment, capsules_near, legs_are_clear
from renew.kernels.cheapest_speeds import legs_between
from renew.kernels.current_table import Site, site_of, velocity_there
from renew.kernels.ground_speed import sailing_at
from renew.kernels.viterbi import Stream, arrivals, leg_time, leg_time_from, quickest_chain
from renew.paths.corridor import SLACK, Corridor
from renew.paths.sections import (
    WaterAround,
    points_beside,
    refined_on_transversals,
    with_transversals,
    without_detours,
)
from renew.paths.speed_profile import SpeedProfile, TimedPath
from renew.voyage.voyage import shares

# Spacing of the first part's sections, as a share of the midline. With few sections of many points,
# legs can take almost any course.
_COARSE_SPACING = 1 / 14
# Angle between these sections in a fan, rad.
_COARSE_ANGLE = math.radians(30)
# Number of points on each of these sections.
_COARSE_POINTS = 41
# Spacing if legs that long can't round a corner of V, or cross overpowered water.
_SHORT_SPACING = 1 / 64
# Spacings in narrow water, where only a thin line may be left.
_CLOSE_SPACINGS = 1 / 256, 1 / 1024, 1 / 4096
# Angle in these cases, rad.
_SHORT_ANGLE = math.radians(9)
# A turn from this angle (rad) on is a bend: each pass halves the legs beside it.
BEND = math.radians(5)
# Distance of transversals at which these legs are not halved any more, as a share of v/ω.
MIN_SPACING = 0.25


class _Pass(NamedTuple):
    """A pass over transversals: half-width and spacing (shares of the path), points on each.

    Legs beside a turn of at least `bend` (rad) are halved. Where the time of passage is chosen too,
    the least fuel is computed in each row at `times` times, which span a share `leeway` of the
    possible ones.
    """

    window: float
    spacing: float
    points: int
    bend: float
    times: int = 1
    leeway: float = 0.0


# Half-widths of the passes, as shares of the path, down to 1/4,000: 4 cm on the single gyre. Wider
# passes have more points, so that their legs can take almost any course.
_WINDOWS = tuple(0.15 * 0.45**step for step in range(9))
# Least distance of transversals in the first passes, as a share of the path.
_APART = 1 / 60
# Their distance in the last passes, which move points little.
_CLOSE = 1 / 80
_WIDE = tuple(
    _Pass(window, max(_APART, window / 4), points, math.inf)
    for window, points in zip(_WINDOWS, (17, 13, 9), strict=False)
)
_NARROWING = tuple(_Pass(window, _CLOSE, 7, BEND) for window in _WINDOWS[3:])
# Passes before the narrowest one find little after Newton's method.
_NARROW = (
    *(narrowing._replace(spacing=_APART) for narrowing in _NARROWING[:3]),
    _NARROWING[3],
    _NARROWING[5],
)
# Passes for small eddies: a wide window would hold several eddies, between which the first path has
# already chosen; and the path bends more often.
_WIDE_IN_EDDIES = (_WIDE[2]._replace(spacing=_CLOSE, points=13),)
_NARROW_IN_EDDIES = (
    *_NARROWING[:3],
    *(narrowing._replace(spacing=1 / 160) for narrowing in _NARROWING[3:]),
)
# Largest shift of points by Newton's method, as a share of the path.
_FARTHEST = 0.075
# Turns a point (x, y) into x + iy, so that points can be looked up among others.
_AS_COMPLEX = np.array([1, 1j])


def check_straits(corridor: Corridor) -> None:
    """Raise InfeasibleError, with the strait, if V blocks the corridor."""
    for part, _ in corridor.parts(_midline(corridor)):
        part.open_sections(_COARSE_SPACING * length_of(_midline(part)), _COARSE_ANGLE)


def path_near(corridor: Corridor, first: FloatArray) -> FloatArray:
    """Return a nearly least-fuel path (n, 2) near a first path of the class that may touch V.

    Post-condition: as for :func:`path_through_sections`, if there is such a path nearby.
    """
    has_small_eddies = corridor.voyage.table.has_small_eddies
    passes = _WIDE_IN_EDDIES if has_small_eddies else _WIDE
    return corridor.chained(
        lambda part, piece: _refined(part, piece, passes), corridor.voyage.cut(first)
    )


def path_through_sections(corridor: Corridor) -> FloatArray:
    """Return a roughly least-fuel path (n, 2) within the channel.

    Post-condition: the path enters V only around a start or goal inside V, and no leg crosses a
    current as strong as the vessel. Raises InfeasibleError, with the reason, if there is no path.
    """
    middle = corridor.voyage.cut(_midline(corridor))
    return corridor.chained(_through_some_sections, middle)


def path_through_close_sections(corridor: Corridor) -> FloatArray:
    """Return a rough path (n, 2) within a channel that leaves hardly any room in places.

    See :func:`path_through_sections`.
    """
    middle = corridor.voyage.cut(_midline(corridor))
    return corridor.chained(_through_close_sections, middle)


def _through_close_sections(corridor: Corridor, middle: FloatArray) -> FloatArray:
    """Return a rough path (n, 2) without via points, given the channel's midline (n, 2)."""
    length, *closer = (share * length_of(middle) for share in _CLOSE_SPACINGS)
    for spacing in closer:
        with contextlib.suppress(InfeasibleError):
            return _through_sections(corridor, length, _SHORT_ANGLE)
        length = spacing
    return _through_sections(corridor, length, _SHORT_ANGLE)


def _through_some_sections(corridor: Corridor, middle: FloatArray) -> FloatArray:
    """Return a rough path (n, 2) without via points, given the channel's midline (n, 2)."""
    length = length_of(middle)
    try:
        return _through_sections(corridor, _COARSE_SPACING * length, _COARSE_ANGLE)
    except InfeasibleError as error:
        if error.strait is not None:
            raise
        return _through_sections(corridor, _SHORT_SPACING * length, _SHORT_ANGLE)


def refined_path(corridor: Corridor, rough: FloatArray) -> FloatArray:
    """Return the least-fuel path (n, 2) near a rough one, even if V has grown into it since.

    Post-condition: as for :func:`path_through_sections`. Raises InfeasibleError if no way out of V
    is nearby, or V contains a via point.
    """
    for at, point in enumerate(corridor.voyage.via):
        beside = corridor.by_part[at : at + 2]
        needed = max(padded.around(point).padding.max(initial=0.0) for padded in beside)
        if needed > 0:
            raise InfeasibleError(
                "the via point {0} lies within the padding, {1} there, where the vessel can't "
                "turn away; move it further off",
                point,
                Length(float(needed)),
            )
    return corridor.chained(_refined_part, corridor.voyage.cut(rough))


def _refined_part(corridor: Corridor, rough: FloatArray) -> FloatArray:
    """Return the least-fuel path (n, 2) near a rough one, without via points."""
    has_small_eddies = corridor.voyage.table.has_small_eddies
    *wider, narrowest = _NARROW_IN_EDDIES if has_small_eddies else _NARROW
    path = _straightened(corridor, _refined(corridor, rough, wider))
    # Points of legs that touch V have stayed where they were.
    path = _refined(corridor, path, [narrowest, narrowest])
    if not corridor.legs_clear(path).all():
        raise InfeasibleError("its path lies in V, and no path clear of V is near")
    return simplified(corridor, path)


def _refined(corridor: Corridor, path: FloatArray, passes: Sequence[_Pass]) -> FloatArray:
    """Return a path (n, 2) after passes over transversals."""
    path = corridor.straight_in_soft_ends(path)
    length = length_of(path)
    closest = MIN_SPACING * corridor.voyage.vessel.turning_radius
    water = WaterAround(corridor.stream, corridor.search_capsules)
    # A pass moves the path by at most its window. Windows shrink: their sum is twice the first.
    within = capsules_near(water.capsules, path, 2 * passes[0].window * length)
    water, exempt = water.near(within), corridor.exempt[:, within]
    keep_whole = np.asarray(corridor.exempt.any(axis=1))
    # A channel of many triangles gives a path of many points.
    path = without_detours(path, 2 * passes[0].spacing * length, water)
    for stage in passes:
        path = with_transversals(path, stage.spacing * length, stage.bend, closest, keep_whole)
        window, longest = stage.window * length, 2 * stage.spacing * length
        # Legs connect points inside windows beside the path.
        near = capsules_near(water.capsules, path, window)
        path = refined_on_transversals(
            path, window, stage.points, longest, water.near(near), exempt[:, near].copy()
        )
    return path


def _straightened(corridor: Corridor, path: FloatArray) -> FloatArray:
    """Return a path (n, 2) with long stretches turned to their fastest course."""
    farthest = _FARTHEST * length_of(path)
    water = WaterAround(corridor.stream, corridor.search_capsules)
    water = water.near(capsules_near(water.capsules, path, farthest))
    return straightened(path, farthest, water, np.asarray(corridor.exempt.any(axis=1)))


def _midline(corridor: Corridor) -> FloatArray:
    """Return the line (n, 2) through the middles of a channel's passing edges."""
    return corridor.channel.midline(corridor.voyage.start, corridor.voyage.goal)


def length_of(path: FloatArray) -> float:
    """Return the length of a path (n, 2) in metres."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _through_sections(corridor: Corridor, spacing: float, angle: float) -> FloatArray:
    """Return the fastest path (n, 2) through points all over the channel's sections."""
    voyage = corridor.voyage
    sections, free = corridor.open_sections(spacing, angle)
    places = free.spread(_COARSE_POINTS)
    points = np.empty((len(places) + 2, max(places.shape[1], 1), 2))
    points[0], points[-1] = voyage.start, voyage.goal
    points[1:-1] = sections.points(places)
    arrival, chain = quickest_chain(
        points, corridor.stream, corridor.search_capsules, corridor.exempt
    )
    if not math.isfinite(arrival):
        raise InfeasibleError(
            "no leg between two sections is clear of V and of current as strong as the vessel"
        )
    return np.asarray(points[np.arange(len(points)), chain])


def simplified(corridor: Corridor, path: FloatArray) -> FloatArray:
    """Drop points that a nearly straight path does not need, if the new legs avoid V."""
    tolerance = SLACK * corridor.voyage.vessel.turning_radius
    left = shapely.get_coordinates(
        shapely.LineString(path).simplify(tolerance, preserve_topology=False)
    )
    kept = np.flatnonzero(np.isin(path @ _AS_COMPLEX, left @ _AS_COMPLEX))
    keep = np.zeros(len(path), dtype=bool)
    keep[kept] = True
    for leg in np.flatnonzero(~corridor.legs_clear(path[kept])):
        keep[kept[leg] : kept[leg + 1]] = True
    return np.asarray(path[keep])


# Passes of a path whose speeds are chosen in a changing current: each moves the path and its times
# of passage less than the one before.
_TIMED_PASSES = (
    _Pass(0.1, 1 / 30, 9, math.inf, 24, 1.0),
    _Pass(0.03, 1 / 60, 7, math.inf, 14, 0.4),
    *(_Pass(0.012 * 0.42**step, 1 / 80, 7, BEND, 11, 0.2 * 0.6**step) for step in range(3)),
)


def path_by_clock(corridor: Corridor, profile: SpeedProfile) -> FloatArray:
    """Return a path (n, 2) near a profile's path; it nearly always needs less fuel.

    Post-condition: that of :func:`refined_path`, if the profile met it.
    """
    voyage = corridor.voyage
    closest = MIN_SPACING * voyage.vessel.turning_radius
    keep_whole = np.asarray(corridor.exempt.any(axis=1))
    mean = length_of(profile.path) / float(profile.times[-1] - profile.times[0])
    vessel = voyage.vessel
    polar = sailing_at(min(mean, vessel.speed), voyage.drift == "crab", vessel.speed, vessel.law)
    water = WaterAround(Stream(voyage.table, polar, voyage.clock), corridor.search_capsules)
    schedule = shares(profile.path), profile.times
    path = without_detours(
        profile.path, 2 * _TIMED_PASSES[0].spacing * length_of(profile.path), water
    )
    best, least = path, math.inf
    for stage in _TIMED_PASSES:
        length = length_of(path)
        path = with_transversals(path, stage.spacing * length, stage.bend, closest, keep_whole)
        if len(path) < len(("start", "between", "goal")):
            break
        near = capsules_near(water.capsules, path, stage.window * length)
        beside, exempt = water.near(near).capsules, corridor.exempt[:, near].copy()
        points = points_beside(path, stage.window * length, stage.points, beside)
        way = TimedPath(path, voyage, as_it_is=True)
        if not way.can_be_made:
            continue
        passed = np.interp(shares(path), *schedule)
        chain = way.cheapest(
            points,
            legs_between(points, beside, exempt),
            _times(way.window(voyage.deadline), passed, stage, stage.window * length / mean),
            np.tile(way.speeds, (len(path) - 1, 1)),
            voyage.deadline,
        )
        if not math.isfinite(chain.cost):
            continue
        path = points[np.arange(len(points)), chain.points]
        schedule = shares(path), chain.times
        path = without_detours(path, 2 * stage.spacing * length, water.near(near))
        if chain.cost < least:
            best, least = path, chain.cost
    return simplified(corridor, best)


def _times(
    allowed: tuple[FloatArray, FloatArray], passed: FloatArray, stage: _Pass, sideways: float
) -> FloatArray:
    """Return the times (n, q), s, at which the least fuel is computed in each row of a pass.

    They are centred on the time of passage in the last pass, `passed` (n,), or, with a leeway of 1,
    on the middle of the `allowed` times. They extend by a further `sideways` (s) on both sides.
    """
    early, late = allowed
    middle = (early + late) / 2 if stage.leeway == 1 else passed
    half = stage.leeway * (late - early) / 2 + sideways
    return np.linspace(middle - half, middle + half, stage.times).T


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
        gradient, diagonal, beside = _derivatives(path, normals, times, stream)
        for _ in range(_TRIES):
            shift, found = _newton_step(gradient, diagonal, beside, damping, movable)
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
def _derivatives(
    path: FloatArray, normals: FloatArray, times: FloatArray, stream: Stream
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return derivatives of the arrival time by each point's shift along its normal, each (n,).

    They are the gradient, s/m, and the second derivatives, s/m²: by the same point's shift twice,
    and by its shift and the next point's. They are taken by differences, given the times (n,), s,
    at which legs begin.

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
    return gradient, diagonal, beside


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


@small_kernel
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


@small_kernel
def _place(x: float, y: float, time: float, stream: Stream) -> _Place:
    """Return the place of a point that is passed at a given time (s)."""
    site = site_of(stream.table, x, y)
    u, v = velocity_there(stream.table, site, time)
    return _Place(x, y, site, u, v)


@small_kernel
def _time_between(a: _Place, b: _Place, begin: float, stream: Stream) -> float:
    """Return the time (s) over a leg, which begins at a given time (s)."""
    leg = Segment(a.x, a.y, b.x, b.y)
    return leg_time_from(leg, a.u, a.v, b.site, begin, stream)


@kernel
def _newton_step(
    gradient: FloatArray,
    diagonal: FloatArray,
    beside: FloatArray,
    damping: float,
    movable: BoolArray,
) -> tuple[FloatArray, bool]:
    """Return the shift (n,), m, of each point, and whether it leads towards a minimum.

    The first three are as :func:`_derivatives` returns them.
    By Cholesky's method for tridiagonal systems; `damping` is a share of the mean diagonal.
    """
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
