"""Independent yardsticks for the planner: a dense grid Dijkstra with a wide stencil.

Nothing here shares code with the planner but the inputs: a chart, a current and a vessel. Every
edge is priced by its own quadrature of Eq. 4 and tested against the land exactly, so that the
fuel found is that of a real path, never too low. How much it is too high: an edge's course is off
the best one by at most half the stencil's widest gap (4.1 degrees with the 144 neighbours of
radius 7, so 0.26 % and on average under 0.1 %), and corners of land lie up to a spacing beside
the nodes. `tighten` takes most of that away.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt
    from shapely.geometry.base import BaseGeometry

    import renew
    from renew._types import BoolArray, FloatArray

    IntArray = npt.NDArray[np.int64]
    Field = Callable[[FloatArray], FloatArray]

STENCIL_RADIUS = 7
# Gauss-Legendre nodes a piece; pieces are at most this long, in spacings.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_LONGEST_PIECE = 4.0
# Land shrinks by this share of the extent's width, so that edges may slide along it.
_TOUCH = 1e-9
# A quarter circle of a clearance is drawn with so many chords: inside it by 2e-5 of the radius.
_QUAD_SEGMENTS = 128


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

    The grid covers the chart's extent at `spacing` metres; nodes are joined by all coprime
    offsets up to `radius` steps along either axis, start and goal to all nodes as near as that.
    Returns inf and an empty path where no edges lead to the goal.
    """
    water = _Water.of(chart, clearance)
    nodes, (columns, rows) = _grid(chart, spacing)
    count = len(nodes)
    index = np.arange(count).reshape(rows, columns)
    free = water.holds(nodes)
    reach = spacing * math.hypot(radius, radius - 1)
    near_land = water.near(nodes, reach)
    tails: list[IntArray] = []
    heads: list[IntArray] = []
    for dx, dy in _offsets(radius):
        x = slice(max(0, -dx), columns - max(0, dx)), slice(max(0, dx), columns + min(0, dx))
        tail, head = index[: rows - dy, x[0]].ravel(), index[dy:, x[1]].ravel()
        keep = free[tail] & free[head]
        tails.append(tail[keep])
        heads.append(head[keep])
    points = np.vstack([nodes, start, goal])
    for end in (count, count + 1):
        close = np.flatnonzero(free & (np.linalg.norm(nodes - points[end], axis=1) <= reach))
        tails.append(np.full(len(close), end))
        heads.append(close)
    tail, head = np.concatenate(tails), np.concatenate(heads)
    doubtful = np.ones(len(tail), dtype=bool)
    doubtful[tail < count] = near_land[tail[tail < count]]
    clear = ~doubtful
    clear[doubtful] = water.legs_clear(points[tail[doubtful]], points[head[doubtful]])
    tail, head = tail[clear], head[clear]
    there, back = leg_times(
        points[tail], points[head], current, vessel, drift, _LONGEST_PIECE * spacing
    )
    graph = csr_array(
        (
            np.concatenate([there, back]),
            (np.concatenate([tail, head]), np.concatenate([head, tail])),
        ),
        shape=(count + 2, count + 2),
    )
    graph.data[~np.isfinite(graph.data)] = np.inf
    time, before = dijkstra(graph, indices=count, return_predecessors=True)
    if not math.isfinite(time[count + 1]):
        return math.inf, np.empty((0, 2))
    row = [count + 1]
    while row[-1] != count:
        row.append(int(before[row[-1]]))
    return float(vessel.fuel_rate * time[count + 1]), points[row[::-1]]


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
    """Pull a path's string in Eq. 4: its fuel, and the path (n, 2), in the same water.

    Rungs stand across the path every `spacing` metres, `width` metres to either side; the
    cheapest row of one point a rung is found, and again on rungs half as wide around it.
    Post-condition: the path found is never dearer than the one given, up to rounding.
    """
    water = _Water.of(chart, clearance)
    best, best_time = path, _path_time(path, current, vessel, drift, spacing)
    for _ in range(rounds):
        places = _rungs(best, spacing, width)
        shape = places.shape
        a = np.broadcast_to(places[:-1, :, None], (shape[0] - 1, shape[1], shape[1], 2))
        b = np.broadcast_to(places[1:, None], a.shape)
        times, _ = leg_times(
            a.reshape(-1, 2), b.reshape(-1, 2), current, vessel, drift, spacing * 2
        )
        times[~water.legs_clear(a.reshape(-1, 2), b.reshape(-1, 2))] = np.inf
        layers = times.reshape(a.shape[:-1])
        arrival, came = np.where(np.arange(shape[1]) == 0, 0.0, np.inf), []
        for layer in layers:
            total = arrival[:, None] + layer
            came.append(total.argmin(axis=0))
            arrival = total.min(axis=0)
        if arrival.min() < best_time:
            chain = [int(arrival.argmin())]
            for back in reversed(came):
                chain.append(int(back[chain[-1]]))
            best = places[np.arange(shape[0]), chain[::-1]]
            best_time = float(arrival.min())
        width /= 2
    return float(vessel.fuel_rate * best_time), best


