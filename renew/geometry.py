"""Plane primitives: segments against capsules (all points within a distance of a segment)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from renew._types import FloatArray


def capsule_interval(
    a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interval [enter, leave] of s in [0, 1] where a + s (b - a) lies within radius of pq.

    All points broadcast as (..., 2) and the radius as (...). Empty intervals have enter > leave.
    A capsule is convex, so there is one interval: the hull of those of its two discs and of the
    rectangle between them.
    """
    d = b - a
    enter, leave = _slab_interval(a, d, p, q, radius)
    for centre in (p, q):
        disc_enter, disc_leave = _disc_interval(a, d, centre, radius)
        empty = disc_enter > disc_leave
        enter = np.where(empty, enter, np.minimum(enter, disc_enter))
        leave = np.where(empty, leave, np.maximum(leave, disc_leave))
    enter, leave = np.maximum(enter, 0.0), np.minimum(leave, 1.0)
    return enter, leave


def _disc_interval(
    a: FloatArray, d: FloatArray, centre: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interval of s where a + s d lies in a disc; (inf, -inf) where nowhere."""
    f = a - centre
    dd = (d * d).sum(-1)
    fd = (f * d).sum(-1)
    root = fd**2 - dd * ((f * f).sum(-1) - radius**2)
    hit = (root >= 0) & (dd > 0)
    safe = np.where(dd > 0, dd, 1.0)
    half = np.sqrt(np.where(hit, root, 0.0))
    return np.where(hit, (-fd - half) / safe, np.inf), np.where(hit, (-fd + half) / safe, -np.inf)


def _slab_interval(
    a: FloatArray, d: FloatArray, p: FloatArray, q: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interval of s where a + s d lies in the rectangle of half-width radius along pq."""
    axis = q - p
    length = np.sqrt((axis * axis).sum(-1))
    unit = axis / np.where(length > 0, length, 1.0)[..., None]
    f = a - p
    along, along_d = (f * unit).sum(-1), (d * unit).sum(-1)
    across = f[..., 1] * unit[..., 0] - f[..., 0] * unit[..., 1]
    across_d = d[..., 1] * unit[..., 0] - d[..., 0] * unit[..., 1]
    enter_1, leave_1 = _between(along, along_d, 0.0 * length, length)
    enter_2, leave_2 = _between(across, across_d, -radius, radius)
    enter, leave = np.maximum(enter_1, enter_2), np.minimum(leave_1, leave_2)
    empty = (enter > leave) | (length == 0)
    return np.where(empty, np.inf, enter), np.where(empty, -np.inf, leave)


def _between(
    value: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interval of s where low <= value + s slope <= high; (inf, -inf) where nowhere."""
    flat = np.abs(slope) < 1e-300
    safe = np.where(flat, 1.0, slope)
    first, second = (low - value) / safe, (high - value) / safe
    within = (low <= value) & (value <= high)
    enter = np.where(flat, np.where(within, -np.inf, np.inf), np.minimum(first, second))
    leave = np.where(flat, np.where(within, np.inf, -np.inf), np.maximum(first, second))
    return enter, leave


def segment_distance(points: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Distance (...) from points (..., 2) to segments pq (..., 2)."""
    axis = q - p
    square = (axis * axis).sum(-1)
    place = ((points - p) * axis).sum(-1) / np.where(square > 0, square, 1.0)
    nearest = p + np.clip(place, 0.0, 1.0)[..., None] * axis
    return np.asarray(np.linalg.norm(points - nearest, axis=-1))
