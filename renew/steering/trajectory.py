"""Turn a path into a trajectory that a vessel can steer: corners as arcs, headings, times.

A vessel that turns at ω while its ground speed is v' sails curves of radius r' = v'/ω, its
effective turning radius (paper, kinematic check). A corner that turns by δ between legs of lengths
a and b can be rounded with that radius if r' tan(δ/2) <= min(a, b) / 2.

A least-fuel path that wraps the corner of a no-go zone can't be rounded inwards, because the zone
is there. So a disc of the turning radius is put inside the corner, touching it from within, and the
path is drawn taut around the discs, like a string. The string leaves the first leg before the
corner, passes through the corner on an arc, and meets the next leg behind it, always outside the
zone.
"""

import math
from dataclasses import dataclass

import numpy as np

from renew._compiled import for_kernels, kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.errors import InfeasibleError, TooSharpError
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentField
from renew.kernels.capsules import Capsules, legs_are_clear, wrapped
from renew.kernels.ground_speed import made_at
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
    chart: Chart | None = None,
) -> FloatArray:
    """Return the trajectory (m, 4) along a path (n, 2): t (s), x, y (m), heading (rad).

    It begins at the departure, on the clock of a changing current, and has rounded corners. Legs
    are sailed at the vessel's speed, or at speeds (n - 1,) through water. With a `chart`, by its
    metres.

    The vessel crabs: in each row the ground velocity v (cos θ, sin θ) + c runs along the path.
    Post-condition: |Δθ/Δt| <= ω between rows. Raises InfeasibleError, with the reason, if that is
    impossible.
    """
    own = np.full(len(path) - 1, vessel.speed) if speeds is None else speeds
    # The vessel's turns are those of the plane, and the trajectory's times those of true metres.
    turn_rate = vessel.turn_rate if chart is None else vessel.turn_rate / float(chart.metres.min())
    times = reading_times(path, current, vessel, "crab", departure, own, chart)
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
        lengths = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
        if chart is not None:
            lengths *= chart.true_metres(middles)
        guess = np.interp(shares(curve.points), shares(path), times)
        trajectory = _crab_along(curve, current, (through_water, lengths), guess)
        turning = np.abs(np.diff(trajectory[:, 3]))
        excess = turning / np.maximum(turn_rate * np.diff(trajectory[:, 0]), 1e-300)
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
        f"{np.degrees(turn_rate):.1f} degrees a second",
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
    curve: _Curve,
    current: CurrentField,
    legs: tuple[FloatArray, FloatArray],
    guess: FloatArray,
) -> FloatArray:
    """Return the trajectory (m, 4) along a curve: crab headings, times by the trapezoidal rule.

    The times (m,), s, are a guess: the first is the departure, and the others shorten the search.
    `legs` are sailed at speeds (m - 1,) through water and have lengths (m - 1,) in true metres;
    where the speed changes, the heading is that of the mean.
    """
    velocity, (through_water, lengths) = np.empty(curve.points.shape), legs

    def durations(some: slice, times: FloatArray) -> FloatArray:
        """Return the time (p,), s, over some legs, given the times (p + 1,) at their ends."""
        ends = slice(some.start, some.stop + 1)
        velocity[ends] = current.velocity(curve.points[ends], times)
        return _durations(lengths[some], curve.course[ends], velocity[ends], through_water[some])

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
    lengths: FloatArray, course: FloatArray, velocity: FloatArray, through_water: FloatArray
) -> FloatArray:
    """Return the time (n - 1,), s, over each leg in currents (n, 2); inf if no way is made."""
    durations = np.empty(len(lengths))
    for k in range(len(durations)):
        slowness = 0.0
        for at in (k, k + 1):
            u, v = velocity[at]
            tx, ty = math.cos(course[at]), math.sin(course[at])
            made = made_at(u, v, tx, ty, through_water[k], crab=True)
            slowness += 1.0 / made if made > 0.0 else math.inf
        durations[k] = lengths[k] * slowness / 2
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
        made = made_at(u, v, tx, ty, speed, crab=True)
        heading = math.atan2(made * ty - v, made * tx - u)
        headings[k] = heading if k == 0 else headings[k - 1] + wrapped(heading - headings[k - 1])
    return headings


def effective_turning_radius(
    velocity: FloatArray, heading: FloatArray, vessel: Vessel
) -> FloatArray:
    """Return the radius |v (cos φ, sin φ) + c| / ω (...), m, in currents c on headings φ."""
    through_water = vessel.speed * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    over_ground = np.linalg.norm(through_water + velocity, axis=-1)
    return np.asarray(over_ground / vessel.turn_rate)


