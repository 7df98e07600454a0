"""Improve the speeds of a path's legs in a changing current, for least cost of fuel and lateness.

A leg's speed changes the fuel of all later legs, because these begin at other times. One pass from
the last leg to the first gives all slopes (adjoint method; Bryson & Ho, 1975). Let d be the time
over a leg that begins at t and is sailed at v, and μ the cost of a later arrival at its end. Then
the slope is k v^(k-1) d + (vᵏ + μ) ∂d/∂v, and a later arrival at the leg's beginning costs
μ + (vᵏ + μ) ∂d/∂t.

The method is a projected quasi-Newton descent with limited memory. The last changes of the slopes
give an estimate of the inverse Hessian, and so the step (L-BFGS; Nocedal & Wright, Numerical
Optimization, 2006, 7.2). Speeds at a limit stay there, and a step ends at the limits (Bertsekas,
Projected Newton methods, 1982). All is one kernel, because hundreds of costs are computed, in some
20 µs each.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import Segment
from renew.kernels.cheapest_chain import CostModel, stream_at
from renew.kernels.current_table import site_of, velocity
from renew.kernels.viterbi import leg_time_from

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


@kernel
def _leg_time(path: FloatArray, k: int, begin: float, speed: float, costs: CostModel) -> float:
    """Return the time (s) over the k-th leg, begun at a time and sailed at a speed (m/s)."""
    (ax, ay), (bx, by) = path[k], path[k + 1]
    u, v = velocity(costs.table, ax, ay, begin)
    leg, end = Segment(ax, ay, bx, by), site_of(costs.table, bx, by)
    return leg_time_from(leg, u, v, end, begin, stream_at(speed, begin, costs))


@kernel
def slopes(speeds: FloatArray, made: SailedLegs, price: float, exponent: float) -> FloatArray:
    """Return the slopes (n - 1,) of fuel + price × arrival, over α, by each leg's speed."""
    times, by_begin, by_speed = made
    found = np.empty(len(speeds))
    for k in range(len(speeds) - 1, -1, -1):
        speed, time = speeds[k], times[k + 1] - times[k]
        rate = speed**exponent
        found[k] = exponent * rate / speed * time + (rate + price) * by_speed[k]
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
    legs, scale, exponent = problem.legs, problem.scale, problem.costs.exponent
    slope[:] = 0.0
    speeds = np.empty(len(legs))
    for k in range(len(legs)):
        speeds[k] = scaled[legs[k]] / scale[legs[k]]
    made = sailed(problem.path, speeds, problem.departure, problem.costs)
    if not math.isfinite(made.times[-1]):
        return _NO_WAY
    late = made.times[-1] - problem.deadline
    at = max(0.0, problem.price + problem.stiffness * late)
    by_speed, fuel = slopes(speeds, made, at, exponent), 0.0
    for k in range(len(legs)):
        fuel += speeds[k] ** exponent * (made.times[k + 1] - made.times[k])
        slope[legs[k]] += by_speed[k] / scale[legs[k]] / problem.unit
    whole = fuel + (at**2 - problem.price**2) / (2 * problem.stiffness)
    return float(whole / problem.unit)
