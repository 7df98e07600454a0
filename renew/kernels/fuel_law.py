"""The law of fuel: what a vessel burns a second at a speed v through water, divided by its α.

It is vᵏ, or a power P(v) given at some speeds, and in addition a constant rate, the hotel load. At
a given speed the hotel load is only a factor of fuel. Where speeds are chosen it is a price of time
that each second has, whatever the price of an early arrival.

Between given points P is a quadratic spline, convex and rising as the points are (Schumaker, On
shape preserving quadratic spline interpolation, 1983): its slope is continuous, and linear between
nodes. Nodes are the points, and one between each two of them, where the slope is their chord's. At
a point the slope is that of a vⁿ, with the n that log P has by log v there, but between the slopes
of the chords beside it. So points on K vⁿ are nearly met between them, too.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from renew._compiled import for_kernels, kernel, small_kernel
from renew._types import FloatArray


class FuelLaw(NamedTuple):
    """Fuel a second over α: vᵏ + `hotel`, with k the `exponent`; by a table P(v) + `hotel`.

    The `nodes` (n, 3) of a table are speed, power and slope; the exponent is NaN then. A law
    without a table has none: were they `None`, every kernel would be compiled twice.
    """

    exponent: float = 2.0
    hotel: float = 0.0
    nodes: FloatArray = np.empty((0, 3))


@cache
def spline_nodes(points: tuple[tuple[float, float], ...]) -> FloatArray:
    """Return the nodes (n, 3) of the spline through points (v, P) above 0, convex and rising."""
    v, power = np.array(points).T
    width = np.diff(v)
    chord = np.diff(power) / width
    local = np.gradient(np.log(power), np.log(v), edge_order=2 if len(width) > 1 else 1)
    slope = np.clip(local * power / v, np.append(0.0, chord), np.append(chord, np.inf))
    bend = np.diff(slope)
    share = np.divide(slope[1:] - chord, bend, out=np.full(len(bend), 0.5), where=bend > 0)
    nodes = np.empty((2 * len(v) - 1, 3))
    nodes[::2] = np.column_stack([v, power, slope])
    up_to = share * width
    nodes[1::2] = np.column_stack(
        [v[:-1] + up_to, power[:-1] + (slope[:-1] + chord) / 2 * up_to, chord]
    )
    return for_kernels(nodes)


@small_kernel
def effort(speed: float, law: FuelLaw) -> float:
    """Return fuel a second over α at a speed through water (m/s)."""
    return _power(speed, law.exponent, law.nodes)[0] + law.hotel


@small_kernel
def effort_by_speed(speed: float, law: FuelLaw) -> float:
    """Return the derivative of :func:`effort` by speed."""
    return _power(speed, law.exponent, law.nodes)[1]


@small_kernel
def in_way(way: float, square: float, law: FuelLaw) -> tuple[float, float, float]:
    """Return :func:`effort` at v = √(way² + square), and its two derivatives by `way` (m/s)."""
    power, slope, bend = _power_in_way(way, square, law.exponent, law.nodes)
    return power + law.hotel, slope, bend


@small_kernel
def _power(speed: float, exponent: float, nodes: FloatArray) -> tuple[float, float, float]:
    """Return vᵏ or P(v), and its two derivatives by speed (m/s)."""
    if len(nodes) == 0:
        power = speed**exponent
        slope = exponent * power / speed
        return power, slope, (exponent - 1.0) * slope / speed
    last, k = len(nodes) - 2, 0
    while k < last and speed >= nodes[k + 1, 0]:
        k += 1
    width = nodes[k + 1, 0] - nodes[k, 0]
    bend = (nodes[k + 1, 2] - nodes[k, 2]) / width if width > 0.0 else 0.0
    beyond = speed - nodes[k, 0]
    slope = nodes[k, 2] + bend * beyond
    return nodes[k, 1] + (nodes[k, 2] + slope) / 2 * beyond, slope, bend


@small_kernel
def _power_in_way(
    way: float, square: float, exponent: float, nodes: FloatArray
) -> tuple[float, float, float]:
    """Return vᵏ or P(v) at v = √(way² + square), and its two derivatives by `way` (m/s)."""
    through = way * way + square
    if len(nodes) == 0:
        power = through ** (exponent / 2 - 1) if through > 0.0 else 0.0
        bend = 0.0
        if through > 0.0:
            bend = exponent * power * (1.0 + (exponent - 2.0) * way * way / through)
        return power * through, exponent * way * power, bend
    speed = math.sqrt(through)
    power, slope, bend = _power(speed, exponent, nodes)
    share = way / speed if speed > 0.0 else 1.0
    turning = slope * (1.0 - share * share) / speed if speed > 0.0 else 0.0
    return power, slope * share, bend * share * share + turning


def efforts(speeds: float | FloatArray, law: FuelLaw) -> FloatArray:
    """Return :func:`effort` (...) at speeds (...), m/s, or at one."""
    if len(law.nodes) == 0:
        return np.asarray(speeds**law.exponent + law.hotel)
    speeds = for_kernels(speeds)
    return np.asarray(_efforts(speeds.ravel(), law).reshape(speeds.shape))


@kernel
def _efforts(speeds: FloatArray, law: FuelLaw) -> FloatArray:
    """Return :func:`effort` (n,) at speeds (n,), m/s."""
    found = np.empty(len(speeds))
    for i in range(len(speeds)):
        found[i] = effort(speeds[i], law)
    return found


def marginal(speed: float, law: FuelLaw) -> float:
    """Return the derivative of :func:`effort` by speed, at a speed (m/s)."""
    if len(law.nodes) == 0:
        return float(law.exponent * speed ** (law.exponent - 1))
    return float(effort_by_speed(speed, law))


def exponent_near(speed: float, law: FuelLaw) -> float:
    """Return the k of the vᵏ, times a factor, that a law without hotel load is near a speed."""
    if len(law.nodes) == 0:
        return law.exponent
    return marginal(speed, law) * speed / (effort(speed, law) - law.hotel)
