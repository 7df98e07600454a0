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
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import shapely
from numba import njit
from scipy.special import ndtri

from renew.checks import is_size
from renew.errors import ParameterError
from renew.geometry import segment_distance

if TYPE_CHECKING:
    from renew._types import FloatArray, IntArray
    from renew.channels import Channel, Move
    from renew.current import CurrentField, CurrentStatistics
    from renew.triangulation import Triangulation
    from renew.vessel import Vessel

_Crossing: TypeAlias = "tuple[int, Move]"
"""A triangle, and the move of the channel in it or beside it."""

Padding: TypeAlias = Literal["adaptive", "none"] | float

HEADING_SPREAD = math.radians(20)
"""Δφ: how far a route's heading may be off the line between the passing edges' midpoints (rad).
Larger values change little, since a turn reaches furthest when begun along the edge."""

LAYERS = 2
"""A path may bulge out of its channel by so many triangles."""

# Draws that set a quantile: some at the least, and so many that this many lie beyond it. They lie
# evenly, so that their share beyond it is off by some 1/n rather than 1/√n.
_FEWEST_DRAWS, _BEYOND = 256, 12.8
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
        self._draws = max(_FEWEST_DRAWS, math.ceil(_BEYOND / risk))
        speed, turn, heading = _even_draws(seed, self._draws)
        self._speed_draws, self._turn_draws = ndtri(speed), ndtri(turn)
        self._heading_draws = HEADING_SPREAD * (2 * heading - 1)
        lines = shapely.linestrings(self._edges) if len(self._edges) else np.array([], dtype=object)
        self._tree = shapely.STRtree(lines)
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
        crossings = {(triangle, moves[place]): place for triangle, place in places.items()}
        self._learn(crossings, middle)
        own, beside = np.full((2, len(self._edges)), -1.0)
        for (triangle, move), place in crossings.items():
            edges, needed = self._known[triangle, move]
            padding = own if triangle == row[place] else beside
            padding[edges] = np.maximum(padding[edges], needed)
        padding = np.where(own >= 0, own, beside)
        chosen = np.flatnonzero(padding >= 0)
        return Hazards(self._edges[chosen, 0], self._edges[chosen, 1], padding[chosen], chosen)

    def _learn(self, crossings: dict[_Crossing, int], middle: FloatArray) -> None:
        """Work out the edges next to triangles, and their paddings, for crossings not yet known.

        A triangle is crossed from middle[place] to middle[place + 1].
        """
        new = [crossing for crossing in crossings if crossing not in self._known]
        if not new:
            return
        place = np.array([crossings[crossing] for crossing in new])
        corners = self._triangulation.corners[[triangle for triangle, _ in new]]
        statistics = self._current.statistics(corners)
        furthest = np.maximum(self._furthest_padding(statistics), self._clearance)
        row, edge = self._tree.query(
            shapely.polygons(corners), predicate="dwithin", distance=furthest
        )
        order = np.lexsort((edge, row))
        row, edge = row[order], edge[order]
        if self._padding == "adaptive":
            enter, leave = middle[place], middle[place + 1]
            needed = self._adaptive(statistics, row, self._edges[edge], enter, leave)
            needed = np.maximum(needed, self._clearance)
        else:
            needed = furthest[row]
        bounds = np.searchsorted(row, np.arange(len(new) + 1)).tolist()
        for crossing, (first, last) in zip(new, itertools.pairwise(bounds), strict=True):
            self._known[crossing] = edge[first:last], needed[first:last]

    def _furthest_padding(self, statistics: CurrentStatistics) -> FloatArray:
        """Upper bounds (n,) on the padding that any edge needs from triangles (m)."""
        if self._padding != "adaptive":
            width = 0.0 if self._padding == "none" else float(self._padding)
            return np.full(len(statistics.speed), width)
        speed = statistics.speed + 4 * statistics.speed_std
        return 2 * self._vessel.turning_radius + speed * self._vessel.turn_period

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
        heading = np.arctan2(travel[:, 1], travel[:, 0])[:, None] + self._heading_draws
        s = statistics
        speed = np.maximum(0.0, s.speed[:, None] + s.speed_std[:, None] * self._speed_draws)
        towards = s.direction[:, None] + s.direction_std[:, None] * self._turn_draws
        reach = _reaches(
            row,
            _normals(edges, ((enter + leave) / 2)[row]),
            heading,
            speed * np.cos(towards),
            speed * np.sin(towards),
            self._vessel.speed,
            self._vessel.turn_rate,
        )
        rank = math.ceil((self._draws - 1) * (1 - _SAFE * self._risk))
        return np.asarray(np.partition(reach, rank, axis=1)[:, rank])


def _even_draws(seed: int, count: int) -> FloatArray:
    """Draws (3, n), evenly in the unit cube: Roberts' additive sequence, shifted by the seed.

    Its steps are the powers of 1/φ, with φ the root of φ⁴ = φ + 1.
    """
    steps = 1.2207440846057596 ** -np.arange(1.0, 4.0)
    shift = np.random.default_rng(seed).random((3, 1))
    draws = (shift + steps[:, None] * np.arange(count)) % 1.0
    # Neither 0 nor 1, where a normal draw would be infinite.
    return np.asarray((draws * (count - 1) + 0.5) / count)


@njit(cache=True, error_model="numpy")
def _reaches(
    row: IntArray,
    normals: FloatArray,
    heading: FloatArray,
    u: FloatArray,
    v: FloatArray,
    speed: float,
    turn_rate: float,
) -> FloatArray:
    """Reach (p, draws) in the draws (t, draws) of a row each along normals (p, 2), m.

    :func:`turn_reach`, compiled.
    """
    cos, sin = np.cos(heading), np.sin(heading)
    draws = heading.shape[1]
    radius, period = speed / turn_rate, 2 * math.pi / turn_rate
    reach = np.empty((len(row), draws))
    for p in range(len(row)):
        t = row[p]
        nx, ny = normals[p]
        bearing = math.atan2(ny, nx)
        for k in range(draws):
            drift = u[t, k] * nx + v[t, k] * ny
            ratio = min(max(-drift / speed, -1.0), 1.0)
            turned_to = math.acos(ratio)
            furthest = math.sqrt(1.0 - ratio * ratio)
            begin = heading[t, k] - bearing
            sine = sin[t, k] * nx - cos[t, k] * ny
            port, starboard = turned_to - begin, turned_to + begin
            port -= 2 * math.pi * math.floor(port / (2 * math.pi))
            starboard -= 2 * math.pi * math.floor(starboard / (2 * math.pi))
            reach[p, k] = max(
                radius * (furthest - sine) + drift * port / turn_rate,
                radius * (furthest + sine) + drift * starboard / turn_rate,
                drift * period,
                0.0,
            )
    return reach


def _normals(edges: FloatArray, from_points: FloatArray) -> FloatArray:
    """Unit normals (e, 2) of edges (e, 2, 2), each on the side that points away from a point."""
    along = edges[:, 1] - edges[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = ((edges[:, 0] - from_points) * normal).sum(-1)
    return np.where(away[:, None] < 0, -normal, normal)
