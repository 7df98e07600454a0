"""Compute how tightly a vessel can turn over ground: effective turning radius r' and corners.

A vessel that turns at ω while its ground speed is v' sails curves of radius r' = v'/ω, its
effective turning radius (paper, kinematic check). A corner that turns by δ between legs of lengths
a and b can be rounded with that radius if r' tan(δ/2) <= min(a, b) / 2.
"""

import math

import numpy as np

from renew._compiled import for_kernels, kernel
from renew._types import BoolArray, FloatArray
from renew.inputs.current import CurrentField
from renew.inputs.vessel import Vessel
from renew.kernels.capsules import wrapped


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
