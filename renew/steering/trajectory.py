"""From a path to a trajectory that a vessel can steer.

A vessel that turns at ω while it makes v' over ground sails curves of radius r' = v'/ω, its
effective turning radius (paper, kinematic check). A corner between legs of lengths a and b that
turns by δ can be rounded with that radius when r' tan(δ/2) <= min(a, b) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renew._types import BoolArray, FloatArray, IntArray
from renew.errors import InfeasibleError
from renew.inputs.current import CurrentField
from renew.inputs.fuel import ground_speed
from renew.inputs.vessel import Vessel

# An arc is sampled every 2 degrees, so that its chords leave it by 0.02 % of the radius.
_ARC_STEP = np.radians(2)
# Straight legs are sampled so that the heading is known along a current that changes.
_LEG_SAMPLES = 256
# Radii grow by this factor, so many times at the most, until the heading rate fits.
_RADIUS_GROWTH, _MOST_GROWTHS = 1.05, 20


def effective_turning_radius(
    points: FloatArray, heading: FloatArray, current: CurrentField, vessel: Vessel
) -> FloatArray:
    """Effective turning radius |v (cos φ, sin φ) + c| / ω (...), m, at points on headings φ."""
    through_water = vessel.speed * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    over_ground = np.linalg.norm(through_water + current(points), axis=-1)
    return np.asarray(over_ground / vessel.turn_rate)


def steerable(paths: FloatArray, current: CurrentField, vessel: Vessel) -> BoolArray:
    """Whether every corner of each path (..., n, 2) can be rounded with r' (paper's check)."""
    lengths = np.linalg.norm(np.diff(paths, axis=-2), axis=-1)
    room = np.minimum(lengths[..., :-1], lengths[..., 1:]) / 2
    turns, _ = course_changes(paths)
    course = np.arctan2(*np.moveaxis(np.diff(paths, axis=-2), -1, 0)[::-1])
    corners = paths[..., 1:-1, :]
    radius = np.maximum(
        effective_turning_radius(corners, course[..., :-1], current, vessel),
        effective_turning_radius(corners, course[..., 1:], current, vessel),
    )
    needed = radius * np.tan(np.abs(turns) / 2)
    return np.asarray((needed <= room).all(axis=-1))


def course_changes(paths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turns (..., n - 2) in rad, to port positive, and unit vectors (..., n - 2, 2) into them.

    The unit vectors halve the corners of the paths (..., n, 2), on the inside of the turn.
    """
    legs = np.diff(paths, axis=-2)
    course = np.arctan2(legs[..., 1], legs[..., 0])
    turns = _wrapped(np.diff(course, axis=-1))
    inwards = course[..., :-1] + turns / 2 + np.where(turns >= 0, np.pi / 2, -np.pi / 2)
    return turns, np.stack([np.cos(inwards), np.sin(inwards)], axis=-1)


