"""A simple planner to compare with: Dijkstra's algorithm on a grid with 80 neighbours a node.

This is what a navigator who knows SciPy could write in a page, and it takes a second. It finds a
good route on each side of an island, but not the least fuel; for that see :mod:`tests.oracles`. It
shares only the land, the current as a function, and the plane with the planner. The plane is shared
on purpose: it is conformal and, on Palawan, true to 0.1 %, so both plan in the same metres, with
straight legs and the same current, and only their searches differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from renew._types import BoolArray, FloatArray, IntArray

Field = Callable[[FloatArray], FloatArray]

SPACING_M = 0.05 * 111_195.0
"""Spacing of the grid, m: 0.05 degrees of latitude."""

# Largest number of grid steps along an axis between two nodes that an edge joins: 80 neighbours.
_RADIUS = 5
# Gauss-Legendre nodes and weights for an edge, and for each piece of a path in `passage_time`.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
# Largest length (m) of such a piece.
_MAX_PIECE_M = 1_000.0
# Number of chords for a quarter circle of the clearance, outside the circle.
_QUAD_SEGMENTS = 32


def keep_out(land: Sequence[Polygon], clearance: float) -> BaseGeometry:
    """Land, and the water closer to it than a clearance (m)."""
    radius = clearance / math.cos(math.pi / 4 / _QUAD_SEGMENTS)
    grown = shapely.buffer(np.array(land, dtype=object), radius, quad_segs=_QUAD_SEGMENTS)
    return shapely.union_all(grown)


@dataclass(frozen=True, slots=True)
class Wall:
    """A line through `middle`, perpendicular to `way`: each of its halves closes one side.

    `middle` (2,) lies on the island between start and goal; `way` (2,) points from start to goal.
    """

    middle: FloatArray
    way: FloatArray

    def halves(self, tail: FloatArray, head: FloatArray) -> IntArray:
        """Half that each leg tail -> head (n, 2) crosses: 1 the left, -1 the right, 0 neither."""
        left = np.array([-self.way[1], self.way[0]])
        before, after = (tail - self.middle) @ self.way, (head - self.middle) @ self.way
        place = before * ((head - self.middle) @ left) - after * ((tail - self.middle) @ left)
        crosses = (before < 0) != (after < 0)
        return np.where(crosses, np.sign(place * (before - after)), 0).astype(np.int64)


@dataclass(frozen=True, slots=True)
class Grid:
    """Edges tail -> head between points (n, 2), with the times (s) in both directions.

    The last two points are the start and the goal.
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
        no_go: BaseGeometry,
        current: Field,
        speed: float,
        start: FloatArray,
        goal: FloatArray,
        spacing: float = SPACING_M,
    ) -> Grid:
        """Edges outside a no-go zone; `speed` (m/s) is through water, the drift projected."""
        shapely.prepare(no_go)
        xmin, ymin, xmax, ymax = extent.bounds
        x = np.arange(xmin + spacing / 2, xmax, spacing)
        y = np.arange(ymin + spacing / 2, ymax, spacing)
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        points = np.vstack([nodes, start, goal])
        free = shapely.contains_xy(extent, nodes) & ~shapely.intersects_xy(no_go, nodes)
        tail, head = _edges(len(x), len(y), free)
        for endpoint in (len(nodes), len(nodes) + 1):
            distance = np.linalg.norm(nodes - points[endpoint], axis=1)
            close = np.flatnonzero(free & (distance > 0) & (distance <= _RADIUS * spacing))
            tail, head = np.append(tail, np.full(len(close), endpoint)), np.append(head, close)
        beside = shapely.dwithin(no_go, shapely.points(nodes), spacing)
        free_radius = spacing * _free_radius(beside.reshape(len(y), len(x)))
        clear = _clear(points, tail, head, np.append(free_radius, [0.0, 0.0]), no_go)
        tail, head = tail[clear], head[clear]
        there, back = _times(points[tail], points[head], current, speed)
        passable = (there > 0) & (back > 0)
        return cls(points, tail[passable], head[passable], there[passable], back[passable])

    def best(self, without: BoolArray | None = None) -> FloatArray | None:
        """Quickest path (n, 2) from start to goal, or None; edges marked `without` are not used."""
        used = slice(None) if without is None else ~without
        a, b = self.tail[used], self.head[used]
        times = np.append(self.there[used], self.back[used])
        start, goal = len(self.points) - 2, len(self.points) - 1
        shape = len(self.points), len(self.points)
        graph = csr_array((times, (np.append(a, b), np.append(b, a))), shape=shape)
        _, predecessor = dijkstra(graph, indices=start, return_predecessors=True)
        row = [goal]
        while predecessor[row[-1]] >= 0:
            row.append(int(predecessor[row[-1]]))
        return self.points[row[::-1]] if row[-1] == start else None

    def best_on_each_side(self, wall: Wall) -> dict[int, FloatArray]:
        """Quickest paths that cross only the wall's left half (1) and only its right half (-1)."""
        half = wall.halves(self.points[self.tail], self.points[self.head])
        found = {side: self.best(without=half == -side) for side in (1, -1)}
        return {side: path for side, path in found.items() if path is not None}


def passage_time(path: FloatArray, current: Field, speed: float) -> float:
    """Time (s) along a path (n, 2) in the projected drift model, by a fine quadrature."""
    legs = np.diff(path, axis=0)
    total = 0.0
    for a, leg in zip(path[:-1], legs, strict=True):
        length = float(np.hypot(*leg))
        if length == 0:
            continue
        pieces = math.ceil(length / _MAX_PIECE_M)
        place = (np.arange(pieces)[:, None] + (_NODES + 1) / 2) / pieces
        along = current(a + place[..., None] * leg) @ (leg / length)
        total += float((_WEIGHTS / 2 / (speed + along)).sum()) * length / pieces
    return total


def _edges(columns: int, rows: int, free: BoolArray) -> tuple[IntArray, IntArray]:
    """Pairs of free nodes that an edge joins, row by row, each pair once."""
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


def _free_radius(beside: BoolArray) -> FloatArray:
    """Lower bound (n,) on each node's distance from the no-go zone, in spacings.

    `beside` (rows, columns) marks the nodes within one spacing of it. The node nearest to a point
    of the zone is among them, as it lies within 0.71 spacings.
    """
    distance: FloatArray = distance_transform_edt(~beside)
    return np.maximum(distance - math.sqrt(0.5), 0.0).ravel()


def _clear(
    points: FloatArray,
    tail: IntArray,
    head: IntArray,
    free_radius: FloatArray,
    no_go: BaseGeometry,
) -> BoolArray:
    """Whether each edge stays outside the no-go zone.

    It does if the free circles around its two nodes meet; only the other edges are tested.
    """
    length = np.linalg.norm(points[head] - points[tail], axis=1)
    clear: BoolArray = length < free_radius[tail] + free_radius[head]
    uncertain = np.flatnonzero(~clear)
    legs = shapely.linestrings(np.stack([points[tail[uncertain]], points[head[uncertain]]], axis=1))
    clear[uncertain] = ~shapely.intersects(no_go, legs)
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
