"""Close gaps that are too narrow for a route, by flooding a triangulation of the water.

The water is triangulated with vertices on the coast only (constrained Delaunay). An edge from coast
to coast that is shorter than the gap is a closed gate. Water that a flood from the endpoints
reaches through open gates stays; everything else becomes land: narrow straits, bays behind narrow
mouths, lakes and pools. A closed gate with water on both sides, as between two lone rocks, is
barred by a thin strip of land, so that no route can cross it either.

Where closed gates separate the endpoints, those on the widest way between them are opened again:
the path in the maximum spanning tree of the dual graph (Hu, *The maximum capacity route problem*,
1961).
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

# Length of the pieces into which the coast is divided, as a share of the gap: a strait along a
# straight coast is then crossed by an edge at most 3 % longer than the strait is wide.
_PIECE = 0.5
# Width of the bar across a closed gate, as a share of the gap, and of the narrowest opened gate.
_BAR = 1 / 20
_BAR_IN_OPENING = 1 / 8
# Width up to which a gate on a way counts as an opening, as a multiple of the gap: simplification
# must not narrow those to nothing.
_NARROW = 4.0
# Maximum length of an islet, as a multiple of the gap across which it is merged: passing it on the
# other side is a detour of about that length.
_ISLET = 3.0
# Minimum size of the land that is added where two polygons touch in a point, m.
_MIN_CONTACT_M = 0.5
# Grid for overlays, m: the vertices that divide an edge are off its line by rounding, which must
# not leave a slit.
_GRID_M = 1e-3


@dataclass(frozen=True, slots=True)
class Opening:
    """A narrow gate on the way between two endpoints.

    `middle` (x, y) and `width_m` are the gate's; `way` runs through it from the previous gate to
    the next; `reopened` says that it would be closed if it did not connect endpoints.
    """

    middle: tuple[float, float]
    width_m: float
    way: LineString
    reopened: bool


@dataclass(frozen=True, slots=True)
class ClosedLand:
    """Land with closed gaps: valid polygons with no point in common; the openings to stay open."""

    polygons: Geometries
    openings: tuple[Opening, ...]


@dataclass(frozen=True, slots=True)
class _WaterMesh:
    """Triangles of the water and the gates between them.

    `triangles` (t,) are polygons; gate g separates the triangles `sides[g]` and runs between the
    points (p, 2) with indices `ends[g]`, `width[g]` metres apart.
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


def close_gaps(
    land: BaseGeometry,
    extent: Polygon,
    gap_m: float,
    endpoints: FloatArray,
    overlap_m: float,
    merge_m: float = 0.0,
) -> ClosedLand:
    """Close gaps narrower than `gap_m` with land.

    Parameters
    ----------
    land
        Planar metres; the result covers it inside the domain, the extent grown by `overlap_m`.
    extent
        Where routes may go. Its edge is no coast: a passage between coast and edge is open where it
        has half the gap, otherwise it becomes land.
    endpoints
        Points (n, 2) in water that stay in water, and connected if they are. Without any, all water
        larger than the gap (or `merge_m`) squared stays.
    overlap_m
        Above 0, so that land that meets the extent's edge extends beyond it.
    merge_m
        Where above `gap_m`: islets up to a few times as long as this are merged with each other or
        with one other piece of land across gaps narrower than this. A strait between two larger
        pieces is never closed by it.
    """
    widest_m = max(gap_m, merge_m)
    domain = extent.buffer(overlap_m, join_style="mitre")
    coast = shapely.intersection(land, domain)
    if widest_m > 0:
        domain, coast = shapely.segmentize([domain, coast], _PIECE * widest_m)
    mesh = _triangulated(shapely.difference(domain, coast, grid_size=_GRID_M))
    if len(mesh.triangles) == 0:
        return ClosedLand(np.array([domain], dtype=object), ())
    piece = _pieces_at(mesh.points, coast)
    is_open = _open_gates(mesh, piece, extent, gap_m, gap_m + 2 * overlap_m)
    is_open &= ~_merging_gates(mesh, piece, coast, is_open, merge_m)
    ways, stays = _remaining_water(mesh, is_open, endpoints, widest_m**2)
    openings = _openings(mesh, endpoints, ways, is_open, _NARROW * widest_m)
    barred = ~is_open & stays[mesh.sides].any(axis=1) & (np.diff(piece[mesh.ends])[:, 0] != 0)
    barred[[gate for way in ways for gate in way]] = False
    bars_m = min([_BAR * widest_m, *(_BAR_IN_OPENING * opening.width_m for opening in openings)])
    bars = _bars(shapely.linestrings(mesh.points[mesh.ends[barred]]), bars_m, endpoints)
    sea = shapely.coverage_union_all(mesh.triangles[stays])
    solid = shapely.union_all(
        [shapely.difference(domain, sea, grid_size=_GRID_M), *bars.tolist()], grid_size=_GRID_M
    )
    parts = shapely.get_parts(_without_lakes(solid, endpoints))
    polygons = _joined_at_contacts(parts, max(bars_m, _MIN_CONTACT_M))
    # Water that the flood did not reach and no land encloses lies in the extent's corners.
    real = shapely.intersects(polygons, extent) & shapely.intersects(polygons, coast)
    return ClosedLand(polygons[real], openings)


