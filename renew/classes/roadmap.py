"""A roadmap of the water: nodes of a grid and in straits, and straight legs between them.

What a search for classes runs on. Nodes stand on a rectangular grid, and on passing edges
(*gates*): straits may be far narrower than a cell. A leg joins nodes whose straight line crosses
passing edges only; it is followed from triangle to triangle, so that a search knows which class it
is in.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.resolution import Resolution, Tube
from renew.classes.triangulation import Triangulation
from renew.inputs.voyage import Voyage
from renew.kernels.capsules import Segment
from renew.kernels.current_table import Table, velocities, velocity
from renew.kernels.ground_speed import Polar, ground_speed

START, GOAL = 0, 1
"""Numbers of the start's and the goal's node."""

NONE_CROSSED, SEVERAL_CROSSED = -1, -2
"""Stand for an edge where a leg stays in its triangle, or crosses several edges."""

_IMPASSABLE = -3


# Number of gates on a passing edge that is shorter than this, in cells; longer ones have one, so
# that legs lead wherever triangles do. Number of the nearest nodes that a gate is joined to, and
# itself.
_GATE_LENGTH, _GATES, _NEAREST = 3.0, 3, 17
# Least number of cells between start and goal; around them the grid is as fine as that takes, and
# grows coarser outwards by this factor from cell to cell.
_WAY_CELLS, _GROWTH = 16, 1.15
# Lowest speed over ground, as a share of the vessel's: a straight leg may lead against a current
# that the path itself avoids.
_MIN_SPEED = 0.1
# Number of triangles that a leg may cross, and by how much of its length it may miss its end.
MAX_CROSSED, _ROUNDING = 4096, 1e-9


class Mesh(NamedTuple):
    """The triangulation as legs are followed through it; `clearance` in m.

    A passing edge is only crossed where that is `clearance` off its ends on land.
    """

    corners: FloatArray  # (t, 3, 2), m
    neighbours: IntArray  # (t, 3), -1 across edges that are too narrow as well
    back: IntArray  # (t, 3): the corner of the neighbour that is opposite to the shared edge
    on_land: BoolArray  # (t, 3): whether that corner is
    hazardous: BoolArray  # (t, 3): whether the edge opposite to that corner lies on land
    clearance: float


class Roadmap(NamedTuple):
    """Nodes, start and goal first; the legs of a node are first[node] to first[node + 1].

    `time` and `back` (m,) are the least at any time along a leg, to its `head`, and back, s;
    `crossed` (m,) is the edge that it crosses, as the corner of the triangle it leaves that is
    opposite to it. The way is begun at `departure` (s), on the clock of the `table` of the current.
    """

    mesh: Mesh
    points: FloatArray  # (n, 2), m
    triangle: IntArray  # (n,): the triangle that holds each
    first: IntArray  # (n + 1,)
    head: IntArray  # (m,)
    time: FloatArray
    back: FloatArray
    crossed: IntArray
    table: Table
    departure: float
    polar: Polar


class _Extremes(NamedTuple):
    """The least and the largest velocity (m/s) along x and along y at a place at any time."""

    least: tuple[float, float]
    largest: tuple[float, float]


def roadmap(
    voyage: Voyage,
    triangulation: Triangulation,
    table: Table,
    *,
    clearance: float,
    resolution: Resolution,
    tube: Tube | None = None,
) -> Roadmap:
    """Put nodes over the water and join them; straits narrower than twice `clearance` m are closed.

    `table` is the current by which legs are timed. Wherever a row of triangles leads through, legs
    do; but all keep in the tube, if one is given.
    """
    mesh = _mesh(triangulation, clearance)
    x, y = _axes(voyage, resolution.cells)
    gates = _gates(triangulation, clearance, _GATE_LENGTH * _coarsest(x, y))
    ends = np.stack([voyage.start, voyage.goal])
    holding = np.array([triangulation.locate(point) for point in ends])
    grid = _triangles_of(x, y, mesh)
    if tube is not None:
        inside = tube.holds(gates.points)
        gates = _Gates(gates.points[inside], gates.triangles[inside])
        row, column = np.nonzero(grid >= 0)
        outside = ~tube.holds(np.column_stack([x[column], y[row]]))
        grid[row[outside], column[outside]] = -1
    row, column = np.nonzero(grid >= 0)
    points = np.concatenate([ends, gates.points, np.column_stack([x[column], y[row]])])
    triangle = np.concatenate([holding, gates.triangles[:, 0], grid[row, column]])
    loose = len(ends) + len(gates.points)
    node = np.full(grid.shape, -1)
    node[row, column] = np.arange(loose, len(points))
    around = np.concatenate([np.stack([holding, holding], axis=1), gates.triangles])
    pairs = np.concatenate(
        [
            _grid_pairs(node, resolution.reach),
            _loose_pairs(points, around, resolution.reach * _coarsest(x, y)),
        ]
    )
    legs = _legs(points, triangle, pairs, mesh, table.extremes(), voyage.polar)
    return Roadmap(mesh, points, triangle, *legs, table, voyage.departure, voyage.polar)


def _mesh(triangulation: Triangulation, clearance: float) -> Mesh:
    """Mesh of a triangulation."""
    neighbours = triangulation.neighbours
    triangle, corner = np.nonzero(neighbours >= 0)
    back = np.zeros_like(neighbours)
    beside = neighbours[triangle, corner]
    back[triangle, corner] = (neighbours[beside] == triangle[:, None]).argmax(axis=1)
    passable = neighbours.copy()
    is_narrow = triangulation.free_widths(clearance) <= 0
    passable[triangle[is_narrow], corner[is_narrow]] = -1
    on_land = triangulation.on_land[triangulation.triangles]
    return Mesh(triangulation.corners, passable, back, on_land, triangulation.hazardous, clearance)


def _axes(voyage: Voyage, cells: int) -> tuple[FloatArray, FloatArray]:
    """Coordinates of a grid's lines, even, or finer around a short voyage."""
    xmin, ymin, xmax, ymax = voyage.chart.bounds
    cell = math.sqrt((xmax - xmin) * (ymax - ymin) / cells)
    fine = math.dist(voyage.start, voyage.goal) / _WAY_CELLS
    # A strip of a chart would have far more cells along it than so many.
    wide, high = (max(cell, side / cells) for side in (xmax - xmin, ymax - ymin))
    return (
        _axis(xmin, xmax, wide, fine, sorted((voyage.start[0], voyage.goal[0]))),
        _axis(ymin, ymax, high, fine, sorted((voyage.start[1], voyage.goal[1]))),
    )


