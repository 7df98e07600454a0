"""Join the land between which no route could pass, by a flood through a triangulation of the water.

The water is triangulated with its corners on land and no others (constrained Delaunay). An edge
from coast to coast that is shorter than the gap is a closed gate. The water that a flood from the
points to be kept reaches through open gates stays; everything else, narrow straits, bays behind
narrow mouths, lakes and pools, becomes land. Gates that are closed with water on both sides, as
between two lone rocks, get a thin bar of land, so that no route can cross them either.

Where the points to be kept are parted by closed gates, those on the widest way between them (the
path in the maximum spanning tree of the dual graph; Hu, *The maximum capacity route problem*, 1961)
are opened again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import KDTree

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from shapely.geometry import LineString, Polygon
    from shapely.geometry.base import BaseGeometry

    FloatArray = npt.NDArray[np.float64]
    IntArray = npt.NDArray[np.int64]
    BoolArray = npt.NDArray[np.bool_]
    Geometries = npt.NDArray[np.object_]

# The coast is cut into pieces of this share of the gap, so that a strait beside a long straight
# coast is crossed by an edge hardly longer than the strait is wide (by 3 % at most).
_PIECE = 0.5
# Width of the bar across a closed gate, as a share of the gap, and of the narrowest gate opened.
_BAR = 1 / 20
_BAR_IN_OPENING = 1 / 8
# Gates of the ways up to this many times the gap are told of: later simplification shall not narrow
# them to nothing.
_TIGHT = 4.0
# An islet is no longer than this many times the gap across which it is merged: going around it
# instead of behind it is a detour of that order.
_ISLET = 3.0
# Where polygons touch in a point, at least this much land (m) is laid around it.
_LEAST_WELD_M = 0.5
# Grid (m) for overlays: edges that were cut are off their line by rounding; no slit may come of it.
_GRID_M = 1e-3


@dataclass(frozen=True, slots=True)
class Opening:
    """A gate through which the points to be kept meet, and none too wide.

    `middle` (x, y) and `width_m` are the gate's; `way` runs through it from the gate before to the
    gate behind; `reopened` says that it would be closed but for the points.
    """

    middle: tuple[float, float]
    width_m: float
    way: LineString
    reopened: bool


@dataclass(frozen=True, slots=True)
class Joined:
    """The joined land as valid polygons with no point in common; the openings to be kept open."""

    polygons: Geometries
    openings: tuple[Opening, ...]


@dataclass(frozen=True, slots=True)
class _Mesh:
    """Triangles of the water and the gates between them.

    `triangles` (t,) are polygons; gate g parts the triangles `sides[g]` and runs between the points
    (p, 2) numbered `ends[g]`, `width[g]` metres apart.
    """

    triangles: Geometries
    points: FloatArray
    ends: IntArray
    sides: IntArray
    width: FloatArray

    def middles(self, gates: Sequence[int]) -> FloatArray:
        """Return the midpoints (n, 2) of gates."""
        middles: FloatArray = self.points[self.ends[list(gates)]].mean(axis=1)
        return middles


def join(
    land: BaseGeometry,
    extent: Polygon,
    gap_m: float,
    keep: FloatArray,
    overrun_m: float,
    merge_m: float = 0.0,
) -> Joined:
    """Join land across gaps narrower than `gap_m`.

    Parameters
    ----------
    land
        Planar metres; the result covers it wherever it lies inside the domain, which is the extent
        grown by `overrun_m`.
    extent
        Where routes may go. Its edge is no coast: a way between coast and edge is open where half
        the gap is left, else land fills it.
    keep
        Points (n, 2) in the water that must stay so and stay joined to each other, if they are.
        Without any, all water larger than the gap (or `merge_m`) squared is kept.
    overrun_m
        Above 0: land that meets the extent's edge shall run over it, not end on it.
    merge_m
        Where above `gap_m`: islets up to a few times as long as this are merged with each other or
        one other piece of land across gaps narrower than this. A strait between two larger pieces
        never closes that way.
    """
    widest_m = max(gap_m, merge_m)
    domain = extent.buffer(overrun_m, join_style="mitre")
    coast = shapely.intersection(land, domain)
    if widest_m > 0:
        domain, coast = shapely.segmentize([domain, coast], _PIECE * widest_m)
    mesh = _mesh(shapely.difference(domain, coast, grid_size=_GRID_M))
    if len(mesh.triangles) == 0:
        return Joined(np.array([domain], dtype=object), ())
    piece = _pieces_at(mesh.points, coast)
    is_open = _open_gates(mesh, piece, extent, gap_m, gap_m + 2 * overrun_m)
    is_open &= ~_merging_gates(mesh, piece, coast, is_open, merge_m)
    label = _flood(mesh, is_open)
    if len(keep):
        at = _triangles_at(mesh, keep)
        ways = _widest_ways(mesh, at)
        crossed = mesh.sides[[gate for way in ways for gate in way]]
        kept = np.isin(label, label[np.concatenate([at, crossed.ravel()])])
    else:
        ways = []
        kept = np.bincount(label, shapely.area(mesh.triangles))[label] > widest_m**2
    openings = _openings(mesh, keep, ways, is_open, _TIGHT * widest_m)
    barred = ~is_open & kept[mesh.sides].any(axis=1) & (np.diff(piece[mesh.ends])[:, 0] != 0)
    barred[[gate for way in ways for gate in way]] = False
    bars_m = min([_BAR * widest_m, *(_BAR_IN_OPENING * opening.width_m for opening in openings)])
    bars = _bars(shapely.linestrings(mesh.points[mesh.ends[barred]]), bars_m, keep)
    sea = shapely.coverage_union_all(mesh.triangles[kept])
    solid = shapely.union_all(
        [shapely.difference(domain, sea, grid_size=_GRID_M), *bars.tolist()], grid_size=_GRID_M
    )
    polygons = _welded(shapely.get_parts(_without_pools(solid, keep)), max(bars_m, _LEAST_WELD_M))
    # Water that the flood did not reach, and that no land encloses, lies in the extent's corners.
    real = shapely.intersects(polygons, extent) & shapely.intersects(polygons, coast)
    return Joined(polygons[real], openings)


def _mesh(water: BaseGeometry) -> _Mesh:
    """Triangulate the water and find what parts its triangles."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(water))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    # As complex numbers, points sort and compare in one go; shared corners are equal to the bit.
    flat, number = np.unique(corners[..., 0] + 1j * corners[..., 1], return_inverse=True)
    points = np.stack([flat.real, flat.imag], axis=-1)
    number = number.reshape(-1, 3)
    pairs = np.stack([number, np.roll(number, -1, axis=1)], axis=-1)
    edges = np.sort(pairs, axis=-1).reshape(-1, 2)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    shared = np.flatnonzero((edges[order][1:] == edges[order][:-1]).all(axis=1))
    ends = edges[order[shared]]
    sides = np.stack([order[shared], order[shared + 1]], axis=-1) // 3
    width = np.hypot(*(points[ends[:, 1]] - points[ends[:, 0]]).T)
    return _Mesh(triangles, points, ends, sides, width)


