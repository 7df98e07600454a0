"""Oracles of their own for chosen speeds, which share only the inputs.

In steady currents SciPy's SLSQP improves a path and the speeds of its legs. In currents that change
there are two. One is a table over places, times and speeds: on a grid of nodes with a wide stencil
every edge is sailed at each of some speeds, and arrivals are rounded *up* to a bucket of time: the
vessel may slow down. What it finds is the fuel of a plan that can be sailed, so never too low, but
for what slowing down below the lowest speed would take. The other improves a path and the speeds of
its legs by SLSQP, with the clock of :mod:`tests.clock_oracle`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import minimize

import renew
from renew._types import FloatArray
from renew.inputs.options import Drift
from tests.clock_oracle import sailed
from tests.strategies import PAPER_VESSEL

# Places and weights of Simpson's rule on a leg.
_PLACES, _WEIGHTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0]), np.array([7, 32, 12, 32, 7]) / 90

_STEP = 1.5e-8
"""Of differences: about the square root of a float's precision."""


def with_and_against(points: FloatArray) -> FloatArray:
    """Velocity (..., 2): 0.4 m/s with the vessel for a metre, then as much against it."""
    u = np.where(points[..., 0] < 1, 0.4, -0.4)
    return np.stack([u, np.zeros_like(u)], axis=-1)


def leg_times(
    path: FloatArray, speeds: FloatArray, current: Callable[[FloatArray], FloatArray], *, crab: bool
) -> FloatArray:
    """Times (..., n - 1), s, over the legs of paths (..., n, 2) at speeds through water.

    By Boole's rule.
    """
    legs = np.diff(path, axis=-2)
    length = np.linalg.norm(legs, axis=-1)
    unit = legs / length[..., None]
    c = current(path[..., :-1, None, :] + _PLACES[:, None] * legs[..., None, :])
    along = (c * unit[..., None, :]).sum(-1)
    across = c[..., 1] * unit[..., None, 0] - c[..., 0] * unit[..., None, 1]
    v = speeds[..., None]
    way = np.sqrt(np.maximum(v**2 - across**2, 1e-9)) if crab else v
    return np.asarray(length * (_WEIGHTS / np.maximum(along + way, 1e-3)).sum(axis=-1))


def gradient(function: Callable[[FloatArray], FloatArray], values: FloatArray) -> FloatArray:
    """Gradient by differences, all of them in one call: SciPy's own are a call each."""
    shifted = values + _STEP * np.eye(len(values))
    return np.asarray((function(shifted) - function(values)) / _STEP)


def least_fuel(
    path: FloatArray,
    current: Callable[[FloatArray], FloatArray],
    speeds: tuple[float, float],
    time: float,
    *,
    exponent: float,
    crab: bool,
    moving: bool,
    hotel: float = 0.0,
) -> float:
    """Least fuel found to sail a path (n, 2) in a time (s), over the speeds of its legs.

    `hotel` is burnt each second beside the power of the speed. Its inner points may be moved as
    well, square to the line between its ends.
    """
    legs, (a, b) = len(path) - 1, path[[0, -1]]
    square = np.array([a[1] - b[1], b[0] - a[0]]) / math.dist(a, b)
    inner = legs - 1 if moving else 0

    def times(values: FloatArray) -> FloatArray:
        way = np.broadcast_to(path, (*values.shape[:-1], *path.shape)).copy()
        way[..., 1 : 1 + inner, :] += values[..., legs:, None] * square
        return leg_times(way, values[..., :legs], current, crab=crab)

    def fuel(values: FloatArray) -> FloatArray:
        return np.asarray(((values[..., :legs] ** exponent + hotel) * times(values)).sum(-1))

    def spare(values: FloatArray) -> FloatArray:
        return np.asarray((time - times(values).sum(-1)) / time)

    found = []
    for share in (0.3, 0.6, 0.9):
        first = np.concatenate(
            [np.full(legs, speeds[0] + share * (speeds[1] - speeds[0])), np.zeros(inner)]
        )
        result = minimize(
            fuel,
            first,
            jac=partial(gradient, fuel),
            method="SLSQP",
            bounds=[speeds] * legs + [(None, None)] * inner,
            constraints={"type": "ineq", "fun": spare, "jac": partial(gradient, spare)},
            options={"maxiter": 400, "ftol": 1e-10},
        )
        if times(result.x).sum() <= time * (1 + 1e-6):
            found.append(float(result.fun))
    return min(found)


# Number of pieces of a leg on a path.
_PIECES = 4
# Share of the time by which the optimizer's path may be late.
_LATE = 1e-4


