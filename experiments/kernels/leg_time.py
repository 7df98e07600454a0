"""Time along straight legs by Eq. 4, compiled: what baselines with fuel as their objective ask for.

Water whose current is as strong as the vessel is impassable, as it is for our planner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

import renew
from experiments.kernels.compiled import compiled
from renew._types import FloatArray
from renew.kernels.current_table import CurrentTable, velocity

_RULE = np.polynomial.legendre.leggauss(4)
# Gauss-Legendre nodes of a piece of a leg, from -1 to 1.
_NODES = _RULE[0]
# Their weights.
_WEIGHTS = _RULE[1]
# Largest number of pieces along the longer side of the chart.
_PIECES = 64


class LegTimes(NamedTuple):
    """The current as a table, the vessel's speed (m/s), and the longest piece of a leg (m)."""

    table: CurrentTable
    speed: float
    piece: float

    @classmethod
    def of(cls, chart: renew.Chart, current: renew.CurrentField, vessel: renew.Vessel) -> LegTimes:
        """Legs on a chart."""
        xmin, ymin, xmax, ymax = chart.bounds
        side = max(xmax - xmin, ymax - ymin)
        return cls(current.table(chart.bounds), vessel.speed, side / _PIECES)


@compiled
def leg_time(ax: float, ay: float, bx: float, by: float, legs: LegTimes) -> float:
    """Time (s) of a leg; inf where the current is as strong as the vessel."""
    length = math.hypot(bx - ax, by - ay)
    if length == 0.0:
        return 0.0
    tx, ty = (bx - ax) / length, (by - ay) / length
    pieces = math.ceil(length / legs.piece)
    total = 0.0
    for piece in range(pieces):
        for k in range(len(_NODES)):
            place = (piece + (_NODES[k] + 1) / 2) / pieces
            u, v = velocity(legs.table, ax + place * (bx - ax), ay + place * (by - ay), 0.0)
            if u * u + v * v >= legs.speed * legs.speed:
                return math.inf
            total += _WEIGHTS[k] / 2 / (legs.speed + u * tx + v * ty)
    return total * length / pieces


@compiled
def leg_times(a: FloatArray, b: FloatArray, legs: LegTimes) -> FloatArray:
    """Times (n,), s, of legs a -> b (n, 2)."""
    times = np.empty(len(a))
    for k in range(len(a)):
        times[k] = leg_time(a[k, 0], a[k, 1], b[k, 0], b[k, 1], legs)
    return times
