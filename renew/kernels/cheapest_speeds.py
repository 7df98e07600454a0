"""The cheapest speeds in a changing current: a chain with a speed per leg, and its improvement.

The chain leads through rows of points.

A vessel that chooses its speeds may have burnt more or less fuel when it reaches a point, and the
best continuation depends on the time. So a state is a point and a time. With a rate R(v), vᵏ as a
rule, the least remaining cost obeys

    V(x, t) = min over the points y of the next row, and speeds v, of  R(v) τ + V(y, t + τ),

where τ is the time over the leg x -> y, begun at t and sailed at v. At the goal V is 0 until the
deadline; each later second has a price so high that no speed is worth it. V is computed at some
times in each row, and linear between them (a semi-Lagrangian scheme: Falcone & Ferretti, 2013).

Then the speeds of a path's legs are improved, for least cost of fuel and lateness. A leg's speed
changes the fuel of all later legs, because these begin at other times. One pass from the last leg
to the first gives all slopes (adjoint method; Bryson & Ho, 1975). Let d be the time over a leg that
begins at t and is sailed at v, and μ the cost of a later arrival at its end. Then the slope is
R'(v) d + (R + μ) ∂d/∂v, and a later arrival at the leg's beginning costs μ + (R + μ) ∂d/∂t.

The method is a projected quasi-Newton descent with limited memory. The last changes of the slopes
give an estimate of the inverse Hessian, and so the step (L-BFGS; Nocedal & Wright, Numerical
Optimization, 2006, 7.2). Speeds at a limit stay there, and a step ends at the limits (Bertsekas,
Projected Newton methods, 1982). All is one kernel, because hundreds of costs are computed, in some
20 µs each.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import Capsules, Segment, capsule_bounds, intersects, leg_is_clear
from renew.kernels.current_table import CurrentTable, site_of, velocity, velocity_there
from renew.kernels.fuel_law import FuelLaw, effort, effort_by_speed
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

    The highest speed is `most` (m/s). The vessel burns fuel by a `law`, and updates the time after
    each `step` (m). Each second after the `deadline` (s) costs `late_price`.
    """

    table: CurrentTable
    most: float
    crab: bool
    law: FuelLaw
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
    `times` (r, q), s: ascending, evenly spaced; V is known at them, and the first is the departure.
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
    """Return the chain that follows from V (r, m, q), given as `cost`."""
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
        total += effort(sailed[row], costs.law) * taken
        when[row + 1] = when[row] + taken
    total += costs.late_price * max(when[-1] - costs.deadline, 0.0)
    return Chain(total, chain, when, sailed)


@reading_kernel
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
        polar = sailing_at(speed, costs.crab, costs.most, costs.law)
        water = Stream(costs.table, polar, Clock(begin, costs.step))
        time = leg_time_from(leg, u, v, end, begin, water)
        if time < np.inf:
            cost = effort(speed, costs.law) * time + _cost_from(begin + time, to_go, costs)
            if cost < least:
                least, best, taken = cost, speed, time
    return least, best, taken


@small_kernel
def _cost_from(time: float, to_go: _CostToGo, costs: CostModel) -> float:
    """Return V at a time (s), linear between the times at which it is computed.

    V is constant before the first time. After the last one, each second costs as much as lateness.
    So leaving the window gains nothing.
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


# Change of a leg's speed for ∂d/∂v, as a share of the speed.
_OF_SPEED = 1e-4
# Change of a leg's beginning for ∂d/∂t, as a share of the time over the leg.
_OF_TIME = 1e-2


class SailedLegs(NamedTuple):
    """Times (n,), s, at the points of a path, and derivatives of the time over each leg.

    `by_begin` (n - 1,), s/s, is ∂d/∂t and `by_speed` (n - 1,), s/(m/s), is ∂d/∂v. Times are
    infinite from the first point that the vessel can't reach.
    """

    times: FloatArray
    by_begin: FloatArray
    by_speed: FloatArray


@kernel
def sailed(path: FloatArray, speeds: FloatArray, departure: float, costs: CostModel) -> SailedLegs:
    """Sail a path (n, 2) at speeds (n - 1,) through water, m/s, from a departure (s) on."""
    legs = len(path) - 1
    times, by_begin, by_speed = np.full(legs + 1, np.inf), np.zeros(legs), np.zeros(legs)
    times[0] = departure
    for k in range(legs):
        now, speed = times[k], speeds[k]
        time = _leg_time(path, k, now, speed, costs)
        if time == np.inf:
            break
        times[k + 1] = now + time
        step = _OF_SPEED * speed
        more = _leg_time(path, k, now, speed + step, costs)
        less = _leg_time(path, k, now, speed - step, costs)
        by_speed[k] = (more - less) / (2 * step) if less < np.inf else (more - time) / step
        step = _OF_TIME * time
        later = _leg_time(path, k, now + step, speed, costs)
        sooner = _leg_time(path, k, now - step, speed, costs)
        if step > 0.0 and later < np.inf and sooner < np.inf:
            by_begin[k] = (later - sooner) / (2 * step)
    return SailedLegs(times, by_begin, by_speed)


@reading_kernel
def _leg_time(path: FloatArray, k: int, begin: float, speed: float, costs: CostModel) -> float:
    """Return the time (s) over the k-th leg, begun at a time and sailed at a speed (m/s)."""
    (ax, ay), (bx, by) = path[k], path[k + 1]
    u, v = velocity(costs.table, ax, ay, begin)
    leg, end = Segment(ax, ay, bx, by), site_of(costs.table, bx, by)
    polar = sailing_at(speed, costs.crab, costs.most, costs.law)
    water = Stream(costs.table, polar, Clock(begin, costs.step))
    return leg_time_from(leg, u, v, end, begin, water)


@kernel
def slopes(speeds: FloatArray, made: SailedLegs, price: float, law: FuelLaw) -> FloatArray:
    """Return the derivatives (n - 1,) of fuel / α + price × arrival by each leg's speed."""
    times, by_begin, by_speed = made
    found = np.empty(len(speeds))
    for k in range(len(speeds) - 1, -1, -1):
        speed, time = speeds[k], times[k + 1] - times[k]
        rate = effort(speed, law)
        found[k] = effort_by_speed(speed, law) * time + (rate + price) * by_speed[k]
        price += (rate + price) * by_begin[k]
    return found


