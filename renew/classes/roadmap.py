"""A roadmap of the water: nodes of a grid and in straits, and straight legs between them.

A search for classes runs on it. Nodes stand on a rectangular grid, and on passing edges (*gates*):
straits may be far narrower than a cell. The more eddies and islands there are, the closer the nodes
stand; for a finer search beside a path, they stand only in a tube of water. A leg joins nodes whose
straight line crosses passing edges only; it is followed from triangle to triangle, so that a search
knows which class it is in.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from renew._compiled import kernel, reading_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.dual_graph import without_dead_ends
from renew.classes.legs import Mesh, legs_between
from renew.classes.triangulation import Triangulation
from renew.kernels.current_table import CurrentTable, number_below, number_up_to
from renew.voyage.voyage import Voyage

# Number of cells in still water.
_SMOOTH = 1_024
# Least number of cells in small eddies.
_EDDIES = 22_500
# Number of cells per triangle.
_PER_TRIANGLE = 20
# Largest number of cells for many triangles.
_MAX_CELLS = 40_000
# Number of cells from which legs lead in more directions.
_MANY = 5_000
# In smooth currents, cells per node of the coarsest table that is fine enough.
_PER_NODE = 0.1
# Factor by which nodes stand closer together in a finer search beside a path.
_CLOSER = 4
# Half the width of the tube of water around that path, in cells.
_TUBE = 8.0
START = 0
"""Number of the start's node."""
GOAL = 1
"""Number of the goal's node."""
# Length in cells below which a passing edge has _GATES gates; a longer edge has one, so that legs
# lead wherever triangles do.
_GATE_LENGTH = 3.0
_GATES = 3
# Number of nearest nodes to which a gate is joined, itself included.
_NEAREST = 17
# Least number of cells between start and goal.
_WAY_CELLS = 16
# Factor by which cells grow from one to the next outside of these, where the grid is coarser.
_GROWTH = 1.15


class Resolution(NamedTuple):
    """How closely nodes stand: about `cells` over the extent, each with legs to those around it.

    Legs lead to nodes at up to `reach` cells along either axis: 16 for a reach of 2, 48 for 4.
    """

    cells: int
    reach: int


def resolution_for(voyage: Voyage, triangulation: Triangulation) -> Resolution:
    """Return a resolution that distinguishes a voyage's classes: finer with eddies and islands.

    In small eddies legs also lead in more directions: with few directions, the search ends in a
    poor local minimum.
    """
    islands = min(_PER_TRIANGLE * len(triangulation.triangles), _MAX_CELLS)
    if voyage.table.has_small_eddies:
        return Resolution(max(_EDDIES, islands), 4)
    smooth = max(_SMOOTH, round(_PER_NODE * voyage.table.nodes_needed**2))
    return Resolution(max(smooth, islands), 2 if islands < _MANY else 3)


def is_coarse(resolution: Resolution) -> bool:
    """Whether a grid has so few cells that a closer one takes little time."""
    return resolution.cells < _MANY


def closer(resolution: Resolution) -> Resolution:
    """Return a resolution with cells of half the size, and legs in as many directions as any."""
    return Resolution(4 * resolution.cells, 4)


