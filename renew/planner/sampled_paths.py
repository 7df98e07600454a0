"""Find paths of a class by the paper's sampling; the harmonic mean of their fuel ranks classes.

The published figures are of smoothed paths, and hardly any raw chain can be steered. So each chain
is smoothed by shortcuts before it is checked and counted in the harmonic mean. A shortcut keeps the
chain's class: it crosses the rays of the islands (see :mod:`renew.classes.h_signature`) like the
part of the chain that it replaces.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.h_signature import Rays
from renew.classes.k_best_paths import RayColumns, appended, no_words
from renew.errors import InfeasibleError
from renew.kernels.capsules import Capsules, Segment, capsule_bounds, leg_is_clear
from renew.kernels.current_table import CurrentTable, mean_metre, velocity
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import slowness
from renew.paths.corridor import Corridor
from renew.planner.problem import MUCH_MORE
from renew.results import Route
from renew.steering.trajectory import steerable
from renew.voyage.voyage import Voyage

# Number of pieces into which a path is cut in each round; shortcuts connect their ends.
_PIECES = 60
# Number of rounds.
_ROUNDS = 4
# Number of pieces of a chain among hundreds, which gets one round.
_CHAIN_PIECES = 8
# Legs are timed in pieces of at most this share of the whole path, at two points in each.
_TIMED = 1 / 10
# Places of the two Gauss-Legendre points in a piece, as shares of its length.
_GAUSS = (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12))

# Number of columns by which the capsules near a leg are found.
_COLUMNS = 64


class _Water(NamedTuple):
    """The current that times legs, the capsules that legs avoid, and the rays that define classes.

    The chart is cut into columns of even width, `per_metre` of them a metre, from `west` (m) on.
    Column k meets the capsules member[first[k] : first[k + 1]]. `exempt[i, j]` (c,) says which
    capsules a leg may meet: i is 1 for a path's first leg, j is 1 for its last. Paths begin at
    `departure`, s.
    """

    table: CurrentTable
    departure: float
    polar: Polar
    capsules: Capsules
    first: IntArray
    member: IntArray
    west: float
    per_metre: float
    exempt: BoolArray
    rays: RayColumns


def with_shortcuts(corridor: Corridor, rays: Rays, path: FloatArray) -> FloatArray:
    """Return the fastest path (m, 2) along straight legs between places on a path, clear of V."""
    time, path = _shortened(path, _PIECES, _ROUNDS, _water(corridor, rays))
    if not math.isfinite(time):
        raise InfeasibleError("no legs between places on its path are clear of V")
    return path


def each_shortened(
    corridor: Corridor, rays: Rays, chains: FloatArray
) -> tuple[list[FloatArray], FloatArray]:
    """Smooth chains (c, n, 2) by shortcuts between their places; omit those without a clear way.

    Returns paths (n, 2), m, and their times (p,), s. A chain may itself cross V if a shortcut
    avoids that leg.
    """
    water = _water(corridor, rays)
    found = [_shortened(chain, _CHAIN_PIECES, 1, water) for chain in chains]
    found = [(time, path) for time, path in found if math.isfinite(time)]
    return [path for _, path in found], np.array([time for time, _ in found])


def _water(corridor: Corridor, rays: Rays) -> _Water:
    """Return the water of a corridor, with the rays that define classes."""
    capsules = corridor.search_capsules
    west, _, east, _ = corridor.voyage.chart.bounds
    per_metre = _COLUMNS / (east - west)
    sides = (capsule_bounds(capsules)[:, ::2] - west) * per_metre
    low, high = np.clip(np.floor(sides).astype(np.int64), 0, _COLUMNS - 1).T
    column = np.concatenate([np.empty(0, dtype=np.int64), *map(np.arange, low, high + 1)])
    order = np.argsort(column, kind="stable")
    from_start, to_goal = corridor.exempt
    return _Water(
        corridor.voyage.table,
        corridor.voyage.departure,
        corridor.polar,
        capsules,
        np.searchsorted(column[order], np.arange(_COLUMNS + 1)),
        np.repeat(np.arange(len(low)), high + 1 - low)[order],
        west,
        per_metre,
        np.array(
            [[np.zeros_like(to_goal), to_goal], [from_start, from_start | to_goal]], dtype=np.bool_
        ),
        RayColumns(rays.x, rays.y, rays.island),
    )


@kernel
def _shortened(
    path: FloatArray, pieces: int, rounds: int, water: _Water
) -> tuple[float, FloatArray]:
    """Return duration (s) and fastest path (m, 2) between places on a path; inf if none is clear.

    In each round the path is cut evenly into about `pieces` pieces.
    """
    time = math.inf
    for _ in range(rounds):
        points = _cut(path, pieces)
        time, row = _quickest(points, water)
        if time == math.inf:
            break
        path = points[row]
    return time, path


@kernel
def _cut(path: FloatArray, count: int) -> FloatArray:
    """Return a path (m, 2) with points added evenly."""
    legs = len(path) - 1
    whole = _length(path)
    pieces = np.empty(legs, dtype=np.int64)
    for k in range(legs):
        length = math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        pieces[k] = max(1, math.ceil(length / whole * count))
    points = np.empty((pieces.sum() + 1, 2))
    at = 0
    for k in range(legs):
        for piece in range(pieces[k]):
            points[at] = path[k] + piece / pieces[k] * (path[k + 1] - path[k])
            at += 1
    points[at] = path[legs]
    return points


@kernel
def _length(path: FloatArray) -> float:
    """Return the length of a path (n, 2), m."""
    length = 0.0
    for k in range(len(path) - 1):
        length += math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
    return length


@kernel
def _leg_time(leg: Segment, begin: float, longest: float, water: _Water) -> float:
    """Return the time (s) over a straight leg by Eq. 4, in pieces of up to `longest` m, or inf.

    The leg begins at the time `begin` of the table's clock, s.
    """
    dx, dy = leg.bx - leg.ax, leg.by - leg.ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0
    pieces = math.ceil(length / longest)
    metres = length * mean_metre(water.table, leg.ax, leg.ay, leg.bx, leg.by)
    total, last, behind = 0.0, 1.0 / water.polar.speed, 0.0
    for piece in range(pieces):
        for within in _GAUSS:
            place = (piece + within) / pieces
            # Time to this point, at the slowness of the point before.
            begin += last * (place - behind) * metres
            u, v = velocity(water.table, leg.ax + place * dx, leg.ay + place * dy, begin)
            last, behind = slowness(u, v, dx / length, dy / length, water.polar), place
            total += last
    return total * metres / (2 * pieces)


@kernel
def _quickest(points: FloatArray, water: _Water) -> tuple[float, IntArray]:
    """Return duration (s) and points (m,) of the fastest clear way along points (n, 2).

    The first leg may leave capsules, and the last leg may enter them.
    """
    last, words = len(points) - 1, no_words()
    word = np.zeros(last + 1, dtype=np.int64)
    arrival, before = np.full(last + 1, np.inf), np.zeros(last + 1, dtype=np.int64)
    arrival[0] = 0.0
    total, longest = np.empty(last + 1), _TIMED * _length(points)
    for new in range(1, last + 1):
        (ax, ay), (bx, by) = points[new - 1], points[new]
        word[new] = appended(water.rays, words, word[new - 1], Segment(ax, ay, bx, by))
        for old in range(new):
            leg = Segment(points[old, 0], points[old, 1], bx, by)
            total[old] = arrival[old]
            if arrival[old] < np.inf:
                total[old] += _leg_time(leg, water.departure + arrival[old], longest, water)
        while True:
            old = int(np.argmin(total[:new]))
            if total[old] == np.inf:
                break
            leg = Segment(points[old, 0], points[old, 1], bx, by)
            same_class = appended(water.rays, words, word[old], leg) == word[new]
            if same_class and _is_clear(leg, water, is_first=old == 0, is_last=new == last):
                arrival[new], before[new] = total[old], old
                break
            total[old] = np.inf
    row = [last]
    while row[-1] > 0:
        row.append(before[row[-1]])
    return arrival[last], np.array(row[::-1], dtype=np.int64)


@kernel
def _is_clear(leg: Segment, water: _Water, is_first: bool, is_last: bool) -> bool:
    """Whether a leg stays out of V; the first leg may leave V, and the last may enter V."""
    exempt = water.exempt[int(is_first), int(is_last)]
    low, high = _column(min(leg.ax, leg.bx), water), _column(max(leg.ax, leg.bx), water)
    for k in range(low, high + 1):
        near = water.member[water.first[k] : water.first[k + 1]]
        if not leg_is_clear(leg, water.capsules, near, exempt):
            return False
    return True


@kernel
def _column(x: float, water: _Water) -> int:
    """Return the column of an x, m; the outermost ones reach on."""
    return min(max(math.floor((x - water.west) * water.per_metre), 0), _COLUMNS - 1)


def harmonic_mean(fuels: FloatArray) -> float:
    """Return the harmonic mean of the fuel of some paths (n,)."""
    return float(len(fuels) / (1 / fuels).sum())


# Metres of voyage that a metre without room for a hard-over turn counts as: with 10, the way into
# Drammen would be 4 % longer than the pilots' reference route.
_NARROW = 5.0


def chosen_class(routes: Sequence[Route]) -> int:
    """Return the index of the route whose class has the least harmonic mean (h* of the paper).

    The optimal method has one path per class, whose fuel is the harmonic mean. So it chooses the
    least-fuel route. Where the water is narrow, routes that need much more are left out, then those
    with a greater shortfall at their tightest place, by more than the step in which it is measured.
    Of the others, stretches without room count by their length: routes that leave one quay lack
    about as much room there, and a little less of it is not worth a long way.
    """
    every = range(len(routes))
    most = MUCH_MORE * min(route.harmonic_mean for route in routes)
    near = [at for at in every if routes[at].harmonic_mean <= most]
    least = min(routes[at].lacking[0] for at in near)
    near = [at for at in near if routes[at].lacking[0] <= least + (least > 0)]

    def counted(at: int) -> float:
        share = routes[at].lacking[1] / routes[at].length if least else 0.0
        return routes[at].harmonic_mean * (1 + _NARROW * share)

    return min(near, key=counted)


# Number of sampled chains, least fuel first, that are tried for steering.
_MAX_CHAINS = 60
# Number of these that are smoothed further.
_MAX_SMOOTHED = 4


def sampled_paths(
    corridor: Corridor, rays: Rays, samples: int, seed: int
) -> tuple[Iterable[FloatArray], float]:
    """Return paths (n, 2) of a class, the best first, and the harmonic mean of their fuel.

    Raises InfeasibleError if no sample can be sailed.
    """
    voyage = corridor.voyage
    rng = np.random.default_rng([seed, *corridor.channel.triangles.tolist()])
    paths, times = each_shortened(corridor, rays, random_chains(corridor, samples, rng))
    if not paths:
        raise InfeasibleError(
            f"each of {samples} sampled chains crosses the soft no-go zone, or water whose current "
            "is as fast as the vessel"
        )
    chosen = np.flatnonzero(_are_steerable(paths, voyage))
    if not len(chosen):
        raise InfeasibleError(
            f"none of {samples} sampled chains can be steered at a turn rate of "
            f"{math.degrees(voyage.vessel.turn_rate):g} degrees a second; method='optimal' may"
        )
    best = [paths[i] for i in chosen[np.argsort(times[chosen])[:_MAX_CHAINS]]]
    smooth = [with_shortcuts(corridor, rays, path) for path in best[:_MAX_SMOOTHED]]
    class_mean = harmonic_mean(voyage.vessel.fuel_rate * times[chosen])
    return (*sorted(smooth, key=voyage.fuel), *best), class_mean


def _are_steerable(paths: Sequence[FloatArray], voyage: Voyage) -> BoolArray:
    """Return which paths (n, 2) can be steered; paths of equal length are checked together."""
    points = np.array([len(path) for path in paths])
    result = np.zeros(len(paths), dtype=bool)
    for count in np.unique(points):
        alike = np.flatnonzero(points == count)
        stacked = np.stack([paths[i] for i in alike.tolist()])
        times = np.stack([voyage.reading_times(paths[i])[1:-1] for i in alike.tolist()])
        result[alike] = steerable(stacked, voyage.current, voyage.vessel, times)
    return result


def random_chains(corridor: Corridor, samples: int, rng: np.random.Generator) -> FloatArray:
    """Return random chains (samples, n, 2) through the free part of each passing edge.

    The paper samples whole passing edges and rejects points in V. Sampling the free part gives the
    same distribution sooner. Legs between the points may cross V.
    """
    passing_edges, free = corridor.open_sections(math.inf, math.inf)
    chains = np.empty((samples, len(passing_edges.left) + 2, 2))
    chains[:, 0], chains[:, -1] = corridor.voyage.start, corridor.voyage.goal
    chains[:, 1:-1] = passing_edges.points(free.draw(samples, rng)).swapaxes(0, 1)
    return chains