# Number of steps, with their changes of the slopes, that are remembered.
_MEMORY = 12
# The descent ends once the cost has been computed this number of times.
_MAX_COSTS = 300
# A step is taken if it lowers the cost by this share of what the slope promises.
_ENOUGH = 1e-4
# A step is halved until it is this share of its first length.
_SHORTEST = 1e-8
# A step that lowers the cost by no more than this share lowers it too little.
_LITTLE = 1e-9
# The descent ends after this number of successive steps that lower the cost too little.
_LAST_ONES = 2
# Cost of speeds that make no way, as a multiple of a path's usual cost.
_NO_WAY = 1e3


class SpeedProblem(NamedTuple):
    """What the speeds of a path (n, 2), m, are chosen for; fuel is divided by α.

    Row k of the path is sailed at the speed of leg `legs[k]`. Leg speeds are multiplied by `scale`
    (l,), so that a change of any of them costs about the same; they lie between `low` and `high`
    (l,). The cost is an augmented Lagrangian of the deadline (s), with a `price` of time and its
    `stiffness`, divided by `unit`.
    """

    path: FloatArray
    legs: IntArray
    scale: FloatArray
    low: FloatArray
    high: FloatArray
    departure: float
    costs: CostModel
    deadline: float
    price: float
    stiffness: float
    unit: float


@kernel
def cheapest_speeds(problem: SpeedProblem, scaled: FloatArray) -> FloatArray:
    """Return scaled speeds (l,) of least cost near given ones, between their limits."""
    x, slope = scaled.copy(), np.zeros(len(scaled))
    new, new_slope = np.empty(len(x)), np.empty(len(x))
    steps, changes = np.zeros((_MEMORY, len(x))), np.zeros((_MEMORY, len(x)))
    cost, known, last_ones = _cost(problem, x, slope), 0, 0
    costs = 1
    while costs < _MAX_COSTS and last_ones < _LAST_ONES:
        free = ~((x <= problem.low) & (slope > 0.0) | (x >= problem.high) & (slope < 0.0))
        ahead = _direction(slope, free, steps, changes, known)
        if not (ahead * slope).sum() < 0.0:
            if known == 0:
                break
            known = 0
            continue
        share, new_cost = 1.0, np.inf
        while costs < _MAX_COSTS and share > _SHORTEST:
            for k in range(len(x)):
                new[k] = min(max(x[k] + share * ahead[k], problem.low[k]), problem.high[k])
            new_cost = _cost(problem, new, new_slope)
            costs += 1
            if new_cost <= cost + _ENOUGH * (slope * (new - x)).sum():
                break
            share /= 2
        if not new_cost < cost:
            if known == 0:
                break
            known = 0
            continue
        steps[known % _MEMORY], changes[known % _MEMORY] = new - x, new_slope - slope
        known += 1
        last_ones = last_ones + 1 if cost - new_cost <= _LITTLE * abs(cost) else 0
        x[:], slope[:], cost = new, new_slope, new_cost
    return x


@kernel
def _direction(
    slope: FloatArray, free: BoolArray, steps: FloatArray, changes: FloatArray, known: int
) -> FloatArray:
    """Return a direction (l,) of descent among the free speeds, by the changes that are known."""
    ahead = np.where(free, -slope, 0.0)
    shares = np.zeros(_MEMORY)
    oldest, size = max(0, known - _MEMORY), 0.5
    for at in range(known - 1, oldest - 1, -1):
        step, change = steps[at % _MEMORY] * free, changes[at % _MEMORY] * free
        bend = (step * change).sum()
        if bend > 0.0:
            shares[at % _MEMORY] = (step * ahead).sum() / bend
            ahead -= shares[at % _MEMORY] * change
            if size == 0.5:
                size = bend / (change * change).sum()
    ahead *= size
    for at in range(oldest, known):
        step, change = steps[at % _MEMORY] * free, changes[at % _MEMORY] * free
        bend = (step * change).sum()
        if bend > 0.0:
            ahead += (shares[at % _MEMORY] - (change * ahead).sum() / bend) * step
    return ahead


@kernel
def _cost(problem: SpeedProblem, scaled: FloatArray, slope: FloatArray) -> float:
    """Return the cost at scaled speeds (l,), and fill in its slopes (l,)."""
    legs, scale, law = problem.legs, problem.scale, problem.costs.law
    slope[:] = 0.0
    speeds = np.empty(len(legs))
    for k in range(len(legs)):
        speeds[k] = scaled[legs[k]] / scale[legs[k]]
    made = sailed(problem.path, speeds, problem.departure, problem.costs)
    if not math.isfinite(made.times[-1]):
        return _NO_WAY
    late = made.times[-1] - problem.deadline
    at = max(0.0, problem.price + problem.stiffness * late)
    by_speed, fuel = slopes(speeds, made, at, law), 0.0
    for k in range(len(legs)):
        fuel += effort(speeds[k], law) * (made.times[k + 1] - made.times[k])
        slope[legs[k]] += by_speed[k] / scale[legs[k]] / problem.unit
    whole = fuel + (at**2 - problem.price**2) / (2 * problem.stiffness)
    return float(whole / problem.unit)
