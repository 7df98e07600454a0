"""The shortest path of each of the k best homotopy classes of a graph.

A* over pairs of (node, word so far), after Bhattacharya, Likhachev & Kumar (2012): "Topological
constraints in search-based robot path planning". The heuristic is the exact distance to go.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from renew._types import FloatArray, IntArray
from renew.classes.h_signature import Rays, Word

Label: TypeAlias = tuple[float, int, int, Word]

# Number of words per node for each wanted class: above 1, because paths that cross themselves are
# found, too, and dropped.
_WORDS = 2


@dataclass(frozen=True, eq=False)
class Graph:
    """Nodes (n, 2), m, and directed edges (m, 2) between them with a cost (m,) each.

    An edge follows its `shape` (a polyline) if it has one, else the straight leg. Node 0 is the
    start, node 1 the goal; where `goals` is given, all of these are.
    """

    nodes: FloatArray
    edges: IntArray
    cost: FloatArray
    shapes: dict[int, FloatArray] | None = None
    goals: tuple[int, ...] = (1,)

    def polyline(self, row: list[int], taken: list[int]) -> FloatArray:
        """Points (p, 2) along a row of nodes by the edges taken."""
        if self.shapes is None:
            return np.asarray(self.nodes[row])
        pieces = [self.shapes[edge] for edge in taken]
        return np.vstack([pieces[0], *(piece[1:] for piece in pieces[1:])])


def best_of_classes(graph: Graph, rays: Rays, classes: int) -> list[FloatArray]:
    """The shortest path (n, 2) of each of the first `classes` classes, the shortest first."""
    count = len(graph.nodes)
    matrix = csr_array((graph.cost, (graph.edges[:, 1], graph.edges[:, 0])), shape=(count, count))
    distances = dijkstra(matrix, indices=list(graph.goals), min_only=True)
    leaving, to_go = _leaving(graph, rays, distances), distances.tolist()
    goals = set(graph.goals)
    found: dict[Word, FloatArray] = {}
    # Least estimate at each node by word, -inf once it is settled; and the number of those settled.
    least: defaultdict[int, dict[Word, float]] = defaultdict(dict)
    settled, limit = [0] * count, _WORDS * classes
    labels: list[tuple[int, int, int]] = [(0, -1, -1)]  # node, edge, label before
    queue: list[Label] = [(to_go[0], 0, 0, ())] if math.isfinite(to_go[0]) else []
    while queue and len(found) < classes:
        total, node, label, word = heapq.heappop(queue)
        if total > least[node].get(word, math.inf) or settled[node] >= limit:
            continue
        least[node][word] = -math.inf
        settled[node] += 1
        if node in goals:
            path = _path(graph, labels, label)
            if word not in found and shapely.LineString(path).is_simple:
                found[word] = path
            continue
        so_far = total - to_go[node]
        for edge, head, cost, letters in leaving[node]:
            if settled[head] >= limit:
                continue
            further = _joined(word, letters) if letters else word
            estimate = so_far + cost + to_go[head]
            if estimate < least[head].get(further, math.inf):
                least[head][further] = estimate
                labels.append((head, edge, label))
                heapq.heappush(queue, (estimate, head, len(labels) - 1, further))
    return list(found.values())


def _leaving(
    graph: Graph, rays: Rays, to_go: FloatArray
) -> list[list[tuple[int, int, float, Word]]]:
    """Edges of each node that lead on: number, head, cost and the letters of the rays crossed."""
    letters = _letters(graph, rays)
    leaving: list[list[tuple[int, int, float, Word]]] = [[] for _ in range(len(graph.nodes))]
    useful = np.flatnonzero(np.isfinite(to_go[graph.edges[:, 1]]))
    tails, heads, costs = graph.edges[:, 0].tolist(), graph.edges[:, 1].tolist(), graph.cost
    for edge in useful.tolist():
        leaving[tails[edge]].append((edge, heads[edge], float(costs[edge]), letters.get(edge, ())))
    return leaving


def _letters(graph: Graph, rays: Rays) -> dict[int, Word]:
    """Words of the edges that cross any ray."""
    if graph.shapes is not None:
        words = ((edge, rays.word(shape)) for edge, shape in graph.shapes.items())
        return {edge: word for edge, word in words if word}
    a, b = graph.nodes[graph.edges[:, 0]], graph.nodes[graph.edges[:, 1]]
    crossing: set[int] = set()
    for x, y in zip(rays.x, rays.y, strict=True):
        between = (np.minimum(a[:, 0], b[:, 0]) <= x) & (x <= np.maximum(a[:, 0], b[:, 0]))
        crossing.update(np.flatnonzero(between & (np.maximum(a[:, 1], b[:, 1]) > y)).tolist())
    words = ((edge, rays.word(np.stack([a[edge], b[edge]]))) for edge in sorted(crossing))
    return {edge: word for edge, word in words if word}


def _joined(word: Word, letters: Word) -> Word:
    """Concatenate two reduced words, and reduce."""
    joined = list(word)
    for letter in letters:
        if joined and joined[-1] == -letter:
            joined.pop()
        else:
            joined.append(letter)
    return tuple(joined)


def _path(graph: Graph, labels: list[tuple[int, int, int]], label: int) -> FloatArray:
    """Path of a label at the goal."""
    row, taken = [], []
    while label >= 0:
        node, edge, label = labels[label]
        row.append(node)
        taken.append(edge)
    return graph.polyline(row[::-1], taken[-2::-1])
