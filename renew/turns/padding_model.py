"""Adaptive padding: how wide each constrained edge is kept clear, triangle by triangle.

The padding is the σ-quantile (risk = 1 - σ) of the reach (:mod:`renew.turns.turn_reach`) of
hard-over turns to the worse side, over currents drawn from the triangle's mean and spread and
headings φ ± Δφ about the direction of travel. Where the current changes, mean and spread are also
taken over the window of time in which the vessel may be in the triangle. Edges with their padding
are the soft no-go zone V.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.dual_graph import Channel, Transition, Visits, surroundings
from renew.classes.triangulation import Triangulation
from renew.inputs.chart_and_vessel import Vessel
from renew.inputs.current import CurrentField, CurrentStatistics
from renew.inputs.options import PlanOptions
from renew.kernels.capsules import segment_distance
from renew.turns.turn_reach import TurnSampler, TurnsAtEdges, furthest_reach, normals_away

# A path may bulge by this number of triangles out of its channel, or out of the triangles of the
# path by which its class was found.
_LAYERS = 2
# Number of further triangles that are surveyed with those asked for: all those of a small chart.
_BATCH = 128
# Where the current changes, edges are searched for up to the reach times this factor, because the
# reach may be larger in the next window of time.
_ROOM = 1.5


@dataclass(frozen=True, slots=True)
class PaddedEdges:
    """Constrained edges with their padding: the soft no-go zone V as capsules.

    `start`, `end` are (e, 2) metres, `padding` is (e,) metres, `edge` (e,) the index into the
    triangulation's constrained edges, and `turns` (e,) metres the padding that turns need: an
    offing may make it wider. `most` (e,) metres is the padding that leaves a way through narrow
    water; inf where it may grow.
    """

    start: FloatArray
    end: FloatArray
    padding: FloatArray
    edge: IntArray
    turns: FloatArray
    most: FloatArray

    @classmethod
    def of(
        cls, start: FloatArray, end: FloatArray, padding: FloatArray, edge: IntArray
    ) -> "PaddedEdges":
        """Return edges with the padding that turns need, which may grow."""
        return cls(start, end, padding, edge, padding, np.full(len(edge), np.inf))

    @classmethod
    def joined(cls, parts: "Sequence[PaddedEdges]") -> "PaddedEdges":
        """Return all edges of some parts of a voyage, each once, with its least padding."""
        every = cls.stacked(parts)
        order = np.lexsort((every.padding, every.edge))
        return every.select(order[np.diff(every.edge[order], prepend=-1) != 0])

    @classmethod
    def stacked(cls, parts: "Sequence[PaddedEdges]") -> "PaddedEdges":
        """Return the edges of all parts, one part after the other."""
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__)
        )

    def select(self, keep: BoolArray | IntArray) -> "PaddedEdges":
        """Return only some of the edges."""
        return PaddedEdges(*(getattr(self, name)[keep] for name in self.__slots__))

    def at_least(self, width: FloatArray) -> "PaddedEdges":
        """Return the edges with a padding of at least `width` (e,) metres."""
        return replace(self, padding=np.maximum(self.padding, width))

    def cut(self, longest: float) -> "PaddedEdges":
        """Return the edges in pieces of at most `longest` metres."""
        along = self.end - self.start
        count = np.maximum(np.ceil(np.linalg.norm(along, axis=1) / longest), 1).astype(np.int64)
        row = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        low, high = step / count[row], (step + 1) / count[row]
        start, along = self.start[row], along[row]
        return PaddedEdges(
            start + low[:, None] * along,
            start + high[:, None] * along,
            self.padding[row],
            self.edge[row],
            self.turns[row],
            self.most[row],
        )

    @property
    def yields(self) -> bool:
        """Whether some of it leaves a way through narrow water."""
        return bool(np.isfinite(self.most).any())

    def around(self, point: FloatArray) -> "PaddedEdges":
        """Return only the edges whose padding reaches over a point (2,)."""
        return self.select(segment_distance(point, self.start, self.end) < self.padding)

    def grown(self, edges: IntArray, by: FloatArray) -> "PaddedEdges":
        """Return the edges, with the padding of some of them larger by `by` metres each."""
        extra = np.zeros(len(self.edge))
        order = np.argsort(self.edge, kind="stable")
        np.maximum.at(extra, order[np.searchsorted(self.edge, edges, sorter=order)], by)
        padding = np.minimum(self.padding + extra, self.most)
        return replace(self, padding=padding, turns=np.where(extra > 0, padding, self.turns))

    def widened(self, places: FloatArray, by: FloatArray, reach: float) -> "PaddedEdges":
        """Return the edges, with more padding on the parts within reach (m) of places (n, 2).

        `by` (n,) is how much more, m, at each place.
        """
        distance = segment_distance(places[:, None], self.start, self.end)
        place, edge = np.nonzero(distance < reach)
        axis = self.end[edge] - self.start[edge]
        square = (axis * axis).sum(axis=1)
        middle = ((places[place] - self.start[edge]) * axis).sum(axis=1) / square
        half = reach / np.sqrt(square)
        low, high = np.clip([middle - half, middle + half], 0.0, 1.0)
        return PaddedEdges(
            np.concatenate([self.start, self.start[edge] + low[:, None] * axis]),
            np.concatenate([self.end, self.start[edge] + high[:, None] * axis]),
            np.concatenate([self.padding, self.padding[edge] + by[place]]),
            np.concatenate([self.edge, self.edge[edge]]),
            np.concatenate([self.turns, self.padding[edge] + by[place]]),
            np.concatenate([self.most, self.most[edge]]),
        )


_Place: TypeAlias = tuple[int, int, int]
"""A triangle, and the first and the last step of the clock of the window in which it is crossed."""

_Crossing: TypeAlias = tuple[_Place, Transition]
"""A place, and the transition of the channel in it or beside it."""


class _Around(NamedTuple):
    """Constrained edges (e,) around a triangle up to a `reach`, and how far `apart` they are, m."""

    reach: float
    edges: IntArray
    apart: FloatArray


def region_of(triangulation: Triangulation, channel: Channel) -> dict[int, int]:
    """Return the triangles for a channel's paths, each with the nearest place in its row."""
    path = channel.found_by
    crossed = set() if path is None else set(path.triangles.tolist())
    return surroundings(triangulation, channel.triangles.tolist(), _LAYERS, crossed)


