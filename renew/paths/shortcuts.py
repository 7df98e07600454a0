"""Chains merged and smoothed: straight legs past points, wherever they are clear and quicker.

Merging follows the hybridization of paths (Raveh, Enosh & Halperin, 2011): pieces of several good
chains make a better one.
"""

from __future__ import annotations

import numpy as np

from renew._types import BoolArray, FloatArray, IntArray
from renew.errors import InfeasibleError
from renew.inputs.current_table import velocities
from renew.kernels.capsules import legs_are_clear
from renew.kernels.ground_speed import ground_speeds
from renew.paths.corridor import Corridor

# Number of pieces into which the path is cut in each round: their ends are what legs lead between.
_PIECES, _ROUNDS = 60, 4
# Gauss-Legendre nodes and weights by which a leg is timed.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def merged(corridor: Corridor, chains: FloatArray) -> FloatArray:
    """Quickest path (m, 2) along straight legs between points of some chains (c, n, 2)."""
    count = chains.shape[1]
    inner = chains[:, 1:-1].swapaxes(0, 1).reshape(-1, 2)
    points = np.vstack([chains[0, 0], inner, chains[0, -1]])
    place = np.concatenate([[0], np.repeat(np.arange(1, count - 1), len(chains)), [count - 1]])
    return points[_quickest(corridor, points, place)]


def with_shortcuts(corridor: Corridor, path: FloatArray) -> FloatArray:
    """Quickest path (m, 2) along straight legs between places on a path (n, 2), clear of V."""
    for _ in range(_ROUNDS):
        points = _cut(path)
        path = points[_quickest(corridor, points, np.arange(len(points)))]
    return path


def _cut(path: FloatArray) -> FloatArray:
    """Path (m, 2) with points added: its own, and others evenly along it."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    pieces = np.maximum(np.ceil(lengths / lengths.sum() * _PIECES), 1).astype(np.int64)
    leg = np.repeat(np.arange(len(pieces)), pieces)
    place = (np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[leg]
    points = path[leg] + place[:, None] * (path[leg + 1] - path[leg])
    return np.vstack([points, path[-1]])


def _times(corridor: Corridor, a: FloatArray, b: FloatArray) -> FloatArray:
    """Times (n,), s, over legs a -> b (n, 2) by Eq. 4; inf where no way is made."""
    way = b - a
    length = np.linalg.norm(way, axis=1)
    tangent = np.repeat(way / np.maximum(length, 1e-300)[:, None], len(_NODES), axis=0)
    points = a[:, None] + (_NODES[:, None] + 1) / 2 * way[:, None]
    current = velocities(corridor.voyage.table, points.reshape(-1, 2))
    speed = ground_speeds(current, tangent, corridor.polar)
    strength = np.linalg.norm(current, axis=1)
    is_passable = (speed > 0) & (strength < corridor.polar.speed)
    slowness = np.where(is_passable, 1 / np.where(is_passable, speed, 1.0), np.inf)
    return np.asarray(length * (slowness.reshape(-1, len(_NODES)) @ (_WEIGHTS / 2)))


def _are_clear(corridor: Corridor, points: FloatArray, one: IntArray, other: IntArray) -> BoolArray:
    """Which legs (n,) between points keep out of V; the first may leave it, the last enter it."""
    capsules, exempt = corridor.search_capsules, corridor.exempt
    clear = legs_are_clear(points[one], points[other], capsules)
    for legs, free in ((one == 0, exempt[0]), (other == len(points) - 1, exempt[1])):
        if free.any():
            left = capsules.select(~free)
            clear[legs] |= legs_are_clear(points[one[legs]], points[other[legs]], left)
    return np.asarray(clear)


def _quickest(corridor: Corridor, points: FloatArray, place: IntArray) -> IntArray:
    """Points (m,) of the quickest clear way from the first to the last; places (n,) must ascend."""
    one, other = np.triu_indices(len(points), k=1)
    onwards = place[one] < place[other]
    one, other = one[onwards], other[onwards]
    times = np.full((len(points), len(points)), np.inf)
    clear = _are_clear(corridor, points, one, other)
    times[one[clear], other[clear]] = _times(corridor, points[one[clear]], points[other[clear]])
    arrival, before = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    arrival[0] = 0.0
    for point in range(1, len(points)):
        total = arrival[:point] + times[:point, point]
        before[point] = total.argmin()
        arrival[point] = total[before[point]]
    if not np.isfinite(arrival[-1]):
        raise InfeasibleError("no legs between its sampled points are clear of V")
    row = [len(points) - 1]
    while row[-1]:
        row.append(int(before[row[-1]]))
    return np.array(row[::-1])