def _pieces_at(points: FloatArray, land: BaseGeometry) -> IntArray:
    """Return which polygon of the land each point (p,) lies on; -1 at the domain's border."""
    vertices, owner = shapely.get_coordinates(shapely.get_parts(land), return_index=True)
    if len(vertices) == 0:
        return np.full(len(points), -1, dtype=np.int64)
    # No corner was added, so a corner on land is one of its vertices, off by the grid at most.
    apart, nearest = KDTree(vertices).query(points, distance_upper_bound=2 * _GRID_M)
    return np.where(np.isfinite(apart), np.append(owner, -1)[nearest], -1)


def _open_gates(
    mesh: _Mesh, piece: IntArray, extent: Polygon, gap_m: float, behind_m: float
) -> BoolArray:
    """Say of each gate (g,) whether a route could pass it.

    One to the border longer than `behind_m` runs along the extent's edge: nothing is closed by it.
    """
    is_open: BoolArray = mesh.width >= gap_m
    to_border = np.flatnonzero((piece[mesh.ends] < 0).any(axis=1))
    lines = shapely.linestrings(mesh.points[mesh.ends[to_border]])
    # Between two points of the border there is no land to be joined.
    free = (piece[mesh.ends[to_border]] < 0).all(axis=1)
    inside = shapely.length(shapely.intersection(lines, extent))
    is_open[to_border] = free | (inside >= gap_m / 2) | (mesh.width[to_border] > behind_m)
    return is_open


def _merging_gates(
    mesh: _Mesh, piece: IntArray, coast: BaseGeometry, is_open: BoolArray, merge_m: float
) -> BoolArray:
    """Say which gates (g,) merge an islet with its nearest land, or close a pool between the two.

    Kruskal's algorithm: the narrowest gates first, never joining two groups that are both large.
    """
    one, other = piece[mesh.ends].T
    merging = np.zeros(len(is_open), dtype=np.bool_)
    candidates = np.flatnonzero((mesh.width < merge_m) & (one >= 0) & (other >= 0) & (one != other))
    boxes = shapely.bounds(shapely.get_parts(coast)).tolist()
    group = list(range(len(boxes)))

    def root(member: int) -> int:
        while group[member] != member:
            group[member] = group[group[member]]
            member = group[member]
        return member

    for gate in candidates[np.argsort(mesh.width[candidates], kind="stable")].tolist():
        a, b = root(int(one[gate])), root(int(other[gate]))
        if a != b:
            if is_open[gate] and min(_size(boxes[a]), _size(boxes[b])) > _ISLET * merge_m:
                continue
            group[a] = b
            boxes[b] = _around(boxes[a], boxes[b])
        merging[gate] = True
    return merging


