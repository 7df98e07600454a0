"""What a navigator who knows SciPy would write instead: a Dijkstra over a grid of 80 neighbours.

No oracle of the least fuel (that is :mod:`tests.oracles`), but a page that takes a second and
finds a good route on each side of an island. It shares nothing with the planner but the land,
the current as a function, and the plane. It works in the planner's plane on purpose: that is
conformal and on Palawan true to 0.1 %, and so both plan in the same metres, with the same
straight legs and the same current, and differ by their search alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from shapely import Polygon
    from shapely.geometry.base import BaseGeometry

    from renew._types import BoolArray, FloatArray, IntArray

    Field = Callable[[FloatArray], FloatArray]

SPACING_M = 0.05 * 111_195.0
"""0.05 degrees of latitude (m)."""

_RADIUS = 5  # coprime offsets of up to 5 steps: 80 neighbours
# Gauss-Legendre on an edge, and on each piece of a route that is scored.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_PIECE_M = 1_000.0
# Chords to a quarter circle of the clearance; the circle lies inside of them.
_QUAD_SEGMENTS = 32


def keep_out(land: Sequence[Polygon], clearance: float) -> BaseGeometry:
    """Land and all water nearer to it than a clearance (m)."""
    radius = clearance / math.cos(math.pi / 4 / _QUAD_SEGMENTS)
    grown = shapely.buffer(np.array(land, dtype=object), radius, quad_segs=_QUAD_SEGMENTS)
    return shapely.union_all(grown)


@dataclass(frozen=True, slots=True)
class Wall:
    """A line through `middle` square to the way: its left half bars one side, its right the other.

    `middle` (2,) lies on the island between start and goal; `way` (2,) points from start to goal.
    """

    middle: FloatArray
    way: FloatArray

    def halves(self, tail: FloatArray, head: FloatArray) -> IntArray:
        """Which half legs tail -> head (n, 2) cross: 1 the left, -1 the right, 0 neither."""
        left = np.array([-self.way[1], self.way[0]])
        before, after = (tail - self.middle) @ self.way, (head - self.middle) @ self.way
        place = before * ((head - self.middle) @ left) - after * ((tail - self.middle) @ left)
        crosses = (before < 0) != (after < 0)
        return np.where(crosses, np.sign(place * (before - after)), 0).astype(np.int64)


@dataclass(frozen=True, slots=True)
class Grid:
    """Edges tail -> head between points (n, 2), each with its times there and back (s).

    The last two points are start and goal.
    """

    points: FloatArray
    tail: IntArray
    head: IntArray
    there: FloatArray
    back: FloatArray

    @classmethod
    def over(
        cls,
        extent: Polygon,
        barred: BaseGeometry,
        current: Field,
        speed: float,
        start: FloatArray,
        goal: FloatArray,
        spacing: float = SPACING_M,
    ) -> Grid:
        """Edges that keep out of barred water; `speed` (m/s) is through water, drift projected."""
        shapely.prepare(barred)
        xmin, ymin, xmax, ymax = extent.bounds
        x = np.arange(xmin + spacing / 2, xmax, spacing)
        y = np.arange(ymin + spacing / 2, ymax, spacing)
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        points = np.vstack([nodes, start, goal])
        free = shapely.contains_xy(extent, nodes) & ~shapely.intersects_xy(barred, nodes)
        tail, head = _edges(len(x), len(y), free)
        for end in (len(nodes), len(nodes) + 1):
            apart = np.linalg.norm(nodes - points[end], axis=1)
            close = np.flatnonzero(free & (apart > 0) & (apart <= _RADIUS * spacing))
            tail, head = np.append(tail, np.full(len(close), end)), np.append(head, close)
        beside = shapely.dwithin(barred, shapely.points(nodes), spacing)
        room = _room(beside.reshape(len(y), len(x)))
        clear = _clear(points, tail, head, spacing * np.append(room, [0.0, 0.0]), barred)
        tail, head = tail[clear], head[clear]
        there, back = _times(points[tail], points[head], current, speed)
        swift = (there > 0) & (back > 0)
        return cls(points, tail[swift], head[swift], there[swift], back[swift])

    def best(self, without: BoolArray | None = None) -> FloatArray | None:
        """Quickest path (n, 2) from start to goal, or None; `without` says which edges to bar."""
        kept = slice(None) if without is None else ~without
        a, b = self.tail[kept], self.head[kept]
        times = np.append(self.there[kept], self.back[kept])
        start, goal = len(self.points) - 2, len(self.points) - 1
        shape = len(self.points), len(self.points)
        graph = csr_array((times, (np.append(a, b), np.append(b, a))), shape=shape)
        _, before = dijkstra(graph, indices=start, return_predecessors=True)
        row = [goal]
        while before[row[-1]] >= 0:
            row.append(int(before[row[-1]]))
        return self.points[row[::-1]] if row[-1] == start else None

    def best_on_each_side(self, wall: Wall) -> dict[int, FloatArray]:
        """Paths that cross the wall's left half only (1) and its right half only (-1)."""
        half = wall.halves(self.points[self.tail], self.points[self.head])
        found = {side: self.best(without=half == -side) for side in (1, -1)}
        return {side: path for side, path in found.items() if path is not None}


