"""An independent oracle for currents that change: Dijkstra's algorithm with the clock running.

Labels are arrival times on a dense grid with a wide stencil; an edge is sailed from the time at
which its first node is reached, by this module's own rule. Where nobody who leaves later arrives
earlier (FIFO) the label that is settled is the earliest arrival along edges. As in
:mod:`tests.oracles`, whose edges it takes, the fuel is that of a real path and never too low, and
`tighten` removes most of what an edge's course costs.
"""

import itertools
import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.sparse import csr_array

import renew
from renew._types import BoolArray, FloatArray, IntArray
from tests.oracles import _transversals, _Water, grid_graph

# Number of pieces of an edge, and of a leg between transversals or along a path.
_EDGE_PIECES, _LEG_PIECES, _PATH_PIECES = 4, 3, 24


IsShut: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], BoolArray]
"""Says of legs from a to b (n, 2), m, begun and ended at times (n,), s, which are shut."""


def _never(*legs: FloatArray) -> BoolArray:
    """No leg is ever shut."""
    return np.zeros(len(legs[0]), dtype=bool)


def earliest_arrival(
    chart: renew.Chart,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    start: FloatArray,
    goal: FloatArray,
    departure: float,
    *,
    spacing: float,
    clearance: float = 0.0,
    drift: str = "projected",
    radius: int = 7,
    is_shut: IsShut = _never,
) -> tuple[float, FloatArray]:
    """Least fuel from start to goal over a grid's edges, and the path (n, 2) in metres."""
    points, graph = grid_graph(
        chart, _still, vessel, start, goal, spacing, clearance, drift, radius=radius
    )
    graph = graph.tocsr()
    first, last = len(points) - 2, len(points) - 1
    arrival = np.full(len(points), np.inf)
    came_from = np.full(len(points), -1)
    arrival[first] = departure
    settled = np.zeros(len(points), dtype=bool)
    settled[last] = True  # nothing goes on from there
    # No edge of the grid takes less than its time in still water at twice the speed: nodes that are
    # reached within that time of each other can't improve each other, and are settled at once.
    inner = graph[:first, :first].data
    together = float(inner.min()) / 2 if inner.size else math.inf
    while (now := np.where(settled, np.inf, arrival).min()) < arrival[last]:
        nodes = (
            np.flatnonzero(~settled & (arrival <= now + together)) if settled[first] else [first]
        )
        settled[nodes] = True
        tails, heads = _edges(graph, np.asarray(nodes))
        usable = ~settled[heads] | (heads == last)
        tails, heads = tails[usable], heads[usable]
        legs = points[tails], points[heads], arrival[tails]
        found = sailed(*legs, current, vessel, drift, _EDGE_PIECES)
        found[is_shut(*legs, found)] = np.inf
        better = np.flatnonzero(found < arrival[heads])
        better = better[np.argsort(-found[better])]  # of those to one node the best is put last
        arrival[heads[better]] = found[better]
        came_from[heads[better]] = tails[better]
    if not math.isfinite(arrival[last]):
        return math.inf, np.empty((0, 2))
    row = [last]
    while row[-1] != first:
        row.append(int(came_from[row[-1]]))
    return float(vessel.fuel_rate * (arrival[last] - departure)), points[row[::-1]]


def _edges(graph: csr_array, nodes: IntArray) -> tuple[IntArray, IntArray]:
    """First and last nodes (m,) of the edges from nodes (n,)."""
    counts = np.diff(graph.indptr)[nodes]
    before = np.repeat(graph.indptr[nodes] - (np.cumsum(counts) - counts), counts)
    return np.repeat(nodes, counts), graph.indices[before + np.arange(counts.sum())]


