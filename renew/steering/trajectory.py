"""Turn a path into a trajectory that a vessel can steer: corners as arcs, headings, times."""

import math
from dataclasses import dataclass

import numpy as np

from renew._compiled import for_kernels, kernel
from renew._types import FloatArray, IntArray
from renew.errors import InfeasibleError, TooSharpError
from renew.inputs.current import CurrentField
from renew.inputs.vessel import Vessel
from renew.kernels.capsules import wrapped
from renew.kernels.ground_speed import ground_speed, sailing_at
from renew.steering.corners import corner_radius, course_changes
from renew.voyage.fuel import reading_times, speeds_along, times_under_way
from renew.voyage.voyage import shares

# Angle (rad) between an arc's points: chords deviate from it by 0.02 % of the radius.
_ARC_STEP = math.radians(2)
# Number of samples on all straight legs: the heading follows a changing current.
_LEG_SAMPLES = 256
# Factor by which arcs are wider than the corner itself needs, because the current changes along
# them.
_MARGIN = 1.05
# An arc on which the heading turns faster than ω gets a radius larger by that excess times this
# factor.
_RADIUS_GROWTH = 1.003
# Largest number of times that radii grow so.
_MAX_GROWTHS = 20
# Length of a leg that counts as 0, as a share of the path.
_NO_LENGTH = 1e-9
# Largest turn (rad), from rounding, at a point where only the speed changes.
_STRAIGHT = 1e-9


def steer(
    path: FloatArray,
    current: CurrentField,
    vessel: Vessel,
    departure: float = 0.0,
    speeds: FloatArray | None = None,
) -> FloatArray:
    """Return the trajectory (m, 4) along a path (n, 2): t (s), x, y (m), heading (rad).

    It begins at the departure, on the clock of a changing current, and has rounded corners. Legs
    are sailed at the vessel's speed, or at speeds (n - 1,) through water.

    The vessel crabs: in each row the ground velocity v (cos θ, sin θ) + c runs along the path.
    Post-condition: |Δθ/Δt| <= ω between rows. Raises InfeasibleError, with the reason, if that is
    impossible.
    """
    own = np.full(len(path) - 1, vessel.speed) if speeds is None else speeds
    times = reading_times(path, current, vessel, "crab", departure, own)
    radius = corner_radius(path, current, vessel, times[1:-1], own)
    corners = path
    if speeds is not None:
        # Where only the speed changes there is no corner; legs beside a corner are longer.
        turn, _ = course_changes(path)
        is_corner = np.concatenate([[True], np.abs(turn) > _STRAIGHT, [True]])
        corners, radius = path[is_corner], radius[is_corner[1:-1]]
    if _have_room(corners, _MARGIN * radius):
        radius = _MARGIN * radius
    for _ in range(_MAX_GROWTHS):
        curve = _rounded(corners, radius)
        middles = (curve.points[:-1] + curve.points[1:]) / 2
        through_water = speeds_along(middles, path, own)
        guess = np.interp(shares(curve.points), shares(path), times)
        trajectory = _crab_along(curve, current, through_water, guess)
        turning = np.abs(np.diff(trajectory[:, 3]))
        excess = turning / np.maximum(vessel.turn_rate * np.diff(trajectory[:, 0]), 1e-300)
        fast = excess > 1 + 1e-9
        if not fast.any():
            return trajectory
        growth = np.ones(len(radius) + 1)  # the last for points on a leg, -1
        for ends in (curve.corner[:-1], curve.corner[1:]):
            np.maximum.at(growth, ends[fast], _RADIUS_GROWTH * excess[fast])
        if growth[:-1].max(initial=1.0) == 1.0:
            # The current changes too fast along a leg; no radius helps.
            break
        radius = radius * growth[:-1]
    where = trajectory[:-1][fast][0]
    raise InfeasibleError(
        "to hold the course at {0} in the current there the vessel would have to turn faster than "
        f"{np.degrees(vessel.turn_rate):.1f} degrees a second",
        where[1:3],
    )


@dataclass(frozen=True, slots=True)
class _Curve:
    """A path with its corners as arcs: points (m, 2), course (m,) rad, corner or -1 (m,)."""

    points: FloatArray
    course: FloatArray
    corner: IntArray


def _have_room(path: FloatArray, radius: FloatArray) -> bool:
    """Whether a path's legs (n, 2) are long enough for arcs of radii (n - 2,) at its corners."""
    *_, asked, length = _with_arcs(for_kernels(path), radius)
    return bool((asked <= length).all())


def _rounded(path: FloatArray, radius: FloatArray) -> _Curve:
    """Round every corner of a path (n, 2) with its radius (n - 2,), and sample the legs."""
    points, course, corner, asked, length = _with_arcs(for_kernels(path), radius)
    if (asked > length).any():
        raise TooSharpError.at_points(path, asked, length)
    return _Curve(*_densified(points, course, corner))


