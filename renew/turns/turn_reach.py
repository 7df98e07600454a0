"""How far a hard-over turn carries the vessel towards an edge.

A turn at rate ω in a current c, begun with heading φ, follows (paper, best effort τ)

    p(t) = v/ω [sin(φ + ωt) - sin φ, cos φ - cos(φ + ωt)] + c t.

Its reach towards an edge with unit normal n is the largest p(t)·n over one full turn. With θ the
heading and ψ the normal's direction, d/dt p·n = v cos(θ - ψ) + c·n. For a turn to port it falls
through zero at θ = ψ + arccos(-c·n / v), the one maximum inside the turn; at its ends p·n is 0 and
c·n 2π/ω. A turn to starboard is the mirror image.

In a current that is known by its mean and spread, padding takes the σ-quantile of the reach. The
draws are those of the paper: speed and direction of the current about their means, the heading at
which a turn begins about the course. `TurnReach` bounds the reach of any turn from above.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, reading_kernel
from renew._types import FloatArray, IntArray
from renew.inputs.chart_and_vessel import Vessel
from renew.inputs.current import CurrentStatistics
from renew.kernels.current_table import CurrentTable, same_axes, weakest_and_strongest

HEADING_SPREAD = math.radians(20)
"""Δφ: how far a route's heading may be off the line between the passing edges' midpoints (rad).
Larger values change little, since a turn reaches furthest when begun along the edge."""

MAX_DEVIATIONS = 2.0
"""Largest deviation from the field of currents in which turns are simulated, standard deviations:
95 % of a normal spread lie within it, as the default risk of 5 % asks for."""

# Approximate number of draws that exceed the quantile.
_TAIL_DRAWS = 20.0
# Least number of draws.
_MIN_DRAWS = 512
# Largest number of draws.
_MAX_DRAWS = 20_000
# Number of draws if a risk would need more than _MAX_DRAWS: these are stretched.
_STRETCHED_DRAWS = 4096
# Approximate share of the stretched draws that exceeds the quantile.
_STRETCHED_SHARE = 0.02
# Share of the risk at which the quantile is taken: the rest covers the error of the draws.
_SAFETY = 0.85
# Largest number of turns that are held in memory at a time: 160 MB.
_MAX_TURNS = 4_000_000


class TurnStarts(NamedTuple):
    """Turns (n,) that begin: heading (rad), its cosine and sine, and the current u, v (m/s).

    All are at one speed through water (m/s) and one rate (rad/s).
    """

    heading: FloatArray
    cos: FloatArray
    sin: FloatArray
    u: FloatArray
    v: FloatArray
    speed: float
    turn_rate: float


@reading_kernel
def reach_along(normal: FloatArray, turns: TurnStarts, reach: FloatArray) -> None:
    """Fill in the reach (n,), m, of turns along a unit normal (2,): the worse of both sides."""
    nx, ny = normal
    bearing = math.atan2(ny, nx)
    heading, cos, sin, u, v, speed, turn_rate = turns
    radius, period = speed / turn_rate, 2 * math.pi / turn_rate
    for k in range(len(reach)):
        drift = u[k] * nx + v[k] * ny
        ratio = min(max(-drift / speed, -1.0), 1.0)
        turned_to = math.acos(ratio)
        furthest = math.sqrt(1.0 - ratio * ratio)
        begin = heading[k] - bearing
        sine = sin[k] * nx - cos[k] * ny
        port, starboard = turned_to - begin, turned_to + begin
        port -= 2 * math.pi * math.floor(port / (2 * math.pi))
        starboard -= 2 * math.pi * math.floor(starboard / (2 * math.pi))
        reach[k] = max(
            radius * (furthest - sine) + drift * port / turn_rate,
            radius * (furthest + sine) + drift * starboard / turn_rate,
            drift * period,
            0.0,
        )


def turn_reach(
    vessel: Vessel, heading: FloatArray, current: FloatArray, normal: FloatArray
) -> FloatArray:
    """Return the reach (...), m, of hard-over turns along normals, the worse of both sides.

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
    """
    shape = np.broadcast_shapes(heading.shape, current.shape[:-1], normal.shape[:-1])
    headings = np.broadcast_to(heading, shape).reshape(-1, 1)
    currents = np.broadcast_to(current, (*shape, 2)).reshape(-1, 2, 1)
    normals = np.broadcast_to(normal, (*shape, 2)).reshape(-1, 2)
    reach = np.empty((len(normals), 1))
    for at, towards in enumerate(normals):
        phi, (u, v) = headings[at], currents[at]
        turn = TurnStarts(phi, np.cos(phi), np.sin(phi), u, v, vessel.speed, vessel.turn_rate)
        reach_along(towards, turn, reach[at])
    return reach.reshape(shape)


def normals_away(edges: FloatArray, points: FloatArray) -> FloatArray:
    """Return unit normals (e, 2) of edges (e, 2, 2), each pointing away from one of the points."""
    along = edges[:, 1] - edges[:, 0]
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = ((edges[:, 0] - points) * normal).sum(-1)
    return np.where(away[:, None] < 0, -normal, normal)


class TurnsAtEdges(NamedTuple):
    """Turns of a vessel towards edges.

    Turn p begins in the current `row[p]` of some (t,), on the course (t,) rad there, and its reach
    is taken along the unit normal p of `normals` (p, 2), m.
    """

    statistics: CurrentStatistics
    course: FloatArray
    row: IntArray
    normals: FloatArray
    vessel: Vessel


def furthest_reach(statistics: CurrentStatistics, vessel: Vessel) -> FloatArray:
    """Return bound (n,), m, on the reach of drawn turns in currents (n,), up to four deviations."""
    speed = statistics.speed + 4 * statistics.speed_std
    return np.asarray(2 * vessel.turning_radius + speed * vessel.turn_period)


class TurnSampler:
    """Drawn turns, the same for every place, so that a place's figures depend on itself alone.

    With a `stretch` above 1 speeds and directions deviate by that factor more than they should, and
    draws have weights that make up for it (importance sampling): few draws reach far into the tail.
    """

    def __init__(self, seed: int, count: int, stretch: float = 1.0) -> None:
        from scipy.special import ndtri

        speed, turn, heading = _even_draws(seed, count)
        self.count = count
        self._speed, self._turn = stretch * ndtri(speed), stretch * ndtri(turn)
        self._heading = HEADING_SPREAD * (2 * heading - 1)
        square = self._speed**2 + self._turn**2
        self._weight = stretch**2 * np.exp(-square / 2 * (1 - 1 / stretch**2))
        self._is_stretched = stretch > 1

    @classmethod
    def for_risk(cls, seed: int, risk: float) -> "TurnSampler":
        """Return a sampler whose quantiles at that risk are near enough."""
        count = math.ceil(_TAIL_DRAWS / risk)
        if count <= _MAX_DRAWS:
            return cls(seed, max(_MIN_DRAWS, count))
        from scipy.special import ndtri

        return cls(seed, _STRETCHED_DRAWS, float(ndtri(risk) / ndtri(_STRETCHED_SHARE)))

    def reaches(self, asked: TurnsAtEdges) -> FloatArray:
        """Return the reach (p, draws) of turns towards edges, m, the worse of both sides."""
        turns = self._turns(asked.statistics, asked.course, asked.vessel)
        return np.asarray(_reaches(asked.row, asked.normals, turns))

    def quantile(self, asked: TurnsAtEdges, risk: float) -> FloatArray:
        """Return reach (p,), m, that no more than a share `risk` of turns exceed, on the safe side.

        The rows ascend.
        """
        rows = max(1, _MAX_TURNS // self.count)
        parts = [
            self._quantile(asked, risk, slice(at, at + rows))
            for at in range(0, len(asked.course), rows)
        ]
        return np.concatenate(parts) if parts else np.zeros(0)

    def upper_quantile(self, values: FloatArray, risk: float) -> FloatArray:
        """Return values (n,) that a share `risk` of draws (n, draws) exceeds, on the safe side."""
        order = np.argsort(-values, axis=1)
        beyond = np.cumsum(self._weight[order] / self.count, axis=1)
        at = np.minimum((beyond <= _SAFETY * risk).sum(axis=1), self.count - 1)
        return np.asarray(np.take_along_axis(values, order, axis=1)[np.arange(len(at)), at])

    def _quantile(self, asked: TurnsAtEdges, risk: float, rows: slice) -> FloatArray:
        """Return quantiles for some of the rows."""
        statistics, course, row, normals, vessel = asked
        some = CurrentStatistics(*(figures[rows] for figures in statistics))
        turns = self._turns(some, course[rows], vessel)
        first, last = np.searchsorted(row, (rows.start, rows.stop))
        own, towards = row[first:last] - rows.start, normals[first:last]
        beyond = _SAFETY * risk
        if self._is_stretched:
            weight = self._weight / self.count
            return np.asarray(_weighted_quantile(own, towards, turns, weight, beyond))
        exceeding = math.floor((self.count - 1) * beyond)
        return np.asarray(_quantile(own, towards, turns, exceeding))

    def _turns(
        self, statistics: CurrentStatistics, course: FloatArray, vessel: Vessel
    ) -> TurnStarts:
        """Return turns (t, draws) in draws of currents (t,), with headings about courses (t,)."""
        s = statistics
        heading = course[:, None] + self._heading
        speed = np.maximum(0.0, s.speed[:, None] + s.speed_std[:, None] * self._speed)
        towards = s.direction[:, None] + s.direction_std[:, None] * self._turn
        return TurnStarts(
            heading,
            np.cos(heading),
            np.sin(heading),
            speed * np.cos(towards),
            speed * np.sin(towards),
            vessel.speed,
            vessel.turn_rate,
        )


def _even_draws(seed: int, count: int) -> FloatArray:
    """Return draws (3, count), evenly in the unit cube: Hammersley's points, shifted by the seed.

    Their quantiles are off by 1.3 %, and quantiles of random draws by 2.6 % (512 draws, risk 5 %).
    Sobol's scrambled sequence is no better, and takes SciPy half a second to import.
    """
    index = np.arange(count)
    draws = np.stack([index / count, _radical_inverse(index, 2), _radical_inverse(index, 3)])
    draws = (draws + np.random.default_rng(seed).random((3, 1))) % 1.0
    # Neither 0 nor 1, where a normal draw would be infinite.
    return np.asarray((draws * (count - 1) + 0.5) / count)


def _radical_inverse(index: IntArray, base: int) -> FloatArray:
    """Mirror whole numbers (n,) at the point: 6, 110 in base 2, is 0.011 (van der Corput)."""
    mirrored = np.zeros(len(index))
    worth = 1.0 / base
    while index.any():
        mirrored += worth * (index % base)
        index, worth = index // base, worth / base
    return mirrored


@kernel
def _turns_in(turns: TurnStarts, row: int) -> TurnStarts:
    """Return turns (draws,) that begin in one current of several (t, draws)."""
    heading, cos, sin, u, v, speed, turn_rate = turns
    return TurnStarts(heading[row], cos[row], sin[row], u[row], v[row], speed, turn_rate)


@kernel
def _reaches(row: IntArray, normals: FloatArray, turns: TurnStarts) -> FloatArray:
    """Return the reach (p, draws) along normals (p, 2), each in the draws of one row, m."""
    reach = np.empty((len(row), turns.heading.shape[1]))
    for p in range(len(row)):
        reach_along(normals[p], _turns_in(turns, row[p]), reach[p])
    return reach


@kernel
def _quantile(row: IntArray, normals: FloatArray, turns: TurnStarts, exceeding: int) -> FloatArray:
    """Return the reach (p,) that a number of draws exceed: the largest after `exceeding` others."""
    found = np.empty(len(row))
    reach = np.empty(turns.heading.shape[1])
    largest = np.empty(exceeding + 1)
    for p in range(len(row)):
        reach_along(normals[p], _turns_in(turns, row[p]), reach)
        # The largest so far, in a heap: none is below its parent, the one half as far along.
        largest[:] = -1.0
        for one in reach:
            if not one > largest[0]:
                continue
            place, child = 0, 1
            while child <= exceeding:
                if child < exceeding and largest[child + 1] < largest[child]:
                    child += 1
                if one <= largest[child]:
                    break
                largest[place] = largest[child]
                place, child = child, 2 * child + 1
            largest[place] = one
        found[p] = largest[0]
    return found


@kernel
def _weighted_quantile(
    row: IntArray,
    normals: FloatArray,
    turns: TurnStarts,
    weight: FloatArray,
    risk: float,
) -> FloatArray:
    """Return the reach (p,) that draws with a weight (draws,) of at most `risk` together exceed."""
    found = np.empty(len(row))
    reach = np.empty(turns.heading.shape[1])
    for p in range(len(row)):
        reach_along(normals[p], _turns_in(turns, row[p]), reach)
        order = np.argsort(-reach)
        beyond, at = weight[order[0]], 0
        while beyond <= risk and at < len(order) - 1:
            at += 1
            beyond += weight[order[at]]
        found[p] = reach[order[at]]
    return found


@dataclass(frozen=True, slots=True)
class TurnReach:
    """Furthest reach (ny, nx) in metres of turns from near the nodes x (nx,) and y (ny,).

    `others` are the reaches in other currents, on nodes of their own.
    """

    x: FloatArray
    y: FloatArray
    furthest: FloatArray
    others: "tuple[TurnReach, ...]" = ()

    @classmethod
    def of(cls, table: CurrentTable, vessel: Vessel) -> "TurnReach":
        """Return bounds from the strongest current that a turn can meet, at any time.

        A turn is 2 v/ω wide in still water, and is carried by the drift of one period. Speeds
        between 0 and m have a standard deviation of at most m / 2, so that a perturbed current is
        slower than (1 + deviations / 2) m.
        """
        from scipy.ndimage import maximum_filter

        drift = (1 + MAX_DEVIATIONS / 2) * vessel.turn_period
        wide = 2 * vessel.turning_radius
        _, speed = weakest_and_strongest(table)
        # Distance within which a turn meets its strongest current; one node more for safety.
        sight = wide + drift * float(speed.max())
        size = [
            2 * min(int(np.ceil(sight / np.diff(axis).min())) + 1, len(axis)) + 1
            for axis in (table.y, table.x)
        ]
        return cls(table.x, table.y, wide + drift * maximum_filter(speed, size, mode="nearest"))

    @classmethod
    def of_all(cls, tables: Sequence[CurrentTable], vessel: Vessel) -> "TurnReach":
        """Return bounds for turns in any of several currents."""
        alike = [same_axes(table, tables[0]) for table in tables]
        each = list(zip(alike, (cls.of(table, vessel) for table in tables), strict=True))
        furthest = np.max([one.furthest for is_alike, one in each if is_alike], axis=0)
        others = tuple(one for is_alike, one in each if not is_alike)
        return cls(tables[0].x, tables[0].y, furthest, others)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the bound (n,) in metres for turns that begin at points (n, 2)."""
        column = np.clip(np.searchsorted(self.x, points[:, 0]), 0, len(self.x) - 1)
        row = np.clip(np.searchsorted(self.y, points[:, 1]), 0, len(self.y) - 1)
        reaches = [self.furthest[row, column], *(other(points) for other in self.others)]
        return np.asarray(np.max(reaches, axis=0))