@dataclass(frozen=True)
class CostModel:
    """From `start` to `goal` (2,), m, from a departure to a deadline (s), at least and most m/s."""

    current: renew.CurrentField
    start: FloatArray
    goal: FloatArray
    departure: float
    deadline: float
    speeds: tuple[float, float]
    exponent: float
    drift: Drift
    hotel: float = 0.0

    def sailed(
        self, a: FloatArray, b: FloatArray, begin: FloatArray, speed: FloatArray, pieces: int
    ) -> FloatArray:
        """Arrival times (n,), s, over legs a -> b (n, 2) begun at times (n,); inf if shut."""
        fastest = replace(PAPER_VESSEL, speed=self.speeds[1])
        return sailed(a, b, begin, self.current, fastest, self.drift, pieces, speed)

    def flown(self, paths: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fuel over α (b,), and arrivals (b,), s, of paths (b, n, 2) at speeds (b, n - 1)."""
        now, fuel = np.full(len(paths), self.departure), np.zeros(len(paths))
        for leg in range(speeds.shape[1]):
            speed = speeds[:, leg]
            then = self.sailed(paths[:, leg], paths[:, leg + 1], now, speed, _PIECES)
            fuel, now = fuel + (speed**self.exponent + self.hotel) * (then - now), then
        return fuel, now


def least_fuel_in_table(
    costs: CostModel, nodes: FloatArray, *, reach: float, buckets: int, tried: int
) -> tuple[float, FloatArray, FloatArray]:
    """Least fuel over α, and its path (n, 2) and speeds (n - 1,), over nodes (m, 2), m.

    Edges up to `reach` m that lead on by a quarter of that at least, towards the goal. The last two
    nodes are start and goal.
    """
    ahead = (costs.goal - costs.start) / math.dist(costs.start, costs.goal)
    points = np.vstack([nodes, costs.start, costs.goal])
    first, last = len(points) - 2, len(points) - 1
    place = points @ ahead
    place[first], place[last] = place.min() - reach, place.max() + reach
    step = (costs.deadline - costs.departure) / buckets
    fuel = np.full((len(points), buckets + 1), np.inf)
    fuel[first, 0] = 0.0
    came = np.zeros((len(points), buckets + 1, 3), dtype=np.int64)
    speeds = np.linspace(*costs.speeds, tried)
    for node in np.argsort(place).tolist():
        known = np.flatnonzero(np.isfinite(fuel[node]))
        if not len(known):
            continue
        apart = np.hypot(*(points - points[node]).T)
        on = (points - points[node]) @ ahead
        heads = np.flatnonzero((apart <= reach) & (on >= reach / 4) & (place > place[node]))
        pairs = np.stack(
            np.meshgrid(known, heads, np.arange(tried), indexing="ij"), axis=-1
        ).reshape(-1, 3)
        if not len(pairs):
            continue
        depth, head, speed = pairs.T
        begin = np.asarray(costs.departure + depth * step, dtype=np.float64)
        tail = np.broadcast_to(points[node], (len(pairs), 2))
        arrival = costs.sailed(tail, points[head], begin, speeds[speed], 2)
        burnt = fuel[node, depth] + (speeds[speed] ** costs.exponent + costs.hotel) * (
            arrival - begin
        )
        reached = np.ceil((arrival - costs.departure) / step - 1e-9)
        fine = np.isfinite(burnt) & (reached <= buckets)
        at, there = head[fine], reached[fine].astype(int)
        burnt, fro = burnt[fine], np.stack([np.full(fine.sum(), node), depth[fine], speed[fine]])
        order = np.argsort(-burnt, kind="stable")
        before = fuel[at, there]
        np.minimum.at(fuel, (at, there), burnt)
        won = order[(burnt <= fuel[at, there])[order] & (burnt < before)[order]]
        came[at[won], there[won]] = fro.T[won]
    bucket = int(fuel[last].argmin())
    if not math.isfinite(fuel[last, bucket]):
        return math.inf, np.empty((0, 2)), np.empty(0)
    least, row, chosen = float(fuel[last, bucket]), [last], []
    while row[-1] != first:
        node, bucket, at_speed = came[row[-1], bucket].tolist()
        row.append(node)
        chosen.append(float(speeds[at_speed]))
    return least, points[row[::-1]], np.array(chosen[::-1])


def improved(
    costs: CostModel, path: FloatArray, speeds: FloatArray, legs: int
) -> tuple[float, FloatArray, FloatArray]:
    """Fuel over α, path and speeds, of a path (n, 2) and its speeds (n - 1,) with so many legs.

    Its inner points are moved square to the line between its ends, in open water.
    """
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    marks = np.linspace(0.0, along[-1], legs + 1)
    way = np.column_stack([np.interp(marks, along, path[:, d]) for d in range(2)])
    leg = np.searchsorted(along, (marks[1:] + marks[:-1]) / 2, side="right") - 1
    a, b = way[[0, -1]]
    square = np.array([a[1] - b[1], b[0] - a[0]]) / math.dist(a, b)

    def flown(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fuel and lateness (b,), of some values (b, legs + legs - 1), as shares."""
        paths = np.repeat(way[None], len(values), axis=0)
        paths[:, 1:-1] += values[:, legs:, None] * square
        fuel, arrival = costs.flown(paths, values[:, :legs])
        shut = ~np.isfinite(arrival)
        late = (arrival - costs.deadline) / total
        return np.where(shut, 1e9, fuel / unit), np.where(shut, 1e9, late)

    def both(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Fuel, its slopes, lateness and its slopes."""
        step = 1e-5 * np.where(np.arange(len(values)) < legs, 1.0, along[-1])
        moved = np.vstack([values, values + np.diag(step), values - np.diag(step)])
        fuel, late = flown(moved)
        n = len(values)
        slopes = [(one[1 : n + 1] - one[n + 1 :]) / (2 * step) for one in (fuel, late)]
        return fuel[0], slopes[0], late[0], slopes[1]

    unit, total = 1.0, costs.deadline - costs.departure
    begun = np.concatenate([speeds[leg], np.zeros(legs - 1)])
    unit = float(flown(begun[None])[0][0])
    result = minimize(
        lambda values: both(values)[:2],
        begun,
        jac=True,
        method="SLSQP",
        bounds=[costs.speeds] * legs + [(None, None)] * (legs - 1),
        constraints={
            "type": "ineq",
            "fun": lambda values: -flown(values[None])[1][0],
            "jac": lambda values: -both(values)[3],
        },
        options={"maxiter": 150, "ftol": 1e-7},
    )
    found = way.copy()
    found[1:-1] += result.x[legs:, None] * square
    (fuel,), (late,) = flown(result.x[None])
    # A little late still counts: that is to the oracle's advantage.
    return (float(fuel) * unit if late <= _LATE else math.inf), found, result.x[:legs]