@kernel
def _with_arcs(
    path: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Return points (m, 2), course (m,) rad and corner or -1 (m,) of a path (n, 2) with arcs.

    Also return how much of each leg (n - 1,) its corners need, and the leg's length, m.
    """
    inner = len(radius)
    turns, first_course = np.zeros(inner + 1), 0.0
    lengths, tangent = np.empty(inner + 1), np.zeros(inner + 2)
    # Each corner becomes the points of an arc; the path's ends stay single points.
    steps, count = np.zeros(inner + 1, dtype=np.int64), 2
    last = 0.0
    for k in range(inner + 1):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        lengths[k], towards = math.hypot(dx, dy), math.atan2(dy, dx)
        if k == 0:
            first_course = towards
        else:
            turns[k] = wrapped(towards - last)
            tangent[k] = radius[k - 1] * math.tan(abs(turns[k]) / 2)
            steps[k] = max(1, math.ceil(abs(turns[k]) / _ARC_STEP))
            count += steps[k] + 1
        last = towards
    # A leg is divided between its two corners in proportion to their needs.
    asked = np.empty(inner + 1)
    for k in range(inner + 1):
        asked[k] = (tangent[k] + tangent[k + 1]) * (1 - 1e-12)
    points, course = np.empty((count, 2)), np.empty(count)
    corner = np.full(count, -1, dtype=np.int64)
    points[0, 0], points[0, 1], course[0] = path[0, 0], path[0, 1], first_course
    at, behind = 1, first_course
    for k in range(1, inner + 1):
        side = 1.0 if turns[k] >= 0 else -1.0
        ux = (path[k, 0] - path[k - 1, 0]) / lengths[k - 1]
        uy = (path[k, 1] - path[k - 1, 1]) / lengths[k - 1]
        centre_x = path[k, 0] - tangent[k] * ux - side * radius[k - 1] * uy
        centre_y = path[k, 1] - tangent[k] * uy + side * radius[k - 1] * ux
        for place in range(steps[k] + 1):
            course[at] = behind + turns[k] * place / steps[k]
            outwards = course[at] - side * math.pi / 2
            points[at, 0] = centre_x + radius[k - 1] * math.cos(outwards)
            points[at, 1] = centre_y + radius[k - 1] * math.sin(outwards)
            corner[at] = k - 1
            at += 1
        behind += turns[k]
    points[at, 0], points[at, 1], course[at] = path[-1, 0], path[-1, 1], behind
    return points, course, corner, asked, lengths


@kernel
def _densified(
    points: FloatArray, course: FloatArray, corner: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Cut long legs so that headings follow the current along them; drop legs of length 0."""
    whole = 0.0
    for k in range(1, len(points)):
        whole += math.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
    kept, lengths = [0], [0.0]
    for k in range(1, len(points)):
        length = math.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
        if length > _NO_LENGTH * whole:
            kept.append(k)
            lengths.append(length)
    pieces = [max(1, math.ceil(_LEG_SAMPLES * length / whole)) for length in lengths[1:]]
    count = sum(pieces) + 1
    dense, courses = np.empty((count, 2)), np.empty(count)
    corners = np.full(count, -1, dtype=np.int64)
    at = 0
    for leg in range(len(pieces)):
        here, there = kept[leg], kept[leg + 1]
        corners[at] = corner[here]
        for piece in range(pieces[leg]):
            place = piece / pieces[leg]
            for d in range(2):
                dense[at, d] = points[here, d] + place * (points[there, d] - points[here, d])
            courses[at] = course[here] + place * (course[there] - course[here])
            at += 1
    last = kept[-1]
    dense[at, 0], dense[at, 1] = points[last, 0], points[last, 1]
    courses[at], corners[at] = course[last], corner[last]
    return dense, courses, corners


def _crab_along(
    curve: _Curve, current: CurrentField, through_water: FloatArray, guess: FloatArray
) -> FloatArray:
    """Return the trajectory (m, 4) along a curve: crab headings, times by the trapezoidal rule.

    The times (m,), s, are a guess: the first is the departure, and the others shorten the search.
    Legs are sailed at speeds (m - 1,) through water; where these change, the heading is that of
    their mean.
    """
    velocity = np.empty(curve.points.shape)

    def durations(some: slice, times: FloatArray) -> FloatArray:
        """Return the time (p,), s, over some legs, given the times (p + 1,) at their ends."""
        ends = slice(some.start, some.stop + 1)
        velocity[ends] = current.velocity(curve.points[ends], times)
        return _durations(
            curve.points[ends], curve.course[ends], velocity[ends], through_water[some]
        )

    time = times_under_way(
        durations, len(through_water), float(guess[0]), is_steady=current.is_steady, guess=guess
    )
    if not math.isfinite(time[-1]):
        at = curve.points[~np.isfinite(time)][0]
        raise InfeasibleError("the current at {0} is too strong to hold the course", at)
    heading = _headings(curve.course, velocity, through_water)
    return np.column_stack([time, curve.points, heading])


@kernel
def _durations(
    points: FloatArray, course: FloatArray, velocity: FloatArray, through_water: FloatArray
) -> FloatArray:
    """Return the time (n - 1,), s, over each leg in currents (n, 2); inf if no way is made."""
    durations = np.empty(len(points) - 1)
    for k in range(len(durations)):
        polar, slowness = sailing_at(through_water[k], crab=True, most=0.0), 0.0
        for at in (k, k + 1):
            u, v = velocity[at]
            made = ground_speed(u, v, math.cos(course[at]), math.sin(course[at]), polar)
            slowness += 1.0 / made if made > 0.0 else math.inf
        way = math.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
        durations[k] = way * slowness / 2
    return durations


@kernel
def _headings(course: FloatArray, velocity: FloatArray, through_water: FloatArray) -> FloatArray:
    """Return continuous headings (n,), rad, that hold courses (n,) in currents (n, 2).

    At a point the speed is the mean of the speeds (n - 1,) before and behind it.
    """
    headings = np.empty(len(course))
    last = len(through_water) - 1
    for k in range(len(course)):
        speed = (through_water[max(k - 1, 0)] + through_water[min(k, last)]) / 2
        tx, ty = math.cos(course[k]), math.sin(course[k])
        u, v = velocity[k]
        made = ground_speed(u, v, tx, ty, sailing_at(speed, crab=True, most=0.0))
        heading = math.atan2(made * ty - v, made * tx - u)
        headings[k] = heading if k == 0 else headings[k - 1] + wrapped(heading - headings[k - 1])
    return headings
