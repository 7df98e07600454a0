"""The least-fuel path in one homotopy class, outside its soft no-go zone V.

A dynamic programme in two parts. The first runs over sections of the channel: few sections with
many points each, to find the right way round. The second refines this path on transversals, which
are perpendicular lines from V to V, in ever narrower windows. So the path can bend, and bulge out
of its channel: the least-fuel path of a class may leave its row of triangles across open water and
come back. Before the last pass, Newton's method moves all points at once.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import InfeasibleError, Length
from renew.kernels.capsules import capsules_near
from renew.kernels.cheapest_chain import legs_between
from renew.kernels.ground_speed import sailing_at
from renew.kernels.viterbi import Stream, quickest_chain
from renew.paths.corridor import SLACK, Corridor
from renew.paths.newton import straightened
from renew.paths.sections import (
    WaterAround,
    points_beside,
    refined_on_transversals,
    with_transversals,
    without_detours,
)
from renew.paths.speed_profile import SpeedProfile
from renew.paths.speeds_by_clock import TimedPath
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
# Angle in that case, rad.
_SHORT_ANGLE = math.radians(9)
# A turn from this angle (rad) on is a bend: each pass halves the legs beside it.
BEND = math.radians(5)
# Distance of transversals at which these legs are not halved any more, as a share of v/ω.
MIN_SPACING = 0.25


class _Pass(NamedTuple):
    """A pass over transversals: half-width and spacing (shares of the path), points on each.

    Legs beside a turn of at least `bend` (rad) are halved.
    """

    window: float
    spacing: float
    points: int
    bend: float


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
    *(one._replace(spacing=_APART) for one in _NARROWING[:3]),
    _NARROWING[3],
    _NARROWING[5],
)
# Passes for small eddies: a wide window would hold several eddies, between which the first path has
# already chosen; and the path bends more often.
_WIDE_IN_EDDIES = (_WIDE[2]._replace(spacing=_CLOSE, points=13),)
_NARROW_IN_EDDIES = (
    *_NARROWING[:3],
    *(one._replace(spacing=1 / 160) for one in _NARROWING[3:]),
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
    for one in passes:
        path = with_transversals(path, one.spacing * length, one.bend, closest, keep_whole)
        window, longest = one.window * length, 2 * one.spacing * length
        # Legs connect points inside windows beside the path.
        near = capsules_near(water.capsules, path, window)
        path = refined_on_transversals(
            path, window, one.points, longest, water.near(near), exempt[:, near].copy()
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


class _TimedPass(NamedTuple):
    """A pass over transversals: half-width and spacing (shares of the path), points on each.

    Legs beside a turn of more than `bend` (rad) are halved. In each row the least fuel is computed
    at `times` times, which span a share `leeway` of the possible times of passage.
    """

    window: float
    spacing: float
    points: int
    bend: float
    times: int
    leeway: float


_TIMED_PASSES = (
    _TimedPass(0.1, 1 / 30, 9, math.inf, 24, 1.0),
    _TimedPass(0.03, 1 / 60, 7, math.inf, 14, 0.4),
    *(_TimedPass(0.012 * 0.42**step, 1 / 80, 7, BEND, 11, 0.2 * 0.6**step) for step in range(3)),
)


def path_by_clock(corridor: Corridor, profile: SpeedProfile) -> FloatArray:
    """Return a path (n, 2) near a profile's path; it nearly always needs less fuel.

    Post-condition: that of :func:`refined_path`, if the profile met it.
    """
    voyage = corridor.voyage
    closest = MIN_SPACING * voyage.vessel.turning_radius
    keep_whole = np.asarray(corridor.exempt.any(axis=1))
    mean = length_of(profile.path) / float(profile.times[-1] - profile.times[0])
    polar = sailing_at(min(mean, voyage.vessel.speed), voyage.drift == "crab", voyage.vessel.speed)
    water = WaterAround(Stream(voyage.table, polar, voyage.clock), corridor.search_capsules)
    schedule = shares(profile.path), profile.times
    path = without_detours(
        profile.path, 2 * _TIMED_PASSES[0].spacing * length_of(profile.path), water
    )
    best, least = path, math.inf
    for one in _TIMED_PASSES:
        length = length_of(path)
        path = with_transversals(path, one.spacing * length, one.bend, closest, keep_whole)
        if len(path) < len(("start", "between", "goal")):
            break
        near = capsules_near(water.capsules, path, one.window * length)
        beside, exempt = water.near(near).capsules, corridor.exempt[:, near].copy()
        points = points_beside(path, one.window * length, one.points, beside)
        way = TimedPath(path, voyage, as_it_is=True)
        if not way.can_be_made:
            continue
        passed = np.interp(shares(path), *schedule)
        chain = way.cheapest(
            points,
            legs_between(points, beside, exempt),
            _times(way.window(voyage.deadline), passed, one, one.window * length / mean),
            np.tile(way.speeds, (len(path) - 1, 1)),
            voyage.deadline,
        )
        if not math.isfinite(chain.cost):
            continue
        path = points[np.arange(len(points)), chain.points]
        schedule = shares(path), chain.times
        path = without_detours(path, 2 * one.spacing * length, water.near(near))
        if chain.cost < least:
            best, least = path, chain.cost
    return simplified(corridor, best)


def _times(
    allowed: tuple[FloatArray, FloatArray], passed: FloatArray, one: _TimedPass, sideways: float
) -> FloatArray:
    """Return the times (n, q), s, at which the least fuel is computed in each row of a pass.

    They are centred on the time of passage in the last pass, `passed` (n,), or, with a leeway of 1,
    on the middle of the `allowed` times. They extend by a further `sideways` (s) on both sides.
    """
    early, late = allowed
    middle = (early + late) / 2 if one.leeway == 1 else passed
    half = one.leeway * (late - early) / 2 + sideways
    return np.linspace(middle - half, middle + half, one.times).T