def passage_time(path: FloatArray, current: Field, speed: float) -> float:
    """Score a path (n, 2): its time (s) in the projected drift model, by a fine quadrature."""
    legs = np.diff(path, axis=0)
    total = 0.0
    for a, leg in zip(path[:-1], legs, strict=True):
        length = float(np.hypot(*leg))
        if length == 0:
            continue
        pieces = math.ceil(length / _PIECE_M)
        place = (np.arange(pieces)[:, None] + (_NODES + 1) / 2) / pieces
        along = current(a + place[..., None] * leg) @ (leg / length)
        total += float((_WEIGHTS / 2 / (speed + along)).sum()) * length / pieces
    return total


def _edges(columns: int, rows: int, free: BoolArray) -> tuple[IntArray, IntArray]:
    """Pairs of free nodes, one row of the grid after the other, each pair once."""
    index = np.arange(columns * rows).reshape(rows, columns)
    tails, heads = [], []
    for dy in range(_RADIUS + 1):
        for dx in range(-_RADIUS, _RADIUS + 1):
            if math.gcd(dx, dy) == 1 and (dy > 0 or dx > 0):
                tail = index[: rows - dy, max(0, -dx) : columns - max(0, dx)].ravel()
                head = index[dy:, max(0, dx) : columns + min(0, dx)].ravel()
                both = free[tail] & free[head]
                tails.append(tail[both])
                heads.append(head[both])
    return np.concatenate(tails), np.concatenate(heads)


def _room(beside: BoolArray) -> FloatArray:
    """How many spacings each node is from barred water at least.

    `beside` (rows, columns) says which nodes are within one spacing of it: the node nearest to
    any barred point is, as it is within 0.71.
    """
    away: FloatArray = distance_transform_edt(~beside)
    return np.maximum(away - math.sqrt(0.5), 0.0).ravel()


def _clear(
    points: FloatArray, tail: IntArray, head: IntArray, room: FloatArray, barred: BaseGeometry
) -> BoolArray:
    """Whether edges keep out of the barred water.

    They do where the circles of free water about their ends meet; the others are looked at.
    """
    length = np.linalg.norm(points[head] - points[tail], axis=1)
    clear: BoolArray = length < room[tail] + room[head]
    doubtful = np.flatnonzero(~clear)
    legs = shapely.linestrings(np.stack([points[tail[doubtful]], points[head[doubtful]]], axis=1))
    clear[doubtful] = ~shapely.intersects(barred, legs)
    return clear


def _times(
    tail: FloatArray, head: FloatArray, current: Field, speed: float
) -> tuple[FloatArray, FloatArray]:
    """Times (s) of edges tail -> head and head -> tail (n, 2)."""
    leg = head - tail
    length = np.hypot(leg[:, 0], leg[:, 1])
    there, back = np.zeros((2, len(leg)))
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        along = (current(tail + (node + 1) / 2 * leg) * leg).sum(axis=1) / length
        there += weight / 2 * length / (speed + along)
        back += weight / 2 * length / (speed - along)
    return there, back
