"""The k first homotopy classes between two points, each as a channel of triangles.

A channel is a simple path in the dual graph of the triangulation. ``order="fuel"`` gives first
the class whose cheapest chain of points on passing edges needs the least fuel
(:mod:`renew.classes.k_best_chains`); ``"length"`` the one of the shortest; ``"depth-first"`` takes
them in the order in which the paper's depth-first search meets them.

Where islets have no letter in the words (see :mod:`renew.classes.h_signature`), one word has many
channels, and the first may be shut by its padding. So moves that were found shut can be taken out,
and the search gives the next channel of that word.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal, TypeAlias, get_args

import networkx as nx
import numpy as np

from renew._types import BoolArray, FloatArray, IntArray
from renew.classes import h_signature as homotopy
from renew.classes import k_best_chains as gates
from renew.classes.h_signature import Rays, Word
from renew.classes.triangulation import Triangulation
from renew.errors import ParameterError, UnreachableError
from renew.inputs.current_table import STILL, Table
from renew.inputs.fuel import Drift

Order: TypeAlias = Literal["fuel", "length", "depth-first"]

# A search gives up after this many steps: a few seconds. It is reached only where fewer than k
# classes exist in a chart full of islands.
_MOST_STEPS = 1_000_000

# Among so many triangles or more, classes differ by less than a chain of few points can tell.
_MANY_TRIANGLES = 1000

Move: TypeAlias = tuple[int, int, int]
"""A triangle with the one before and the one after it; -1 before the start, after the goal."""


@dataclass(frozen=True)
class Channel:
    """A row of triangles from start to goal.

    Attributes
    ----------
    triangles : (n,) indices into the triangulation, none twice.
    left, right : (n - 1, 2) ends of the passing edges in metres, as seen when sailing along.
    word : the homotopy class's crossing sequence.
    """

    triangles: IntArray
    left: FloatArray
    right: FloatArray
    word: Word

    @property
    def name(self) -> str:
        """The class's name, such as "s2.p1"."""
        return homotopy.name(self.word)

    @property
    def moves(self) -> list[Move]:
        """How each triangle is crossed."""
        row = [-1, *self.triangles.tolist(), -1]
        return list(zip(row[:-2], row[1:-1], row[2:], strict=True))

    def midline(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Start, the passing edges' midpoints, goal: shape (n + 1, 2)."""
        return np.vstack([start, (self.left + self.right) / 2, goal])


class ChannelSearch:
    """Finds channels from start to goal, no two with the same word.

    The cheapest are those of the quickest chain in the currents of `table` (m/s) at `speed`
    through water (m/s); order "length" does without. Passing edges are only crossed where that
    is `clearance` m from the land at their ends.

    Raises
    ------
    ParameterError
        An unknown order.
    UnreachableError
        No row of triangles joins start and goal.
    """

    def __init__(
        self,
        triangulation: Triangulation,
        rays: Rays,
        start: FloatArray,
        goal: FloatArray,
        order: Order = "length",
        *,
        table: Table = STILL,
        speed: float = 1.0,
        drift: Drift = "projected",
        clearance: float = 0.0,
    ) -> None:
        if order not in get_args(Order):
            raise ParameterError(f"order = {order!r} is not one of {', '.join(get_args(Order))}")
        self._triangulation, self._rays = triangulation, rays
        self._start, self._goal, self._order = start, goal, order
        self._ends = triangulation.locate(start), triangulation.locate(goal)
        if not triangulation.joined(*self._ends):
            raise UnreachableError(
                f"no water joins start ({start[0]:g}, {start[1]:g}) m and goal ({goal[0]:g}, "
                f"{goal[1]:g}) m: the no-go zone parts them. Widen the extent, join fewer "
                "islands, or move one of the two"
            )
        self._mesh_of = partial(
            gates.mesh_of,
            triangulation,
            rays,
            start,
            goal,
            self._ends,
            table=table if order == "fuel" else STILL,
            speed=speed,
            crab=drift == "crab",
            clearance=clearance,
        )
        self._coarse = _Nodes.on(self._mesh_of(spread=gates.COARSE))

    def channels(
        self, count: int, shut: Collection[Move] = (), *, roughly: bool = False
    ) -> list[Channel]:
        """The first `count` channels, but for those that make a move found shut.

        Roughly, a class with several channels comes by any that is nearly the best.
        """
        if self._order == "depth-first":
            return list(itertools.islice(self._depth_first(frozenset(shut)), count))
        moves = self._closed(shut)
        rows, words = self._coarse.cheapest(count, moves)
        if not roughly and (self._rays.are_few or len(moves) > _MANY_TRIANGLES):
            # As many classes, now that it is known how many there are.
            rows, words = self._fine.cheapest(len(rows), moves)
        return [
            self._channel(row, tuple(word.tolist())) for row, word in zip(rows, words, strict=True)
        ]

    def _depth_first(self, shut: frozenset[Move]) -> Iterator[Channel]:
        """Simple paths of the dual graph as a depth-first search meets them (the paper's order)."""
        first, last = self._ends
        if first == last:  # networkx yields nothing then
            yield self._channel(np.array([first]), ())
            return
        seen: set[Word] = set()
        rows = nx.all_simple_paths(self._triangulation.dual, first, last)
        for row in itertools.islice(rows, _MOST_STEPS):
            channel = self._channel(np.array(row), ())
            word = self._rays.word(channel.midline(self._start, self._goal))
            if word not in seen and shut.isdisjoint(channel.moves):
                seen.add(word)
                yield replace(channel, word=word)

    def widest_gap(self) -> float:
        """Width (m) of the narrowest passing edge on the way whose narrowest is the widest."""
        dual = self._triangulation.dual
        way = nx.maximum_spanning_tree(dual, weight="width")
        row = nx.shortest_path(way, *self._ends)
        widths = (dual.edges[edge]["width"] for edge in itertools.pairwise(row))
        return min(widths, default=math.inf)

    @cached_property
    def _fine(self) -> _Nodes:
        """Many points on passing edges."""
        return _Nodes.on(self._mesh_of(spread=gates.FINE))

    def _closed(self, shut: Collection[Move]) -> BoolArray:
        """Moves as the compiled search takes them: (t, 4, 4)."""
        neighbours = self._triangulation.neighbours
        closed = np.zeros((len(neighbours), 4, 4), dtype=bool)
        for before, triangle, after in shut:
            beside = neighbours[triangle].tolist()
            entry, out = (beside.index(t) if t >= 0 else 3 for t in (before, after))
            closed[triangle, entry, out] = True
        return closed

    def _channel(self, row: IntArray, word: Word) -> Channel:
        """Channel of a row of triangles."""
        beside = self._triangulation.neighbours[row[:-1]]
        corners = (beside == row[1:, None]).argmax(axis=1)
        # Leaving an anticlockwise triangle across its edge (first, second): first is on the right.
        ends = self._triangulation.vertices[self._triangulation.edge_vertices(row[:-1], corners)]
        return Channel(row, ends[:, 1], ends[:, 0], word)


@dataclass(frozen=True)
class _Nodes:
    """Points on the passing edges, and what is left to go from each with no move shut."""

    mesh: gates.Mesh
    left: FloatArray

    @classmethod
    def on(cls, mesh: gates.Mesh) -> _Nodes:
        """Work out what is left to go."""
        shut = np.zeros((len(mesh.neighbours), 4, 4), dtype=bool)
        return cls(mesh, np.asarray(gates.remaining(mesh, shut)))

    def cheapest(self, count: int, shut: BoolArray) -> tuple[list[IntArray], list[IntArray]]:
        """Rows of triangles, and their words, of the cheapest chains."""
        # Were what is left to go not exact, the search would drown in chains that differ by little.
        left = np.asarray(gates.remaining(self.mesh, shut)) if shut.any() else self.left
        rows, words = gates.cheapest_rows(self.mesh, left, shut, count, _MOST_STEPS)
        return rows, words
