"""The first k homotopy classes between two points, each as a channel of triangles.

A channel is a simple path in the dual graph of the triangulation. ``order="fuel"`` sorts classes by
the fuel of their quickest path on a roadmap (:mod:`renew.classes.k_best_paths`); ``"length"`` by
the length of their shortest path; ``"depth-first"`` is the order in which the paper's depth-first
search meets them.

Where small islands have no ray (see :mod:`renew.classes.h_signature`), one class has many channels,
and the first may be blocked by its padding. So blocked transitions can be excluded, and the
enumerator gives the next channel of that class.

Via points divide a voyage into parts; each part begins when the one before ends. An earlier arrival
at a via point never means a later arrival at the next (FIFO). So the best route begins with the
best path to each via point, and the k best combinations of classes are found part by part. In two
ascending lists, the pair (i, j), counted from 1, can have one of the k smallest sums only if
i x j <= k.
"""

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.dual_graph import Channel, RoughPath, Transition, is_connected, simple_paths
from renew.classes.h_signature import Rays, Word
from renew.classes.k_best_paths import (
    MAX_FLOODED,
    RayColumns,
    SearchTask,
    k_best_paths,
    time_to_go,
    triangles_crossed,
)
from renew.classes.roadmap import (
    START,
    Resolution,
    Roadmap,
    Tube,
    closer,
    is_coarse,
    resolution_beside,
    resolution_for,
    roadmap,
)
from renew.classes.triangulation import Triangulation
from renew.errors import UnreachableError
from renew.inputs.options import Order
from renew.kernels.current_table import STILL_WATER
from renew.kernels.viterbi import Stream
from renew.voyage.voyage import Voyage

# Largest number of steps of a search: a few seconds. It is reached only where fewer than k classes
# exist in a chart full of islands.
_MAX_STEPS = 1_000_000
# Least size, in cells, of the islands that distinguish paths in a search on a finer roadmap.
_WIDE = 2.0
# Largest number of steps of the depth-first search, which looks at triangles one by one.
_MAX_DEPTH_FIRST_STEPS = 100_000


@dataclass(frozen=True, eq=False)
class _Roads:
    """Roadmaps of the water for one order of classes, `clearance` m off land.

    Legs with less room than `narrow[0]` m cost more than on the roadmaps of `plain`: without any,
    `narrow[1]` times as much beside their own cost.
    """

    voyage: Voyage
    triangulation: Triangulation
    order: Order
    clearance: float
    narrow: tuple[float, float] = (0.0, 0.0)
    plain: "_Roads | None" = None
    searches: dict[tuple[object, ...], list[Channel]] = field(default_factory=dict, init=False)

    @cached_property
    def everywhere(self) -> Roadmap:
        """Nodes over the whole water, and legs."""
        if self.plain:
            return self._dearer_in_narrows(self.plain.everywhere)
        return self.roadmap(self.voyage, resolution_for(self.voyage, self.triangulation))

    @cached_property
    def time_to_go(self) -> FloatArray:
        """Least time (n,) in s from each node to the goal, whatever the departure."""
        return np.asarray(time_to_go(self.everywhere))

    @cached_property
    def closer(self) -> Roadmap:
        """Nodes over the whole water, closer together, with legs in more directions."""
        return self.roadmap(self.voyage, closer(resolution_for(self.voyage, self.triangulation)))

    def beside(self, paths: Sequence[FloatArray], voyage: Voyage) -> tuple[Roadmap, float]:
        """Return nodes beside paths (n, 2), closer together, and a cell's size (m)."""
        whole = resolution_for(voyage, self.triangulation)
        resolution, tube = resolution_beside(paths, voyage, whole)
        return self.roadmap(voyage, resolution, tube), tube.cell

    def stream(self, voyage: Voyage) -> Stream:
        """Return the current in which legs are timed; still water for order "length"."""
        table = voyage.table if self.order == "fuel" else STILL_WATER
        return Stream(table, voyage.polar, voyage.clock)

    def roadmap(self, voyage: Voyage, resolution: Resolution, tube: Tube | None = None) -> Roadmap:
        """Return nodes over the water, or in a tube."""
        graph = roadmap(
            voyage,
            self.triangulation,
            self.stream(voyage).table,
            clearance=self.clearance,
            resolution=resolution,
            tube=tube,
        )
        return self._dearer_in_narrows(graph) if self.plain else graph

    def _dearer_in_narrows(self, graph: Roadmap) -> Roadmap:
        """Return a roadmap whose legs take longer the less room they have, so that few are used."""
        roomy, most = self.narrow
        room = np.minimum(self.triangulation.room_at(graph.points, roomy), roomy)
        tail = np.repeat(np.arange(len(room)), np.diff(graph.first))
        lacking = 1 - np.minimum(room[tail], room[graph.head]) / roomy
        dearer = 1 + most * lacking
        return graph._replace(time=dearer * graph.time, back=dearer * graph.back)