def _remaining_water(
    mesh: _WaterMesh, is_open: BoolArray, endpoints: FloatArray, min_area: float
) -> tuple[list[list[int]], BoolArray]:
    """Return the widest ways between the endpoints, and which triangles (t,) stay water.

    Without endpoints, water of more than `min_area` (m²) stays, and there are no ways.
    """
    body = _flooded(mesh, is_open)
    if len(endpoints) == 0:
        return [], np.bincount(body, shapely.area(mesh.triangles))[body] > min_area
    at = _triangles_at(mesh, endpoints)
    ways = _widest_ways(mesh, at)
    crossed = mesh.sides[[gate for way in ways for gate in way]]
    return ways, np.isin(body, body[np.concatenate([at, crossed.ravel()])])


def _triangulated(water: BaseGeometry) -> _WaterMesh:
    """Triangulate the water and find the gates between its triangles."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(water))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    # As complex numbers, points can be sorted and compared; shared corners are equal bit by bit.
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
    return _WaterMesh(triangles, points, ends, sides, width)


def _pieces_at(points: FloatArray, land: BaseGeometry) -> IntArray:
    """Return the index of the polygon on which each point (p,) lies; -1 on the domain's border."""
    vertices, owner = shapely.get_coordinates(shapely.get_parts(land), return_index=True)
    if len(vertices) == 0:
        return np.full(len(points), -1, dtype=np.int64)
    # The triangulation adds no points, so that a point on land is one of its vertices, to the grid.
    apart, nearest = KDTree(vertices).query(points, distance_upper_bound=2 * _GRID_M)
    return np.where(np.isfinite(apart), np.append(owner, -1)[nearest], -1)


def _open_gates(
    mesh: _WaterMesh, piece: IntArray, extent: Polygon, gap_m: float, along_edge_m: float
) -> BoolArray:
    """Say of each gate (g,) whether a route can pass it.

    A gate to the border that is longer than `along_edge_m` runs along the extent's edge: open.
    """
    is_open: BoolArray = mesh.width >= gap_m
    to_border = np.flatnonzero((piece[mesh.ends] < 0).any(axis=1))
    lines = shapely.linestrings(mesh.points[mesh.ends[to_border]])
    # Between two points of the border there is no land.
    free = (piece[mesh.ends[to_border]] < 0).all(axis=1)
    inside = shapely.length(shapely.intersection(lines, extent))
    is_open[to_border] = free | (inside >= gap_m / 2) | (mesh.width[to_border] > along_edge_m)
    return is_open


