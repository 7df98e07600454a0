"""The dual graph of the triangulation: a node for each triangle, an edge for each passing edge."""

from __future__ import annotations

import itertools
import math
from collections.abc import Container, Iterator
from typing import TYPE_CHECKING

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, IntArray
from renew.classes.triangulation import Triangulation

if TYPE_CHECKING:
    import networkx as nx


def dual_graph(triangulation: Triangulation) -> nx.Graph[int]:
    """Dual graph; each of its edges has the passing edge's `midpoint` (2,) and `width`, m."""
    import networkx as nx

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
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    triangle, corner = np.nonzero(triangulation.neighbours >= 0)
    beside = triangulation.neighbours[triangle, corner]
    count = len(triangulation.triangles)
    links = coo_array((np.ones(len(triangle)), (triangle, beside)), shape=(count, count))
    _, component = connected_components(links, directed=False)
    return bool(component[one] == component[other])


@kernel
def without_dead_ends(neighbours: IntArray, first: int, last: int) -> BoolArray:
    """Triangles (t,) but for dead ends, which no row without repeats leads through.

    `neighbours` (t, 3) are those of :class:`renew.classes.triangulation.Triangulation`.
    """
    ways = np.zeros(len(neighbours), dtype=np.int64)
    for triangle in range(len(neighbours)):
        for beside in neighbours[triangle]:
            ways[triangle] += beside >= 0
    # Start and goal may lie in a dead end.
    ways[first] += 2
    ways[last] += 2
    found = np.ones(len(neighbours), dtype=np.bool_)
    for end in range(len(neighbours)):
        triangle = end
        while triangle >= 0 and found[triangle] and ways[triangle] <= 1:
            found[triangle] = False
            onwards = -1
            for beside in neighbours[triangle]:
                if beside >= 0 and found[beside]:
                    ways[beside] -= 1
                    onwards = beside
            triangle = onwards
    return found


def simple_paths(
    triangulation: Triangulation, first: int, last: int, max_steps: int
) -> Iterator[list[int]]:
    """Rows of triangles, none twice, as a depth-first search meets them.

    A triangle is only entered if the last one can still be reached from it without those in the
    row: otherwise the search would spend most of its time in dead ends. It gives up after having
    looked at `max_steps` triangles.
    """
    beside = {node: list(others) for node, others in dual_graph(triangulation).adjacency()}
    row, used, waiting = [first], {first}, [iter(beside[first])]
    while waiting and max_steps > 0:
        after = next((node for node in waiting[-1] if node not in used), None)
        if after is None:
            waiting.pop()
            used.remove(row.pop())
        elif after == last:
            yield [*row, last]
        else:
            # Where there is no other way on, the goal is reached by this one.
            is_only_way = sum(node not in used for node in beside[row[-1]]) == 1
            reached = {last} if is_only_way else _flooded(beside, after, used, last)
            max_steps -= len(reached)
            if last in reached:
                row.append(after)
                used.add(after)
                waiting.append(iter(beside[after]))


def _flooded(beside: dict[int, list[int]], start: int, used: set[int], until: int) -> set[int]:
    """Triangles that are met from one, without those in use, until some other is met."""
    reached, waiting = {start}, [start]
    while waiting and until not in reached:
        found = [node for node in beside[waiting.pop()] if node not in used and node not in reached]
        reached.update(found)
        waiting += found
    return reached


def widest_gap(triangulation: Triangulation, one: int, other: int) -> float:
    """Width (m) of the narrowest passing edge on the way whose narrowest is the widest."""
    import networkx as nx

    graph = dual_graph(triangulation)
    row = nx.shortest_path(nx.maximum_spanning_tree(graph, weight="width"), one, other)
    widths = (graph.edges[edge]["width"] for edge in itertools.pairwise(row))
    return min(widths, default=math.inf)


def surroundings(
    triangulation: Triangulation, row: list[int], layers: int, crossed: Container[int] = ()
) -> dict[int, int]:
    """Triangles around a row, each with the place in it that it is nearest to.

    They are those at most `layers` edges away from the row, or from those of some path that bulges
    out of it. The row's own come first, in their order.
    """
    nearest = {triangle: place for place, triangle in enumerate(row)}
    outermost = row
    while outermost:
        outermost = _beside(triangulation, outermost, nearest, crossed)
    outermost = list(nearest)
    for _ in range(layers):
        outermost = _beside(triangulation, outermost, nearest)
    return nearest


def _beside(
    triangulation: Triangulation,
    outermost: list[int],
    nearest: dict[int, int],
    among: Container[int] | None = None,
) -> list[int]:
    """Triangles next to the outermost ones, added to the nearest; all, or those among some."""
    found: dict[int, int] = {}
    for triangle in outermost:
        for beside in triangulation.neighbours[triangle].tolist():
            if beside >= 0 and beside not in nearest and (among is None or beside in among):
                found.setdefault(beside, nearest[triangle])
    nearest |= found
    return list(found)
