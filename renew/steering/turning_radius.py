"""How tightly a vessel can turn over ground: the effective turning radius r' and its corners.

A vessel that turns at ω while it makes v' over ground sails curves of radius r' = v'/ω, its
effective turning radius (paper, kinematic check). A corner between legs of lengths a and b that
turns by δ can be rounded with that radius when r' tan(δ/2) <= min(a, b) / 2.
"""

from __future__ import annotations

import numpy as np

from renew._types import BoolArray, FloatArray
from renew.inputs.current import CurrentField
from renew.inputs.fuel import ground_speed
from renew.inputs.vessel import Vessel
from renew.kernels.angles import wrapped


def effective_turning_radius(
    velocity: FloatArray, heading: FloatArray, vessel: Vessel
) -> FloatArray:
    """Effective turning radius |v (cos φ, sin φ) + c| / ω (...), m, in currents on headings φ."""
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
    turns, _ = course_changes(paths)
    course = np.arctan2(*np.moveaxis(np.diff(paths, axis=-2), -1, 0)[::-1])
    velocity = current.velocity(paths[..., 1:-1, :], times)
    radius = np.maximum(
        effective_turning_radius(velocity, course[..., :-1], vessel),
        effective_turning_radius(velocity, course[..., 1:], vessel),
    )
    needed = radius * np.tan(np.abs(turns) / 2)
    return np.asarray((needed <= room).all(axis=-1))


def course_changes(paths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turns (..., n - 2) in rad, to port positive, and unit vectors (..., n - 2, 2) into them.

    The unit vectors halve the corners of the paths (..., n, 2), on the inside of the turn.
    """
    legs = np.diff(paths, axis=-2)
    course = np.arctan2(legs[..., 1], legs[..., 0])
    turns = wrapped(np.diff(course, axis=-1))
    inwards = course[..., :-1] + turns / 2 + np.where(turns >= 0, np.pi / 2, -np.pi / 2)
    return turns, np.stack([np.cos(inwards), np.sin(inwards)], axis=-1)


def corner_radius(
    paths: FloatArray,
    current: CurrentField,
    vessel: Vessel,
    times: float | FloatArray = 0.0,
    speeds: FloatArray | None = None,
) -> FloatArray:
    """Smallest radius (..., n - 2) in metres that can be steered over ground at inner corners.

    At a course χ with crab angle β (sin β = c⊥ / v) the heading turns by V / (v cos β) for each
    radian of χ, with V the speed over ground: following the curve at rate ω takes a radius of
    V² / (ω v cos β). In a following current that is more than r' = V / ω. The larger of the two
    legs' radii counts; where the course can't be held, r' with V = v + |c|. Corners are passed at
    `times` (..., n - 2), s; legs are sailed at the vessel's speed, or at speeds (n - 1,).
    """
    if speeds is None:
        speeds = np.full(paths.shape[-2] - 1, vessel.speed)
    corners, legs = paths[..., 1:-1, :], np.diff(paths, axis=-2)
    units = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
    velocity = current.velocity(corners, times)
    radius = np.zeros(corners.shape[:-1])
    sides = ((units[..., :-1, :], speeds[:-1]), (units[..., 1:, :], speeds[1:]))
    for tangent, speed in sides:
        over_ground = ground_speed(velocity, tangent, speed, "crab")
        along = (velocity * tangent).sum(-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            # over_ground - along = v cos β
            needed = over_ground**2 / (vessel.turn_rate * (over_ground - along))
        bound = (speed + np.linalg.norm(velocity, axis=-1)) / vessel.turn_rate
        radius = np.maximum(radius, np.where(np.isfinite(needed), needed, bound))
    return radius