def steerable(
    paths: FloatArray, current: CurrentField, vessel: Vessel, times: float | FloatArray = 0.0
) -> BoolArray:
    """Whether every corner of each path (..., n, 2) can be rounded with r' (paper's check).

    Corners are passed at `times` (..., n - 2), s.
    """
    lengths = np.linalg.norm(np.diff(paths, axis=-2), axis=-1)
    room = np.minimum(lengths[..., :-1], lengths[..., 1:]) / 2
    course = np.arctan2(*np.moveaxis(np.diff(paths, axis=-2), -1, 0)[::-1])
    turns = wrapped(np.diff(course, axis=-1))
    velocity = current.velocity(paths[..., 1:-1, :], times)
    radius = np.maximum(
        effective_turning_radius(velocity, course[..., :-1], vessel),
        effective_turning_radius(velocity, course[..., 1:], vessel),
    )
    needed = radius * np.tan(np.abs(turns) / 2)
    return np.asarray((needed <= room).all(axis=-1))


@kernel
def course_changes(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a path's turns (n - 2,), rad, port positive, and unit vectors (n - 2, 2).

    The unit vectors bisect its corners, on the inside of the turn.
    """
    turns, inwards = np.zeros(len(path) - 2), np.zeros((len(path) - 2, 2))
    before = 0.0
    for leg in range(len(path) - 1):
        course = math.atan2(path[leg + 1, 1] - path[leg, 1], path[leg + 1, 0] - path[leg, 0])
        if leg > 0:
            turn = wrapped(course - before)
            middle = before + turn / 2 + math.copysign(math.pi / 2, turn)
            turns[leg - 1] = turn
            inwards[leg - 1, 0], inwards[leg - 1, 1] = math.cos(middle), math.sin(middle)
        before = course
    return turns, inwards


def corner_radius(
    path: FloatArray,
    current: CurrentField,
    vessel: Vessel,
    times: float | FloatArray = 0.0,
    speeds: FloatArray | None = None,
) -> FloatArray:
    """Return the smallest radius (n - 2,), m, over ground that can be steered at inner corners.

    At a course χ with crab angle β (sin β = c⊥ / v) the heading turns by V / (v cos β) per radian
    of χ, where V is the speed over ground. So a curve at rate ω needs a radius of V² / (ω v cos β).
    In a following current that is more than r' = V / ω. The larger radius of the two legs counts;
    if the course can't be held, r' with V = v + |c|. Corners are passed at `times` (n - 2), s; legs
    are sailed at the vessel's speed, or at speeds (n - 1,).
    """
    if speeds is None:
        speeds = np.full(len(path) - 1, vessel.speed)
    velocity = for_kernels(current.velocity(path[1:-1], times))
    return _corner_radius(for_kernels(path), velocity, speeds, vessel.turn_rate)


@kernel
def _corner_radius(
    path: FloatArray, velocity: FloatArray, speeds: FloatArray, turn_rate: float
) -> FloatArray:
    """Return the radii (n - 2,), m, given the current (n - 2, 2) at the corners."""
    radius = np.zeros(len(velocity))
    for k in range(len(velocity)):
        u, v = velocity[k]
        for leg in (k, k + 1):
            dx, dy = path[leg + 1, 0] - path[leg, 0], path[leg + 1, 1] - path[leg, 1]
            length = math.hypot(dx, dy)
            needed = math.nan
            if length > 0.0:
                along, across = (u * dx + v * dy) / length, (v * dx - u * dy) / length
                # Component of the speed through water along the course: v cos β.
                forward = speeds[leg] * speeds[leg] - across * across
                if forward > 0.0:
                    forward = math.sqrt(forward)
                    needed = (along + forward) ** 2 / (turn_rate * forward)
            if math.isnan(needed):
                needed = (speeds[leg] + math.hypot(u, v)) / turn_rate
            radius[k] = max(radius[k], needed)
    return radius


# Angle (rad) between the vertices of an arc's polyline (vertices outside the arc, edges tangent).
_DISC_STEP = math.radians(4)
# At a disc the string may seem to turn to the wrong side, because angles are known only up to whole
# turns. From this angle (rad) on, the string really turns to the disc's side by more than half a
# circle: it comes back almost on its own line, and runs around the disc.
_AROUND = math.radians(135)


def round_corners(
    path: FloatArray, sharp: BoolArray, radius: FloatArray, *, together: bool = False
) -> tuple[FloatArray, IntArray]:
    """Draw a path's sharp corners (n - 2,) around discs of given radii (n - 2,), m.

    Returns the path (m, 2), and for each of its points the point (m,) of the given path (n, 2).
    With `together`, a disc that covers several corners is turned about its own corner to suit them
    all.
    """
    turns, bisectors = course_changes(path)
    # A point of the path that is not sharp is a disc of radius 0.
    size = np.where(sharp, radius, 0.0)
    centres = path.copy()
    centres[1:-1] += size[:, None] * bisectors
    radii, sides = np.zeros(len(path)), np.ones(len(path))
    radii[1:-1], sides[1:-1] = size, np.where(turns >= 0, 1.0, -1.0)
    kept, courses, clash = _taut_string(centres, radii, sides)
    if together and clash < 0:
        centres = _with_turned_discs(path, centres, radii, sides, kept, courses)
        kept, courses, clash = _taut_string(centres, radii, sides)
    if clash >= 0:
        raise InfeasibleError(
            "two opposite turns near {0} are too close together to be steered", centres[clash]
        )
    points, disc = _drawn(centres[kept], radii[kept], sides[kept], courses)
    return points, kept[disc]


@kernel
def _with_turned_discs(
    path: FloatArray,
    centres: FloatArray,
    radii: FloatArray,
    sides: FloatArray,
    kept: IntArray,
    courses: FloatArray,
) -> FloatArray:
    """Return centres (n, 2), where each kept disc that covers other corners is turned.

    Around several corners the string turns differently than at one. So the disc is turned about its
    own corner, towards the middle of the courses before and behind the disc. It turns only as far
    as the other corners stay inside it.
    """
    turned = centres.copy()
    for at in range(1, len(kept) - 1):
        k = kept[at]
        radius = radii[k]
        now = math.atan2(centres[k, 1] - path[k, 1], centres[k, 0] - path[k, 0])
        middle = courses[at - 1] + _turn(courses[at - 1], courses[at], sides[k]) / 2
        change, has_others = wrapped(middle + sides[k] * math.pi / 2 - now), False
        for other in range(kept[at - 1] + 1, kept[at + 1]):
            dx, dy = path[other, 0] - path[k, 0], path[other, 1] - path[k, 1]
            apart = math.hypot(dx, dy)
            away = math.hypot(path[other, 0] - centres[k, 0], path[other, 1] - centres[k, 1])
            if apart == 0.0 or away > radius:
                continue
            has_others = True
            # Seen from the disc's corner, the disc covers the other corner if the direction to the
            # centre and the direction to that corner differ by at most `widest`.
            widest, off = math.acos(apart / (2 * radius)), wrapped(math.atan2(dy, dx) - now)
            change = min(max(change, min(off - widest, 0.0)), max(off + widest, 0.0))
        if has_others:
            turned[k, 0] = path[k, 0] + radius * math.cos(now + change)
            turned[k, 1] = path[k, 1] + radius * math.sin(now + change)
    return turned


@kernel
def _taut_string(
    centres: FloatArray, radii: FloatArray, sides: FloatArray
) -> tuple[IntArray, FloatArray, int]:
    """Draw the string: drop discs that the string doesn't touch until it touches all others.

    At a disc of side 1 the string turns to port, at a disc of side -1 to starboard. Returns the
    kept discs (m,), the courses (m - 1,), rad, between them, and -1. If two neighbouring discs on
    opposite sides of the string overlap too far, the first of them is returned in place of the -1.
    The first of two neighbours is also returned if one of them is the first or the last point and
    lies inside the other.
    """
    kept = np.arange(len(radii))
    courses = np.empty(len(radii) - 1)
    while True:
        nested = False
        for k in range(len(kept) - 1):
            one, other = kept[k], kept[k + 1]
            dx, dy = centres[other, 0] - centres[one, 0], centres[other, 1] - centres[one, 1]
            apart = math.hypot(dx, dy)
            # Each centre lies to port of the leg, by side * radius. The difference of these offsets
            # is `apart` times the sine of the angle between the leg and the line of centres.
            offset = sides[other] * radii[other] - sides[one] * radii[one]
            if apart == 0.0 or abs(offset) > apart:
                inner = k if radii[one] < radii[other] else k + 1
                if sides[one] != sides[other] or inner in (0, len(kept) - 1):
                    return kept, courses, one
                # The string round a disc doesn't touch a disc inside it: start again without that.
                kept, nested = np.concatenate((kept[:inner], kept[inner + 1 :])), True
                break
            courses[k] = math.atan2(dy, dx) - math.asin(offset / apart)
        if nested:
            continue
        # Drop one disc at a time, the slackest: the string may then touch its neighbours again.
        worst, slackest = -1, 0.0
        for k in range(1, len(kept) - 1):
            turn = _turn(courses[k - 1], courses[k], sides[kept[k]])
            if radii[kept[k]] > 0 and sides[kept[k]] * turn < 0 and abs(turn) > slackest:
                worst, slackest = k, abs(turn)
        if worst < 0:
            return kept, courses[: len(kept) - 1], -1
        kept = np.concatenate((kept[:worst], kept[worst + 1 :]))


@kernel
def _turn(before: float, after: float, side: float) -> float:
    """Return the angle (rad) by which the string turns at a disc on this side, port positive."""
    turn = wrapped(after - before)
    return turn + side * 2 * math.pi if side * turn < -_AROUND else turn


@kernel
def _drawn(
    centres: FloatArray, radii: FloatArray, sides: FloatArray, courses: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Return the string's vertices (m, 2), arcs as tangent polylines, and the disc (m,) of each."""
    last = len(radii) - 1
    turns = np.zeros(last + 1)
    steps = np.ones(last + 1, dtype=np.int64)
    for k in range(1, last):
        turns[k] = _turn(courses[k - 1], courses[k], sides[k])
        if radii[k] > 0:
            steps[k] = max(1, math.ceil(abs(turns[k]) / _DISC_STEP))
    points = np.empty((steps.sum(), 2))
    disc = np.empty(len(points), dtype=np.int64)
    at = 0
    for k in range(last + 1):
        outer = radii[k] / math.cos(turns[k] / steps[k] / 2)
        for step in range(steps[k]):
            middle = (courses[k - 1] if k else 0.0) + turns[k] * (step + 0.5) / steps[k]
            outwards = middle - sides[k] * math.pi / 2
            points[at, 0] = centres[k, 0] + outer * math.cos(outwards)
            points[at, 1] = centres[k, 1] + outer * math.sin(outwards)
            disc[at] = k
            at += 1
    return points, disc


# Distance, in chords of a sharp corner's disc, within which other corners obstruct its rounding.
_CROWDING = 1.5


@kernel
def sharp_corners(path: FloatArray, radius: FloatArray, no_go: Capsules) -> BoolArray:
    """Return whether each inner corner (n - 2,) of a path (n, 2) can't be rounded inwards.

    A corner can't be rounded inwards if an arc of its radius (n - 2,), m, would enter the no-go
    capsules, or if a leg is too short for the arc.
    """
    corners = len(radius)
    turns, bisectors = course_changes(path)
    tangent = np.zeros(corners + 2)
    begin, inner, end = np.empty((corners, 2)), np.empty((corners, 2)), np.empty((corners, 2))
    for k in range(corners):
        half = abs(turns[k]) / 2
        tangent[k + 1] = radius[k] * math.tan(half)
        inwards = radius[k] * (1 / math.cos(half) - 1)
        x, y = path[k + 1]
        inner[k, 0], inner[k, 1] = x + inwards * bisectors[k, 0], y + inwards * bisectors[k, 1]
        begin[k, 0], begin[k, 1] = _along(path[k + 1], path[k], tangent[k + 1])
        end[k, 0], end[k, 1] = _along(path[k + 1], path[k + 2], tangent[k + 1])
    # Chords lie inside the arc, so test the chords, not the arc.
    before, behind = legs_are_clear(begin, inner, no_go), legs_are_clear(inner, end, no_go)
    sharp = np.empty(corners, dtype=np.bool_)
    for k in range(corners):
        sharp[k] = not (before[k] and behind[k])
    for leg in range(corners + 1):
        dx, dy = path[leg + 1, 0] - path[leg, 0], path[leg + 1, 1] - path[leg, 1]
        if tangent[leg] + tangent[leg + 1] > math.hypot(dx, dy):
            # Of the leg's two corners, the one whose arc needs more of the leg is sharp; the start
            # is no corner.
            asks_more = leg > 0 and tangent[leg] >= tangent[leg + 1]
            sharp[leg - 1 if asks_more else leg] = True
    return sharp


@kernel
def _along(a: FloatArray, b: FloatArray, distance: float) -> tuple[float, float]:
    """Return the point at a distance (m) from a towards b, or a if the points coincide."""
    x, y = b[0] - a[0], b[1] - a[1]
    share = distance / max(math.hypot(x, y), 1e-300)
    return a[0] + share * x, a[1] + share * y


@kernel
def crowding(path: FloatArray, sharp: BoolArray, radius: FloatArray) -> BoolArray:
    """Return whether each inner corner (n - 2,) of a path (n, 2) obstructs a sharp corner.

    The sharp corners' discs have radii (n - 2,), m.
    """
    turns, _ = course_changes(path)
    along = np.zeros(len(turns))
    for k in range(1, len(turns)):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        along[k] = along[k - 1] + math.hypot(dx, dy)
    is_crowding = np.zeros(len(turns), dtype=np.bool_)
    for k in range(len(turns)):
        if not sharp[k]:
            continue
        # A disc that touches the corner from within cuts this chord off both legs.
        chord = 2 * radius[k] * math.sin(abs(turns[k]) / 2)
        for other in range(len(turns)):
            if not sharp[other] and abs(along[other] - along[k]) <= _CROWDING * chord:
                is_crowding[other] = True
    return is_crowding
