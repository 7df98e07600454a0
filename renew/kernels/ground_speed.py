"""Speed over ground along a course in a current: the denominator of Eq. 4, in both drift models.

If the vessel chooses its speed through water v, and each second costs μ, a metre costs the least of
(R(v) + μ) / g, where g is the speed over ground, and R is vᵏ or another convex law of fuel that
rises (:mod:`renew.kernels.fuel_law`). With the inverse of this cost in place of g, every search for
the fastest path finds the cheapest one. Let a be the current along the course, x across it (0 in
the projected model), and W = √(v² - x²). Then g is a + W, and R is convex in W, too. So the cost
has one minimum, where dR/dW (a + W) = R + μ. For v², without a hotel load, that is
W = -a + √(a² + x² + μ).
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import for_kernels, kernel, small_kernel
from renew._types import FloatArray
from renew.kernels.fuel_law import FuelLaw, effort, in_way

# Largest number of Newton's iterations.
_MAX_STEPS = 40
# Change of W below which an iteration is the last one, as a share of the highest W.
_SETTLED = 1e-8


class Polar(NamedTuple):
    """What the vessel "makes" on a course: its speed over ground (m/s), or what takes its place.

    `crab` is True for the exact model, in which the vessel heads into the cross-current, and False
    for the projected one, as published. If `least` is below `speed`, the vessel chooses its speed v
    through water between the two. Then `price` is μ, R is the fuel `law`, and the vessel "makes"
    `scale` divided by the least (R(v) + μ) / g. `still` is the v that would be best in still water
    if there were no `least`. If `speed` is below the vessel's highest speed, `no_go` is the highest
    speed (m/s): the vessel may cross currents weaker than `no_go`.
    """

    speed: float
    crab: bool
    least: float = math.inf
    price: float = 0.0
    law: FuelLaw = FuelLaw()
    scale: float = 1.0
    still: float = 0.0
    no_go: float = 0.0


@small_kernel
def sailing_at(speed: float, crab: bool, most: float, law: FuelLaw) -> Polar:
    """Return the polar at a speed through water (m/s) below the vessel's highest one."""
    return Polar(speed, crab, math.inf, 0.0, law, 1.0, 0.0, most)


def choosing(speed: float, *, crab: bool, least: float, price: float, law: FuelLaw) -> Polar:
    """Return the polar of a vessel with speeds from `least` to `speed`, if a second costs μ.

    It is scaled to "make" `speed` in still water, as a vessel without a choice does.
    """
    best, exponent = speed, law.exponent
    if exponent > 1:
        best = ((price + law.hotel) / (exponent - 1)) ** (1 / exponent)
    polar = Polar(speed, crab, least, price, law, 1.0, min(best, speed))
    return polar._replace(scale=speed / ground_speed(0.0, 0.0, 1.0, 0.0, polar))


@small_kernel
def ground_speed(cx: float, cy: float, tx: float, ty: float, polar: Polar) -> float:
    """Return what the vessel "makes" along the unit tangent t in the current c, m/s."""
    if polar.least < polar.speed:
        across = cy * tx - cx * ty if polar.crab else 0.0
        return _chosen_speed(cx * tx + cy * ty, across, polar)[1]
    return made_at(cx, cy, tx, ty, polar.speed, polar.crab)


@small_kernel
def made_at(cx: float, cy: float, tx: float, ty: float, speed: float, crab: bool) -> float:
    """Return the speed over ground along the unit tangent t in the current c at a speed v, m/s.

    Projected: v + c·t. Crab: c·t + √(v² - |c - (c·t)t|²). Not positive where the vessel can't make
    way in that direction, and NaN where it can't even hold the course.
    """
    along = cx * tx + cy * ty
    if not crab:
        return along + speed
    across = cy * tx - cx * ty
    square = speed * speed - across * across
    return along + math.sqrt(square) if square >= 0.0 else math.nan