def _size(box: Sequence[float]) -> float:
    """Diagonal of bounds."""
    return math.hypot(box[2] - box[0], box[3] - box[1])


def _around(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """Return the bounds around two bounds."""
    low = [min(pair) for pair in zip(one[:2], other[:2], strict=True)]
    return low + [max(pair) for pair in zip(one[2:], other[2:], strict=True)]


def _flood(mesh: _Mesh, is_open: BoolArray) -> IntArray:
    """Label (t,) the triangles by the water body that the open gates make of them."""
    graph = _dual(mesh, np.flatnonzero(is_open), np.ones(len(mesh.width)))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], dtype=np.int64)


def _dual(mesh: _Mesh, gates: IntArray, weight: FloatArray) -> sparse.csr_array:
    """Return the graph (t, t) of the triangles that some gates join."""
    size = len(mesh.triangles)
    return sparse.csr_array((weight[gates], mesh.sides[gates].T), shape=(size, size))


def _triangles_at(mesh: _Mesh, points: FloatArray) -> IntArray:
    """Return the triangle (n,) that holds each point, or the nearest one."""
    which, found = shapely.STRtree(mesh.triangles).query_nearest(shapely.points(points))
    # A point on a gate is in two triangles: either will do.
    _, first = np.unique(which, return_index=True)
    return np.asarray(found[first], dtype=np.int64)


def _widest_ways(mesh: _Mesh, at: IntArray) -> list[list[int]]:
    """Return the gates on the widest way from the first triangle to each of the others.

    Between two nodes of a maximum spanning tree runs the path whose narrowest gate is the widest.
    Empty where no way exists.
    """
    tree = csgraph.minimum_spanning_tree(_dual(mesh, np.arange(len(mesh.width)), 1 / mesh.width))
    _, before = csgraph.breadth_first_order(tree, at[0], directed=False)
    gates = {frozenset(pair): gate for gate, pair in enumerate(mesh.sides.tolist())}
    ways = []
    for last in at[1:].tolist():
        way, here = [], last
        while before[here] >= 0:
            way.append(gates[frozenset((here, int(before[here])))])
            here = int(before[here])
        ways.append(way[::-1])
    return ways


def _openings(
    mesh: _Mesh,
    keep: FloatArray,
    ways: Sequence[Sequence[int]],
    is_open: BoolArray,
    tight_m: float,
) -> tuple[Opening, ...]:
    """Return the gates on the ways that are narrower than `tight_m`, each once."""
    openings = {}
    for way, last in zip(ways, keep[1:], strict=True):
        line = np.concatenate([keep[:1], mesh.middles(way), last[None]])
        for position, gate in enumerate(way):
            if mesh.width[gate] < tight_m:
                through = shapely.linestrings(line[position : position + 3])
                x, y = line[position + 1].tolist()
                width = float(mesh.width[gate])
                openings[gate] = Opening((x, y), width, through, not is_open[gate])
    return tuple(openings.values())


def _bars(gates: Geometries, width_m: float, keep: FloatArray) -> Geometries:
    """Return bars across gates: narrower where a point to be kept is near, none where it is on."""
    apart = (
        shapely.distance(gates[:, None], shapely.points(keep)) if len(keep) else np.empty((0, 0))
    )
    room = apart.min(axis=1) if apart.size else np.full(len(gates), np.inf)
    half = np.minimum(width_m, room)[room > _GRID_M] / 2
    bars: Geometries = shapely.buffer(gates[room > _GRID_M], half, cap_style="square")
    return bars


def _welded(polygons: Geometries, size_m: float) -> Geometries:
    """Join polygons that touch in a point, by a little land around it."""
    one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    pair = one < other
    if not pair.any():
        return polygons
    contacts = shapely.intersection(polygons[one[pair]], polygons[other[pair]])
    weld = shapely.buffer(contacts, size_m, cap_style="square", quad_segs=1)
    welded: Geometries = shapely.get_parts(shapely.union_all([*polygons, *weld], grid_size=_GRID_M))
    return welded


def _without_pools(land: BaseGeometry, keep: FloatArray) -> BaseGeometry:
    """Fill the holes of the land, but for those that hold a point to be kept (all, if none is)."""
    if len(keep) == 0 or land.is_empty:
        return land
    parts = shapely.get_parts(land)
    filled = shapely.polygons(shapely.get_exterior_ring(parts))
    rings, owner = shapely.get_rings(parts, return_index=True)
    is_hole = np.concatenate([[False], owner[1:] == owner[:-1]])
    holes = shapely.polygons(rings[is_hole])
    wanted = shapely.intersects(holes[:, None], shapely.points(keep)).any(axis=1)
    return shapely.difference(shapely.union_all(filled), shapely.union_all(holes[wanted]))