def _axis(low: float, high: float, cell: float, fine: float, way: list[float]) -> FloatArray:
    """Coordinates from low to high, a cell apart; `fine` m apart around a way, if that is less."""
    if fine >= cell:
        count = max(2, math.ceil((high - low) / cell))
        return low + (np.arange(count) + 0.5) * (high - low) / count
    margin = (_WAY_CELLS // 2) * fine
    west, east = max(low, way[0] - margin), min(high, way[1] + margin)
    count = max(1, math.ceil((east - west) / fine))
    inner = west + (np.arange(count) + 0.5) * (east - west) / count
    # Geometric growth up to the common cell.
    steps = fine * _GROWTH ** np.arange(1, 1 + max(0, math.ceil(math.log(cell / fine, _GROWTH))))
    steps = np.minimum(steps, cell)
    far = math.ceil((high - low) / cell)
    outwards = np.cumsum(np.concatenate([steps, np.full(far, cell)]))
    return np.concatenate(
        [
            (inner[0] - outwards)[inner[0] - outwards > low][::-1],
            inner,
            (inner[-1] + outwards)[inner[-1] + outwards < high],
        ]
    )


def _coarsest(x: FloatArray, y: FloatArray) -> float:
    """Size (m) of the largest cell."""
    return float(max(np.diff(x).max(initial=0.0), np.diff(y).max(initial=0.0)))


class _Gates(NamedTuple):
    """Points (g, 2) on passing edges, and the triangles (g, 2) on both sides of each."""

    points: FloatArray
    triangles: IntArray


def _gates(triangulation: Triangulation, clearance: float, short: float) -> _Gates:
    """Gates on passing edges, a few on those shorter than `short` m."""
    neighbours = triangulation.neighbours
    triangle, corner = np.nonzero(neighbours > np.arange(len(neighbours))[:, None])
    vertices = triangulation.edge_vertices(triangle, corner)
    a, b = triangulation.vertices[vertices[:, 0]], triangulation.vertices[vertices[:, 1]]
    length = np.linalg.norm(b - a, axis=1)
    trim = clearance * triangulation.on_land[vertices] / np.maximum(length, 1e-300)[:, None]
    low, high = trim[:, 0], 1 - trim[:, 1]
    is_strait = (length < short) & triangulation.on_land[vertices].all(axis=1)
    count = np.where(low < high, np.where(is_strait, _GATES, 1), 0)
    edge = np.repeat(np.arange(len(count)), count)
    place = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[edge]
    place = low[edge] + place * (high - low)[edge]
    points = a[edge] + place[:, None] * (b - a)[edge]
    beside = np.stack([triangle, neighbours[triangle, corner]], axis=1)
    return _Gates(points, beside[edge])


def _grid_pairs(node: IntArray, reach: int) -> IntArray:
    """Pairs (p, 2) of the grid's nodes (ny, nx) that stand close; -1 is none."""
    rows, columns = node.shape
    found = []
    for dr, dc in itertools.product(range(reach + 1), range(-reach, reach + 1)):
        if math.gcd(dr, dc) == 1 and (dr > 0 or dc > 0):
            one = node[: max(rows - dr, 0), max(0, -dc) : columns - max(0, dc)]
            other = node[dr:, max(0, dc) : columns + min(0, dc)]
            both = (one >= 0) & (other >= 0)
            found.append(np.stack([one[both], other[both]], axis=1))
    return np.concatenate(found)


def _loose_pairs(points: FloatArray, around: IntArray, radius: float) -> IntArray:
    """Pairs (p, 2) of start, goal and gates with what stands around them, each pair once.

    These come first among the points; `around` (l, 2) has the triangles on both sides of each. All
    on the same triangle are joined, and the nearest others within a radius (m).
    """
    loose = len(around)
    _, near = cKDTree(points).query(
        points[:loose], k=min(_NEAREST, len(points)), distance_upper_bound=radius
    )
    one, place = np.nonzero(near < len(points))
    found = [np.stack([one, near[one, place]], axis=1)]
    order = np.argsort(around, axis=None, kind="stable")
    triangle, member = around.ravel()[order], order // 2
    for shift in range(1, 3 * _GATES + 2):
        same = triangle[shift:] == triangle[:-shift]
        if not same.any():
            break
        found.append(np.stack([member[:-shift][same], member[shift:][same]], axis=1))
    pairs = np.concatenate(found)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    # As one number each: of pairs NumPy takes ten times as long to find the same.
    same = np.unique(pairs.min(axis=1) * len(points) + pairs.max(axis=1))
    return np.column_stack(np.divmod(same, len(points)))


@kernel
def _triangles_of(x: FloatArray, y: FloatArray, mesh: Mesh) -> IntArray:
    """Triangle (ny, nx) that holds each point of a grid; -1 on land, or too close to it."""
    holding = np.full((len(y), len(x)), -1, dtype=np.int64)
    for t in range(len(mesh.corners)):
        xs, ys = mesh.corners[t, :, 0], mesh.corners[t, :, 1]
        first, last = np.searchsorted(x, xs.min()), np.searchsorted(x, xs.max(), side="right")
        for r in range(np.searchsorted(y, ys.min()), np.searchsorted(y, ys.max(), side="right")):
            for c in range(first, last):
                if _holds(mesh, t, x[c], y[r]):
                    holding[r, c] = t
    return holding


@kernel
def _holds(mesh: Mesh, triangle: int, x: float, y: float) -> bool:
    """Whether a point lies in a triangle, and clear of its edges on land."""
    for c in range(3):
        px, py = mesh.corners[triangle, (c + 1) % 3]
        qx, qy = mesh.corners[triangle, (c + 2) % 3]
        inside = (qx - px) * (y - py) - (qy - py) * (x - px)
        least = (
            mesh.clearance * math.hypot(qx - px, qy - py) if mesh.hazardous[triangle, c] else 0.0
        )
        if inside < least:
            return False
    return True


@kernel
def crossed_edge(mesh: Mesh, triangle: int, entry: int, leg: Segment) -> tuple[int, bool]:
    """Edge by which a leg leaves a triangle, as the corner opposite to it; -1 for none.

    `entry` is the corner opposite to the edge by which it came in, -1 at its beginning. Also
    whether the edge may be crossed there.
    """
    ax, ay, bx, by = leg
    dx, dy = bx - ax, by - ay
    out, place = -1, 1.0 + _ROUNDING
    for c in range(3):
        if c == entry:
            continue
        px, py = mesh.corners[triangle, (c + 1) % 3]
        qx, qy = mesh.corners[triangle, (c + 2) % 3]
        ux, uy = qx - px, qy - py
        slope = ux * dy - uy * dx
        if slope < 0.0:
            # Inside is to the left of the edge.
            at = (ux * (ay - py) - uy * (ax - px)) / -slope
            if at < place:
                out, place = c, at
    if out < 0 or mesh.neighbours[triangle, out] < 0:
        return out, False
    if mesh.clearance == 0.0:
        return out, True
    one, other = (out + 1) % 3, (out + 2) % 3
    x, y = ax + place * dx, ay + place * dy
    for c in (one, other):
        if mesh.on_land[triangle, c]:
            px, py = mesh.corners[triangle, c]
            if math.hypot(px - x, py - y) < mesh.clearance:
                return out, False
    return out, True


@kernel
def _crossed(mesh: Mesh, leg: Segment, triangle: int, last: int) -> tuple[int, int]:
    """Edge that a leg from one triangle to the last crosses, seen from its beginning and its end.

    Both stand for something else where it crosses none, several, or one that can't be passed.
    """
    if triangle == last:
        return NONE_CROSSED, NONE_CROSSED
    out, is_open = crossed_edge(mesh, triangle, -1, leg)
    if is_open and mesh.neighbours[triangle, out] == last:
        return out, mesh.back[triangle, out]
    for _ in range(MAX_CROSSED):
        if not is_open:
            break
        triangle, entry = mesh.neighbours[triangle, out], mesh.back[triangle, out]
        if triangle == last:
            return SEVERAL_CROSSED, SEVERAL_CROSSED
        out, is_open = crossed_edge(mesh, triangle, entry, leg)
    return _IMPASSABLE, _IMPASSABLE


@kernel
def leg_time(graph: Roadmap, node: int, number: int, begin: float) -> float:
    """Time (s) along a leg from a node, so many seconds after departure, by Simpson's rule."""
    if len(graph.table.times) == 1:
        return float(graph.time[number])
    (ax, ay), (bx, by) = graph.points[node], graph.points[graph.head[number]]
    length = math.hypot(bx - ax, by - ay)
    if length == 0.0:
        return 0.0
    tx, ty = (bx - ax) / length, (by - ay) / length
    slowest = _MIN_SPEED * graph.polar.speed
    now, total, last = graph.departure + begin, 0.0, 0.0
    for step, weight in ((0.0, 1.0), (0.5, 4.0), (1.0, 1.0)):
        x, y = ax + step * (bx - ax), ay + step * (by - ay)
        u, v = velocity(graph.table, x, y, now + step * length * last)
        last = 1.0 / max(slowest, ground_speed(u, v, tx, ty, graph.polar))
        total += weight * last
    return max(float(graph.time[number]), total * length / 6)


@kernel
def _least_times(
    leg: Segment, here: _Extremes, there: _Extremes, extremes: tuple[Table, Table], polar: Polar
) -> tuple[float, float]:
    """Least times (s) along a leg and back, by Simpson's rule, whenever it is sailed."""
    dx, dy = leg.bx - leg.ax, leg.by - leg.ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0, 0.0
    tx, ty = dx / length, dy / length
    slowest = _MIN_SPEED * polar.speed
    x, y = leg.ax + dx / 2, leg.ay + dy / 2
    middle = _Extremes(velocity(extremes[0], x, y, 0.0), velocity(extremes[1], x, y, 0.0))
    time, back = 0.0, 0.0
    for weight, currents in ((1.0, here), (4.0, middle), (1.0, there)):
        time += weight / max(slowest, _fastest(currents, tx, ty, polar))
        back += weight / max(slowest, _fastest(currents, -tx, -ty, polar))
    return time * length / 6, back * length / 6


@kernel
def _fastest(currents: _Extremes, tx: float, ty: float, polar: Polar) -> float:
    """Largest speed over ground (m/s) along the unit tangent t in currents between two extremes.

    No current is as helpful along t as the one taken, and none lies less across it.
    """
    (u, v), (more_u, more_v) = currents.least, currents.largest
    along = max(tx * u, tx * more_u) + max(ty * v, ty * more_v)
    low = min(tx * v, tx * more_v) - max(ty * u, ty * more_u)
    high = max(tx * v, tx * more_v) - min(ty * u, ty * more_u)
    across = low if low > 0.0 else min(0.0, high)
    return ground_speed(along * tx - across * ty, along * ty + across * tx, tx, ty, polar)


@kernel
def _legs(
    points: FloatArray,
    triangle: IntArray,
    pairs: IntArray,
    mesh: Mesh,
    extremes: tuple[Table, Table],
    polar: Polar,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, IntArray]:
    """Legs between pairs (p, 2) of nodes that see each other, as a roadmap's columns."""
    always = np.zeros(len(points))
    least = velocities(extremes[0], points, always)
    largest = velocities(extremes[1], points, always)
    crossed = np.empty((len(pairs), 2), dtype=np.int64)
    first = np.zeros(len(points) + 1, dtype=np.int64)
    for k in range(len(pairs)):
        a, b = pairs[k]
        leg = Segment(points[a, 0], points[a, 1], points[b, 0], points[b, 1])
        crossed[k, 0], crossed[k, 1] = _crossed(mesh, leg, triangle[a], triangle[b])
        if crossed[k, 0] != _IMPASSABLE:
            first[a + 1] += 1
            first[b + 1] += 1
    first = np.cumsum(first)
    at = first[:-1].copy()
    head, edge = np.empty((2, first[-1]), dtype=np.int64)
    time, back = np.empty((2, first[-1]))
    for k in range(len(pairs)):
        if crossed[k, 0] == _IMPASSABLE:
            continue
        a, b = pairs[k]
        leg = Segment(points[a, 0], points[a, 1], points[b, 0], points[b, 1])
        here = _Extremes((least[a, 0], least[a, 1]), (largest[a, 0], largest[a, 1]))
        there = _Extremes((least[b, 0], least[b, 1]), (largest[b, 0], largest[b, 1]))
        one, other = _least_times(leg, here, there, extremes, polar)
        head[at[a]], time[at[a]], back[at[a]], edge[at[a]] = b, one, other, crossed[k, 0]
        head[at[b]], time[at[b]], back[at[b]], edge[at[b]] = a, other, one, crossed[k, 1]
        at[a] += 1
        at[b] += 1
    return first, head, time, back, edge
