"""An independent oracle for the planner: Dijkstra's algorithm on a dense grid, wide stencil.

It shares only its inputs with the planner: a chart, a current and a vessel. It computes the time of
each edge by its own quadrature of Eq. 4 and tests each edge exactly against land, so the fuel found
is that of a real path and never too low. It may be too high: an edge's course differs from the best
one by at most half the widest angle between neighbours (4.1 degrees for the 144 neighbours of
radius 7, which costs at most 0.26 % and on average less than 0.1 %), and a corner of land lies up
to one spacing from the nodes. `tighten` removes most of that error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely.geometry.base import BaseGeometry

import renew
from pipeline._types import IntArray
from renew._types import BoolArray, FloatArray

Field = Callable[[FloatArray], FloatArray]

STENCIL_RADIUS = 7
"""Largest number of grid steps along an axis between two nodes that an edge joins."""

# Gauss-Legendre nodes and weights for one piece of an edge.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
# Largest length of a piece, in grid spacings.
_MAX_PIECE = 4.0
# Share of the extent's width by which land is shrunk, so that edges may run along it.
_SHRINK = 1e-9
# Number of chords for a quarter circle of a clearance: they cut it by 2e-5 of the radius.
_QUAD_SEGMENTS = 128
# Number of candidate points on a transversal.
_CANDIDATES = 13


def grid_dijkstra(
    chart: renew.Chart,
    current: Field,
    vessel: renew.Vessel,
    start: FloatArray,
    goal: FloatArray,
    spacing: float,
    clearance: float = 0.0,
    drift: str = "projected",
    *,
    radius: int = STENCIL_RADIUS,
) -> tuple[float, FloatArray]:
    """Least fuel from start to goal over a grid's edges, and the path (n, 2) in metres.

    The grid covers the chart's extent, its nodes `spacing` metres apart. Edges join each node to
    those at coprime offsets of up to `radius` steps along either axis, and the start and the goal
    to every node within that range. Returns inf and an empty path if no edges lead to the goal.
    """
    points, graph = grid_graph(
        chart, current, vessel, start, goal, spacing, clearance, drift, radius=radius
    )
    first, last = len(points) - 2, len(points) - 1
    time, predecessor = dijkstra(graph, indices=first, return_predecessors=True)
    if not math.isfinite(time[last]):
        return math.inf, np.empty((0, 2))
    row = [last]
    while row[-1] != first:
        row.append(int(predecessor[row[-1]]))
    return float(vessel.fuel_rate * time[last]), points[row[::-1]]


def grid_graph(
    chart: renew.Chart,
    current: Field,
    vessel: renew.Vessel,
    start: FloatArray,
    goal: FloatArray,
    spacing: float,
    clearance: float = 0.0,
    drift: str = "projected",
    *,
    radius: int = STENCIL_RADIUS,
) -> tuple[FloatArray, csr_array]:
    """Nodes (n, 2) of the grid, the last two start and goal, and times (n, n), s, of its edges."""
    water = _Water.of(chart, clearance)
    nodes, (columns, rows) = _grid(chart, spacing)
    count = len(nodes)
    index = np.arange(count).reshape(rows, columns)
    free = water.holds(nodes)
    max_edge = spacing * math.hypot(radius, radius - 1)
    near_land = water.near(nodes, max_edge)
    tails: list[IntArray] = []
    heads: list[IntArray] = []
    for dx, dy in _offsets(radius):
        x = slice(max(0, -dx), columns - max(0, dx)), slice(max(0, dx), columns + min(0, dx))
        tail, head = index[: rows - dy, x[0]].ravel(), index[dy:, x[1]].ravel()
        keep = free[tail] & free[head]
        tails.append(tail[keep])
        heads.append(head[keep])
    points = np.vstack([nodes, start, goal])
    for endpoint in (count, count + 1):
        distance = np.linalg.norm(nodes - points[endpoint], axis=1)
        close = np.flatnonzero(free & (distance <= max_edge))
        tails.append(np.full(len(close), endpoint))
        heads.append(close)
    tail, head = np.concatenate(tails), np.concatenate(heads)
    uncertain = np.ones(len(tail), dtype=bool)
    uncertain[tail < count] = near_land[tail[tail < count]]
    clear = ~uncertain
    clear[uncertain] = water.legs_clear(points[tail[uncertain]], points[head[uncertain]])
    tail, head = tail[clear], head[clear]
    there, back = leg_times(
        points[tail], points[head], current, vessel, drift, _MAX_PIECE * spacing
    )
    graph = csr_array(
        (
            np.concatenate([there, back]),
            (np.concatenate([tail, head]), np.concatenate([head, tail])),
        ),
        shape=(count + 2, count + 2),
    )
    graph.data[~np.isfinite(graph.data)] = np.inf
    return points, graph


def tighten(
    path: FloatArray,
    chart: renew.Chart,
    current: Field,
    vessel: renew.Vessel,
    clearance: float = 0.0,
    drift: str = "projected",
    *,
    spacing: float = 3.0,
    width: float = 6.0,
    rounds: int = 7,
) -> tuple[float, FloatArray]:
    """Improve a path locally by Eq. 4: its fuel, and the path (n, 2), in the same water.

    Each round puts transversals across the path every `spacing` metres, `width` metres to either
    side, and finds the quickest chain of one point on each; the next round halves the width.
    Post-condition: the result needs no more fuel than the given path, up to rounding.
    """
    water = _Water.of(chart, clearance)
    best, best_time = path, _path_time(path, current, vessel, drift, spacing)
    for _ in range(rounds):
        places = _transversals(best, spacing, width)
        shape = places.shape
        a = np.broadcast_to(places[:-1, :, None], (shape[0] - 1, shape[1], shape[1], 2))
        b = np.broadcast_to(places[1:, None], a.shape)
        times, _ = leg_times(
            a.reshape(-1, 2), b.reshape(-1, 2), current, vessel, drift, spacing * 2
        )
        times[~water.legs_clear(a.reshape(-1, 2), b.reshape(-1, 2))] = np.inf
        layers = times.reshape(a.shape[:-1])
        arrival, came_from = np.where(np.arange(shape[1]) == 0, 0.0, np.inf), []
        for layer in layers:
            total = arrival[:, None] + layer
            came_from.append(total.argmin(axis=0))
            arrival = total.min(axis=0)
        if arrival.min() < best_time:
            chain = [int(arrival.argmin())]
            for previous in reversed(came_from):
                chain.append(int(previous[chain[-1]]))
            best = places[np.arange(shape[0]), chain[::-1]]
            best_time = float(arrival.min())
        width /= 2
    return float(vessel.fuel_rate * best_time), best


def leg_times(
    a: FloatArray, b: FloatArray, current: Field, vessel: renew.Vessel, drift: str, max_piece: float
) -> tuple[FloatArray, FloatArray]:
    """Times (n,) over straight legs a -> b and b -> a (n, 2), s; inf where a leg is impassable.

    Water with a current as strong as the vessel is no-go, in whichever direction it is crossed.
    """
    leg = b - a
    length = np.hypot(leg[:, 0], leg[:, 1])
    unit = leg / np.where(length > 0, length, 1.0)[:, None]
    pieces = max(1, math.ceil(float(length.max(initial=0.0)) / max_piece))
    there, back = np.zeros(len(a)), np.zeros(len(a))
    for piece, (node, weight) in itertools.product(
        range(pieces), zip(_NODES, _WEIGHTS, strict=True)
    ):
        velocity = current(a + (piece + (node + 1) / 2) / pieces * leg)
        along = (velocity * unit).sum(axis=1)
        square = (velocity * velocity).sum(axis=1)
        if drift == "crab":
            ahead = np.sqrt(np.maximum(vessel.speed**2 - square + along**2, 0.0))
        else:
            ahead = np.full(len(a), vessel.speed)
        share = np.where(square < vessel.speed**2, weight / 2 / pieces * length, np.inf)
        share[length == 0] = 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            there += np.where(ahead + along > 0, share / (ahead + along), np.inf)
            back += np.where(ahead - along > 0, share / (ahead - along), np.inf)
    return there, back


@dataclass(frozen=True)
class _Water:
    """Where legs may run: inside `extent`, outside the interior of `land`."""

    extent: BaseGeometry
    land: BaseGeometry

    @classmethod
    def of(cls, chart: renew.Chart, clearance: float) -> _Water:
        """Water of a chart at a clearance (m)."""
        shrink = _SHRINK * float(np.ptp(np.asarray(chart.extent.exterior.coords), axis=0).max())
        land = shapely.union_all(np.array(chart.no_go, dtype=object))
        if clearance > 0:
            land = shapely.buffer(land, clearance, quad_segs=_QUAD_SEGMENTS)
        # Legs may run along the extent's edge, but not between that and land that it cuts. A chart
        # rounds its land, which then ends just inside the edge.
        touches = shapely.dwithin(land, chart.extent.exterior, 2 * chart.precision)
        extent = shapely.buffer(
            chart.extent, -2 * shrink if touches else shrink, join_style="mitre"
        )
        land = shapely.buffer(land, -shrink, join_style="mitre")
        shapely.prepare(land)
        shapely.prepare(extent)
        return cls(extent, land)

    def holds(self, points: FloatArray) -> BoolArray:
        """Whether points (n, 2) lie in the water."""
        inside: BoolArray = shapely.contains_xy(self.extent, points)
        return np.asarray(inside & ~shapely.intersects_xy(self.land, points))

    def near(self, points: FloatArray, distance: float) -> BoolArray:
        """Whether points (n, 2) lie within a distance of land or of the extent's edge."""
        where = shapely.points(points)
        close: BoolArray = shapely.dwithin(self.land, where, distance)
        if not _is_box(self.extent):
            close |= shapely.dwithin(self.extent.boundary, where, distance)
        return close

    def legs_clear(self, a: FloatArray, b: FloatArray) -> BoolArray:
        """Whether legs a -> b (n, 2) stay in the extent and out of the land."""
        moving = (a != b).any(axis=1)
        clear: BoolArray = np.zeros(len(a), dtype=bool)
        clear[~moving] = self.holds(a[~moving])
        legs = shapely.linestrings(np.stack([a[moving], b[moving]], axis=1))
        clear[moving] = shapely.covers(self.extent, legs) & ~shapely.intersects(self.land, legs)
        return clear


