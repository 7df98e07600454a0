"""Coasts in the plane: land covered by few vertices, and moved back where the vessel needs water.

Only polygons that overlap afterwards are joined, and there is no limit on vertices: a strait stays
open if it is wider than 2 × (margin + tolerance).

Every ring is simplified by itself (Douglas and Peucker, *Algorithms for the reduction of the number
of points required to represent a digitized line or its caricature*, 1973). The ring can be deformed
into the simplified one with no point moving by more than the cut. So a point that is further than
the cut from the simplified ring is inside it if and only if it was inside the original: a buffer
outwards by the cut covers the area, and a buffer inwards lies within it. (shapely's own
simplification of polygons drops lobes where a ring crosses itself.)

The widest path between two points is found over a triangulation of the water (constrained Delaunay,
with vertices on the coast only). Each edge of the triangulation is a gate as wide as it is long.
The path between two nodes of a maximum spanning tree is the one whose narrowest gate is widest (Hu,
*The maximum capacity route problem*, 1961).
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse import csgraph

import renew
from pipeline._types import FloatArray, Geometries, IndexArray
from renew.classes.triangulation import Triangulation, triangulate, triangulate_tiles

# Share of the tolerance that is cut before the buffer. The rest is cut after it, which also removes
# vertices that the buffer adds. Of the shares that were tried, this left the fewest vertices.
_BEFORE = 1 / 3
# Segments per quarter circle of a round corner, most of whose vertices are removed again. A mitre
# would take fewer, but make capes longer, and so shut straits between them.
_QUADRANT_SEGMENTS = 5
# Factor on a buffer's radius, so that its corners also reach as far as the radius: GEOS rounds the
# number of segments of a corner, so that each may be half as long again, and simplifies a line by
# about 1 % of the radius before it buffers the line.
_REACH = 1.02 / math.cos(1.5 * math.pi / (4 * _QUADRANT_SEGMENTS))


def covering_land(
    polygons: Geometries, tolerance_m: float, margin_m: float, endpoints: FloatArray
) -> Geometries:
    """Cover polygons and a margin around them by disjoint polygons of fewer vertices.

    The new coast is at most margin plus tolerance (planar metres) from the land, or 1.05 times the
    margin if that is more. Enclosed water becomes land, unless it holds one of the endpoints
    (n, 2); without endpoints it stays water.
    """
    # The factor on the buffer's radius moves the coast beyond the margin: the tolerance is reduced
    # by this distance.
    cut_m = max(0.0, tolerance_m - (_REACH - 1) * margin_m) / (1 + _REACH)
    radius_m = (cut_m + margin_m) * _REACH
    areas, outlines, _ = simplified(_without_lakes(polygons, endpoints), _BEFORE * cut_m)
    grown = shapely.buffer(
        np.concatenate([areas, outlines]), radius_m, quad_segs=_QUADRANT_SEGMENTS
    )
    land = _without_lakes(_united(grown), endpoints)
    smooth = _united(simplified(land, (1 - _BEFORE) * cut_m)[0])
    # Filling may enclose other water: its islands are united with the land around.
    return _united(_without_lakes(smooth, endpoints))


def inner_land(polygons: Geometries, tolerance_m: float, margin_m: float) -> Geometries:
    """Return polygons of fewer vertices inside others, at least the margin away from their coast.

    They overlap where the given ones do. All land further from the coast than margin plus twice the
    tolerance (planar metres; 5 % more) is inside, except for narrow necks.
    """
    areas, outlines, owner = simplified(polygons, _BEFORE * tolerance_m)
    radius_m = (tolerance_m + margin_m) * _REACH
    shrunk = shapely.buffer(areas, -radius_m, quad_segs=_QUADRANT_SEGMENTS)
    has_area = ~shapely.is_empty(areas[owner])
    owner = owner[has_area]
    around = shapely.buffer(outlines[has_area], radius_m, quad_segs=_QUADRANT_SEGMENTS)
    for index in np.unique(owner):
        shrunk[index] = shapely.difference(shrunk[index], shapely.union_all(around[owner == index]))
    cut_m = (1 - _BEFORE) * tolerance_m
    return _polygons_of(simplified(_polygons_of(shrunk), cut_m)[0])


# Number of vertices above which a polygon is halved.
_SMALL = 256
# Dimensions of an area.
_AREA = 2


def in_small_pieces(polygons: Geometries) -> Geometries:
    """Return polygons of few vertices that make up others: to cut a continent takes milliseconds.

    Pieces of one polygon meet along straight lines.
    """
    is_small = shapely.get_num_coordinates(polygons) <= _SMALL
    if is_small.all():
        return polygons
    west, south, east, north = shapely.bounds(polygons[~is_small]).T
    is_wide = east - west > north - south
    x = np.where(is_wide, (west + east) / 2, east)
    y = np.where(is_wide, north, (south + north) / 2)
    other_x, other_y = np.where(is_wide, x, west), np.where(is_wide, south, y)
    halves = np.concatenate(
        [shapely.box(west, south, x, y), shapely.box(other_x, other_y, east, north)]
    )
    cut = shapely.intersection(np.tile(polygons[~is_small], 2), halves)
    parts = _polygons_of(cut)
    pieces = parts[shapely.get_dimensions(parts) == _AREA]  # a corner on the cut leaves a point
    return np.concatenate([polygons[is_small], in_small_pieces(pieces)])


def _united(areas: Geometries) -> Geometries:
    """Unite areas that overlap; the polygons returned are disjoint."""
    # Much faster than one union of all: most polygons are far from each other.
    return _polygons_of(shapely.disjoint_subset_union_all(areas))


def cut_to(areas: Geometries, other: shapely.Geometry) -> Geometries:
    """Cut areas (n,) along another; those inside stay exactly as they are."""
    shapely.prepare(other)
    outside = ~shapely.covers(other, areas)
    cut = areas.copy()
    cut[outside] = shapely.intersection(areas[outside], other)
    return cut


def within(areas: Geometries, other: shapely.Geometry) -> Geometries:
    """Return areas (n,) as far as they lie in another; those inside stay exactly as they are."""
    shapely.prepare(other)
    return cut_to(areas[shapely.intersects(other, areas)], other)


def _polygons_of(areas: Geometries | shapely.Geometry) -> Geometries:
    """Split areas into polygons."""
    parts = shapely.get_parts(areas)
    return np.asarray(parts[~shapely.is_empty(parts)])


def _without_lakes(polygons: Geometries, endpoints: FloatArray) -> Geometries:
    """Fill holes of polygons that hold no endpoint; islands in a hole stay and overlap."""
    rings, owner = shapely.get_rings(polygons, return_index=True)
    is_hole = np.diff(owner, prepend=-1) == 0
    if len(endpoints) == 0 or not is_hole.any():
        return polygons
    kept = ~is_hole
    lakes = shapely.polygons(rings[is_hole])
    held = shapely.STRtree(lakes).query(shapely.points(endpoints), predicate="intersects")[1]
    kept[np.flatnonzero(is_hole)[held]] = True
    return np.asarray(shapely.polygons(rings[kept], indices=owner[kept]))


# Number of coordinates of the shortest ring: a closed triangle.
_MIN_RING = 4


def simplified(polygons: Geometries, cut_m: float) -> tuple[Geometries, Geometries, IndexArray]:
    """Remove vertices of polygons (n,) by moving no part of a ring further than the cut.

    Returns valid areas (n,), some of them empty or in several parts; outlines (m,), which are parts
    of simplified rings that bound no area, because a ring crosses itself or collapsed to a line;
    and for each outline the index (m,) of its polygon. The cut is a distance from the areas and
    from the outlines.
    """
    rings, owner = shapely.get_rings(polygons, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    lines = shapely.linestrings(points, indices=ring)
    lines = shapely.simplify(lines, cut_m, preserve_topology=False)
    size = shapely.get_num_coordinates(lines)
    is_shell = np.diff(owner, prepend=-1) != 0
    has_area = (size >= _MIN_RING) & (size[is_shell] >= _MIN_RING)[owner]
    areas = _from_rings(lines[has_area], owner[has_area], len(polygons))
    crossed = ~shapely.is_valid(areas)
    areas[crossed] = shapely.make_valid(areas[crossed], method="structure", keep_collapsed=False)
    lines[~has_area] = _open_where_collapsed(lines[~has_area])
    inside = has_area & crossed[owner]
    lines[inside] = shapely.difference(lines[inside], shapely.boundary(areas[owner[inside]]))
    outlined = (~has_area | inside) & ~shapely.is_empty(lines)
    return areas, lines[outlined], owner[outlined]


def _from_rings(lines: Geometries, owner: IndexArray, count: int) -> Geometries:
    """Build polygons (count,) of closed lines, the shell first; empty if there are no lines."""
    areas = np.full(count, shapely.Polygon(), dtype=object)
    if len(lines):
        points, ring = shapely.get_coordinates(lines, return_index=True)
        there, polygon = np.unique(owner, return_inverse=True)
        areas[there] = shapely.polygons(shapely.linearrings(points, indices=ring), indices=polygon)
    return areas


def _open_where_collapsed(lines: Geometries) -> Geometries:
    """Turn closed lines that lead to a point and back into open lines to that point."""
    opened = lines.copy()
    collapsed = shapely.get_num_coordinates(lines) < _MIN_RING
    ends = [shapely.get_point(lines[collapsed], i) for i in (0, 1)]
    opened[collapsed] = shapely.linestrings(
        np.stack([shapely.get_coordinates(end) for end in ends], axis=1)
    )
    return opened


# Share of the distance to the original land that is cleared of added land.
_CLEARED = 1 / 2
# Radius around an endpoint in which the coast is moved back, as a multiple of the width added to
# the land: a vessel there has room on all sides, not only on its way.
_AROUND = 3.0


@dataclass(frozen=True, slots=True)
class OpenWater:
    """Land (m, planar polygons) that leaves starts and goals in water and connected.

    `narrowest` (x, y) is the narrowest place that was opened to connect two of them, and `width_m`
    its width between the original coasts; None and inf if nothing was opened.
    """

    land: Geometries
    narrowest: tuple[float, float] | None = None
    width_m: float = np.inf


def opened(
    land: Geometries,
    original: Geometries,
    extent: shapely.Polygon,
    endpoints: FloatArray,
    added_m: float,
) -> OpenWater:
    """Remove added land that covers the endpoints (n, 2) or separates them.

    These are start and goal of each voyage in turn. `added_m` is how far the land extends beyond
    the original. Endpoints on original land stay on land, and endpoints that original land
    separates stay separated.
    """
    result = OpenWater(_clear_of_endpoints(land, original, endpoints, added_m))
    voyages = endpoints[: len(endpoints) // 2 * 2].reshape(-1, 2, 2)
    apart = parted(result.land, extent, voyages)
    for voyage in sorted(apart - parted(original, extent, voyages) if apart else ()):
        # The way opened for another voyage may have joined the ends of this one as well.
        if voyage in parted(result.land, extent, voyages):
            result = _connected(result, original, extent, voyages[voyage], added_m)
    return result


def parted(land: Geometries, extent: shapely.Polygon, voyages: FloatArray) -> set[int]:
    """Return the voyages, of (n, 2, 2), whose ends do not lie in one body of water."""
    bodies = shapely.get_parts(shapely.difference(extent, shapely.disjoint_subset_union_all(land)))
    points = shapely.points(voyages.reshape(-1, 2))
    held = set(zip(*shapely.STRtree(bodies).query(points, "intersects").tolist(), strict=True))
    joined = {end // 2 for end, body in held if end % 2 == 0 and (end + 1, body) in held}
    return set(range(len(voyages))) - joined


def _connected(
    water: OpenWater,
    original: Geometries,
    extent: shapely.Polygon,
    ends: FloatArray,
    added_m: float,
) -> OpenWater:
    """Open the widest way between the ends (2, 2) of a voyage, if there is one."""
    way = widest_path(original, extent, ends[0], ends[1], added_m)
    if way is None:
        return water
    near = np.unique(shapely.STRtree(way).query(water.land, predicate="intersects")[1])
    blocked = way[near]
    (_, nearest), room_m = shapely.STRtree(original).query_nearest(
        blocked, return_distance=True, all_matches=False
    )
    narrowest = int(np.argmin(room_m))
    cleared = shapely.union_all(shapely.buffer(blocked, _CLEARED * np.minimum(room_m, added_m)))
    land = _without(water.land, cleared)
    shore, middle = shapely.get_coordinates(
        shapely.shortest_line(original[nearest[narrowest]], blocked[narrowest])
    )
    line = shore_to_shore(original, np.array([shore, 2 * middle - shore]), room_m[narrowest])
    width_m = 2 * float(room_m[narrowest]) if line is None else math.dist(*line)
    if width_m >= water.width_m:
        return OpenWater(land, water.narrowest, water.width_m)
    x, y = middle.tolist()
    return OpenWater(land, (x, y), width_m)


def _clear_of_endpoints(
    land: Geometries, original: Geometries, endpoints: FloatArray, added_m: float
) -> Geometries:
    """Move the coast back around covered endpoints, to half of their distance to original land."""
    tree, points = shapely.STRtree(original), shapely.points(endpoints)
    on_land, covered = (
        set(of.query(points, predicate="intersects")[0].tolist())
        for of in (tree, shapely.STRtree(land))
    )
    for point in points[sorted(covered - on_land)]:
        if not shapely.intersects(land, point).any():
            continue
        around = shapely.buffer(point, _AROUND * added_m)
        near = original[tree.query(around, predicate="intersects")]
        near = shapely.intersection(near, around.envelope.buffer(added_m))
        room_m = _CLEARED * float(shapely.distance(near, point).min())
        kept = shapely.union_all(shapely.buffer(near, room_m))
        land = _without(land, shapely.difference(around, kept))
    return land


def _without(land: Geometries, cleared: shapely.Geometry) -> Geometries:
    """Remove an area from disjoint polygons."""
    meets = shapely.intersects(land, cleared)
    parts = shapely.get_parts(shapely.difference(land[meets], cleared))
    return np.concatenate([land[~meets], parts[~shapely.is_empty(parts)]])


def mesh_of_water(
    land: Geometries, extent: shapely.Polygon, points: FloatArray, piece_m: float = 0.0
) -> Triangulation | None:
    """Triangulate the body of water that holds all points (n, 2); None if there is none.

    Its coast is divided into pieces no longer than `piece_m`, if that is not 0.
    """
    bodies = shapely.get_parts(shapely.difference(extent, shapely.disjoint_subset_union_all(land)))
    holds = shapely.intersects(bodies[:, None], shapely.points(points)).all(axis=1)
    if not holds.any():
        return None
    rings = shapely.get_rings(bodies[np.argmax(holds)])
    shell, *holes = shapely.polygons(shapely.segmentize(rings, piece_m) if piece_m else rings)
    # The land is not the chart's no-go zone here, because all of a no-go zone is united first.
    return triangulate(renew.Chart(shell), closed=shapely.MultiPolygon(holes))


# Number of the land's vertices in a tile of water, about.
_TILE = 2_000


def mesh_in_tiles(
    land: Geometries, extent: shapely.Polygon, points: FloatArray
) -> Triangulation | None:
    """Triangulate the water in tiles; None if the points (n, 2) do not lie in one body of water."""
    count = max(1, round(math.sqrt(shapely.get_num_coordinates(land).sum() / _TILE)))
    west, south, east, north = extent.bounds
    x, y = (np.linspace(*of, count + 1) for of in ((west, east), (south, north)))
    boxes = shapely.box(x[:-1], y[:-1, None], x[1:], y[1:, None]).ravel()
    tiles = shapely.intersection(boxes, extent)
    pieces = in_small_pieces(land)
    tile, piece = shapely.STRtree(pieces).query(tiles, "intersects")
    for at in np.unique(tile):
        tiles[at] = shapely.difference(tiles[at], shapely.union_all(pieces[piece[tile == at]]))
    water = shapely.get_parts(tiles)
    mesh = triangulate_tiles(water[shapely.get_dimensions(water) == _AREA])
    triangle, corner = np.nonzero(mesh.neighbours >= 0)
    meeting = triangle, mesh.neighbours[triangle, corner]
    graph = sparse.coo_array((np.ones(len(triangle)), meeting), shape=(len(mesh.triangles),) * 2)
    body = csgraph.connected_components(graph, directed=False)[1]
    holding = [mesh.locate(point) for point in points]
    return mesh if min(holding) >= 0 and len(set(body[holding])) == 1 else None


# Number of times that a line from shore to shore is drawn to the nearest point of either shore. It
# comes to rest after two or three.
_ROUNDS = 4


def shore_to_shore(land: Geometries, gap: FloatArray, reach: float) -> FloatArray | None:
    """Return the shortest line (2, 2) between the shores beside a gap (2, 2), planar metres.

    The gap is between banks that are up to `reach` m off the land. None if one is further off.
    """
    middle, along = gap.mean(axis=0), (gap[1] - gap[0]) / math.dist(*gap)
    deep = math.dist(*gap) / 2 + reach
    aside = deep * np.array([-along[1], along[0]])
    shores = []
    for bank, outwards in zip(gap, (-deep * along, deep * along), strict=True):
        corners = [middle - aside, middle + aside, middle + aside + outwards]
        beside = shapely.Polygon([*corners, middle - aside + outwards])
        # Other land may lie on both sides of the middle, with no width between.
        near = land[shapely.dwithin(land, shapely.Point(bank), reach)]
        shore = shapely.union_all(shapely.intersection(near, beside))
        if not shore.distance(shapely.Point(bank)) <= reach:
            return None
        shores.append(shore)
    one, other = (
        shapely.shortest_line(shore, shapely.Point(bank)).coords[0]
        for shore, bank in zip(shores, gap, strict=True)
    )
    for _ in range(_ROUNDS):
        one = shapely.shortest_line(shores[0], shapely.Point(other)).coords[0]
        other = shapely.shortest_line(shores[1], shapely.Point(one)).coords[0]
    return np.array([one, other])


def widest_path(
    land: Geometries, extent: shapely.Polygon, start: FloatArray, goal: FloatArray, piece_m: float
) -> Geometries | None:
    """Return the widest path as lines (n,) no longer than `piece_m`; None if there is none.

    Coasts are divided into pieces of that length as well, so that a gate is hardly longer than the
    strait is wide.
    """
    mesh = mesh_of_water(land, extent, np.stack([start, goal]), piece_m)
    if mesh is None:
        return None
    triangle, corner = np.nonzero(mesh.neighbours >= 0)
    gate = mesh.vertices[mesh.edge_vertices(triangle, corner)]
    width = np.linalg.norm(gate[:, 1] - gate[:, 0], axis=1)
    beyond = mesh.neighbours[triangle, corner]
    size = len(mesh.triangles)
    # SciPy before 1.17 accepts only this type of index for a spanning tree.
    ends = triangle.astype(np.int32), beyond.astype(np.int32)
    graph = sparse.csr_array((1 / width, ends), shape=(size, size))
    tree = csgraph.minimum_spanning_tree(graph)
    _, before = csgraph.breadth_first_order(tree, mesh.locate(start), directed=False)
    passed = [mesh.locate(goal)]
    while before[passed[-1]] >= 0:
        passed.append(int(before[passed[-1]]))
    here, following = np.array(passed[:-1], dtype=np.intp), np.array(passed[1:], dtype=np.intp)
    side = np.argmax(mesh.neighbours[here] == following[:, None], axis=1)
    middles = mesh.vertices[mesh.edge_vertices(here, side)].mean(axis=1)
    line = shapely.linestrings([goal, *middles, start])
    points = shapely.get_coordinates(shapely.segmentize(line, piece_m))
    return np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))
