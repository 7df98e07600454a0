"""Keeps starts and goals in water and connected if only a margin or a tolerance covers them.

The widest way between two points is found over a triangulation of the water (constrained Delaunay,
with vertices on the coast only). Each edge of the triangulation is a gate as wide as it is long.
The path between two nodes of a maximum spanning tree is the one whose narrowest gate is widest (Hu,
*The maximum capacity route problem*, 1961).
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse import csgraph

import renew
from pipeline._types import FloatArray, Geometries
from renew.classes.triangulation import triangulate

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
    result = OpenWater(_drawn_back(land, original, endpoints, added_m))
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
    way = widest_way(original, extent, ends[0], ends[1], added_m)
    if way is None:
        return water
    near = np.unique(shapely.STRtree(way).query(water.land, predicate="intersects")[1])
    blocked = way[near]
    _, room_m = shapely.STRtree(original).query_nearest(
        blocked, return_distance=True, all_matches=False
    )
    narrowest = int(np.argmin(room_m))
    cleared = shapely.union_all(shapely.buffer(blocked, _CLEARED * np.minimum(room_m, added_m)))
    land, width_m = _without(water.land, cleared), 2 * float(room_m[narrowest])
    if width_m >= water.width_m:
        return OpenWater(land, water.narrowest, water.width_m)
    x, y = shapely.get_coordinates(shapely.centroid(blocked[narrowest]))[0].tolist()
    return OpenWater(land, (x, y), width_m)


def _drawn_back(
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


def widest_way(
    land: Geometries, extent: shapely.Polygon, start: FloatArray, goal: FloatArray, piece_m: float
) -> Geometries | None:
    """Return the widest way as lines (n,) no longer than `piece_m`; None if there is no way.

    Coasts are divided into pieces of that length as well, so that a gate is hardly longer than the
    strait is wide.
    """
    bodies = shapely.get_parts(shapely.difference(extent, shapely.disjoint_subset_union_all(land)))
    holds = shapely.intersects(bodies[:, None], shapely.points([start, goal])).all(axis=1)
    if not holds.any():
        return None
    body = bodies[np.argmax(holds)]
    shell, *holes = shapely.polygons(shapely.segmentize(shapely.get_rings(body), piece_m))
    # Not as the chart's no-go zone, all of which would be united first, one island with the other.
    mesh = triangulate(renew.Chart(shell), closed=shapely.MultiPolygon(holes))
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