class Tube(NamedTuple):
    """The water beside some paths (n, 2), a few cells of a size (m) to either side."""

    paths: Sequence[FloatArray]
    cell: float

    def holds(self, points: FloatArray) -> BoolArray:
        """Whether it holds points (m, 2)."""
        from scipy.spatial import cKDTree

        distance, _ = cKDTree(self._along).query(points, distance_upper_bound=_TUBE * self.cell)
        return np.asarray(np.isfinite(distance))

    def holds_nodes(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether it holds each node (ny, nx) of a grid: far quicker than point by point."""
        return np.asarray(_nodes_near(x, y, self._along, _TUBE * self.cell))

    @property
    def _along(self) -> FloatArray:
        """Points (n, 2) along the paths, a cell apart at most."""
        lines = shapely.segmentize(shapely.MultiLineString(self.paths), self.cell)
        return np.asarray(shapely.get_coordinates(lines))


@kernel
def _nodes_near(x: FloatArray, y: FloatArray, points: FloatArray, distance: float) -> BoolArray:
    """Return nodes (ny, nx) of a grid that are closer than a distance (m) to some points (n, 2)."""
    near = np.zeros((len(y), len(x)), dtype=np.bool_)
    for px, py in points:
        first, last = number_below(x, px - distance), number_up_to(x, px + distance)
        for row in range(number_below(y, py - distance), number_up_to(y, py + distance)):
            for column in range(first, last):
                if math.hypot(x[column] - px, y[row] - py) < distance:
                    near[row, column] = True
    return near


def resolution_beside(
    paths: Sequence[FloatArray], voyage: Voyage, resolution: Resolution
) -> tuple[Resolution, Tube]:
    """Return the resolution and the tube for a finer search beside paths (n, 2).

    Legs lead in many directions: the ways round an islet differ by less than the detour that few
    directions cost.
    """
    xmin, ymin, xmax, ymax = voyage.chart.bounds
    cell = math.sqrt((xmax - xmin) * (ymax - ymin) / resolution.cells) / _CLOSER
    return Resolution(_CLOSER**2 * resolution.cells, 4), Tube(paths, cell)


class Roadmap(NamedTuple):
    """Nodes, start and goal first; the legs of a node are first[node] to first[node + 1].

    `time` and `back` (m,) are the least at any time along a leg, to its `head`, and back, s. The
    passing edges that a leg crosses are crossed[first_crossed[leg] : first_crossed[leg + 1]], each
    as three times the triangle that the leg leaves there, plus the corner opposite to the edge.
    """

    mesh: Mesh
    points: FloatArray  # (n, 2), m
    triangle: IntArray  # (n,): the triangle that holds each
    first: IntArray  # (n + 1,)
    head: IntArray  # (m,)
    time: FloatArray
    back: FloatArray
    first_crossed: IntArray  # (m + 1,)
    crossed: IntArray


def roadmap(
    voyage: Voyage,
    triangulation: Triangulation,
    table: CurrentTable,
    *,
    clearance: float,
    resolution: Resolution,
    tube: Tube | None = None,
) -> Roadmap:
    """Put nodes over the water and join them; straits narrower than twice `clearance` m are closed.

    `table` is the current in which legs are timed. Legs lead wherever a row of triangles does, but
    only inside the tube, if one is given.
    """
    mesh = _mesh(triangulation, clearance)
    x, y = _axes(voyage, resolution.cells)
    ends = np.stack([voyage.start, voyage.goal])
    holding = np.array([triangulation.locate(point) for point in ends])
    is_way = without_dead_ends(triangulation.neighbours, *holding.tolist())
    gates, beside_gates = _gates(triangulation, clearance, _GATE_LENGTH * _coarsest(x, y), is_way)
    wanted = np.ones((len(y), len(x)), dtype=bool)
    if tube is not None:
        inside = tube.holds(gates)
        gates, beside_gates = gates[inside], beside_gates[inside]
        wanted = tube.holds_nodes(x, y)
    grid = grid_triangles(x, y, mesh, wanted)
    row, column = np.nonzero(grid >= 0)
    points = np.concatenate([ends, gates, np.column_stack([x[column], y[row]])])
    triangle = np.concatenate([holding, beside_gates[:, 0], grid[row, column]])
    loose = len(ends) + len(gates)
    node = np.full(grid.shape, -1)
    node[row, column] = np.arange(loose, len(points))
    around = np.concatenate([np.stack([holding, holding], axis=1), beside_gates])
    pairs = np.concatenate(
        [
            _grid_pairs(node, resolution.reach),
            _loose_pairs(points, around, resolution.reach * _coarsest(x, y)),
        ]
    )
    legs = legs_between(points, triangle, pairs, mesh, table.extremes(), voyage.polar)
    return Roadmap(mesh, points, triangle, *legs)


def _mesh(triangulation: Triangulation, clearance: float) -> Mesh:
    """Return the mesh of a triangulation."""
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
    """Return coordinates of a grid's lines, even, or finer around a short voyage."""
    xmin, ymin, xmax, ymax = voyage.chart.bounds
    cell = math.sqrt((xmax - xmin) * (ymax - ymin) / cells)
    fine = math.dist(voyage.start, voyage.goal) / _WAY_CELLS
    # A strip of a chart would have far more than `cells` along it.
    wide, high = (max(cell, side / cells) for side in (xmax - xmin, ymax - ymin))
    return (
        _axis(xmin, xmax, wide, fine, sorted((voyage.start[0], voyage.goal[0]))),
        _axis(ymin, ymax, high, fine, sorted((voyage.start[1], voyage.goal[1]))),
    )


def _axis(low: float, high: float, cell: float, fine: float, way: list[float]) -> FloatArray:
    """Return coordinates from low to high, a cell apart; around a way at most `fine` m apart."""
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
    """Return the size (m) of the largest cell."""
    return float(max(np.diff(x).max(initial=0.0), np.diff(y).max(initial=0.0)))


def _gates(
    triangulation: Triangulation, clearance: float, short: float, is_way: BoolArray
) -> tuple[FloatArray, IntArray]:
    """Return gates: points (g, 2) on passing edges, and the triangles (g, 2) on both sides of each.

    Only edges between triangles on a way (t,) have gates; short edges have a few.
    """
    neighbours = triangulation.neighbours
    is_passed = (neighbours > np.arange(len(neighbours))[:, None]) & is_way[:, None]
    triangle, corner = np.nonzero(is_passed & is_way[neighbours])
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
    return points, beside[edge]


def _grid_pairs(node: IntArray, reach: int) -> IntArray:
    """Return pairs (p, 2) of the grid's nodes (ny, nx) that stand close; -1 is none."""
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
    """Return pairs (p, 2) of start, goal and gates with the nodes around them, each pair once.

    These come first among the points; `around` (l, 2) has the triangles on both sides of each. All
    on the same triangle are joined, and the nearest others within a radius (m).
    """
    from scipy.spatial import cKDTree

    loose = len(around)
    _, near = cKDTree(points).query(
        points[:loose], k=min(_NEAREST, len(points)), distance_upper_bound=radius
    )
    one, place = np.nonzero(near < len(points))
    ones, others = [one], [near[one, place]]
    order = np.argsort(around, axis=None, kind="stable")
    triangle, member = around.ravel()[order], order // 2
    for shift in range(1, 3 * _GATES + 2):
        same = triangle[shift:] == triangle[:-shift]
        if not same.any():
            break
        ones.append(member[:-shift][same])
        others.append(member[shift:][same])
    one, other = np.concatenate(ones), np.concatenate(others)
    # As one number each, sorted: NumPy takes ten times as long to find the same pairs.
    number = np.sort(np.minimum(one, other) * len(points) + np.maximum(one, other))
    number = number[np.diff(number, prepend=-1) > 0]
    low = number // len(points)
    high = number - low * len(points)
    return np.asarray(np.column_stack([low, high])[low < high])


@kernel
def grid_triangles(x: FloatArray, y: FloatArray, mesh: Mesh, wanted: BoolArray) -> IntArray:
    """Return the triangle (ny, nx) of each point of a grid; -1 off the water, or if unwanted.

    Points closer to land than the mesh's clearance are off the water.
    """
    holding = np.full((len(y), len(x)), -1, dtype=np.int64)
    for t in range(len(mesh.corners)):
        (ax, ay), (bx, by), (cx, cy) = mesh.corners[t]
        west, east = min(ax, bx, cx), max(ax, bx, cx)
        south, north = min(ay, by, cy), max(ay, by, cy)
        first, last = number_below(x, west), number_up_to(x, east)
        for r in range(number_below(y, south), number_up_to(y, north)):
            for c in range(first, last):
                if wanted[r, c] and _holds(mesh, t, x[c], y[r]):
                    holding[r, c] = t
    return holding


@reading_kernel
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
