"""Corners too sharp for the vessel, rounded on their outer side.

A least-fuel path that wraps the corner of a no-go zone can't be rounded inwards: the inside is
the zone. So a disc of the turning radius is put inside the corner, touching it from within, and
the path is drawn taut around the discs: it leaves the earlier leg before the corner, passes
through it on an arc, and meets the later leg behind it, always on the far side of the zone.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from renew.errors import InfeasibleError
from renew.kinematics import course_changes

if TYPE_CHECKING:
    from renew._types import BoolArray, FloatArray

# An arc becomes a polyline around it (vertices outside, edges tangent) with this turn a vertex.
_ARC_STEP = np.radians(4)


@dataclass(frozen=True, slots=True)
class _Disc:
    """A disc that the path passes on one side: `side` 1 turns to port around it, -1 to starboard.

    A point of the path is a disc of radius 0.
    """

    centre: FloatArray
    radius: float
    side: float


def round_corners(path: FloatArray, sharp: BoolArray, radius: FloatArray) -> FloatArray:
    """Path (m, 2) with its sharp corners (n - 2,) drawn around discs of given radii (n - 2,), m."""
    turns, bisectors = course_changes(path)
    discs = [_Disc(path[0], 0.0, 1.0)]
    for i, corner in enumerate(path[1:-1]):
        side = 1.0 if turns[i] >= 0 else -1.0
        size = float(radius[i]) if sharp[i] else 0.0
        discs.append(_Disc(corner + size * bisectors[i], size, side))
    discs.append(_Disc(path[-1], 0.0, 1.0))
    return _taut(discs)


def _taut(discs: list[_Disc]) -> FloatArray:
    """Draw the string: drop discs that it doesn't lean on until it leans on all that are left."""
    while True:
        courses = []
        for one, other in itertools.pairwise(discs):
            course = _tangent_course(one, other)
            if course is None:
                raise InfeasibleError(
                    f"two opposite turns near ({one.centre[0]:.1f}, {one.centre[1]:.1f}) m are too "
                    "close together to be steered"
                )
            courses.append(course)
        turns = (np.diff(courses) + np.pi) % (2 * np.pi) - np.pi
        slack = [
            i + 1
            for i, (disc, turn) in enumerate(zip(discs[1:-1], turns, strict=True))
            if disc.radius > 0 and disc.side * turn < 0
        ]
        if not slack:
            return _drawn(discs, np.array(courses), turns)
        # One at a time, the slackest: its neighbours may hold again without it.
        worst = max(slack, key=lambda i: abs(turns[i - 1]))
        discs = discs[:worst] + discs[worst + 1 :]


def _tangent_course(one: _Disc, other: _Disc) -> float | None:
    """Course (rad) of the leg from one disc to the next, or None where they overlap too far."""
    between = other.centre - one.centre
    apart = float(np.hypot(*between))
    # The centres lie side * radius to port of the leg, so this much is gained in between.
    offset = other.side * other.radius - one.side * one.radius
    if apart == 0 or abs(offset) > apart:
        return None
    return float(np.arctan2(between[1], between[0]) - np.arcsin(offset / apart))


def _drawn(discs: list[_Disc], courses: FloatArray, turns: FloatArray) -> FloatArray:
    """Vertices (m, 2) of the string, arcs as tangent polylines."""
    points = [discs[0].centre[None]]
    for disc, course, turn in zip(discs[1:-1], courses[:-1], turns, strict=True):
        steps = max(1, int(np.ceil(abs(turn) / _ARC_STEP))) if disc.radius else 1
        middles = course + turn * (np.arange(steps) + 0.5) / steps - disc.side * np.pi / 2
        outer = disc.radius / np.cos(turn / steps / 2)
        points.append(disc.centre + outer * np.stack([np.cos(middles), np.sin(middles)], axis=-1))
    points.append(discs[-1].centre[None])
    return np.concatenate(points)
