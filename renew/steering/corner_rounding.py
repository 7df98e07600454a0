"""Corners too sharp for the vessel, rounded on their outer side.

A least-fuel path that wraps the corner of a no-go zone can't be rounded inwards: the inside is
the zone. So a disc of the turning radius is put inside the corner, touching it from within, and
the path is drawn taut around the discs: it leaves the earlier leg before the corner, passes
through it on an arc, and meets the later leg behind it, always on the far side of the zone.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renew._types import BoolArray, FloatArray, IntArray
from renew.errors import InfeasibleError
from renew.steering.trajectory import course_changes

# An arc becomes a polyline around it (vertices outside, edges tangent) with this turn a vertex.
_ARC_STEP = math.radians(4)


def round_corners(path: FloatArray, sharp: BoolArray, radius: FloatArray) -> FloatArray:
    """Path (m, 2) with its sharp corners (n - 2,) drawn around discs of given radii (n - 2,), m."""
    turns, bisectors = course_changes(path)
    # A point of the path is a disc of radius 0, the ends' among them.
    size = np.where(sharp, radius, 0.0)
    centres = path.copy()
    centres[1:-1] += size[:, None] * bisectors
    radii, sides = np.zeros(len(path)), np.ones(len(path))
    radii[1:-1], sides[1:-1] = size, np.where(turns >= 0, 1.0, -1.0)
    kept, courses, clash = _taut(centres, radii, sides)
    if clash >= 0:
        x, y = centres[clash]
        raise InfeasibleError(
            f"two opposite turns near ({x:.1f}, {y:.1f}) m are too close together to be steered"
        )
    return np.asarray(_drawn(centres[kept], radii[kept], sides[kept], courses))


@njit(cache=True, error_model="numpy")
def _taut(
    centres: FloatArray, radii: FloatArray, sides: FloatArray
) -> tuple[IntArray, FloatArray, int]:
    """Draw the string: drop discs that it doesn't lean on until it leans on all that are left.

    A disc (n, 2) is passed on one side: 1 turns to port around it, -1 to starboard. Returns the
    discs kept (m,), the courses (m - 1,) from each to the next in rad, and -1; or, as the last,
    the disc that overlaps the next one too far.
    """
    kept = np.arange(len(radii))
    courses = np.empty(len(radii) - 1)
    while True:
        for k in range(len(kept) - 1):
            one, other = kept[k], kept[k + 1]
            dx, dy = centres[other, 0] - centres[one, 0], centres[other, 1] - centres[one, 1]
            apart = math.hypot(dx, dy)
            # The centres lie side * radius to port of the leg: so much is gained in between.
            offset = sides[other] * radii[other] - sides[one] * radii[one]
            if apart == 0.0 or abs(offset) > apart:
                return kept, courses, one
            courses[k] = math.atan2(dy, dx) - math.asin(offset / apart)
        # One at a time, the slackest: its neighbours may hold again without it.
        worst, slackest = -1, 0.0
        for k in range(1, len(kept) - 1):
            turn = (courses[k] - courses[k - 1] + math.pi) % (2 * math.pi) - math.pi
            if radii[kept[k]] > 0 and sides[kept[k]] * turn < 0 and abs(turn) > slackest:
                worst, slackest = k, abs(turn)
        if worst < 0:
            return kept, courses[: len(kept) - 1], -1
        kept = np.concatenate((kept[:worst], kept[worst + 1 :]))


@njit(cache=True, error_model="numpy")
def _drawn(
    centres: FloatArray, radii: FloatArray, sides: FloatArray, courses: FloatArray
) -> FloatArray:
    """Vertices (m, 2) of the string, arcs as tangent polylines."""
    last = len(radii) - 1
    turns = np.zeros(last + 1)
    steps = np.ones(last + 1, dtype=np.int64)
    for k in range(1, last):
        turns[k] = (courses[k] - courses[k - 1] + math.pi) % (2 * math.pi) - math.pi
        if radii[k] > 0:
            steps[k] = max(1, math.ceil(abs(turns[k]) / _ARC_STEP))
    points = np.empty((steps.sum(), 2))
    at = 0
    for k in range(last + 1):
        outer = radii[k] / math.cos(turns[k] / steps[k] / 2)
        for step in range(steps[k]):
            middle = (courses[k - 1] if k else 0.0) + turns[k] * (step + 0.5) / steps[k]
            outwards = middle - sides[k] * math.pi / 2
            points[at, 0] = centres[k, 0] + outer * math.cos(outwards)
            points[at, 1] = centres[k, 1] + outer * math.sin(outwards)
            at += 1
    return points