def tighten(
    path: FloatArray,
    chart: renew.Chart,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    departure: float,
    *,
    clearance: float = 0.0,
    drift: str = "projected",
    spacing: float = 3.0,
    width: float = 6.0,
    rounds: int = 7,
    is_shut: IsShut = _never,
) -> tuple[float, FloatArray]:
    """Improve a path locally: its fuel, and the path (n, 2); never worse than the given one."""
    water = _Water.of(chart, clearance)
    best = path
    least = duration(path, current, vessel, departure, drift)
    for _ in range(rounds):
        places = _transversals(best, spacing, width)
        rows, count = places.shape[:2]
        arrival = np.where(np.arange(count) == 0, departure, np.inf)
        came_from = []
        for here, there in itertools.pairwise(places):
            a = np.repeat(here, count, axis=0)
            b = np.tile(there, (count, 1))
            begin = np.repeat(arrival, count)
            reached = np.isfinite(begin)
            total = np.full(len(a), np.inf)
            total[reached] = sailed(
                a[reached], b[reached], begin[reached], current, vessel, drift, _LEG_PIECES
            )
            total[~water.legs_clear(a, b)] = np.inf
            total[is_shut(a, b, begin, total)] = np.inf
            layer = total.reshape(count, count)
            came_from.append(layer.argmin(axis=0))
            arrival = layer.min(axis=0)
        chain = [int(arrival.argmin())]
        for previous in reversed(came_from):
            chain.append(int(previous[chain[-1]]))
        found = places[np.arange(rows), chain[::-1]]
        taken = duration(found, current, vessel, departure, drift)
        if taken < least:
            best, least = found, taken
        width /= 2
    return float(vessel.fuel_rate * least), best


def duration(
    path: FloatArray,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    departure: float,
    drift: str = "projected",
) -> float:
    """Time (s) along a path (n, 2) with the clock running."""
    now = np.array([departure])
    for a, b in itertools.pairwise(path):
        now = sailed(a[None], b[None], now, current, vessel, drift, _PATH_PIECES)
    return float(now[0] - departure)


def sailed(
    a: FloatArray,
    b: FloatArray,
    begin: FloatArray,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    drift: str,
    pieces: int,
    speeds: FloatArray | None = None,
) -> FloatArray:
    """Arrival times (n,), s, over straight legs a -> b (n, 2) begun at times (n,); inf if shut.

    The midpoint rule: half of each piece at the speed of its beginning finds the time in its middle
    at which the current counts for all of it. Water whose current is as strong as the vessel is
    no-go. The legs are sailed at `speeds` (n,), m/s, through water: the vessel's, if not given.
    """
    through = np.full(len(a), vessel.speed) if speeds is None else speeds
    leg = b - a
    length = np.hypot(leg[:, 0], leg[:, 1])
    unit = leg / np.where(length > 0, length, 1.0)[:, None]
    piece, now = length / pieces, begin.astype(float)
    for k in range(pieces):
        finite = np.where(np.isfinite(now), now, 0.0)
        rest = unit, through, current, vessel, drift
        first = _slowness(a + k / pieces * leg, finite, *rest)
        middle = np.where(np.isfinite(first), finite + piece / 2 * first, finite)
        slow = _slowness(a + (k + 0.5) / pieces * leg, middle, *rest)
        slow[first == np.inf] = np.inf
        now = now + np.where(length > 0, piece * slow, 0.0)
    return now


def _slowness(
    points: FloatArray,
    times: FloatArray,
    unit: FloatArray,
    through: FloatArray,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    drift: str,
) -> FloatArray:
    """Seconds a metre (n,) along unit vectors (n, 2), at speeds through water (n,)."""
    velocity = current.velocity(points, times)
    along = (velocity * unit).sum(axis=1)
    square = (velocity * velocity).sum(axis=1)
    across = square - along**2 if drift == "crab" else 0.0
    speed = along + np.sqrt(np.maximum(through**2 - across, 0.0))
    passable = (square < vessel.speed**2) & (through**2 >= across) & (speed > 0)
    return np.where(passable, 1 / np.where(passable, speed, 1.0), np.inf)


def _still(points: FloatArray) -> FloatArray:
    """No current: edges are chosen by land alone."""
    return np.zeros_like(points)