@kernel
def _chosen_speed(along: float, across: float, polar: Polar) -> tuple[float, float]:
    """Return the cheapest speed through water (m/s), and what it "makes" (:class:`Polar`).

    `along`, `across`: parts of the current, m/s. If no speed makes way, the highest is given.
    """
    k, price = polar.law.exponent, polar.price
    square = across * across
    most = polar.speed * polar.speed - square
    if most < 0.0:
        return polar.speed, math.nan
    high = math.sqrt(most)
    low = math.sqrt(max(polar.least * polar.least - square, 0.0))
    if along + high <= 0.0:
        return polar.speed, along + high
    # Below `low` the cost is infinite, or the speed too low. As the cost has one minimum, a best W
    # outside the limits is replaced by the nearer limit.
    low = max(low, -along)
    worth = price + polar.law.hotel if k == 2.0 else polar.still * polar.still
    best = min(max(math.sqrt(along * along + square + worth) - along, low), high)
    if k != 2.0:
        best = _stationary(along, square, polar, low, high, best)
    speed = min(max(math.sqrt(best * best + square), polar.least), polar.speed)
    return speed, polar.scale * (along + best) / (effort(speed, polar.law) + price)


@kernel
def _stationary(
    along: float, square: float, polar: Polar, low: float, high: float, best: float
) -> float:
    """Return the W (m/s) between two limits at which a metre costs least, by Newton's iteration.

    It begins at the `best` guess. The slope of the cost, times (a + W)², rises with W, so a bracket
    around the minimum can limit the steps.
    """
    top, bottom = high, low
    tried_low = tried_high = False
    for _ in range(_MAX_STEPS):
        burnt, slope, bend = in_way(best, square, polar.law)
        residual = slope * (along + best) - burnt - polar.price
        tried_low, tried_high = tried_low or best == low, tried_high or best == high
        if residual > 0.0:
            top = best
        else:
            bottom = best
        if best == high and residual <= 0.0:
            return high
        if best == low and residual >= 0.0:
            return low
        curve = bend * (along + best)
        towards = low if residual > 0.0 else high
        following = best - residual / curve if curve > 0.0 else towards
        if following <= low and bottom == low and not tried_low:
            following = low
        elif following >= high and top == high and not tried_high:
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
    """Return speeds over ground (n,), m/s, along unit tangents (n, 2) in currents (n, 2).

    `speed` (n,), m/s, is through water.
    """
    speeds = np.empty(len(velocity))
    for k in range(len(velocity)):
        speeds[k] = made_at(
            velocity[k, 0], velocity[k, 1], tangent[k, 0], tangent[k, 1], speed[k], crab
        )
    return speeds


def made_good(velocity: FloatArray, tangent: FloatArray, polar: Polar) -> FloatArray:
    """Return what the vessel "makes" (...), m/s, along tangents (..., 2) in currents (..., 2)."""
    return _at_choice(velocity, tangent, polar)[1]


def chosen_speeds(velocity: FloatArray, tangent: FloatArray, polar: Polar) -> FloatArray:
    """Return speeds through water (...) of least cost along tangents in currents (..., 2), m/s.

    If there is no choice, they are all the polar's own speed.
    """
    if polar.least >= polar.speed:
        return np.full(np.broadcast_shapes(velocity.shape, tangent.shape)[:-1], polar.speed)
    return _at_choice(velocity, tangent, polar)[0]


def _at_choice(
    velocity: FloatArray, tangent: FloatArray, polar: Polar
) -> tuple[FloatArray, FloatArray]:
    """Return speeds through water (...) and what the vessel "makes" at them (...), m/s."""
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
    """Return chosen speeds through water (n,), and what the vessel "makes" at them (n,), m/s."""
    speed, made = np.empty(len(velocity)), np.empty(len(velocity))
    for i in range(len(velocity)):
        (u, v), (tx, ty) = velocity[i], tangent[i]
        across = v * tx - u * ty if polar.crab else 0.0
        speed[i], made[i] = _chosen_speed(u * tx + v * ty, across, polar)
    return speed, made
