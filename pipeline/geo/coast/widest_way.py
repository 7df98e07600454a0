"""The widest way between two points of the water, over a triangulation of it.

Each edge of the triangulation (constrained Delaunay, with vertices on the coast only) is a gate as
wide as it is long. The path between two nodes of a maximum spanning tree is the one whose narrowest
gate is widest (Hu, *The maximum capacity route problem*, 1961).
"""

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse import csgraph
from shapely.geometry import Polygon

import renew
from pipeline._types import FloatArray, Geometries
from renew.classes.triangulation import triangulate


def widest_way(
    land: Geometries, extent: Polygon, start: FloatArray, goal: FloatArray, piece_m: float
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
    holes = [shapely.Polygon(shapely.segmentize(hole, piece_m)) for hole in body.interiors]
    shell = shapely.Polygon(shapely.segmentize(body.exterior, piece_m))
    mesh = triangulate(renew.Chart(shell, holes))
    triangle, corner = np.nonzero(mesh.neighbours >= 0)
    gate = mesh.vertices[mesh.edge_vertices(triangle, corner)]
    width = np.linalg.norm(gate[:, 1] - gate[:, 0], axis=1)
    beyond = mesh.neighbours[triangle, corner]
    size = len(mesh.triangles)
    # SciPy before 1.17 accepts only this type of index for a spanning tree.
    ends = triangle.astype(np.int32), beyond.astype(np.int32)
    graph = sparse.csr_array((1 / width, ends), shape=(size, size))
    tree = csgraph.minimum_spanning_tree(graph)
    first, last = mesh.locate(start), mesh.locate(goal)
    _, before = csgraph.breadth_first_order(tree, first, directed=False)
    middle = {
        (one, other): ends.mean(axis=0)
        for one, other, ends in zip(triangle.tolist(), beyond.tolist(), gate, strict=True)
    }
    way, here = [goal], last
    while before[here] >= 0:
        way.append(middle[here, int(before[here])])
        here = int(before[here])
    points = shapely.get_coordinates(
        shapely.segmentize(shapely.linestrings([*way, start]), piece_m)
    )
    return np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))
