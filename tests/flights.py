"""Flights along a route, step by step: early, on time or late, with full turns from each place."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import renew
from renew._types import FloatArray
from tests.strategies import Scene


def positions(
    route: renew.Route,
    scene: Scene[renew.CurrentField],
    along: FloatArray,
    late: FloatArray,
    side: float,
    step: float,
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield where vessels are (n, 2), m, and when (n,), s, at each step (s) of their turns.

    The vessel sails its track, and from its places there at times `along` (n,), s, it turns full
    circles to a side (1 or -1) at the highest speed of its route. It passes them so much later than
    planned: `late` (n,), s.
    """
    track = route.trajectory
    place = np.stack([np.interp(along, track[:, 0], track[:, k]) for k in (1, 2, 3)], axis=1)
    position, heading = place[:, :2], place[:, 2]
    now = np.maximum(along + late, route.times[0])
    for _ in range(int(np.ceil(scene.vessel.turn_period / step)) + 1):
        yield position, now
        through = route.speeds.max() * np.column_stack([np.cos(heading), np.sin(heading)])
        position = position + step * (through + scene.current.velocity(position, now))
        heading = heading + side * scene.vessel.turn_rate * step
        now = now + step
