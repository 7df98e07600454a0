"""The k first homotopy classes between two points, each as a channel of triangles.

A channel is a simple path in the dual graph of the triangulation. ``order="fuel"`` gives them by
the fuel along their midline, the path through the midpoints of their passing edges, in the mean
current of each triangle, cheapest first; ``"length"`` by the midline's length; ``"depth-first"``
in the order in which the paper's depth-first search meets them.

Where islets have no letter in the words (see :mod:`renew.homotopy`), one word has many channels,
and the shortest may be shut by its padding. So moves that were found shut can be taken out, and
the search gives the next channel of that word.
"""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import networkx as nx
import numpy as np

from renew import homotopy
from renew.errors import ParameterError, UnreachableError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from renew._types import FloatArray, IntArray
    from renew.homotopy import Rays, Word
    from renew.triangulation import Triangulation

Order: TypeAlias = Literal["fuel", "length", "depth-first"]

# A midline may lead against a current that the path itself avoids: it is taken to make at least
# this share of the vessel's speed over ground.
_LEAST_WAY = 0.1
# The best-first search gives up after this many steps: at some 10 µs each, a few seconds. It is
# reached only where fewer than k classes exist in a chart full of islands.
_MOST_STEPS = 400_000

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
    """Finds channels from start to goal, lazily, no two with the same word.

    `drift` (t, 2) is the mean current of each triangle as a share of the vessel's speed through
    water; order "length" does without.

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
        drift: FloatArray | None = None,
    ) -> None:
        if order not in get_args(Order):
            raise ParameterError(f"order = {order!r} is not one of {', '.join(get_args(Order))}")
        self._triangulation, self._rays = triangulation, rays
        self._start, self._goal, self._order = start, goal, order
        self._first, self._last = triangulation.locate(start), triangulation.locate(goal)
        if not nx.has_path(triangulation.dual, self._first, self._last):
            raise UnreachableError(
                f"no water joins start ({start[0]:g}, {start[1]:g}) m and goal ({goal[0]:g}, "
                f"{goal[1]:g}) m: the no-go zone parts them. Widen the extent, join fewer "
                "islands, or move one of the two"
            )
        corners = triangulation.corners
        # Edge i is opposite corner i. Plain lists: the search reads single numbers.
        midpoints = (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1)) / 2
        self._midpoints: list[list[list[float]]] = midpoints.tolist()
        self._neighbours: list[list[int]] = triangulation.neighbours.tolist()
        if drift is None or order != "fuel":
            drift = np.zeros((len(corners), 2))
        self._drift: list[list[float]] = drift.tolist()
        self._letters: dict[tuple[int, int, int], Word] = {}

    def channels(self, shut: set[Move] | frozenset[Move] = frozenset()) -> Iterator[Channel]:
        """Channels in order, but for those that make a move found shut."""
        search = self._depth_first if self._order == "depth-first" else self._best_first
        return search(shut)

    def _depth_first(self, shut: set[Move] | frozenset[Move]) -> Iterator[Channel]:
        """Simple paths of the dual graph as a depth-first search meets them (the paper's order)."""
        if self._first == self._last:  # networkx yields nothing then
            yield self._channel([self._first], ())
            return
        seen: set[Word] = set()
        rows = nx.all_simple_paths(self._triangulation.dual, self._first, self._last)
        for row in itertools.islice(rows, _MOST_STEPS):
            channel = self._channel(row, ())
            word = self._rays.word(channel.midline(self._start, self._goal))
            if word not in seen and shut.isdisjoint(channel.moves):
                seen.add(word)
                yield replace(channel, word=word)

    def _best_first(self, shut: set[Move] | frozenset[Move]) -> Iterator[Channel]:
        """Channels by rising cost of their midline.

        A search over pairs of (triangle, word so far), as in h-signature-augmented graphs: each
        pair is expanded once, by the shortest row that reaches it, so that twins which part only
        around a rayless islet cost nothing. What is left to go is known exactly, but for rows
        that would use a triangle twice.
        """
        serial = itertools.count()
        first = _Step(0.0, self._first, -1, (), 1 << self._first, None)
        queue = [(0.0, next(serial), first)]
        seen: set[tuple[int, int, Word]] = set()
        yielded: set[Word] = set()
        for _ in range(_MOST_STEPS):
            if not queue:
                return
            _, _, step = heapq.heappop(queue)
            state = (step.triangle, step.entry, step.word)
            if state in seen:
                continue
            seen.add(state)
            before = step.before.triangle if step.before else -1
            if step.triangle == self._last:
                word = homotopy.append(step.word, self._crossed(step, -1))
                if word not in yielded and (before, self._last, -1) not in shut:
                    yielded.add(word)
                    yield self._channel(step.row(), word)
                continue
            here = self._here(step)
            for corner, after in enumerate(self._neighbours[step.triangle]):
                if after < 0 or step.visited >> after & 1:
                    continue
                if (before, step.triangle, after) in shut:
                    continue
                entry = self._neighbours[after].index(step.triangle)
                if (after, entry) not in self._remaining:
                    continue
                there = self._midpoints[step.triangle][corner]
                cost = step.cost + self._cost(step.triangle, here, there)
                word = homotopy.append(step.word, self._crossed(step, corner))
                onwards = _Step(cost, after, entry, word, step.visited | 1 << after, step)
                bound = cost + self._remaining[after, entry]
                heapq.heappush(queue, (bound, next(serial), onwards))

    def widest_gap(self) -> float:
        """Width (m) of the narrowest passing edge on the way whose narrowest is the widest."""
        dual = self._triangulation.dual
        way = nx.maximum_spanning_tree(dual, weight="width")
        row = nx.shortest_path(way, self._first, self._last)
        widths = (dual.edges[edge]["width"] for edge in itertools.pairwise(row))
        return min(widths, default=math.inf)

    @cached_property
    def _remaining(self) -> dict[tuple[int, int], float]:
        """Least cost of a midline from each (triangle, entered by edge) to the goal."""
        remaining: dict[tuple[int, int], float] = {}
        goal = self._goal.tolist()
        queue = [
            (self._cost(self._last, self._midpoints[self._last][corner], goal), self._last, corner)
            for corner in range(3)
            if self._neighbours[self._last][corner] >= 0
        ]
        heapq.heapify(queue)
        while queue:
            cost, triangle, entry = heapq.heappop(queue)
            if (triangle, entry) in remaining:
                continue
            remaining[triangle, entry] = cost
            # Whoever enters here comes from the neighbour, which it entered by another edge.
            before = self._neighbours[triangle][entry]
            for corner in range(3):
                onwards = self._neighbours[before][corner]
                if onwards not in {triangle, -1}:
                    step = self._cost(
                        before, self._midpoints[before][corner], self._midpoints[triangle][entry]
                    )
                    heapq.heappush(queue, (cost + step, before, corner))
        return remaining

    def _cost(self, triangle: int, a: Sequence[float], b: Sequence[float]) -> float:
        """Time to cross a triangle from a to b at a speed through water of 1 (projected drift)."""
        dx, dy = b[0] - a[0], b[1] - a[1]
        length = math.hypot(dx, dy)
        if length == 0.0:
            return 0.0
        u, v = self._drift[triangle]
        return length / max(_LEAST_WAY, 1.0 + (u * dx + v * dy) / length)

    def _here(self, step: _Step) -> Sequence[float]:
        """Where a row of triangles stands: at the start, or on the last passing edge."""
        if step.entry < 0:
            return (float(self._start[0]), float(self._start[1]))
        return self._midpoints[step.triangle][step.entry]

    def _crossed(self, step: _Step, corner: int) -> Word:
        """Rays crossed from where a row stands to the edge opposite a corner (-1: to the goal)."""
        key = (step.triangle, step.entry, corner)
        if key not in self._letters:
            there = self._goal if corner < 0 else self._midpoints[step.triangle][corner]
            self._letters[key] = self._rays.crossings(
                np.asarray(self._here(step)), np.asarray(there)
            )
        return self._letters[key]

    def _channel(self, row: list[int], word: Word) -> Channel:
        """Channel of a row of triangles."""
        corners = np.array(
            [self._neighbours[a].index(b) for a, b in itertools.pairwise(row)], dtype=np.int64
        )
        triangles = np.array(row, dtype=np.int64)
        # Leaving an anticlockwise triangle across its edge (first, second): first is on the right.
        ends = self._triangulation.vertices[
            self._triangulation.edge_vertices(triangles[:-1], corners)
        ]
        return Channel(triangles, ends[:, 1], ends[:, 0], word)


@dataclass(frozen=True, slots=True)
class _Step:
    """A row of triangles so far: its cost, the last one, how it was entered, what lies before.

    `visited` has the bit of each triangle in the row.
    """

    cost: float
    triangle: int
    entry: int
    word: Word
    visited: int
    before: _Step | None

    def row(self) -> list[int]:
        """Triangles from the first to this one."""
        step: _Step | None = self
        row = []
        while step is not None:
            row.append(step.triangle)
            step = step.before
        return row[::-1]