@dataclass(frozen=True, eq=False)
class ClassEnumerator:
    """Gives channels from start to goal, no two of the same class.

    Passing edges are only crossed at places `clearance` m or more from the land at their ends. For
    order "length" the water is still. The roadmaps are those of the first departure. Channels whose
    estimated cost is more than `dearest` times the best estimate are left out. With via points,
    `parts` are the enumerators of the voyage's parts.
    """

    _voyage: Voyage
    _triangulation: Triangulation
    _rays: Rays
    _roads: _Roads
    _dearest: float = math.inf
    parts: "tuple[ClassEnumerator, ...]" = ()

    @classmethod
    def of(
        cls,
        voyage: Voyage,
        triangulation: Triangulation,
        rays: Rays,
        order: Order,
        clearance: float = 0.0,
    ) -> "ClassEnumerator":
        """Return the enumerator of the classes that rays distinguish.

        UnreachableError where no row of triangles joins start and goal.
        """
        first, last = triangulation.locate(voyage.start), triangulation.locate(voyage.goal)
        if not is_connected(triangulation, first, last):
            raise UnreachableError(
                "no water joins {0} and {1}: the no-go zone separates them. Move one of "
                "the two, or give a chart of more water between them (--charts)",
                voyage.start,
                voyage.goal,
            )
        return cls(voyage, triangulation, rays, _Roads(voyage, triangulation, order, clearance))

    @classmethod
    def through(cls, voyage: Voyage, parts: "Sequence[ClassEnumerator]") -> "ClassEnumerator":
        """Return the enumerator of a voyage from those of its parts between via points."""
        return replace(parts[0], _voyage=voyage, parts=tuple(parts) if len(parts) > 1 else ())

    @property
    def sees_all(self) -> bool:
        """Whether each class has one channel, and no passing edge is too narrow for any."""
        is_narrow = (self._triangulation.free_widths(self._roads.clearance) <= 0).any()
        return not (self._rays.omits_islands or is_narrow)

    @property
    def has_many_triangles(self) -> bool:
        """Whether the search is cut short on so large a chart: it may miss the best class."""
        return len(self._triangulation.triangles) > MAX_FLOODED

    def by_rays(self, rays: Rays) -> "ClassEnumerator":
        """Return the enumerator of the classes that other rays distinguish."""
        return replace(self, _rays=rays, parts=tuple(part.by_rays(rays) for part in self.parts))

    def dearer_in_narrows(self, room: float, by: float) -> "ClassEnumerator":
        """Return the enumerator whose legs cost up to 1 + `by` times as much, with less room, m."""
        parts = tuple(part.dearer_in_narrows(room, by) for part in self.parts)
        roads = replace(self._roads, narrow=(room, by), plain=self._roads)
        return replace(self, _roads=roads, parts=parts)

    def up_to(self, dearest: float) -> "ClassEnumerator":
        """Return the enumerator without channels that cost over `dearest` times the best one."""
        parts = tuple(part.up_to(dearest) for part in self.parts)
        return replace(self, _dearest=dearest, parts=parts)

    def leaving(self, voyage: Voyage) -> "ClassEnumerator":
        """Return the enumerator of a voyage with another departure; the roadmap is shared."""
        return replace(self, _voyage=voyage)

    def channels(self, count: int, blocked: Collection[Transition] = ()) -> list[Channel]:
        """Return the first `count` channels that make no blocked transition."""
        if self.parts:
            return self._combined(count, lambda _, part: part.channels(count, blocked))
        if self._roads.order == "depth-first":
            return list(itertools.islice(self._depth_first(frozenset(blocked)), count))
        # Classes are searched again with less padding, often around the same blocked places.
        known = self._roads.searches
        search = self._voyage, self._rays, count, self._dearest, frozenset(blocked)
        if search not in known:
            graph, to_go = self._roads.everywhere, self._roads.time_to_go
            known[search] = self._quickest(graph, to_go, self._rays, count, blocked)
        return known[search]

    @property
    def is_coarse(self) -> bool:
        """Whether the roadmap has few nodes."""
        return is_coarse(resolution_for(self._voyage, self._triangulation))

    def best_closely(self) -> list[Channel]:
        """Return the best channel of a closer roadmap, if there is one."""
        return self.channels_on(self._roads.closer, 1)

    @property
    def least_time(self) -> float:
        """Least time (s) from start to goal on the roadmap, at any hour; inf without a way."""
        if self.parts:
            return sum(part.least_time for part in self.parts)
        return float(self._roads.time_to_go[START])

    def roadmap(self, resolution: Resolution) -> Roadmap:
        """Return a roadmap over the whole water at another resolution."""
        return self._roads.roadmap(self._voyage, resolution)

    def channels_on(self, graph: Roadmap, count: int) -> list[Channel]:
        """Return the first `count` channels on a roadmap of this water."""
        return self._quickest(graph, np.asarray(time_to_go(graph)), self._rays, count)

    def channels_beside(self, paths: Sequence[FloatArray], count: int) -> list[Channel]:
        """Search again on a finer roadmap near given paths (n, 2); return `count` channels.

        They differ by islands that are wider than two cells; among smaller islets each path takes
        the best sides.
        """
        if self.parts:
            pieces = [self._voyage.cut(path) for path in paths]
            return self._combined(
                count, lambda at, part: part.channels_beside([cut[at] for cut in pieces], count)
            )
        graph, cell = self._roads.beside(paths, self._voyage)
        wide = self._rays.only(self._rays.size >= _WIDE * cell)
        return self._quickest(graph, np.asarray(time_to_go(graph)), wide, count)

    def _quickest(
        self,
        graph: Roadmap,
        to_go: FloatArray,
        rays: Rays,
        count: int,
        blocked: Collection[Transition] = (),
    ) -> list[Channel]:
        """Return the channels of the quickest paths on a roadmap that rays distinguish."""
        # Without rays all channels are of one class, so the roadmap need not cover all water.
        count = count if len(rays.x) else 1
        columns = RayColumns(rays.x, rays.y, rays.island)
        task = SearchTask(graph, columns, self._excluded(blocked))
        stream = self._roads.stream(self._voyage)
        rows, paths = k_best_paths(task, to_go, stream, count, _MAX_STEPS, self._dearest)
        return [
            self._channel(row, RoughPath(graph.points[nodes], triangles_crossed(graph, nodes)))
            for row, nodes in zip(rows, paths, strict=True)
        ]

    def _channel(self, row: IntArray, path: RoughPath | None = None) -> Channel:
        """Return the channel of a row of triangles (n,), found by a path."""
        channel = Channel.of(self._triangulation, row)
        middle = channel.midline(self._voyage.start, self._voyage.goal)
        return replace(channel, word=self._rays.word(middle), found_by=path)

    def _depth_first(self, blocked: frozenset[Transition]) -> Iterator[Channel]:
        """Yield channels as a depth-first search of the dual graph meets them (paper's order)."""
        stops = self._voyage.start, self._voyage.goal
        first, last = map(self._triangulation.locate, stops)
        if first == last:  # networkx yields nothing then
            yield self._channel(np.array([first]))
            return
        seen: set[Word] = set()
        for row in simple_paths(self._triangulation, first, last, _MAX_DEPTH_FIRST_STEPS):
            channel = self._channel(np.array(row))
            if channel.word not in seen and blocked.isdisjoint(channel.transitions):
                seen.add(channel.word)
                yield channel

    def _excluded(self, blocked: Collection[Transition]) -> BoolArray:
        """Return blocked transitions in the form for compiled code: (t, 4, 4)."""
        neighbours = self._triangulation.neighbours
        excluded = np.zeros((len(neighbours), 4, 4), dtype=bool)
        for before, triangle, after in blocked:
            beside = neighbours[triangle].tolist()
            entry, out = (beside.index(t) if t >= 0 else 3 for t in (before, after))
            excluded[triangle, entry, out] = True
        return excluded

    def _combined(
        self, count: int, channels_of: "Callable[[int, ClassEnumerator], list[Channel]]"
    ) -> list[Channel]:
        """Return the `count` best combinations of channels, one from each part.

        Each part departs at the earliest arrival of the part before it.
        `channels_of` gives the channels of a part by its number and its enumerator.
        """
        combined: list[tuple[float, tuple[Channel, ...]]] = [(0.0, ())]
        for at, part in enumerate(self.parts):
            earliest = combined[0][0]
            # If the part can't be sailed, the clock stops.
            begin = self._voyage.departure + (earliest if math.isfinite(earliest) else 0.0)
            voyage = self._voyage.part(at, begin)
            timed = [
                (voyage.duration(channel.found_by.points), channel)
                for channel in channels_of(at, part.leaving(voyage))
                if channel.found_by is not None
            ]
            timed.sort(key=lambda pair: pair[0])
            longer = [
                (before + time, (*channels, channel))
                for i, (before, channels) in enumerate(combined)
                for time, channel in timed[: count // (i + 1)]
            ]
            if not longer:
                return []
            combined = sorted(longer, key=lambda pair: pair[0])[:count]
        return [Channel.joined(channels, self._voyage.via) for _, channels in combined]
