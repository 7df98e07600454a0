"""The k first homotopy classes between two points, each as a channel of triangles.

A channel is a simple path in the dual graph of the triangulation. ``order="fuel"`` gives first the
class whose quickest chain of points on passing edges needs the least fuel
(:mod:`renew.classes.k_best_chains`); ``"length"`` the one of the shortest chain; ``"depth-first"``
takes classes in the order in which the paper's depth-first search meets them.

Where small islands have no ray (see :mod:`renew.classes.h_signature`), one class has many channels,
and the first may be blocked by its padding. So blocked transitions can be excluded, and the
enumerator gives the next channel of that class.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.channel import Channel, Transition
from renew.classes.dual_graph import is_connected, simple_paths
from renew.classes.h_signature import Rays, Word
from renew.classes.k_best_chains import k_best_chains
from renew.classes.portal_graph import (
    COARSE,
    FINE,
    Density,
    PortalGraph,
    cost_to_go,
    portal_graph,
)
from renew.classes.triangulation import Triangulation
from renew.errors import UnreachableError
from renew.inputs.arguments import Order
from renew.inputs.current_table import STILL_WATER
from renew.inputs.voyage import Voyage

# Largest number of steps of a search: a few seconds. It is reached only where fewer than k classes
# exist in a chart full of islands.
_MAX_STEPS = 1_000_000
# The same for the depth-first search, which looks at triangles one by one.
_MAX_DEPTH_FIRST_STEPS = 100_000
# Number of triangles from which coarse nodes can't rank the classes: these differ by too little.
_MANY_TRIANGLES = 1000


class ClassEnumerator:
    """Gives channels from start to goal, no two of the same class.

    Passing edges are only crossed where that is `clearance` m from the land at their ends. Order
    "length" takes the water as still.

    Raises
    ------
    UnreachableError
        No row of triangles joins start and goal.
    """

    def __init__(
        self,
        voyage: Voyage,
        triangulation: Triangulation,
        rays: Rays,
        order: Order,
        *,
        clearance: float = 0.0,
    ) -> None:
        self._voyage, self._triangulation, self._rays = voyage, triangulation, rays
        self._order, self._clearance = order, clearance
        self._first = triangulation.locate(voyage.start)
        self._last = triangulation.locate(voyage.goal)
        if not is_connected(triangulation, self._first, self._last):
            raise UnreachableError(
                "no water joins start {0} and goal {1}: the no-go zone separates them. Widen the "
                "extent, join fewer islands, or move one of the two",
                voyage.start,
                voyage.goal,
            )

    def channels(
        self, count: int, blocked: Collection[Transition] = (), *, coarse: bool = False
    ) -> list[Channel]:
        """The first `count` channels, except those that make a blocked transition.

        With `coarse`, a class of several channels is given by any that is nearly its best.
        """
        if self._order == "depth-first":
            return list(itertools.islice(self._depth_first(frozenset(blocked)), count))
        excluded = self._excluded(blocked)
        rows, words = self._coarse.k_best(count, excluded)
        if not coarse and (self._rays.omits_small_islands or len(excluded) > _MANY_TRIANGLES):
            # As many classes as the coarse nodes found: looking for more would take every step.
            rows, words = self._fine.k_best(len(rows), excluded)
        return [
            Channel.of(self._triangulation, row, tuple(word.tolist()))
            for row, word in zip(rows, words, strict=True)
        ]

    def _depth_first(self, blocked: frozenset[Transition]) -> Iterator[Channel]:
        """Simple paths of the dual graph as a depth-first search meets them (the paper's order)."""
        if self._first == self._last:  # networkx yields nothing then
            yield Channel.of(self._triangulation, np.array([self._first]))
            return
        seen: set[Word] = set()
        for row in simple_paths(
            self._triangulation, self._first, self._last, _MAX_DEPTH_FIRST_STEPS
        ):
            channel = Channel.of(self._triangulation, np.array(row))
            word = self._rays.word(channel.midline(self._voyage.start, self._voyage.goal))
            if word not in seen and blocked.isdisjoint(channel.transitions):
                seen.add(word)
                yield replace(channel, word=word)

    @cached_property
    def _coarse(self) -> _Search:
        """Search over few nodes."""
        return self._search(COARSE)

    @cached_property
    def _fine(self) -> _Search:
        """Search over many nodes."""
        return self._search(FINE)

    def _search(self, density: Density) -> _Search:
        """Search over nodes of some density."""
        graph = portal_graph(
            self._voyage,
            self._triangulation,
            self._rays,
            (self._first, self._last),
            self._voyage.table if self._order == "fuel" else STILL_WATER,
            clearance=self._clearance,
            density=density,
        )
        return _Search(graph, np.asarray(cost_to_go(graph, _none_excluded(self._triangulation))))

    def _excluded(self, blocked: Collection[Transition]) -> BoolArray:
        """Transitions as the compiled search takes them: (t, 4, 4)."""
        neighbours = self._triangulation.neighbours
        excluded = _none_excluded(self._triangulation)
        for before, triangle, after in blocked:
            beside = neighbours[triangle].tolist()
            entry, out = (beside.index(t) if t >= 0 else 3 for t in (before, after))
            excluded[triangle, entry, out] = True
        return excluded


def _none_excluded(triangulation: Triangulation) -> BoolArray:
    """No transition excluded: (t, 4, 4)."""
    return np.zeros((len(triangulation.triangles), 4, 4), dtype=bool)


@dataclass(frozen=True)
class _Search:
    """A graph of nodes, and the cost to go of each (n,), s, where nothing is blocked."""

    graph: PortalGraph
    unblocked_cost: FloatArray

    def k_best(self, count: int, excluded: BoolArray) -> tuple[list[IntArray], list[IntArray]]:
        """Rows of triangles, and their words, of the quickest chains."""
        cost = (
            np.asarray(cost_to_go(self.graph, excluded)) if excluded.any() else self.unblocked_cost
        )
        rows, words = k_best_chains(self.graph, cost, excluded, count, _MAX_STEPS)
        return rows, words
