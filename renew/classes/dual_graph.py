"""The dual graph of the triangulation: a node for each triangle, an edge for each passing edge."""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from renew.classes.triangulation import Triangulation


def dual_graph(triangulation: Triangulation) -> nx.Graph[int]:
    """Dual graph; each of its edges has the passing edge's `midpoint` (2,) and `width`, m."""
    graph: nx.Graph[int] = nx.Graph()
    count = len(triangulation.triangles)
    graph.add_nodes_from(range(count))
    triangle, corner = np.nonzero(triangulation.neighbours > np.arange(count)[:, None])
    beside = triangulation.neighbours[triangle, corner]
    edges = triangulation.vertices[triangulation.edge_vertices(triangle, corner)]
    for one, other, (a, b) in zip(triangle.tolist(), beside.tolist(), edges, strict=True):
        graph.add_edge(one, other, midpoint=(a + b) / 2, width=float(np.linalg.norm(b - a)))
    return graph


def is_connected(triangulation: Triangulation, one: int, other: int) -> bool:
    """Whether a row of triangles leads from one to the other."""
    triangle, corner = np.nonzero(triangulation.neighbours >= 0)
    beside = triangulation.neighbours[triangle, corner]
    count = len(triangulation.triangles)
    links = coo_array((np.ones(len(triangle)), (triangle, beside)), shape=(count, count))
    _, component = connected_components(links, directed=False)
    return bool(component[one] == component[other])


def widest_gap(triangulation: Triangulation, one: int, other: int) -> float:
    """Width (m) of the narrowest passing edge on the way whose narrowest is the widest."""
    graph = dual_graph(triangulation)
    row = nx.shortest_path(nx.maximum_spanning_tree(graph, weight="width"), one, other)
    widths = (graph.edges[edge]["width"] for edge in itertools.pairwise(row))
    return min(widths, default=math.inf)


def surroundings(triangulation: Triangulation, row: list[int], layers: int) -> dict[int, int]:
    """Triangles at most `layers` edges away from a row, each with the place it is nearest to.

    The row's own come first, in their order.
    """
    nearest = {triangle: place for place, triangle in enumerate(row)}
    outermost = row
    for _ in range(layers):
        found: dict[int, int] = {}
        for triangle in outermost:
            for beside in triangulation.neighbours[triangle].tolist():
                if beside >= 0 and beside not in nearest:
                    found.setdefault(beside, nearest[triangle])
        nearest |= found
        outermost = list(found)
    return nearest