def corner_radius(paths: FloatArray, current: CurrentField, vessel: Vessel) -> FloatArray:
    """Smallest radius (..., n - 2) in metres that can be steered over ground at inner corners.

    At a course χ with crab angle β (sin β = c⊥ / v) the heading turns by V / (v cos β) for each
    radian of χ, with V the speed over ground: following the curve at rate ω takes a radius of
    V² / (ω v cos β). In a following current that is more than r' = V / ω. The larger of both legs
    counts; where the course can't be held, r' with V = v + |c|.
    """
    corners, legs = paths[..., 1:-1, :], np.diff(paths, axis=-2)
    units = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
    velocity = current(corners)
    radius = np.zeros(corners.shape[:-1])
    for tangent in (units[..., :-1, :], units[..., 1:, :]):
        over_ground = ground_speed(velocity, tangent, vessel.speed, "crab")
        along = (velocity * tangent).sum(-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            # over_ground - along = v cos β
            needed = over_ground**2 / (vessel.turn_rate * (over_ground - along))
        bound = (vessel.speed + np.linalg.norm(velocity, axis=-1)) / vessel.turn_rate
        radius = np.maximum(radius, np.where(np.isfinite(needed), needed, bound))
    return radius


def steer(path: FloatArray, current: CurrentField, vessel: Vessel) -> FloatArray:
    """Trajectory (m, 4) of t (s), x, y (m), heading (rad) along a path (n, 2), corners rounded.

    The vessel crabs: at each row its heading is the one whose ground velocity
    v (cos θ, sin θ) + c runs along the path. Post-condition: |Δθ/Δt| <= ω between rows; where
    that can't be, InfeasibleError says why.
    """
    radius = corner_radius(path, current, vessel)
    for _ in range(_MOST_GROWTHS):
        curve = _rounded(path, radius)
        trajectory = _crab_along(curve, current, vessel)
        turning = np.abs(np.diff(trajectory[:, 3]))
        fast = turning > vessel.turn_rate * np.diff(trajectory[:, 0]) * (1 + 1e-9)
        if not fast.any():
            return trajectory
        at = np.unique(np.concatenate([curve.corner[:-1][fast], curve.corner[1:][fast]]))
        radius[at[at >= 0]] *= _RADIUS_GROWTH
    where = trajectory[:-1][fast][0]
    raise InfeasibleError(
        f"to hold the course at ({where[1]:.1f}, {where[2]:.1f}) m in the current there the vessel "
        f"would have to turn faster than {np.degrees(vessel.turn_rate):.1f} degrees a second"
    )


@dataclass(frozen=True, slots=True)
class _Curve:
    """A path with its corners as arcs: points (m, 2), course (m,) rad, corner or -1 (m,)."""

    points: FloatArray
    course: FloatArray
    corner: IntArray


def _rounded(path: FloatArray, radius: FloatArray) -> _Curve:
    """Round every corner of a path (n, 2) with its radius (n - 2,)."""
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    turn, _ = course_changes(path)
    course = np.arctan2(legs[0, 1], legs[0, 0]) + np.concatenate([[0.0], np.cumsum(turn)])
    tangent = radius * np.tan(np.abs(turn) / 2)
    # A leg is shared between its two corners by what each asks for.
    asked = np.concatenate([[0.0], tangent]) + np.concatenate([tangent, [0.0]])
    if (asked > lengths * (1 + 1e-12)).any():
        i = int(np.argmax(asked - lengths))
        raise InfeasibleError(
            f"the corners beside the leg at ({path[i, 0]:.1f}, {path[i, 1]:.1f}) m need "
            f"{asked[i]:.2f} m to turn in; it has {lengths[i]:.2f} m"
        )
    # Each corner has the points of an arc, and the ends one each.
    steps = np.maximum(1, np.ceil(np.abs(turn) / _ARC_STEP).astype(np.int64))
    at = np.repeat(np.arange(len(turn)), steps + 1)
    place = np.arange(len(at)) - np.repeat(np.cumsum(steps + 1) - (steps + 1), steps + 1)
    along = course[at] + turn[at] * place / steps[at]
    unit = legs / lengths[:, None]
    side = np.where(turn >= 0, 1.0, -1.0)
    normal = np.stack([-unit[:-1, 1], unit[:-1, 0]], axis=-1)
    centre = path[1:-1] - tangent[:, None] * unit[:-1] + (side * radius)[:, None] * normal
    outwards = along - side[at] * np.pi / 2
    arcs = centre[at] + radius[at, None] * np.stack([np.cos(outwards), np.sin(outwards)], axis=-1)
    return _densified(
        _Curve(
            np.concatenate([path[:1], arcs, path[-1:]]),
            np.concatenate([course[:1], along, course[-1:]]),
            np.concatenate([[-1], at, [-1]]),
        )
    )


def _densified(curve: _Curve) -> _Curve:
    """Cut long legs so that the current along them is followed, and drop those of no length."""
    lengths = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
    keep = np.concatenate([[True], lengths > 1e-9 * lengths.sum()])
    points, course, corner = curve.points[keep], curve.course[keep], curve.corner[keep]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(_LEG_SAMPLES * lengths / lengths.sum()).astype(int))
    leg = np.repeat(np.arange(len(lengths)), pieces)
    place = (np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[leg]
    dense = points[leg] + place[:, None] * (points[leg + 1] - points[leg])
    between = course[leg] + place * (course[leg + 1] - course[leg])
    return _Curve(
        np.vstack([dense, points[-1:]]),
        np.append(between, course[-1]),
        np.append(np.where(place == 0, corner[leg], -1), corner[-1]),
    )


def _crab_along(curve: _Curve, current: CurrentField, vessel: Vessel) -> FloatArray:
    """Trajectory (m, 4) along a curve: crab headings, times by the trapezoidal rule."""
    tangent = np.stack([np.cos(curve.course), np.sin(curve.course)], axis=-1)
    velocity = current(curve.points)
    speed = ground_speed(velocity, tangent, vessel.speed, "crab")
    if not (speed > 0).all():
        at = curve.points[~(speed > 0)][0]
        raise InfeasibleError(
            f"the current at ({at[0]:.1f}, {at[1]:.1f}) m is too strong to hold the course"
        )
    through_water = speed[:, None] * tangent - velocity
    heading = np.unwrap(np.arctan2(through_water[:, 1], through_water[:, 0]))
    lengths = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
    slowness = (1 / speed[:-1] + 1 / speed[1:]) / 2
    time = np.concatenate([[0.0], np.cumsum(lengths * slowness)])
    return np.column_stack([time, curve.points, heading])


def _wrapped(angle: FloatArray) -> FloatArray:
    """Angles (rad) folded into [-π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