class PaddingModel:
    """Paddings on one triangulation in a current; parts that channels share are computed once."""

    def __init__(
        self,
        triangulation: Triangulation,
        current: CurrentField,
        vessel: Vessel,
        options: PlanOptions,
    ) -> None:
        self._triangulation, self._current, self._vessel = triangulation, current, vessel
        self._options = options
        self._edges = triangulation.constrained_edges
        # One set of draws for all triangles: a triangle's figures depend on itself alone.
        self.sampler = TurnSampler.for_risk(options.seed, options.risk)
        # All windows of a steady current are alike.
        steps = np.diff(current.slice_times)
        self._clock_step = 0.0 if current.is_steady else float(steps.min())
        self._statistics = CurrentStatistics(
            np.zeros((0, 2)), *(np.zeros(0) for _ in CurrentStatistics._fields[1:])
        )
        self._row: dict[_Place, int] = {}
        self._near: list[IntArray] = []
        self._around: dict[int, _Around] = {}
        self._known: dict[_Crossing, tuple[IntArray, FloatArray]] = {}

    def padded_edges(
        self, channel: Channel, start: FloatArray, goal: FloatArray, windows: FloatArray
    ) -> PaddedEdges:
        """Return constrained edges next to a channel, with the largest padding needed for turns.

        Its triangles are crossed in windows of time (c, 2), s.

        Next to means: within the furthest reach of a turn. So all edges count that touch the
        channel by edge or vertex (the paper's rule), and edges just beyond a narrow triangle. An
        edge that is near only triangles beside the channel is padded as these triangles need it,
        since a path may bulge into them; the path is assumed to cross them as it does the channel
        beside them.
        """
        middle = channel.midline(start, goal)
        transitions = channel.transitions
        row = channel.triangles.tolist()
        places = region_of(self._triangulation, channel)
        place = np.fromiter(places.values(), dtype=np.int64)
        steps = self._steps(windows[place])
        crossings = [
            ((triangle, *step), transitions[at])
            for (triangle, at), step in zip(places.items(), steps, strict=True)
        ]
        self._learn(crossings, middle[place], middle[place + 1])
        own, beside = np.full((2, len(self._edges)), -1.0)
        for crossing, at in zip(crossings, places.values(), strict=True):
            edges, needed = self._known[crossing]
            padding = own if crossing[0][0] == row[at] else beside
            padding[edges] = np.maximum(padding[edges], needed)
        padding = np.where(own >= 0, own, beside)
        chosen = np.flatnonzero(padding >= 0)
        start, end, needed = self._edges[chosen, 0], self._edges[chosen, 1], padding[chosen]
        return PaddedEdges.of(start, end, needed, chosen)

    def shortfall(
        self, path: Visits, windows: FloatArray, channel: Channel, padded: PaddedEdges
    ) -> tuple[IntArray, FloatArray] | None:
        """Return constrained edges whose padding is too small for a path, and by how much (m).

        The path's visits fall into windows of time (v, 2), s.

        Where a path bulges out of the channel for which the padding was set, it meets other edges,
        or meets edges on another heading. It is assumed to cross each of its triangles from one
        passing edge's midpoint to the next's, as in its channel; where it leaves a triangle through
        the edge by which it came, its own heading is taken. Returns None if no padding is too
        small.
        """
        if self._current.is_steady and np.array_equal(path.triangle, channel.triangles):
            return None
        row = np.concatenate([[-1], path.triangle, [-1]])
        before, after = row[:-2], row[2:]
        there_and_back = before == after
        enter = self._passing(path.triangle, np.where(there_and_back, -1, before), path.enter)
        leave = self._passing(path.triangle, np.where(there_and_back, -1, after), path.leave)
        transitions = zip(before.tolist(), path.triangle.tolist(), after.tolist(), strict=True)
        crossings = [
            ((transition[1], *step), transition)
            for transition, step in zip(transitions, self._steps(windows), strict=True)
        ]
        for at in np.flatnonzero(there_and_back).tolist():
            # The heading there is this path's own, so it is not taken from an earlier path.
            self._known.pop(crossings[at], None)
        self._learn(crossings, enter, leave)
        wanted = np.full(len(self._edges), -1.0)
        for crossing in crossings:
            edges, needed = self._known[crossing]
            wanted[edges] = np.maximum(wanted[edges], needed)
        # The first row of an edge has its padding for turns; further rows may be for the clearance.
        edges, first = np.unique(padded.edge, return_index=True)
        short = wanted[edges] - padded.padding[first]
        found = np.flatnonzero(short > 0)
        return (edges[found], short[found]) if len(found) else None

    def _steps(self, windows: FloatArray) -> list[tuple[int, int]]:
        """Return first and last step of the clock around windows (n, 2), s."""
        if self._current.is_steady:
            return [(0, 0)] * len(windows)
        first = np.floor(windows[:, 0] / self._clock_step).astype(int)
        last = np.ceil(windows[:, 1] / self._clock_step).astype(int)
        return list(zip(first.tolist(), last.tolist(), strict=True))

    def _passing(self, triangles: IntArray, beside: IntArray, otherwise: FloatArray) -> FloatArray:
        """Return midpoints (n, 2) of edges shared with triangles `beside`; `otherwise` if none."""
        triangulation = self._triangulation
        shared = triangulation.neighbours[triangles] == beside[:, None]
        edges = triangulation.edge_vertices(triangles, shared.argmax(axis=1))
        middle = triangulation.vertices[edges].mean(axis=1)
        found = shared.any(axis=1) & (beside >= 0)
        return np.where(found[:, None], middle, otherwise)

    def _learn(self, crossings: Sequence[_Crossing], enter: FloatArray, leave: FloatArray) -> None:
        """Find the edges next to triangles, and their paddings, for crossings not yet known.

        The triangles are crossed from `enter` (n, 2) to `leave` (n, 2).
        """
        new = {crossing: at for at, crossing in enumerate(crossings) if crossing not in self._known}
        if not new:
            return
        place = np.fromiter(new.values(), dtype=np.int64)
        places = [crossed for crossed, _ in new]
        self._survey(places)
        rows = [self._row[crossed] for crossed in places]
        near = [self._near[number] for number in rows]
        bounds = np.cumsum([0, *map(len, near)])
        row = np.repeat(np.arange(len(new)), np.diff(bounds))
        statistics = CurrentStatistics(*(of[rows] for of in self._statistics))
        if self._options.is_adaptive:
            edges = self._edges[np.concatenate(near)]
            needed = self._adaptive(statistics, row, edges, enter[place], leave[place])
        else:
            needed = np.full(len(row), self._options.fixed_width)
        for crossing, edge, (first, last) in zip(
            new, near, itertools.pairwise(bounds.tolist()), strict=True
        ):
            self._known[crossing] = edge, needed[first:last]

    def _survey(self, places: Sequence[_Place]) -> None:
        """Find the current at places, and the edges within reach in it, if not yet known."""
        new = list(dict.fromkeys(one for one in places if one not in self._row))
        if not new:
            return
        if self._current.is_steady:
            others = ((t, 0, 0) for t in range(len(self._triangulation.triangles)))
            unknown = (one for one in others if one not in self._row)
            new = list(dict.fromkeys([*new, *itertools.islice(unknown, _BATCH)]))
        triangles, first, last = np.array(new).T
        corners = self._triangulation.corners[triangles]
        windows = np.stack([first, last], axis=1) * self._clock_step
        statistics = self._current.statistics(corners, windows)
        self._row |= {one: len(self._row) + at for at, one in enumerate(new)}
        self._near += self._edges_within(triangles, self._furthest(statistics))
        self._statistics = CurrentStatistics(
            *(np.concatenate(both) for both in zip(self._statistics, statistics, strict=True))
        )

    def _edges_within(self, triangles: IntArray, reach: FloatArray) -> list[IntArray]:
        """Return constrained edges within a reach (n,), m, of each of some triangles (n,).

        A triangle is passed in many windows of time, each with a reach of its own.
        """
        room = 1.0 if self._current.is_steady else _ROOM
        known = np.array([self._around[t].reach if t in self._around else -1.0 for t in triangles])
        further: dict[int, float] = {}
        for at in np.flatnonzero(known < reach).tolist():
            triangle = int(triangles[at])
            further[triangle] = max(further.get(triangle, 0.0), room * reach[at])
        if further:
            lacking, distance = np.array(list(further)), np.array(list(further.values()))
            tree = self._triangulation.constrained_edge_tree
            shapes = shapely.polygons(self._triangulation.corners[lacking])
            # The tree's predicate "dwithin" takes three times as long.
            boxes = shapely.bounds(shapes) + distance[:, None] * [-1, -1, 1, 1]
            row, edge = tree.query(shapely.box(*boxes.T))
            apart = shapely.distance(shapes[row], tree.geometries[edge])
            near = np.flatnonzero(apart <= distance[row])
            near = near[np.lexsort((edge[near], row[near]))]
            row, edge, apart = row[near], edge[near], apart[near]
            bounds = np.searchsorted(row, np.arange(len(lacking) + 1))
            for at, (triangle, most) in enumerate(further.items()):
                own = slice(bounds[at], bounds[at + 1])
                self._around[triangle] = _Around(most, edge[own], apart[own])
        around = [self._around[t] for t in triangles.tolist()]
        return [one.edges[one.apart <= r] for one, r in zip(around, reach.tolist(), strict=True)]

    def _furthest(self, statistics: CurrentStatistics) -> FloatArray:
        """Return the upper bounds (n,) on padding and clearance of any edge near triangles (m)."""
        if not self._options.is_adaptive:
            return np.full(len(statistics.speed), self._options.min_width)
        return np.maximum(furthest_reach(statistics, self._vessel), self._options.min_width)

    def _adaptive(
        self,
        statistics: CurrentStatistics,
        row: IntArray,
        edges: FloatArray,
        enter: FloatArray,
        leave: FloatArray,
    ) -> FloatArray:
        """Return σ-quantiles (p,) of the reach from triangles `row` (p,) to edges (p, 2, 2)."""
        travel = leave - enter
        heading = np.arctan2(travel[:, 1], travel[:, 0])
        normals = normals_away(edges, ((enter + leave) / 2)[row])
        asked = TurnsAtEdges(statistics, heading, row, normals, self._vessel)
        return self.sampler.quantile(asked, self._options.risk)
