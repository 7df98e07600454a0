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
from renew.kernels.current_table import CurrentTable, Site, site_of, velocity, velocity_there
from renew.kernels.ground_speed import sailing_at
from renew.kernels.viterbi import TOO_STRONG, leg_time_from

# Number of times that the steps between tried speeds are halved around the best speed: while V is
# computed, and on the chosen chain.
_HALVINGS, _FINAL_HALVINGS = 1, 12


class CostModel(NamedTuple):
    """What a voyage costs, and the limits of its speed and time.

    The highest speed is `most` (m/s). The vessel burns vᵏ a second, where k is the `exponent`, and
    updates the time after each `step` (m). Each second after the `deadline` (s) costs `late_price`.
    """

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


class _CostToGo(NamedTuple):
    """The least cost to go (q,) from a point, at some times (q,), s."""

    times: FloatArray
    cost: FloatArray
    is_goal: bool


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
def cheapest_chain(
    points: FloatArray,
    clear: BoolArray,
    times: FloatArray,
    speeds: FloatArray,
    tries: int,
    table: CurrentTable,
    costs: CostModel,
) -> Chain:
    """Return the chain of least cost.

    Parameters
    ----------
    points : (r, m, 2) metres; the first and the last row are one point each, at index 0.
    clear : (r - 1, m, m) whether a leg may be sailed.
    times : (r, q) s, ascending and even, at which V is known; the first is that of departure.
    speeds : (r - 1, 2) m/s, lowest and highest speed for the legs from each row.
    tries : number of speeds of each leg that are tried at first.
    """
    rows, count = points.shape[:2]
    cost = np.full((rows, count, times.shape[1]), np.inf)
    limit = TOO_STRONG * costs.most * costs.most
    for row in range(rows - 2, 0, -1):
        following = 1 if row == rows - 2 else count
        low, high = speeds[row]
        for i in range(count):
            ax, ay = points[row, i]
            here = site_of(table, ax, ay)
            for k in range(times.shape[1]):
                begin = times[row, k]
                u, v = velocity_there(table, here, begin)
                if u * u + v * v >= limit:
                    continue
                least = np.inf
                for j in range(following):
                    if not clear[row, i, j]:
                        continue
                    bx, by = points[row + 1, j]
                    leg, end = Segment(ax, ay, bx, by), site_of(table, bx, by)
                    to_go = _CostToGo(times[row + 1], cost[row + 1, j], row == rows - 2)
                    least = min(
                        least,
                        _best_speed(
                            leg, u, v, end, begin, low, high, tries, _HALVINGS, to_go, table, costs
                        )[0],
                    )
                cost[row, i, k] = least
    return _traced(points, clear, times, speeds, tries, cost, table, costs)


@kernel
def _traced(
    points: FloatArray,
    clear: BoolArray,
    times: FloatArray,
    speeds: FloatArray,
    tries: int,
    cost: FloatArray,
    table: CurrentTable,
    costs: CostModel,
) -> Chain:
    """Return the chain that V (r, m, q) gives."""
    rows, count = points.shape[:2]
    chain = np.zeros(rows, dtype=np.int64)
    when, sailed = np.full(rows, np.inf), np.full(rows - 1, costs.most)
    when[0] = times[0, 0]
    total = 0.0
    for row in range(rows - 1):
        low, high = speeds[row]
        ax, ay = points[row, chain[row]]
        u, v = velocity(table, ax, ay, when[row])
        least, taken = np.inf, np.inf
        for j in range(1 if row == rows - 2 else count):
            if not clear[row, chain[row], j]:
                continue
            bx, by = points[row + 1, j]
            leg, end = Segment(ax, ay, bx, by), site_of(table, bx, by)
            to_go = _CostToGo(times[row + 1], cost[row + 1, j], row == rows - 2)
            found, speed, duration = _best_speed(
                leg, u, v, end, when[row], low, high, tries, _FINAL_HALVINGS, to_go, table, costs
            )
            if found < least:
                least, sailed[row], taken, chain[row + 1] = found, speed, duration, j
        if least == np.inf:
            return Chain(np.inf, chain, when, sailed)
        total += sailed[row] ** costs.exponent * taken
        when[row + 1] = when[row] + taken
    total += costs.late_price * max(when[-1] - costs.deadline, 0.0)
    return Chain(total, chain, when, sailed)


@kernel
def _best_speed(
    leg: Segment,
    u: float,
    v: float,
    end: Site,
    begin: float,
    low: float,
    high: float,
    tries: int,
    halvings: int,
    to_go: _CostToGo,
    table: CurrentTable,
    costs: CostModel,
) -> tuple[float, float, float]:
    """Return the least cost of a leg and beyond, the leg's speed (m/s), and its duration (s).

    Evenly spaced speeds are tried first, then speeds halfway to those beside the best, and so on.
    """
    least, best, taken = np.inf, low, np.inf
    ratio = (high / low) ** (1.0 / (tries - 1))
    step, centre = math.sqrt(ratio), low
    for at in range(tries + 2 * halvings):
        if at < tries:
            speed = min(low * ratio**at, high)
        elif (at - tries) % 2 == 0:
            centre = best
            speed = centre / step
        else:
            speed = centre * step
            step = math.sqrt(step)
        if not low <= speed <= high:
            continue
        polar = sailing_at(speed, costs.crab, costs.most)
        time = leg_time_from(leg, u, v, end, begin, table, polar, costs.step)
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
