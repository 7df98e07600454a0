"""How far a hard-over turn carries the vessel towards an edge, in closed form.

A turn at rate ω in a current c, begun with heading φ, follows (paper, best effort τ)

    p(t) = v/ω [sin(φ + ωt) - sin φ, cos φ - cos(φ + ωt)] + c t.

Its reach towards an edge with unit normal n is the largest p(t)·n over one full turn. With θ the
heading and ψ the normal's direction, d/dt p·n = v cos(θ - ψ) + c·n. For a turn to port it falls
through zero at θ = ψ + arccos(-c·n / v), the one maximum inside the turn; at its ends p·n is 0 and
c·n 2π/ω. A turn to starboard is the mirror image.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import FloatArray
from renew.inputs.vessel import Vessel


class TurnStarts(NamedTuple):
    """Turns (n,) that begin: heading (rad), its cosine and sine, and the current u, v (m/s)."""

    heading: FloatArray
    cos: FloatArray
    sin: FloatArray
    u: FloatArray
    v: FloatArray


@kernel
def reach_along(
    normal: FloatArray, turns: TurnStarts, speed: float, turn_rate: float, reach: FloatArray
) -> None:
    """Fill in the reach (n,), m, of turns along a unit normal (2,): the worse of both sides."""
    nx, ny = normal
    bearing = math.atan2(ny, nx)
    radius, period = speed / turn_rate, 2 * math.pi / turn_rate
    heading, cos, sin, u, v = turns
    for k in range(len(reach)):
        drift = u[k] * nx + v[k] * ny
        ratio = min(max(-drift / speed, -1.0), 1.0)
        turned_to = math.acos(ratio)
        furthest = math.sqrt(1.0 - ratio * ratio)
        begin = heading[k] - bearing
        sine = sin[k] * nx - cos[k] * ny
        port, starboard = turned_to - begin, turned_to + begin
        port -= 2 * math.pi * math.floor(port / (2 * math.pi))
        starboard -= 2 * math.pi * math.floor(starboard / (2 * math.pi))
        reach[k] = max(
            radius * (furthest - sine) + drift * port / turn_rate,
            radius * (furthest + sine) + drift * starboard / turn_rate,
            drift * period,
            0.0,
        )


def turn_reach(
    vessel: Vessel, heading: FloatArray, current: FloatArray, normal: FloatArray
) -> FloatArray:
    """Reach (...), m, of hard-over turns along unit normals, the worse of port and starboard.

    Parameters
    ----------
    vessel : Vessel
        Gives v and ω.
    heading : (...) rad
        Heading φ at which the turn begins.
    current : (..., 2) m/s
        Steady current c during the turn.
    normal : (..., 2)
        Unit vectors n towards the danger.
    """
    shape = np.broadcast_shapes(heading.shape, current.shape[:-1], normal.shape[:-1])
    headings = np.broadcast_to(heading, shape).reshape(-1, 1)
    currents = np.broadcast_to(current, (*shape, 2)).reshape(-1, 2, 1)
    normals = np.broadcast_to(normal, (*shape, 2)).reshape(-1, 2)
    reach = np.empty((len(normals), 1))
    for at, towards in enumerate(normals):
        phi, (u, v) = headings[at], currents[at]
        turn = TurnStarts(phi, np.cos(phi), np.sin(phi), u, v)
        reach_along(towards, turn, vessel.speed, vessel.turn_rate, reach[at])
    return reach.reshape(shape)


def normals_away(edges: FloatArray, from_points: FloatArray) -> FloatArray:
    """Unit normals (e, 2) of edges (e, 2, 2), each on the side that points away from a point."""
    along = edges[:, 1] - edges[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = ((edges[:, 0] - from_points) * normal).sum(-1)
    return np.where(away[:, None] < 0, -normal, normal)
