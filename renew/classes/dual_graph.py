"""The dual graph of the triangulation, and channels, its simple paths.

The graph has a node for each triangle and an edge for each passing edge. A channel is a row of
triangles from start to goal, in which paths of one class are planned.

A least-fuel path may bulge out of its channel, and then crosses other triangles.
"""

import itertools
import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes import h_signature
from renew.classes.h_signature import VIA, Word
from renew.classes.triangulation import Triangulation
from renew.kernels.capsules import extremes

if TYPE_CHECKING:
    import networkx as nx


def dual_graph(triangulation: Triangulation) -> "nx.Graph[int]":
    """Return the dual graph, whose edges have the passing edges' `width`, m."""
    import networkx as nx

    graph: nx.Graph[int] = nx.Graph()
    count = len(triangulation.triangles)
    graph.add_nodes_from(range(count))
    triangle, corner = np.nonzero(triangulation.neighbours > np.arange(count)[:, None])
    beside = triangulation.neighbours[triangle, corner]
    edges = triangulation.vertices[triangulation.edge_vertices(triangle, corner)]
    for here, there, (a, b) in zip(triangle.tolist(), beside.tolist(), edges, strict=True):
        graph.add_edge(here, there, width=float(np.linalg.norm(b - a)))
    return graph


def is_connected(triangulation: Triangulation, first: int, last: int) -> bool:
    """Whether a row of triangles leads from one to the other."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    triangle, corner = np.nonzero(triangulation.neighbours >= 0)
    beside = triangulation.neighbours[triangle, corner]
    count = len(triangulation.triangles)
    links = coo_array((np.ones(len(triangle)), (triangle, beside)), shape=(count, count))
    _, component = connected_components(links, directed=False)
    return bool(component[first] == component[last])


@kernel
def without_dead_ends(neighbours: IntArray, first: int, last: int) -> BoolArray:
    """Return which triangles (t,) lie in no dead end; a row without repeats enters none.

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
    """Yield rows of triangles without repeats, as a depth-first search meets them.

    A triangle is only entered if `last` can still be reached from it without triangles of the row:
    otherwise the search would spend most of its time in dead ends. It gives up after `max_steps`
    triangles.
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
            # The goal can be reached from the last triangle. If that has only one way on, this way
            # leads there.
            is_only_way = sum(node not in used for node in beside[row[-1]]) == 1
            reached = {last} if is_only_way else _flooded(beside, after, used, last)
            max_steps -= len(reached)
            if last in reached:
                row.append(after)
                used.add(after)
                waiting.append(iter(beside[after]))


def _flooded(beside: dict[int, list[int]], start: int, used: set[int], until: int) -> set[int]:
    """Return the triangles that a search from `start` reaches without used ones, up to `until`."""
    reached, waiting = {start}, [start]
    while waiting and until not in reached:
        found = [node for node in beside[waiting.pop()] if node not in used and node not in reached]
        reached.update(found)
        waiting += found
    return reached


def widest_gap(triangulation: Triangulation, first: int, last: int) -> FloatArray | None:
    """Return the narrowest passing edge (2, 2) on the widest way, m; None if it passes none."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    triangle, corner = np.nonzero(triangulation.neighbours >= 0)
    beside = triangulation.neighbours[triangle, corner]
    a, b = triangulation.vertices[triangulation.edge_vertices(triangle, corner).T]
    width = np.linalg.norm(b - a, axis=1)
    count = len(triangulation.triangles)
    # The widest edges have the least weight; SciPy takes a weight of 0 as no edge.
    weight = coo_array((2 * width.max(initial=0.0) - width, (triangle, beside)), (count, count))
    tree = minimum_spanning_tree(weight.tocsr())
    _, before = breadth_first_order(tree, last, directed=False)
    row = [first]
    while row[-1] != last:
        row.append(int(before[row[-1]]))
    of_edge = {
        edge: at for at, edge in enumerate(zip(triangle.tolist(), beside.tolist(), strict=True))
    }
    passed = [of_edge[edge] for edge in itertools.pairwise(row)]
    if not passed:
        return None
    narrowest = passed[int(width[passed].argmin())]
    return np.stack([a[narrowest], b[narrowest]])


