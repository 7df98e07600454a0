"""From a path to a trajectory that a vessel can steer: corners as arcs, headings, times."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from renew._types import FloatArray, IntArray
from renew.errors import InfeasibleError
from renew.inputs.current import CurrentField
from renew.inputs.fuel import ground_speed, reading_times, times_under_way
from renew.inputs.speeds_along import speeds_along
from renew.inputs.vessel import Vessel
from renew.steering.turning_radius import corner_radius, course_changes

# Angle (rad) between the points of an arc: chords leave it by 0.02 % of the radius.
_ARC_STEP = np.radians(2)
# Number of samples on the straight legs together: the heading follows a current that changes.
_LEG_SAMPLES = 256
# Factor by which radii grow until the heading rate is at most ω, and how often they may.
_RADIUS_GROWTH, _MAX_GROWTHS = 1.05, 20
# Largest turn (rad) at a point where only the speed changes: rounding.
_STRAIGHT = 1e-9


def steer(
    path: FloatArray,
    current: CurrentField,
    vessel: Vessel,
    departure: float = 0.0,
    speeds: FloatArray | None = None,
) -> FloatArray:
    """Trajectory (m, 4) of t (s), x, y (m), heading (rad) along a path (n, 2), corners rounded.

    It begins at the departure, on the clock of a current that changes. Legs are sailed at the
    vessel's speed, or at speeds (n - 1,) through water.

    The vessel crabs: at each row its heading is the one whose ground velocity
    v (cos θ, sin θ) + c runs along the path. Post-condition: |Δθ/Δt| <= ω between rows; where
    that can't be, InfeasibleError says why.
    """
    own = np.full(len(path) - 1, vessel.speed) if speeds is None else speeds
    times = reading_times(path, current, vessel, drift="crab", departure=departure, speeds=own)
    radius = corner_radius(path, current, vessel, times[1:-1], own)
    corners = path
    if speeds is not None:
        # Where the speed alone changes there is no corner, and the legs beside one are longer.
        turn, _ = course_changes(path)
        is_corner = np.concatenate([[True], np.abs(turn) > _STRAIGHT, [True]])
        corners, radius = path[is_corner], radius[is_corner[1:-1]]
    for _ in range(_MAX_GROWTHS):
        curve = _rounded(corners, radius)
        middles = (curve.points[:-1] + curve.points[1:]) / 2
        through_water = speeds_along(middles, path, own)
        trajectory = _crab_along(curve, current, through_water, departure)
        turning = np.abs(np.diff(trajectory[:, 3]))
        fast = turning > vessel.turn_rate * np.diff(trajectory[:, 0]) * (1 + 1e-9)
        if not fast.any():
            return trajectory
        at = np.unique(np.concatenate([curve.corner[:-1][fast], curve.corner[1:][fast]]))
        if at[-1] < 0:
            # It is the current that changes too fast along a leg; no radius helps.
            break
        radius[at[at >= 0]] *= _RADIUS_GROWTH
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


def _rounded(path: FloatArray, radius: FloatArray) -> _Curve:
    """Round every corner of a path (n, 2) with its radius (n - 2,)."""
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    turn, _ = course_changes(path)
    course = np.arctan2(legs[0, 1], legs[0, 0]) + np.concatenate([[0.0], np.cumsum(turn)])
    tangent = radius * np.tan(np.abs(turn) / 2)
    # A leg is shared between its two corners by what each needs.
    asked = np.concatenate([[0.0], tangent]) + np.concatenate([tangent, [0.0]])
    if (asked > lengths * (1 + 1e-12)).any():
        i = int(np.argmax(asked - lengths))
        raise InfeasibleError(
            f"the corners beside the leg at {{0}} need {asked[i]:.2f} m to turn in; it has "
            f"{lengths[i]:.2f} m",
            path[i],
        )
    # Each corner becomes the points of an arc; the path's ends stay single points.
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


def _crab_along(
    curve: _Curve, current: CurrentField, through_water: FloatArray, departure: float
) -> FloatArray:
    """Trajectory (m, 4) along a curve: crab headings, times by the trapezoidal rule.

    Between its points it is sailed at speeds (m - 1,) through water; where these change the heading
    is that of their mean.
    """
    tangent = np.stack([np.cos(curve.course), np.sin(curve.course)], axis=-1)
    lengths = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
    velocity = np.empty(curve.points.shape)

    def durations(some: slice, times: FloatArray) -> FloatArray:
        """Time (p,), s, over some legs, by the times (p + 1,) at their ends."""
        ends = slice(some.start, some.stop + 1)
        velocity[ends] = current.velocity(curve.points[ends], times)
        both = [
            ground_speed(velocity[ends][side], tangent[ends][side], through_water[some], "crab")
            for side in (slice(0, -1), slice(1, None))
        ]
        slowness = np.where(np.array(both) > 0, 1 / np.where(np.array(both) > 0, both, 1.0), np.inf)
        return np.asarray(lengths[some] * slowness.sum(axis=0) / 2)

    time = times_under_way(durations, len(lengths), departure, is_steady=current.is_steady)
    if not math.isfinite(time[-1]):
        at = curve.points[~np.isfinite(time)][0]
        raise InfeasibleError("the current at {0} is too strong to hold the course", at)
    around = np.concatenate([through_water[:1], through_water, through_water[-1:]])
    speed = ground_speed(velocity, tangent, (around[:-1] + around[1:]) / 2, "crab")
    towards = speed[:, None] * tangent - velocity
    heading = np.unwrap(np.arctan2(towards[:, 1], towards[:, 0]))
    return np.column_stack([time, curve.points, heading])
