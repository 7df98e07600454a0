"""Find the corners of a path to round on the outer side, and corners that obstruct these."""

import math

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray
from renew.kernels.capsules import Capsules, legs_are_clear
from renew.steering.turning_radius import course_changes

# Distance, in chords of a sharp corner's disc, within which other corners obstruct its rounding.
_CROWDING = 1.5


@kernel
def sharp_corners(path: FloatArray, radius: FloatArray, no_go: Capsules) -> BoolArray:
    """Return whether each inner corner (n - 2,) of a path (n, 2) can't be rounded inwards.

    With radii (n - 2,), m, its arc would enter the no-go capsules, or a leg is too short.
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
            # Of the leg's two corners, the one that needs more of it is sharp; the start is no
            # corner.
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
