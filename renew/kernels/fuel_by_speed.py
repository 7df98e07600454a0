"""Compute fuel over legs at given speeds in a changing current, and its slope by each speed.

A leg's speed changes the fuel of all later legs, because these begin at other times. One pass from
the last leg to the first gives all slopes (adjoint method; Bryson & Ho, 1975). Let d be the time
over a leg that begins at t and is sailed at v, and μ the cost of a later arrival at its end. Then
the slope is k v^(k-1) d + (vᵏ + μ) ∂d/∂v, and a later arrival at the leg's beginning costs
μ + (vᵏ + μ) ∂d/∂t.
"""

from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import FloatArray
from renew.kernels.capsules import Segment
from renew.kernels.cheapest_chain import Errand
from renew.kernels.current_table import CurrentTable, site_of, velocity_there
from renew.kernels.ground_speed import sailing_at
from renew.kernels.viterbi import leg_time_from

# Steps of differences, as shares of the speed and of the time over a leg.
_OF_SPEED, _OF_TIME = 1e-4, 1e-2


class Sailed(NamedTuple):
    """Times (n,), s, at the points of a path, and derivatives of the time over each leg.

    `by_begin` (n - 1,), s/s, is ∂d/∂t and `by_speed` (n - 1,), s/(m/s), is ∂d/∂v. Times are
    infinite from the first point that the vessel can't reach.
    """

    times: FloatArray
    by_begin: FloatArray
    by_speed: FloatArray


@kernel
def sailed(
    path: FloatArray, speeds: FloatArray, departure: float, table: CurrentTable, errand: Errand
) -> Sailed:
    """Sail a path (n, 2) at speeds (n - 1,) through water, m/s, from a departure (s) on."""
    legs = len(path) - 1
    times, by_begin, by_speed = np.full(legs + 1, np.inf), np.zeros(legs), np.zeros(legs)
    times[0] = departure
    for k in range(legs):
        now, speed = times[k], speeds[k]
        time = _leg_time(path, k, now, speed, table, errand)
        if time == np.inf:
            break
        times[k + 1] = now + time
        step = _OF_SPEED * speed
        more = _leg_time(path, k, now, speed + step, table, errand)
        less = _leg_time(path, k, now, speed - step, table, errand)
        by_speed[k] = (more - less) / (2 * step) if less < np.inf else (more - time) / step
        step = _OF_TIME * time
        later = _leg_time(path, k, now + step, speed, table, errand)
        sooner = _leg_time(path, k, now - step, speed, table, errand)
        if step > 0.0 and later < np.inf and sooner < np.inf:
            by_begin[k] = (later - sooner) / (2 * step)
    return Sailed(times, by_begin, by_speed)


@kernel
def _leg_time(
    path: FloatArray, k: int, begin: float, speed: float, table: CurrentTable, errand: Errand
) -> float:
    """Return the time (s) over the k-th leg, begun at a time and sailed at a speed (m/s)."""
    (ax, ay), (bx, by) = path[k], path[k + 1]
    u, v = velocity_there(table, site_of(table, ax, ay), begin)
    polar = sailing_at(speed, errand.crab, errand.most)
    leg, end = Segment(ax, ay, bx, by), site_of(table, bx, by)
    return leg_time_from(leg, u, v, end, begin, table, polar, errand.step)


@kernel
def slopes(speeds: FloatArray, made: Sailed, price: float, exponent: float) -> FloatArray:
    """Return the slopes (n - 1,) of fuel + price × arrival, over α, by each leg's speed."""
    times, by_begin, by_speed = made
    found = np.empty(len(speeds))
    for k in range(len(speeds) - 1, -1, -1):
        speed, time = speeds[k], times[k + 1] - times[k]
        rate = speed**exponent
        found[k] = exponent * rate / speed * time + (rate + price) * by_speed[k]
        price += (rate + price) * by_begin[k]
    return found