def _merging_gates(
    mesh: _WaterMesh, piece: IntArray, coast: BaseGeometry, is_open: BoolArray, merge_m: float
) -> BoolArray:
    """Say which gates (g,) merge an islet with its nearest land, or close a pool between the two.

    Kruskal's algorithm: the narrowest gates first, never merging two groups that are both large.
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
            boxes[b] = _common_bounds(boxes[a], boxes[b])
        merging[gate] = True
    return merging


def _size(box: Sequence[float]) -> float:
    """Return the diagonal of bounds."""
    return math.hypot(box[2] - box[0], box[3] - box[1])


def _common_bounds(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """Return the bounds that enclose two bounds."""
    low = [min(pair) for pair in zip(one[:2], other[:2], strict=True)]
    return low + [max(pair) for pair in zip(one[2:], other[2:], strict=True)]


def _flooded(mesh: _WaterMesh, is_open: BoolArray) -> IntArray:
    """Label each triangle (t,) by the body of water to which open gates connect it."""
    graph = _dual(mesh, np.flatnonzero(is_open), np.ones(len(mesh.width)))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], dtype=np.int64)


def _dual(mesh: _WaterMesh, gates: IntArray, weight: FloatArray) -> sparse.csr_array:
    """Return the graph (t, t) of the triangles that some gates connect."""
    size = len(mesh.triangles)
    return sparse.csr_array((weight[gates], mesh.sides[gates].T), shape=(size, size))


def _triangles_at(mesh: _WaterMesh, points: FloatArray) -> IntArray:
    """Return the triangle (n,) that holds each point, or the nearest one."""
    which, found = shapely.STRtree(mesh.triangles).query_nearest(shapely.points(points))
    # A point on a gate is in two triangles: either one will do.
    _, first = np.unique(which, return_index=True)
    return np.asarray(found[first], dtype=np.int64)


def _widest_ways(mesh: _WaterMesh, at: IntArray) -> list[list[int]]:
    """Return the gates on the widest way from the first triangle to each of the others.

    The path between two nodes of a maximum spanning tree is the one whose narrowest gate is widest.
    Empty where there is no way.
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
    mesh: _WaterMesh,
    endpoints: FloatArray,
    ways: Sequence[Sequence[int]],
    is_open: BoolArray,
    narrow_m: float,
) -> tuple[Opening, ...]:
    """Return the gates on the ways that are narrower than `narrow_m`, each once."""
    openings = {}
    for way, last in zip(ways, endpoints[1:], strict=True):
        line = np.concatenate([endpoints[:1], mesh.middles(way), last[None]])
        for position, gate in enumerate(way):
            if mesh.width[gate] < narrow_m:
                through = shapely.linestrings(line[position : position + 3])
                x, y = line[position + 1].tolist()
                width = float(mesh.width[gate])
                openings[gate] = Opening((x, y), width, through, not is_open[gate])
    return tuple(openings.values())


def _bars(gates: Geometries, width_m: float, endpoints: FloatArray) -> Geometries:
    """Return bars across gates: narrower where an endpoint is near, none where it is on one."""
    room = np.full(len(gates), np.inf)
    if len(gates) and len(endpoints):
        room = shapely.distance(gates[:, None], shapely.points(endpoints)).min(axis=1)
    half = np.minimum(width_m, room)[room > _GRID_M] / 2
    bars: Geometries = shapely.buffer(gates[room > _GRID_M], half, cap_style="square")
    return bars


def _joined_at_contacts(polygons: Geometries, size_m: float) -> Geometries:
    """Join polygons that touch in a point, by land of the given size (m) around it."""
    one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    pair = one < other
    if not pair.any():
        return polygons
    contacts = shapely.intersection(polygons[one[pair]], polygons[other[pair]])
    added = shapely.buffer(contacts, size_m, cap_style="square", quad_segs=1)
    union = shapely.union_all([*polygons, *added], grid_size=_GRID_M)
    return np.asarray(shapely.get_parts(union))


def _without_lakes(land: BaseGeometry, endpoints: FloatArray) -> BaseGeometry:
    """Fill the holes of the land that hold no endpoint; without endpoints, fill none."""
    if len(endpoints) == 0 or land.is_empty:
        return land
    parts = shapely.get_parts(land)
    filled = shapely.polygons(shapely.get_exterior_ring(parts))
    rings, owner = shapely.get_rings(parts, return_index=True)
    is_hole = np.concatenate([[False], owner[1:] == owner[:-1]])
    holes = shapely.polygons(rings[is_hole])
    stays = shapely.intersects(holes[:, None], shapely.points(endpoints)).any(axis=1)
    return shapely.difference(shapely.union_all(filled), shapely.union_all(holes[stays]))
