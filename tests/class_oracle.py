"""An independent oracle for classes: Dijkstra's algorithm over pairs of grid node and class.

It shares its inputs alone with the planner: the classes are told apart by rays of its own, towards
-y, and a class is a vector over a prime field that each crossing moves by a random matrix, so that
opposite crossings cancel. A node keeps the quickest labels of different classes, so many that those
of the best classes are among them. Paths that cross themselves wind about an island: no route is
one, and they are left out.
"""

import heapq
from collections.abc import Callable

import numpy as np
import shapely
from scipy.sparse.csgraph import dijkstra

import renew
from renew._types import FloatArray, IntArray
from tests.compiler import compiled
from tests.oracles import grid_graph, tighten

# A prime below 2^31, so that products fit into 63 bits.
_PRIME = 2_147_483_647
# Neighbours: 80 a node.
_RADIUS = 5
# Times of the paths that are followed, as shares of the best: at most.
_DEAREST = 1.8


def paths_by_class(
    chart: renew.Chart,
    current: Callable[[FloatArray], FloatArray],
    vessel: renew.Vessel,
    start: FloatArray,
    goal: FloatArray,
    spacing: float,
    *,
    labels: int,
) -> list[tuple[float, FloatArray]]:
    """Fuel and path (n, 2), m, of the quickest classes on a grid, at most `labels`, tightened.

    Least fuel first; those that wind about an island, or are much dearer than the best, are left
    out.
    """
    points, graph = grid_graph(chart, current, vessel, start, goal, spacing, radius=_RADIUS)
    to_go = dijkstra(graph.T.tocsr(), indices=len(points) - 1)
    inside = shapely.get_coordinates(shapely.point_on_surface(list(chart.no_go))).reshape(-1, 2)
    moves = _moves(len(inside), np.random.default_rng(0))
    edges = graph.indptr.astype(np.int64), graph.indices.astype(np.int64), graph.data
    found = _search(points, *edges, to_go, inside, moves, labels)
    result = []
    for row in found:
        path = points[row]
        if shapely.LineString(path).is_simple:
            width = 2 * spacing
            tight = tighten(path, chart, current, vessel, spacing=spacing, width=width)
            result.append(tight)
    return sorted(result, key=lambda one: one[0])


def _moves(count: int, rng: np.random.Generator) -> IntArray:
    """Random matrices (2 count, 2, 2) of determinant 1, each followed by its inverse."""
    moves = []
    for _ in range(count):
        a, b, c = (int(x) for x in rng.integers(1, _PRIME, 3))
        d = (1 + b * c) * pow(a, -1, _PRIME) % _PRIME
        moves += [[[a, b], [c, d]], [[d, _PRIME - b], [_PRIME - c, a]]]
    return np.array(moves, dtype=np.int64).reshape(-1, 2, 2)


@compiled
def _moved(
    word: tuple[int, int], a: FloatArray, b: FloatArray, inside: FloatArray, moves: IntArray
) -> tuple[int, int]:
    """Class after a leg a -> b: it crosses the rays from points inside islands towards -y."""
    step = 1 if b[0] > a[0] else -1
    for k in range(len(inside)):
        i = k if step > 0 else len(inside) - 1 - k
        x, y = inside[i]
        if (a[0] <= x) == (b[0] <= x):
            continue
        if a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1]) < y:
            m = moves[2 * i + (0 if step > 0 else 1)]
            word = (
                (word[0] * m[0, 0] % _PRIME + word[1] * m[1, 0] % _PRIME) % _PRIME,
                (word[0] * m[0, 1] % _PRIME + word[1] * m[1, 1] % _PRIME) % _PRIME,
            )
    return word


@compiled
def _search(
    points: FloatArray,
    first: IntArray,
    head: IntArray,
    time: FloatArray,
    to_go: FloatArray,
    inside: FloatArray,
    moves: IntArray,
    most: int,
) -> list[IntArray]:
    """Rows of nodes of the quickest paths, each of another class, at most so many."""
    order = np.argsort(inside[:, 0])
    inside, pairs = inside[order], moves.copy()
    for k in range(len(order)):
        pairs[2 * k], pairs[2 * k + 1] = moves[2 * order[k]], moves[2 * order[k] + 1]
    start, goal = len(points) - 2, len(points) - 1
    settled = np.zeros(len(points), dtype=np.int64)
    words = np.zeros((len(points), most, 2), dtype=np.int64)
    node, parent, word = [start], [-1], [(1, 1)]
    queue = [(to_go[start], 0.0, 0)]
    found = [np.empty(0, dtype=np.int64)]
    found.clear()
    while queue and len(found) < most:
        _, now, label = heapq.heappop(queue)
        at, (p, q) = node[label], word[label]
        if _is_settled(words[at], settled[at], (p, q)):
            continue
        words[at, settled[at], 0], words[at, settled[at], 1] = p, q
        settled[at] += 1
        if at == goal:
            row, back = [goal], parent[label]
            while back >= 0:
                row.append(node[back])
                back = parent[back]
            found.append(np.array(row[::-1], dtype=np.int64))
            continue
        for leg in range(first[at], first[at + 1]):
            other = head[leg]
            after = _moved((p, q), points[at], points[other], inside, pairs)
            total = now + time[leg]
            if total + to_go[other] < _DEAREST * to_go[start] and not _is_settled(
                words[other], settled[other], after
            ):
                node.append(other)
                parent.append(label)
                word.append(after)
                heapq.heappush(queue, (total + to_go[other], total, len(node) - 1))
    return found


@compiled
def _is_settled(words: IntArray, count: int, word: tuple[int, int]) -> bool:
    """Whether a class is among the first of a node's (k, 2), or all its places are taken."""
    known = count == len(words)
    for k in range(count):
        known |= words[k, 0] == word[0] and words[k, 1] == word[1]
    return bool(known)