def _is_box(extent: BaseGeometry) -> bool:
    """Whether an extent is an upright rectangle: convex, so that legs can't leave it."""
    return bool(abs(extent.area - shapely.box(*extent.bounds).area) <= 1e-9 * extent.area)


def _grid(chart: renew.Chart, spacing: float) -> tuple[FloatArray, tuple[int, int]]:
    """Nodes (n, 2) over the extent, row by row, and the numbers of columns and rows."""
    xmin, ymin, xmax, ymax = chart.extent.bounds
    x = np.arange(xmin, xmax + spacing * 1e-6, spacing)
    y = np.arange(ymin, ymax + spacing * 1e-6, spacing)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), (len(x), len(y))


def _offsets(radius: int) -> list[tuple[int, int]]:
    """Coprime offsets (dx, dy) in the upper half plane; the others are their opposites."""
    return [
        (dx, dy)
        for dy in range(radius + 1)
        for dx in range(-radius, radius + 1)
        if math.gcd(dx, dy) == 1 and (dy > 0 or dx > 0)
    ]


def _transversals(path: FloatArray, spacing: float, width: float) -> FloatArray:
    """Points (t, m, 2) on lines across a path; the first and the last are one point, repeated."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = max(2, math.ceil(along[-1] / spacing))
    # The path's own vertices are among the points, so that the path itself can be chosen again.
    stations = np.unique(np.concatenate([along, np.linspace(0.0, along[-1], count + 1)]))
    stations = stations[np.concatenate([[True], np.diff(stations) > spacing * 1e-3])]
    stations[-1] = along[-1]
    points = np.column_stack([np.interp(stations, along, path[:, k]) for k in (0, 1)])
    tangent = np.gradient(points, stations, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    offsets = np.linspace(-width, width, _CANDIDATES)
    offsets = np.concatenate([[0.0], offsets[offsets != 0]])
    across = points[:, None] + offsets[:, None] * normal[:, None]
    across[[0, -1]] = points[[0, -1], None]
    return np.asarray(across)


def _path_time(
    path: FloatArray, current: Field, vessel: renew.Vessel, drift: str, piece: float
) -> float:
    """Time along a path (s)."""
    there, _ = leg_times(path[:-1], path[1:], current, vessel, drift, piece)
    return float(there.sum())
