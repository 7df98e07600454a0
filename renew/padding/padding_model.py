"""Padding of constrained edges: how far a hard-over turn can carry the vessel towards them.

A turn at rate ω in a current c, begun with heading φ, follows (paper, best effort τ)

    p(t) = v/ω [sin(φ + ωt) - sin φ, cos φ - cos(φ + ωt)] + c t.

Its reach towards an edge with unit normal n is the largest p(t)·n over one full turn. The
padding is the σ-quantile (risk = 1 - σ) of the worst reach of both sides over currents drawn
from the triangle's mean and spread and headings φ ± Δφ about the direction of travel.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import shapely

from renew._types import FloatArray, IntArray
from renew.classes.channels import Channel, Move
from renew.classes.triangulation import Triangulation
from renew.errors import ParameterError
from renew.inputs.checks import is_size
from renew.inputs.current import CurrentField, CurrentStatistics
from renew.inputs.vessel import Vessel
from renew.kernels.capsules import segment_distance
from renew.kernels.traversal import Visits
from renew.padding.turn_sampling import Draws, normals_away

_Crossing: TypeAlias = "tuple[int, Move]"
"""A triangle, and the move of the channel in it or beside it."""

Padding: TypeAlias = Literal["adaptive", "none"] | float

LAYERS = 2
"""A path may bulge out of its channel by so many triangles."""

# Draws that set a quantile: some at the least, and so many that this many lie beyond it.
_FEWEST_DRAWS, _BEYOND = 512, 20.0
# Triangles that are surveyed beside those that are asked for: fewer cost no less time.
_AT_ONCE = 128
# The share that may reach beyond is taken as this much smaller, for what the draws are off.
_SAFE = 0.85


def check_padding(padding: Padding, clearance: float, risk: float) -> None:
    """Refuse what is no padding, no clearance or no risk; all faults at once."""
    faults = []
    if isinstance(padding, str):
        if padding not in {"adaptive", "none"}:
            faults.append(f'padding = {padding!r} is not "adaptive", "none" or metres')
    elif not is_size(padding):
        faults.append(f"padding = {padding!r} m must be finite and at least 0")
    if not is_size(clearance):
        faults.append(f"clearance = {clearance!r} m must be finite and at least 0")
    if not 0 < risk < 1:
        faults.append(f"risk = {risk!r} must lie between 0 and 1, as in 0.05")
    if faults:
        raise ParameterError("; ".join(faults))


def turn_reach(
    vessel: Vessel, heading: FloatArray, current: FloatArray, normal: FloatArray
) -> FloatArray:
    """Reach (m) of a hard-over turn along unit normals, the worse of port and starboard.

    Parameters
    ----------
    vessel : Vessel
        Gives v and ω.
    heading : (...) rad
        Heading φ at which the turn begins.
    current : (..., 2) m/s
        Steady current c during the turn.
    normal : (..., 2)
        Unit vectors n towards the danger.

    Notes
    -----
    d/dt p·n = v cos(θ - ψ) + c·n, with θ the heading and ψ the normal's direction. For a turn to
    port it falls through zero at θ = ψ + arccos(-c·n / v), the one maximum inside the turn; at
    its ends p·n is 0 and c·n 2π/ω. A turn to starboard is the mirror image.
    """
    drift = (current * normal).sum(-1)
    bearing = np.arctan2(normal[..., 1], normal[..., 0])
    turned_to = np.arccos(np.clip(-drift / vessel.speed, -1.0, 1.0))
    ends = np.maximum(0.0, drift * vessel.turn_period)
    radius = vessel.turning_radius
    worst = ends
    for side in (1.0, -1.0):
        # In the frame of the normal a turn to starboard from φ is one to port from -φ.
        begin = side * (heading - bearing)
        turned = (turned_to - begin) % (2 * np.pi)
        peak = radius * (np.sin(turned_to) - np.sin(begin)) + drift * turned / vessel.turn_rate
        worst = np.maximum(worst, peak)
    return np.asarray(worst)


@dataclass(frozen=True, slots=True)
class Hazards:
    """Constrained edges with their padding: the soft no-go zone V as capsules.

    `start`, `end` are (e, 2) metres, `padding` is (e,) metres and `edge` (e,) the index into the
    triangulation's constrained edges.
    """

    start: FloatArray
    end: FloatArray
    padding: FloatArray
    edge: IntArray

    def around(self, point: FloatArray) -> Hazards:
        """Only the padded edges whose padding reaches over a point (2,)."""
        inside = segment_distance(point, self.start, self.end) < self.padding
        return Hazards(
            self.start[inside], self.end[inside], self.padding[inside], self.edge[inside]
        )

    def grown(self, edges: IntArray, by: FloatArray) -> Hazards:
        """The same, with the padding of the given constrained edges larger by so many metres."""
        extra = np.zeros(len(self.edge))
        order = np.argsort(self.edge)
        np.maximum.at(extra, order[np.searchsorted(self.edge, edges, sorter=order)], by)
        return Hazards(self.start, self.end, self.padding + extra, self.edge)


class Padder:
    """Paddings on one triangulation in a current; what channels share is worked out once."""

    def __init__(
        self,
        triangulation: Triangulation,
        current: CurrentField,
        vessel: Vessel,
        *,
        padding: Padding,
        clearance: float,
        risk: float,
        seed: int,
    ) -> None:
        self._triangulation, self._current, self._vessel = triangulation, current, vessel
        self._padding: Padding = padding
        self._clearance, self._risk = clearance, risk
        self._edges = triangulation.constrained_edges
        # The same draws for every triangle: its figures depend on itself alone.
        self._draws = Draws(seed, max(_FEWEST_DRAWS, math.ceil(_BEYOND / risk)))
        lines = shapely.linestrings(self._edges) if len(self._edges) else np.array([], dtype=object)
        self._tree = shapely.STRtree(lines)
        count = len(triangulation.triangles)
        self._statistics = CurrentStatistics(
            np.zeros((count, 2)), *(np.zeros(count) for _ in CurrentStatistics._fields[1:])
        )
        self._near: dict[int, IntArray] = {}
        self._known: dict[_Crossing, tuple[IntArray, FloatArray]] = {}

    def hazards(self, channel: Channel, start: FloatArray, goal: FloatArray) -> Hazards:
        """Constrained edges next to a channel, each with the largest padding it needs there.

        Next to means: within the furthest reach of a turn, which takes in all that touch the
        channel by edge or vertex (the paper's rule) and those just beyond a narrow triangle. Edges
        that are near the triangles beside the channel only are padded by what those need, since a
        path may bulge into them; it is taken to cross them as it does the channel beside them.
        """
        middle = channel.midline(start, goal)
        moves = channel.moves
        row = channel.triangles.tolist()
        places = self._triangulation.surroundings(row, LAYERS)
        place = np.fromiter(places.values(), dtype=np.int64)
        crossings = [(triangle, moves[at]) for triangle, at in places.items()]
        self._learn(crossings, middle[place], middle[place + 1])
        own, beside = np.full((2, len(self._edges)), -1.0)
        for crossing, at in zip(crossings, places.values(), strict=True):
            edges, needed = self._known[crossing]
            padding = own if crossing[0] == row[at] else beside
            padding[edges] = np.maximum(padding[edges], needed)
        padding = np.where(own >= 0, own, beside)
        chosen = np.flatnonzero(padding >= 0)
        return Hazards(self._edges[chosen, 0], self._edges[chosen, 1], padding[chosen], chosen)

    def shortfall(
        self, path: Visits, channel: Channel, hazards: Hazards
    ) -> tuple[IntArray, FloatArray] | None:
        """Constrained edges whose padding is too small for a path, and what it is short of (m).

        Where a path bulges out of the channel for which the padding was set it meets other edges,
        or the same on another heading. It is taken to cross each of its triangles from one passing
        edge's midpoint to the next's, as in its channel; where it comes back through the edge by
        which it went, as it really does. None where nothing is short.
        """
        if np.array_equal(path.triangle, channel.triangles):
            return None
        row = np.concatenate([[-1], path.triangle, [-1]])
        before, after = row[:-2], row[2:]
        there_and_back = before == after
        enter = self._passing(path.triangle, np.where(there_and_back, -1, before), path.enter)
        leave = self._passing(path.triangle, np.where(there_and_back, -1, after), path.leave)
        moves = zip(before.tolist(), path.triangle.tolist(), after.tolist(), strict=True)
        crossings = [(move[1], move) for move in moves]
        for at in np.flatnonzero(there_and_back).tolist():
            # The heading there is this path's own, so it is worked out afresh.
            self._known.pop(crossings[at], None)
        self._learn(crossings, enter, leave)
        wanted = np.full(len(self._edges), -1.0)
        for crossing in crossings:
            edges, needed = self._known[crossing]
            wanted[edges] = np.maximum(wanted[edges], needed)
        short = wanted[hazards.edge] - hazards.padding
        found = np.flatnonzero(short > 0)
        return (hazards.edge[found], short[found]) if len(found) else None

    def _passing(self, triangles: IntArray, beside: IntArray, otherwise: FloatArray) -> FloatArray:
        """Midpoints (n, 2) of the edges that triangles (n,) share with others, where they do."""
        mesh = self._triangulation
        shared = mesh.neighbours[triangles] == beside[:, None]
        middle = mesh.vertices[mesh.edge_vertices(triangles, shared.argmax(axis=1))].mean(axis=1)
        found = shared.any(axis=1) & (beside >= 0)
        return np.where(found[:, None], middle, otherwise)

    def _learn(self, crossings: Sequence[_Crossing], enter: FloatArray, leave: FloatArray) -> None:
        """Work out the edges next to triangles, and their paddings, for crossings not yet known.

        The triangles are crossed from `enter` (n, 2) to `leave` (n, 2).
        """
        new = {crossing: at for at, crossing in enumerate(crossings) if crossing not in self._known}
        if not new:
            return
        place = np.fromiter(new.values(), dtype=np.int64)
        triangles = [triangle for triangle, _ in new]
        self._survey(triangles)
        near = [self._near[triangle] for triangle in triangles]
        bounds = np.cumsum([0, *map(len, near)])
        row = np.repeat(np.arange(len(new)), np.diff(bounds))
        statistics = CurrentStatistics(*(of[triangles] for of in self._statistics))
        if self._padding == "adaptive":
            edges = self._edges[np.concatenate(near)]
            needed = self._adaptive(statistics, row, edges, enter[place], leave[place])
            needed = np.maximum(needed, self._clearance)
        else:
            needed = self._furthest(statistics)[row]
        for crossing, edge, (first, last) in zip(
            new, near, itertools.pairwise(bounds.tolist()), strict=True
        ):
            self._known[crossing] = edge, needed[first:last]

    def _survey(self, triangles: Sequence[int]) -> None:
        """Work out the current in triangles, and the edges within reach of it, if not yet known."""
        if all(triangle in self._near for triangle in triangles):
            return
        at_hand = itertools.chain(triangles, range(len(self._triangulation.triangles)))
        unknown = (triangle for triangle in at_hand if triangle not in self._near)
        new = list(dict.fromkeys(itertools.islice(unknown, len(triangles) + _AT_ONCE)))
        corners = self._triangulation.corners[new]
        statistics = self._current.statistics(corners)
        for of, values in zip(self._statistics, statistics, strict=True):
            of[new] = values
        row, edge = self._tree.query(
            shapely.polygons(corners), predicate="dwithin", distance=self._furthest(statistics)
        )
        order = np.lexsort((edge, row))
        bounds = np.searchsorted(row[order], np.arange(len(new) + 1))
        for triangle, (first, last) in zip(new, itertools.pairwise(bounds.tolist()), strict=True):
            self._near[triangle] = edge[order[first:last]]

    def _furthest(self, statistics: CurrentStatistics) -> FloatArray:
        """Upper bounds (n,) on the padding that any edge needs from triangles (m)."""
        if self._padding != "adaptive":
            width = 0.0 if self._padding == "none" else float(self._padding)
            return np.full(len(statistics.speed), max(width, self._clearance))
        speed = statistics.speed + 4 * statistics.speed_std
        reach = 2 * self._vessel.turning_radius + speed * self._vessel.turn_period
        return np.asarray(np.maximum(reach, self._clearance))

    def _adaptive(
        self,
        statistics: CurrentStatistics,
        row: IntArray,
        edges: FloatArray,
        enter: FloatArray,
        leave: FloatArray,
    ) -> FloatArray:
        """σ-quantiles (p,) of the worst reach from triangles `row` (p,) towards edges (p, 2, 2)."""
        travel = leave - enter
        heading = np.arctan2(travel[:, 1], travel[:, 0])
        normals = normals_away(edges, ((enter + leave) / 2)[row])
        return self._draws.exceeded_by(
            statistics, heading, row, normals, self._vessel, _SAFE * self._risk
        )
