"""Find the triangles that a path really crosses, in order.

A least-fuel path may bulge out of its channel, and then crosses other triangles.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import FloatArray, IntArray

# A path that stays in a triangle for less than this share of its size only touches it.
_TOUCH = 1e-9


class Visits(NamedTuple):
    """The triangle (v,) of each visit, and the points (v, 2) where the visit begins and ends."""

    triangle: IntArray
    enter: FloatArray
    leave: FloatArray


def visits(path: FloatArray, corners: FloatArray) -> Visits:
    """Return the visits of a path (n, 2) to anticlockwise triangles (t, 3, 2), in metres.

    A triangle that is entered again has two visits; a triangle that is only touched has none.
    """
    triangle, leg, enter, leave = _stays(path, corners)
    order = np.lexsort((triangle, leg + (enter + leave) / 2))
    # Consecutive stays in one triangle, one per leg, are one visit.
    new = np.diff(triangle[order], prepend=-1) != 0
    first, last = order[new], order[np.roll(new, -1)]
    way = np.diff(path, axis=0)
    return Visits(
        triangle[first],
        path[leg[first]] + enter[first, None] * way[leg[first]],
        path[leg[last]] + leave[last, None] * way[leg[last]],
    )


@kernel
def _stays(
    path: FloatArray, corners: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return each stay's triangle, leg, and first and last share of the leg, all (s,)."""
    triangles, legs = [np.int64(0)], [np.int64(0)]
    enters, leaves = [0.0], [0.0]
    for t in range(len(corners)):
        x, y = corners[t, :, 0], corners[t, :, 1]
        west, east, south, north = x.min(), x.max(), y.min(), y.max()
        touch = _TOUCH * (east - west + north - south)
        for k in range(len(path) - 1):
            ax, ay = path[k]
            dx, dy = path[k + 1, 0] - ax, path[k + 1, 1] - ay
            if (
                max(ax, ax + dx) < west
                or min(ax, ax + dx) > east
                or max(ay, ay + dy) < south
                or min(ay, ay + dy) > north
            ):
                continue
            enter, leave = 0.0, 1.0
            for c in range(3):
                ux, uy = x[(c + 1) % 3] - x[c], y[(c + 1) % 3] - y[c]
                # Inside is to the left of each edge: inside + s slope >= 0.
                inside = ux * (ay - y[c]) - uy * (ax - x[c])
                slope = ux * dy - uy * dx
                if slope > 0.0:
                    enter = max(enter, -inside / slope)
                elif slope < 0.0:
                    leave = min(leave, -inside / slope)
                elif inside < 0.0:
                    leave = -1.0
            if (leave - enter) * math.hypot(dx, dy) > touch:
                triangles.append(np.int64(t))
                legs.append(np.int64(k))
                enters.append(enter)
                leaves.append(leave)
    return (
        np.array(triangles[1:], dtype=np.int64),
        np.array(legs[1:], dtype=np.int64),
        np.array(enters[1:]),
        np.array(leaves[1:]),
    )