def leg_times(
    a: FloatArray,
    b: FloatArray,
    current: Field,
    vessel: renew.Vessel,
    drift: str,
    longest_piece: float,
) -> tuple[FloatArray, FloatArray]:
    """Times (n,) over straight legs a -> b and b -> a (n, 2), s; inf where no way can be made.

    Water that outruns the vessel is no-go for it in either direction.
    """
    leg = b - a
    length = np.hypot(leg[:, 0], leg[:, 1])
    unit = leg / np.where(length > 0, length, 1.0)[:, None]
    pieces = max(1, math.ceil(float(length.max(initial=0.0)) / longest_piece))
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


def turned(path: FloatArray) -> float:
    """Sum of a path's course changes, rad: large where it tacks."""
    legs = np.diff(path, axis=0)
    course = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    return float(np.abs(np.diff(course)).sum())


@dataclass(frozen=True)
class _Water:
    """Where legs may go: inside `extent`, outside the interior of `land`."""

    extent: BaseGeometry
    land: BaseGeometry

    @classmethod
    def of(cls, chart: renew.Chart, clearance: float) -> _Water:
        """Water of a chart at a clearance (m)."""
        touch = _TOUCH * float(np.ptp(np.asarray(chart.extent.exterior.coords), axis=0).max())
        land = shapely.union_all(np.array(chart.no_go, dtype=object))
        if clearance > 0:
            land = shapely.buffer(land, clearance, quad_segs=_QUAD_SEGMENTS)
        land = shapely.buffer(land, -touch, join_style="mitre")
        extent = shapely.buffer(chart.extent, touch, join_style="mitre")
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
    """Nodes (n, 2) over the extent, row by row, and how many columns and rows."""
    xmin, ymin, xmax, ymax = chart.extent.bounds
    x = np.arange(xmin, xmax + spacing * 1e-6, spacing)
    y = np.arange(ymin, ymax + spacing * 1e-6, spacing)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), (len(x), len(y))


def _offsets(radius: int) -> list[tuple[int, int]]:
    """Coprime offsets (dx, dy) in the upper half plane; the other half are their reverses."""
    return [
        (dx, dy)
        for dy in range(radius + 1)
        for dx in range(-radius, radius + 1)
        if math.gcd(dx, dy) == 1 and (dy > 0 or dx > 0)
    ]


def _rungs(path: FloatArray, spacing: float, width: float) -> FloatArray:
    """Points (rungs, m, 2) across a path; the ends are single points, repeated."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = max(2, math.ceil(along[-1] / spacing))
    # The path's own vertices stay, so that it is among the rows to choose from.
    stations = np.unique(np.concatenate([along, np.linspace(0.0, along[-1], count + 1)]))
    stations = stations[np.concatenate([[True], np.diff(stations) > spacing * 1e-3])]
    stations[-1] = along[-1]
    points = np.column_stack([np.interp(stations, along, path[:, k]) for k in (0, 1)])
    tangent = np.gradient(points, stations, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    offsets = np.linspace(-width, width, 13)
    offsets = np.concatenate([[0.0], offsets[offsets != 0]])
    rungs = points[:, None] + offsets[:, None] * normal[:, None]
    rungs[[0, -1]] = points[[0, -1], None]
    return np.asarray(rungs)


def _path_time(
    path: FloatArray, current: Field, vessel: renew.Vessel, drift: str, piece: float
) -> float:
    """Time along a path (s)."""
    there, _ = leg_times(path[:-1], path[1:], current, vessel, drift, piece)
    return float(there.sum())
