"""Speed over ground along a course in a current: the denominator of Eq. 4, in both drift models.

Where the vessel may choose its speed through water v, and time has a price of μ for each second, a
metre costs the least of (vᵏ + μ) / g, g being the speed over ground. That has the form of a
slowness: with its inverse in the place of g every search for the quickest path finds the cheapest
one. With a the current along the course, x that across it (none in the projected model)
and W = √(v² - x²), g is a + W and (W² + x²)^(k/2) is convex in W for k >= 1; so the cost has one
minimum, where k W v^(k-2) (a + W) = vᵏ + μ. For k = 2 that is W = -a + √(a² + x² + μ).
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import for_kernels, kernel, small_kernel
from renew._types import FloatArray

# Largest number of steps of Newton's iteration, and the change, as a share of v, that ends it.
_MAX_STEPS, _SETTLED = 40, 1e-8


class Polar(NamedTuple):
    """What the vessel makes on every course: `speed` through water (m/s), by which drift model.

    `crab` is True for the exact model, in which the vessel heads into the cross-current, and False
    for the projected one, as published. Where it chooses its speed, `least` is below `speed`: then
    `price` is that of a second, μ, beside vᵏ, with k the `exponent`, and what it "makes" is
    `scale` m/s over the least (vᵏ + μ) / g. Without limits `still` would be best in still water.
    A vessel that sails below its highest speed may cross currents up to that: `no_go` then (m/s).
    """

    speed: float
    crab: bool
    least: float = math.inf
    price: float = 0.0
    exponent: float = 2.0
    scale: float = 1.0
    still: float = 0.0
    no_go: float = 0.0


@small_kernel
def sailing_at(speed: float, crab: bool, most: float) -> Polar:
    """Polar at a speed through water (m/s) below the vessel's highest one."""
    return Polar(speed, crab, math.inf, 0.0, 2.0, 1.0, 0.0, most)


def choosing(speed: float, *, crab: bool, least: float, price: float, exponent: float) -> Polar:
    """Polar of a vessel that chooses its speed from `least` to `speed`, where a second costs μ.

    Its scale is such that in still water it makes `speed`, as if it had no choice.
    """
    best = (price / (exponent - 1)) ** (1 / exponent) if exponent > 1 else speed
    polar = Polar(speed, crab, least, price, exponent, 1.0, min(best, speed))
    return polar._replace(scale=speed / ground_speed(0.0, 0.0, 1.0, 0.0, polar))


@small_kernel
def ground_speed(cx: float, cy: float, tx: float, ty: float, polar: Polar) -> float:
    """Speed over ground along the unit tangent t in the current c, m/s.

    Projected: v + c·T. Crab: c·T + √(v² - |c - (c·T)T|²). Not positive where the vessel can't make
    way in that direction, and NaN where it can't even hold the course.
    """
    along = cx * tx + cy * ty
    across = cy * tx - cx * ty if polar.crab else 0.0
    if polar.least < polar.speed:
        return _chosen_speed(along, across, polar)[1]
    if not polar.crab:
        return along + polar.speed
    square = polar.speed * polar.speed - across * across
    return along + math.sqrt(square) if square >= 0.0 else math.nan


@kernel
def _chosen_speed(along: float, across: float, polar: Polar) -> tuple[float, float]:
    """Speed through water of least cost (m/s), and what is "made" at it, from the current's parts.

    Where no speed makes way, the highest.
    """
    k, price = polar.exponent, polar.price
    square = across * across
    most = polar.speed * polar.speed - square
    if most < 0.0:
        return polar.speed, math.nan
    high = math.sqrt(most)
    low = math.sqrt(max(polar.least * polar.least - square, 0.0))
    if along + high <= 0.0:
        return polar.speed, along + high
    # Below `low` the cost is infinite, or the speed too low; the sign of the slope at W tells on
    # which side of it the minimum lies.
    low = max(low, -along)
    worth = price if k == 2.0 else polar.still * polar.still
    best = min(max(math.sqrt(along * along + square + worth) - along, low), high)
    if k != 2.0:
        best = _stationary(along, square, k, price, low, high, best)
    speed = min(max(math.sqrt(best * best + square), polar.least), polar.speed)
    return speed, polar.scale * (along + best) / (speed**k + price)


