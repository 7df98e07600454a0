"""Water that a baseline may use: land with a padding around each edge, in a grid of buckets.

Legs are tested exactly against all padded edges (capsules) in the cells that they cross.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

import renew
from experiments.kernels.compiled import compiled
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import Segment, capsule_interval, segment_distance

BARE = -1.0
"""Padding of an edge that may be passed at any distance, but not touched."""

# Number of cells of the buckets' grid for each edge.
_CELLS_PER_EDGE = 8
# Largest number of cells of that grid.
_MAX_CELLS = 1_000_000
# Least number of cells of that grid.
_MIN_CELLS = 400
# Share of the distance of start or goal to an edge that its padding may have.
_SHORT = 1 - 1e-6


class Buckets(NamedTuple):
    """Padded edges, with the edges that each cell of a grid meets.

    Edges of cell (row, column) are member[first[i]:first[i + 1]] with i = row * columns + column.
    """

    edges: FloatArray  # (e, 5): x0, y0, x1, y1, padding, m
    first: IntArray
    member: IntArray
    frame: FloatArray  # (5,): xmin, ymin, cells per metre, columns, rows


@dataclass(frozen=True)
class PaddedWater:
    """A chart whose edges are padded: `edges` (e, 5) x0, y0, x1, y1 and padding or BARE, m."""

    chart: renew.Chart
    edges: FloatArray

    @classmethod
    def of(
        cls,
        chart: renew.Chart,
        padding: float | FloatArray = 0.0,
        ends: FloatArray | None = None,
    ) -> PaddedWater:
        """Pad all edges on land by the same (m), or those listed (e, 5) and no others.

        The extent's edge is the end of the chart: it is not padded. No padding reaches `ends` (n,
        2), start and goal: harbours lie in it, and our planner leaves it by its first section.
        """
        land = _ring_edges(shapely.get_rings(chart.no_go))
        end = _ring_edges(shapely.get_rings(chart.extent))
        width = padding if isinstance(padding, float) and padding > 0 else BARE
        bare = np.full((len(end), 1), BARE)
        edges = [
            np.hstack([land, np.full((len(land), 1), width)]),
            np.hstack([end, bare]),
        ]
        if not isinstance(padding, float):
            edges.append(padding[padding[:, 4] > 0])
        every = np.vstack(edges)
        if ends is not None:
            free = segment_distance(ends[:, None], every[:, :2], every[:, 2:4]).min(axis=0)
            padded = every[:, 4] > 0
            every[padded, 4] = np.minimum(every[padded, 4], _SHORT * free[padded])
        return cls(chart, np.ascontiguousarray(every))

    @cached_property
    def buckets(self) -> Buckets:
        """The edges by the cells that they meet."""
        xmin, ymin, xmax, ymax = self.chart.bounds
        wide, high = xmax - xmin, ymax - ymin
        cells = min(max(_MIN_CELLS, _CELLS_PER_EDGE * len(self.edges)), _MAX_CELLS)
        per_metre = math.sqrt(cells / (wide * high))
        columns, rows = math.ceil(wide * per_metre), math.ceil(high * per_metre)
        frame = np.array([xmin, ymin, per_metre, columns, rows])
        first, member = _filled(self.edges, frame)
        return Buckets(self.edges, first, member, frame)

    @cached_property
    def _land(self) -> shapely.geometry.base.BaseGeometry:
        land = self.chart.hard_no_go
        shapely.prepare(land)
        return land

    @cached_property
    def _extent(self) -> shapely.geometry.base.BaseGeometry:
        extent = self.chart.extent
        shapely.prepare(extent)
        return extent

    def holds(self, points: FloatArray) -> BoolArray:
        """Whether points (n, 2) lie in the extent, off land and off all padding."""
        x, y = points[:, 0], points[:, 1]
        inside = shapely.contains_xy(self._extent, x, y) & ~shapely.intersects_xy(self._land, x, y)
        return np.asarray(inside & legs_clear(points, points, self.buckets))

    def holds_one(self, x: float, y: float) -> bool:
        """Whether one point lies in the water; for callbacks."""
        return bool(
            leg_clear(x, y, x, y, self.buckets)
            and shapely.contains_xy(self._extent, x, y)
            and not shapely.intersects_xy(self._land, x, y)
        )

    def clear(self, a: FloatArray, b: FloatArray) -> BoolArray:
        """Whether legs a -> b (n, 2) between points of the water stay in it."""
        return legs_clear(np.ascontiguousarray(a), np.ascontiguousarray(b), self.buckets)


def _ring_edges(rings: npt.NDArray[np.object_]) -> FloatArray:
    """Edges (e, 4) of rings."""
    coordinates = [shapely.get_coordinates(ring) for ring in rings]
    return np.vstack([np.empty((0, 4)), *(np.hstack([c[:-1], c[1:]]) for c in coordinates)])


def _filled(edges: FloatArray, frame: FloatArray) -> tuple[IntArray, IntArray]:
    """Members of all cells, as :class:`Buckets` has them: by the bounding box of each capsule."""
    counts = frame[3:].astype(int)
    reach = np.maximum(edges[:, 4:], 0.0)
    corners = (
        np.minimum(edges[:, :2], edges[:, 2:4]) - reach,
        np.maximum(edges[:, :2], edges[:, 2:4]) + reach,
    )
    low, high = (
        np.clip(np.floor((corner - frame[:2]) * frame[2]).astype(int), 0, counts - 1)
        for corner in corners
    )
    wide, tall = (high - low + 1).T
    edge = np.repeat(np.arange(len(edges)), wide * tall)
    row, column = np.divmod(np.concatenate([np.arange(n) for n in wide * tall]), wide[edge])
    cell = (low[edge, 1] + row) * counts[0] + low[edge, 0] + column
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(counts.prod() + 1))
    return first, edge[order]


@compiled
def _cell(value: float, low: float, per_metre: float, count: int) -> int:
    """Index of the row or column that holds a coordinate; the outermost ones reach on."""
    return min(max(math.floor((value - low) * per_metre), 0), count - 1)


@compiled
def leg_clear(ax: float, ay: float, bx: float, by: float, buckets: Buckets) -> bool:
    """Whether a leg keeps out of all padded edges."""
    edges, first, member, frame = buckets
    columns, rows = int(frame[3]), int(frame[4])
    left, right = min(ax, bx), max(ax, bx)
    slope = (by - ay) / (bx - ax) if bx != ax else 0.0
    leg = Segment(ax, ay, bx, by)
    low, high = min(ay, by), max(ay, by)
    last = _cell(right, frame[0], frame[2], columns)
    for column in range(_cell(left, frame[0], frame[2], columns), last + 1):
        south, north = low, high
        if bx != ax:
            # The part of the leg in this column, with a little to spare for rounding.
            west = max(left, frame[0] + column / frame[2])
            east = min(right, frame[0] + (column + 1) / frame[2])
            one, other = ay + slope * (west - ax), ay + slope * (east - ax)
            spare = 1e-6 / frame[2]
            south = max(low, min(one, other) - spare)
            north = min(high, max(one, other) + spare)
        for row in range(
            _cell(south, frame[1], frame[2], rows), _cell(north, frame[1], frame[2], rows) + 1
        ):
            i = row * columns + column
            for e in member[first[i] : first[i + 1]]:
                radius = edges[e, 4]
                reach = max(radius, 0.0)
                if (
                    max(edges[e, 0], edges[e, 2]) + reach < left
                    or min(edges[e, 0], edges[e, 2]) - reach > right
                    or max(edges[e, 1], edges[e, 3]) + reach < low
                    or min(edges[e, 1], edges[e, 3]) - reach > high
                ):
                    continue
                axis = Segment(edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3])
                enter, leave = capsule_interval(leg, axis, reach)
                if enter < leave or (radius < 0.0 and enter == leave):
                    return False
    return True


@compiled
def legs_clear(a: FloatArray, b: FloatArray, buckets: Buckets) -> BoolArray:
    """Whether each leg a -> b (n, 2) keeps out of all padded edges."""
    clear = np.empty(len(a), dtype=np.bool_)
    for k in range(len(a)):
        clear[k] = leg_clear(a[k, 0], a[k, 1], b[k, 0], b[k, 1], buckets)
    return clear