def surroundings(
    triangulation: Triangulation, row: list[int], layers: int, crossed: Container[int] = ()
) -> dict[int, int]:
    """Return triangles around a row, each with the nearest place in the row.

    They are at most `layers` edges away from the row, or from the triangles that a path crosses
    beside it. The row's own come first, in their order.
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
    """Add the triangles next to the outermost ones to `nearest`, if they are in `among`."""
    found: dict[int, int] = {}
    for triangle in outermost:
        for beside in triangulation.neighbours[triangle].tolist():
            if beside >= 0 and beside not in nearest and (among is None or beside in among):
                found.setdefault(beside, nearest[triangle])
    nearest |= found
    return list(found)


Transition: TypeAlias = tuple[int, int, int]
"""A triangle with the one before and the one after it; -1 before the start, after the goal."""


class RoughPath(NamedTuple):
    """Path by which a search found a class: points (n, 2), m, and the triangles (c,) crossed."""

    points: FloatArray
    triangles: IntArray


@dataclass(frozen=True)
class Channel:
    """A row of triangles from start to goal.

    Attributes
    ----------
    triangles : (n,) indices into the triangulation, none twice on the way to a via point.
    left, right : (n - 1, 2) ends of the passing edges in metres, as seen when sailing along.
    word : the homotopy class's h-signature.
    found_by : rough path of the class, if a search found it by one; it may leave the row.
    parts : the channels from one via point to the next, where there are any.
    """

    triangles: IntArray
    left: FloatArray
    right: FloatArray
    word: Word
    found_by: RoughPath | None = None
    parts: "tuple[Channel, ...]" = ()

    @classmethod
    def joined(cls, parts: "Sequence[Channel]", via: FloatArray) -> "Channel":
        """Return the channel through via points (s - 1, 2), m, of the parts (s,) between them.

        In the triangle of a via point the row has a passing edge of no length there.
        """
        left, right = [parts[0].left], [parts[0].right]
        word = parts[0].word
        for point, part in zip(via, parts[1:], strict=True):
            left += [point[None], part.left]
            right += [point[None], part.right]
            word = (*word, VIA, *part.word)
        paths = [part.found_by for part in parts if part.found_by is not None]
        return cls(
            np.concatenate([part.triangles for part in parts]),
            np.concatenate(left),
            np.concatenate(right),
            word,
            RoughPath(
                np.concatenate([paths[0].points, *(path.points[1:] for path in paths[1:])]),
                np.concatenate([path.triangles for path in paths]),
            ),
            tuple(parts),
        )

    @classmethod
    def of(cls, triangulation: Triangulation, row: IntArray, word: Word = ()) -> "Channel":
        """Return the channel of a row of triangles (n,)."""
        beside = triangulation.neighbours[row[:-1]]
        corners = (beside == row[1:, None]).argmax(axis=1)
        # Leaving an anticlockwise triangle across its edge (first, second): first is on the right.
        edges = triangulation.vertices[triangulation.edge_vertices(row[:-1], corners)]
        return cls(row, edges[:, 1], edges[:, 0], word)

    @property
    def name(self) -> str:
        """The class's name, such as "s2.p1"."""
        return h_signature.name(self.word)

    @property
    def transitions(self) -> list[Transition]:
        """How each triangle is crossed."""
        row = [-1, *self.triangles.tolist(), -1]
        return list(zip(row[:-2], row[1:-1], row[2:], strict=True))

    def midline(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return start, the passing edges' midpoints, goal: shape (n + 1, 2)."""
        return np.vstack([start, (self.left + self.right) / 2, goal])

    def rough_path(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return the rough path by which the class was found, or the midline: shape (n, 2)."""
        return self.midline(start, goal) if self.found_by is None else self.found_by.points


# A path that stays in a triangle for less than this share of its size only touches it.
_TOUCH = 1e-9


class Visits(NamedTuple):
    """The triangle (v,) of each visit, and the points (v, 2) where the visit begins and ends."""

    triangle: IntArray
    enter: FloatArray
    leave: FloatArray


def visits(path: FloatArray, corners: FloatArray) -> Visits:
    """Return the visits of a path (n, 2) to anticlockwise triangles (t, 3, 2), in metres.

    A triangle that is entered again has two visits; a triangle that is only touched has none.
    """
    triangle, leg, enter, leave = _stays(path, corners)
    order = np.lexsort((triangle, leg + (enter + leave) / 2))
    # Consecutive stays in one triangle, one per leg, are one visit.
    new = np.diff(triangle[order], prepend=-1) != 0
    first, last = order[new], order[np.roll(new, -1)]
    way = np.diff(path, axis=0)
    return Visits(
        triangle[first],
        path[leg[first]] + enter[first, None] * way[leg[first]],
        path[leg[last]] + leave[last, None] * way[leg[last]],
    )


@kernel
def _stays(
    path: FloatArray, corners: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return each stay's triangle, leg, and first and last share of the leg, all (s,)."""
    triangles, legs = [np.int64(0)], [np.int64(0)]
    enters, leaves = [0.0], [0.0]
    for t in range(len(corners)):
        x, y = corners[t, :, 0], corners[t, :, 1]
        (west, east), (south, north) = extremes(x), extremes(y)
        touch = _TOUCH * (east - west + north - south)
        for k in range(len(path) - 1):
            ax, ay = path[k]
            dx, dy = path[k + 1, 0] - ax, path[k + 1, 1] - ay
            if (
                max(ax, ax + dx) < west
                or min(ax, ax + dx) > east
                or max(ay, ay + dy) < south
                or min(ay, ay + dy) > north
            ):
                continue
            enter, leave = 0.0, 1.0
            for c in range(3):
                ux, uy = x[(c + 1) % 3] - x[c], y[(c + 1) % 3] - y[c]
                # Inside is to the left of each edge: inside + s slope >= 0.
                inside = ux * (ay - y[c]) - uy * (ax - x[c])
                slope = ux * dy - uy * dx
                if slope > 0.0:
                    enter = max(enter, -inside / slope)
                elif slope < 0.0:
                    leave = min(leave, -inside / slope)
                elif inside < 0.0:
                    leave = -1.0
            if (leave - enter) * math.hypot(dx, dy) > touch:
                triangles.append(np.int64(t))
                legs.append(np.int64(k))
                enters.append(enter)
                leaves.append(leave)
    return (
        np.array(triangles[1:], dtype=np.int64),
        np.array(legs[1:], dtype=np.int64),
        np.array(enters[1:]),
        np.array(leaves[1:]),
    )