@kernel
def _stationary(
    along: float, square: float, k: float, price: float, low: float, high: float, best: float
) -> float:
    """W between two limits (m/s) at which the cost a metre is least, by Newton's iteration.

    It begins at the `best` guess.
    Its slope, times (a + W)², is rising in W: a bracket keeps the steps in.
    """
    top, bottom = high, low
    for _ in range(_MAX_STEPS):
        speed = best * best + square
        power = speed ** (k / 2 - 1) if speed > 0.0 else 0.0
        slope = k * best * power
        residual = slope * (along + best) - power * speed - price
        if residual > 0.0:
            top = best
        else:
            bottom = best
        if best == high and residual <= 0.0:
            return high
        if best == low and residual >= 0.0:
            return low
        bend = k * power * (1.0 + (k - 2.0) * best * best / speed) if speed > 0.0 else 0.0
        curve = bend * (along + best)
        towards = low if residual > 0.0 else high
        following = best - residual / curve if curve > 0.0 else towards
        if following <= low and bottom == low:
            following = low
        elif following >= high and top == high:
            following = high
        elif not bottom < following < top:
            following = (bottom + top) / 2
        if abs(following - best) <= _SETTLED * high:
            return following
        best = following
    return best


@kernel
def ground_speeds(
    velocity: FloatArray, tangent: FloatArray, speed: FloatArray, crab: bool
) -> FloatArray:
    """Speeds over ground (n,) along unit tangents (n, 2) in currents (n, 2), m/s.

    At speeds through water (n,), m/s.
    """
    speeds = np.empty(len(velocity))
    for k in range(len(velocity)):
        polar = sailing_at(speed[k], crab, 0.0)
        speeds[k] = ground_speed(
            velocity[k, 0], velocity[k, 1], tangent[k, 0], tangent[k, 1], polar
        )
    return speeds


def made_good(velocity: FloatArray, tangent: FloatArray, polar: Polar) -> FloatArray:
    """What a polar makes (...) along unit tangents (..., 2) in currents (..., 2), m/s."""
    return _at_choice(velocity, tangent, polar)[1]


def chosen_speeds(velocity: FloatArray, tangent: FloatArray, polar: Polar) -> FloatArray:
    """Speeds through water (...) of least cost along unit tangents in currents (..., 2), m/s.

    Without a choice it is the polar's own.
    """
    if polar.least >= polar.speed:
        return np.full(np.broadcast_shapes(velocity.shape, tangent.shape)[:-1], polar.speed)
    return _at_choice(velocity, tangent, polar)[0]


def _at_choice(
    velocity: FloatArray, tangent: FloatArray, polar: Polar
) -> tuple[FloatArray, FloatArray]:
    """Speeds through water (...) and what the polar makes (...), m/s."""
    velocity, tangent = np.broadcast_arrays(velocity, tangent)
    speed, made = _chosen_speeds(
        for_kernels(velocity.reshape(-1, 2)), for_kernels(tangent.reshape(-1, 2)), polar
    )
    shape = velocity.shape[:-1]
    return speed.reshape(shape), made.reshape(shape)


@kernel
def _chosen_speeds(
    velocity: FloatArray, tangent: FloatArray, polar: Polar
) -> tuple[FloatArray, FloatArray]:
    """Speeds (n,) through water and over ground, m/s, where the vessel has a choice."""
    speed, made = np.empty(len(velocity)), np.empty(len(velocity))
    for i in range(len(velocity)):
        (u, v), (tx, ty) = velocity[i], tangent[i]
        across = v * tx - u * ty if polar.crab else 0.0
        speed[i], made[i] = _chosen_speed(u * tx + v * ty, across, polar)
    return speed, made
