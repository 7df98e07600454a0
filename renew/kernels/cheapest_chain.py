"""Find the cheapest chain through rows of points, with a speed per leg, in a changing current.

A vessel that chooses its speeds may have burnt more or less fuel when it reaches a point, and the
best continuation depends on the time. So a state is a point and a time. With a rate vᵏ, the least
remaining cost obeys

    V(x, t) = min over the points y of the next row, and speeds v, of  vᵏ τ + V(y, t + τ),

where τ is the time over the leg x -> y, begun at t and sailed at v. At the goal V is 0 until the
deadline; each later second has a price so high that no speed is worth it. V is computed at some
times in each row, and linear between them (a semi-Lagrangian scheme: Falcone & Ferretti, 2013).
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import Capsules, Segment, capsule_bounds, intersects, leg_is_clear
from renew.kernels.current_table import CurrentTable, site_of, velocity, velocity_there
from renew.kernels.ground_speed import sailing_at
from renew.kernels.viterbi import TOO_STRONG, Clock, Stream, leg_time_from

# Number of speeds of each leg that are tried at first.
_TRIES = 6
# Number of times that the steps between tried speeds are halved around the best speed while V is
# computed.
_HALVINGS = 1
# The same on the chosen chain.
_FINAL_HALVINGS = 12


class CostModel(NamedTuple):
    """What a voyage costs in a current, and the limits of its speed and time.

    The highest speed is `most` (m/s). The vessel burns vᵏ a second, where k is the `exponent`, and
    updates the time after each `step` (m). Each second after the `deadline` (s) costs `late_price`.
    """

    table: CurrentTable
    most: float
    crab: bool
    exponent: float
    step: float
    deadline: float
    late_price: float


class Chain(NamedTuple):
    """A point (r,) of each row, the time (r,), s, there, and the speed (r - 1,), m/s, of each leg.

    `cost` is infinite if no chain is clear; it includes the cost of lateness.
    """

    cost: float
    points: IntArray
    times: FloatArray
    speeds: FloatArray


class Rows(NamedTuple):
    """Rows of points through which a chain leads, and when and how fast it may be sailed.

    `points` (r, m, 2), m: the first and the last row are one point each, at index 0.
    `clear` (r - 1, m, m): whether a leg from one row to the next may be sailed.
    `times` (r, q), s: ascending and even, at which V is known; the first is that of departure.
    `speeds` (r - 1, 2), m/s: lowest and highest speed of the legs from each row.
    """

    points: FloatArray
    clear: BoolArray
    times: FloatArray
    speeds: FloatArray


class _CostToGo(NamedTuple):
    """The least cost to go (q,) from a point, at some times (q,), s."""

    times: FloatArray
    cost: FloatArray
    is_goal: bool


@small_kernel
def stream_at(speed: float, begin: float, costs: CostModel) -> Stream:
    """Return the current as it is sailed at a speed (m/s) from some time (s) on."""
    polar = sailing_at(speed, costs.crab, costs.most)
    return Stream(costs.table, polar, Clock(begin, costs.step))


@kernel
def legs_between(points: FloatArray, capsules: Capsules, exempt: BoolArray) -> BoolArray:
    """Return whether legs (r - 1, m, m) from each point of a row to each of the next are clear.

    `points` and `exempt` are as in :func:`renew.kernels.viterbi.quickest_chain`.
    """
    rows, count = points.shape[:2]
    clear = np.zeros((rows - 1, count, count), dtype=np.bool_)
    bounds = capsule_bounds(capsules)
    near = np.empty(len(bounds), dtype=np.int64)
    none_exempt = np.zeros(len(capsules.radius), dtype=np.bool_)
    for row in range(rows - 1):
        both = points[row : row + 2]
        west, east = both[..., 0].min(), both[..., 0].max()
        south, north = both[..., 1].min(), both[..., 1].max()
        found = 0
        for h in range(len(bounds)):
            if intersects(bounds, h, west, south, east, north):
                near[found] = h
                found += 1
        free = exempt[0] if row == 0 else exempt[1] if row == rows - 2 else none_exempt
        for i in range(1 if row == 0 else count):
            for j in range(1 if row == rows - 2 else count):
                (ax, ay), (bx, by) = points[row, i], points[row + 1, j]
                leg = Segment(ax, ay, bx, by)
                clear[row, i, j] = leg_is_clear(leg, capsules, near[:found], free)
    return clear


@kernel
def cheapest_chain(rows: Rows, costs: CostModel) -> Chain:
    """Return the chain of least cost."""
    points, clear, times, speeds = rows
    last, count = len(points) - 1, points.shape[1]
    cost = np.full((last + 1, count, times.shape[1]), np.inf)
    limit = TOO_STRONG * costs.most * costs.most
    for row in range(last - 1, 0, -1):
        following = 1 if row == last - 1 else count
        for i in range(count):
            ax, ay = points[row, i]
            here = site_of(costs.table, ax, ay)
            for k in range(times.shape[1]):
                begin = times[row, k]
                u, v = velocity_there(costs.table, here, begin)
                if u * u + v * v >= limit:
                    continue
                least = np.inf
                for j in range(following):
                    if not clear[row, i, j]:
                        continue
                    bx, by = points[row + 1, j]
                    leg, departed = Segment(ax, ay, bx, by), (begin, u, v)
                    to_go = _CostToGo(times[row + 1], cost[row + 1, j], row == last - 1)
                    tried = _best_speed(leg, departed, speeds[row], _HALVINGS, to_go, costs)
                    least = min(least, tried[0])
                cost[row, i, k] = least
    return _traced(rows, cost, costs)


@kernel
def _traced(rows: Rows, cost: FloatArray, costs: CostModel) -> Chain:
    """Return the chain that V (r, m, q), `cost`, gives."""
    points, clear, times, speeds = rows
    last, count = len(points) - 1, points.shape[1]
    chain = np.zeros(last + 1, dtype=np.int64)
    when, sailed = np.full(last + 1, np.inf), np.full(last, costs.most)
    when[0] = times[0, 0]
    total = 0.0
    for row in range(last):
        ax, ay = points[row, chain[row]]
        u, v = velocity(costs.table, ax, ay, when[row])
        least, taken = np.inf, np.inf
        for j in range(1 if row == last - 1 else count):
            if not clear[row, chain[row], j]:
                continue
            bx, by = points[row + 1, j]
            leg, departed = Segment(ax, ay, bx, by), (when[row], u, v)
            to_go = _CostToGo(times[row + 1], cost[row + 1, j], row == last - 1)
            onwards, speed, duration = _best_speed(
                leg, departed, speeds[row], _FINAL_HALVINGS, to_go, costs
            )
            if onwards < least:
                least, sailed[row], taken, chain[row + 1] = onwards, speed, duration, j
        if least == np.inf:
            return Chain(np.inf, chain, when, sailed)
        total += sailed[row] ** costs.exponent * taken
        when[row + 1] = when[row] + taken
    total += costs.late_price * max(when[-1] - costs.deadline, 0.0)
    return Chain(total, chain, when, sailed)


@kernel
def _best_speed(
    leg: Segment,
    departed: tuple[float, float, float],
    limits: FloatArray,
    halvings: int,
    to_go: _CostToGo,
    costs: CostModel,
) -> tuple[float, float, float]:
    """Return the least cost of a leg and beyond, the leg's speed (m/s), and its duration (s).

    `departed` is the time (s) at the leg's beginning, and the current u, v (m/s) there then;
    `limits` are the lowest and the highest speed. Evenly spaced speeds are tried first, then speeds
    halfway to those beside the best, and so on.
    """
    (begin, u, v), (low, high) = departed, limits
    end = site_of(costs.table, leg.bx, leg.by)
    least, best, taken = np.inf, low, np.inf
    ratio = (high / low) ** (1.0 / (_TRIES - 1))
    step, centre = math.sqrt(ratio), low
    for at in range(_TRIES + 2 * halvings):
        if at < _TRIES:
            speed = min(low * ratio**at, high)
        elif (at - _TRIES) % 2 == 0:
            centre = best
            speed = centre / step
        else:
            speed = centre * step
            step = math.sqrt(step)
        if not low <= speed <= high:
            continue
        time = leg_time_from(leg, u, v, end, begin, stream_at(speed, begin, costs))
        if time < np.inf:
            cost = speed**costs.exponent * time + _cost_from(begin + time, to_go, costs)
            if cost < least:
                least, best, taken = cost, speed, time
    return least, best, taken


@small_kernel
def _cost_from(time: float, to_go: _CostToGo, costs: CostModel) -> float:
    """Return V at a time (s), linear between the times at which it is computed.

    Before the first time V is constant; after the last, each second costs as much as lateness. So
    leaving the window gains nothing.
    """
    if to_go.is_goal:
        return costs.late_price * max(time - costs.deadline, 0.0)
    times, cost = to_go.times, to_go.cost
    last = len(times) - 1
    if time <= times[0]:
        return float(cost[0])
    if time >= times[last]:
        return float(cost[last] + costs.late_price * (time - times[last]))
    place = (time - times[0]) / (times[last] - times[0]) * last
    k = min(int(place), last - 1)
    return float(cost[k] + (place - k) * (cost[k + 1] - cost[k]))
