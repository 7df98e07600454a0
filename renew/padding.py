"""Padding of constrained edges: how far a hard-over turn can carry the vessel towards them.

A turn at rate ω in a current c, begun with heading φ, follows (paper, best effort τ)

    p(t) = v/ω [sin(φ + ωt) - sin φ, cos φ - cos(φ + ωt)] + c t.

Its reach towards an edge with unit normal n is the largest p(t)·n over one full turn. The
padding is the σ-quantile (risk = 1 - σ) of the worst reach of both sides over currents drawn
from the triangle's mean and spread and headings φ ± Δφ about the direction of travel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import shapely

from renew.checks import is_size
from renew.errors import ParameterError
from renew.geometry import segment_distance

if TYPE_CHECKING:
    from renew._types import FloatArray, IntArray
    from renew.channels import Channel, Move
    from renew.current import CurrentStatistics
    from renew.triangulation import Triangulation
    from renew.vessel import Vessel

Padding: TypeAlias = Literal["adaptive", "none"] | float

HEADING_SPREAD = math.radians(20)
"""Δφ: how far a route's heading may be off the line between the passing edges' midpoints (rad).
Larger values change little, since a turn reaches furthest when begun along the edge."""

LAYERS = 2
"""A path may bulge out of its channel by so many triangles."""

_DRAWS = 256


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

    def zone(self) -> shapely.Geometry:
        """V as one geometry: the union of the buffered edges."""
        padded = self.padding > 0
        if not padded.any():
            return shapely.MultiPolygon()
        lines = shapely.linestrings(np.stack([self.start, self.end], axis=1)[padded])
        return shapely.union_all(shapely.buffer(lines, self.padding[padded], quad_segs=16))

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
    """Paddings on one triangulation, of whose triangles the current's statistics are given.

    What channels share is worked out once.
    """

    def __init__(
        self,
        triangulation: Triangulation,
        statistics: CurrentStatistics,
        vessel: Vessel,
        *,
        padding: Padding,
        clearance: float,
        risk: float,
        seed: int,
    ) -> None:
        self._triangulation, self._vessel = triangulation, vessel
        self._padding: Padding = padding
        self._clearance, self._risk = clearance, risk
        self._edges = triangulation.constrained_edges
        self._statistics = statistics
        rng = np.random.default_rng(seed)
        # The same draws for every triangle: its figures depend on itself alone.
        self._speed_draws, self._turn_draws = rng.standard_normal((2, _DRAWS))
        self._heading_draws = rng.uniform(-HEADING_SPREAD, HEADING_SPREAD, _DRAWS)
        lines = shapely.linestrings(self._edges) if len(self._edges) else np.array([], dtype=object)
        self._tree = shapely.STRtree(lines)
        self._known: dict[tuple[int, Move], tuple[IntArray, FloatArray]] = {}

    def hazards(self, channel: Channel, start: FloatArray, goal: FloatArray) -> Hazards:
        """Constrained edges next to a channel, each with the largest padding it needs there.

        Next to means: within the furthest reach of a turn, which takes in all that touch the
        channel by edge or vertex (the paper's rule) and those just beyond a narrow triangle. Edges
        that are near the triangles beside the channel only are padded by what those need, since a
        path may bulge into them; it is taken to cross them as it does the channel beside them.
        """
        middle = channel.midline(start, goal)
        moves = channel.moves
        own, beside = np.full((2, len(self._edges)), -1.0)
        row = channel.triangles.tolist()
        for triangle, place in self._triangulation.surroundings(row, LAYERS).items():
            key = (triangle, moves[place])
            if key not in self._known:
                self._known[key] = self._paddings(triangle, middle[place], middle[place + 1])
            edges, needed = self._known[key]
            padding = own if triangle == row[place] else beside
            padding[edges] = np.maximum(padding[edges], needed)
        padding = np.where(own >= 0, own, beside)
        chosen = np.flatnonzero(padding >= 0)
        return Hazards(self._edges[chosen, 0], self._edges[chosen, 1], padding[chosen], chosen)

    def _paddings(
        self, triangle: int, enter: FloatArray, leave: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Constrained edges next to a triangle, and the padding (m) each needs from it."""
        furthest = max(self._furthest_padding(triangle), self._clearance)
        polygon = shapely.polygons(self._triangulation.corners[triangle])
        edges = np.sort(self._tree.query(polygon, predicate="dwithin", distance=furthest))
        if self._padding != "adaptive":
            return edges, np.full(len(edges), furthest)
        needed = self._adaptive(triangle, self._edges[edges], enter, leave)
        return edges, np.maximum(needed, self._clearance)

    def _furthest_padding(self, triangle: int) -> float:
        """Upper bound on the padding that any edge needs from a triangle (m)."""
        if self._padding == "adaptive":
            return self._furthest_reach(triangle)
        return 0.0 if self._padding == "none" else float(self._padding)

    def _furthest_reach(self, triangle: int) -> float:
        """Upper bound on any turn's reach in a triangle's current (m)."""
        speed = self._statistics.speed[triangle] + 4 * self._statistics.speed_std[triangle]
        return float(2 * self._vessel.turning_radius + speed * self._vessel.turn_period)

    def _adaptive(
        self, triangle: int, edges: FloatArray, enter: FloatArray, leave: FloatArray
    ) -> FloatArray:
        """σ-quantile (e,) of the worst reach from a triangle towards edges (e, 2, 2), metres."""
        travel = leave - enter
        heading = np.arctan2(travel[1], travel[0]) + self._heading_draws
        s = self._statistics
        speed = np.maximum(0.0, s.speed[triangle] + s.speed_std[triangle] * self._speed_draws)
        towards = s.direction[triangle] + s.direction_std[triangle] * self._turn_draws
        current = speed[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=-1)
        normal = _normals(edges, (enter + leave) / 2)
        reach = turn_reach(self._vessel, heading, current, normal[:, None])
        return np.asarray(np.quantile(reach, 1 - self._risk, axis=1, method="higher"))


def _normals(edges: FloatArray, from_point: FloatArray) -> FloatArray:
    """Unit normals (e, 2) of edges (e, 2, 2), on the side that points away from a point."""
    along = edges[:, 1] - edges[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = ((edges[:, 0] - from_point) * normal).sum(-1)
    return np.where(away[:, None] < 0, -normal, normal)
