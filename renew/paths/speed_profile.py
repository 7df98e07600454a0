"""Choose speeds through water along a given path, for least fuel until a deadline.

In a steady current, legs depend on each other only through the remaining time. With a price λ of
time, the Lagrange multiplier of the deadline, the best speed at each place has the least
(α vᵏ + λ) / g. The duration falls as λ rises, so least fuel has the λ that just meets the deadline,
or 0 if time is free.

The best speed changes from place to place. So the path is cut into legs in which this speed changes
little. Each leg gets the mean of its speeds, at a price that meets the deadline with these means.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from renew._types import FloatArray, IntArray
from renew.kernels.ground_speed import chosen_speeds
from renew.voyage.fuel import WITHIN, Pieces, ground_speed
from renew.voyage.voyage import Voyage

# Ratio of the highest to the lowest speed within a leg: costs less than 0.05 % more fuel.
_SAME_SPEED = 1.04
# Largest number of steps to find a price.
_PRICE_STEPS = 60
# How early a vessel may arrive at the price that is found, as a share of the duration.
_EARLY = 1e-9
# Number of prices for which a trade-off is computed.
_PRICES = 97


class SpeedProfile(NamedTuple):
    """A path (n, 2) with the speed (n - 1,), m/s, of each leg, and its fuel.

    `times` (n,), s, are the times at its points. Fuel is infinite if even the highest speed is too
    late. `price` is the price of time (fuel units a second), infinite at the highest speed.
    """

    path: FloatArray
    speeds: FloatArray
    times: FloatArray
    fuel: float
    price: float

    @property
    def arrival(self) -> float:
        """Time at the end of the path (s)."""
        return float(self.times[-1])


def speed_profile(path: FloatArray, voyage: Voyage) -> SpeedProfile:
    """Return the speeds of least fuel along a path (n, 2) that meet the voyage's deadline.

    Post-condition: the arrival is not after the deadline, unless the fuel is infinite.
    """
    way = _SteadyPath(path, voyage)
    at_most = way.profile(np.full(len(path) - 1, voyage.vessel.speed), way.own_legs)
    if at_most.arrival > voyage.deadline:
        return at_most._replace(fuel=math.inf)
    if not voyage.has_choice:
        return at_most
    limit = voyage.deadline - voyage.departure
    price = _least_price(lambda price: way.time(way.speeds(price)), limit, way.highest_price)
    legs = way.legs(way.speeds(price))

    def time_by_legs(price: float) -> float:
        return way.time(way.leg_speeds(legs, price)[legs][:, None])

    price = _least_price(time_by_legs, limit, way.highest_price, price)
    found = way.profile(way.leg_speeds(legs, price), legs)
    return found._replace(price=price * voyage.vessel.fuel_coefficient)


def trade_off(path: FloatArray, voyage: Voyage) -> tuple[FloatArray, FloatArray]:
    """Return ascending arrivals (m,), s, and the least fuel (m,) for each along a path (n, 2).

    They range from the highest speed to the arrival after which more time saves no fuel.
    """
    way = _SteadyPath(path, voyage)
    if not voyage.has_choice:
        only = way.profile(np.full(len(path) - 1, voyage.vessel.speed), way.own_legs)
        return only.times[-1:], np.array([only.fuel])
    # Prices for which the best speeds in still water are evenly spaced.
    vessel = voyage.vessel
    still = np.linspace(1.0, 0.0, _PRICES) ** vessel.fuel_exponent
    points = [way.cost(way.speeds(price)) for price in way.highest_price * still]
    times, fuels = np.array(points).T
    return voyage.departure + times, np.minimum.accumulate(fuels)


def alike_legs(low: FloatArray, high: FloatArray, own: IntArray) -> IntArray:
    """Return the leg (p,) of each piece, given its range of speeds and its `own` leg of the path.

    Speeds within a leg differ little, and a leg is straight.
    """
    leg = np.zeros(len(low), dtype=np.int64)
    least, most = low[0], high[0]
    for k in range(1, len(low)):
        least, most = min(least, low[k]), max(most, high[k])
        if most <= _SAME_SPEED * least and own[k] == own[k - 1]:
            leg[k] = leg[k - 1]
        else:
            leg[k], least, most = leg[k - 1] + 1, low[k], high[k]
    return leg


class _SteadyPath:
    """A path in a steady current, cut into pieces with a few nodes each."""

    def __init__(self, path: FloatArray, voyage: Voyage) -> None:
        self._path, self._voyage = path, voyage
        self._pieces = Pieces.of(path)
        velocity = voyage.current.velocity(self._pieces.points, voyage.departure)
        self._velocity, self._tangent = np.broadcast_arrays(velocity, self._pieces.tangent)

    @property
    def own_legs(self) -> IntArray:
        """The path's own leg (p,) that each piece belongs to."""
        return self._pieces.leg

    @property
    def highest_price(self) -> float:
        """Price, over α, from which the highest speed is best everywhere on the path."""
        speed, exponent = self._voyage.vessel.speed, self._voyage.vessel.fuel_exponent
        made = self._made(np.array(speed))
        along = (self._velocity * self._tangent).sum(axis=-1)
        # Derivative of speed over ground by speed through water: v / √(v² - c⊥²), or 1.
        gain = speed / (made - along) if self._voyage.drift == "crab" else np.ones(made.shape)
        highest = exponent * speed ** (exponent - 1) * made / gain - speed**exponent
        return float(np.nanmax(highest, initial=speed**exponent)) * (1 + 1e-6)

    def speeds(self, price: float) -> FloatArray:
        """Return the cheapest speeds (p, 4), m/s, at the nodes, at a price of time over α."""
        polar = self._voyage.at_price(price * self._voyage.vessel.fuel_coefficient).polar
        return chosen_speeds(self._velocity, self._tangent, polar)

    def time(self, speeds: FloatArray) -> float:
        """Return the duration (s) at speeds (p, 4) through water."""
        return float(self._pieces.total(self._slowness(speeds)).sum())

    def cost(self, speeds: FloatArray) -> tuple[float, float]:
        """Return duration (s) and fuel at speeds (p, 4)."""
        slowness, vessel = self._slowness(speeds), self._voyage.vessel
        fuel = self._pieces.total(slowness * speeds**vessel.fuel_exponent).sum()
        return float(self._pieces.total(slowness).sum()), vessel.fuel_coefficient * float(fuel)

    def legs(self, speeds: FloatArray) -> IntArray:
        """Return the leg (p,) of each piece: straight, of similar speeds."""
        return alike_legs(speeds.min(axis=1), speeds.max(axis=1), self._pieces.leg)

    def leg_speeds(self, legs: IntArray, price: float) -> FloatArray:
        """Return each leg's speed (l,), m/s: the mean over time of the cheapest speeds."""
        speeds = self.speeds(price)
        slowness = self._slowness(speeds)
        first = np.flatnonzero(np.diff(legs, prepend=-1))
        way = np.add.reduceat(self._pieces.total(slowness * speeds), first)
        return np.asarray(way / np.add.reduceat(self._pieces.total(slowness), first))

    def profile(self, speeds: FloatArray, legs: IntArray) -> SpeedProfile:
        """Return the profile at one speed per leg (p,) of the pieces."""
        pieces, voyage = self._pieces, self._voyage
        taken = pieces.total(self._slowness(speeds[legs][:, None]))
        first = np.flatnonzero(np.diff(legs, prepend=-1))
        # The place where a piece begins is computed back from its first node.
        step = pieces.length[first, None] * pieces.tangent[first, 0]
        begin = pieces.points[first, 0] - WITHIN[0] * step
        # Legs that begin at the path's own points do so exactly.
        own = np.flatnonzero(np.diff(pieces.leg[first], prepend=-1))
        begin[own] = self._path[pieces.leg[first[own]]]
        time = np.add.reduceat(taken, first)
        vessel = voyage.vessel
        fuel = vessel.fuel_coefficient * (time * speeds**vessel.fuel_exponent).sum()
        times = voyage.departure + np.concatenate([[0.0], np.cumsum(time)])
        path = np.concatenate([begin, self._path[-1:]])
        return SpeedProfile(path, speeds, times, float(fuel), math.inf)

    def _slowness(self, speeds: FloatArray) -> FloatArray:
        """Return seconds per metre (p, 4) at speeds through water, or inf if no way is made."""
        made = self._made(speeds)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(made > 0, 1 / made, np.inf)

    def _made(self, speeds: FloatArray) -> FloatArray:
        """Return speeds over ground (p, 4), m/s, at speeds through water."""
        return ground_speed(self._velocity, self._tangent, speeds, self._voyage.drift)


def _least_price(
    time: Callable[[float], float], limit: float, highest: float, guess: float = 0.0
) -> float:
    """Return the least price whose time (s), which falls as price rises, is within a limit (s).

    By the Illinois rule inside a bracket, near a guess if that is close.
    """
    low, high = 0.0, highest
    at_low, at_high = time(low) - limit, time(high) - limit
    if at_low <= 0:
        return low
    if at_high > 0:
        return high
    following = guess
    for _ in range(_PRICE_STEPS):
        if not low < following < high:
            # If the time is infinite, because the lowest speeds make no way, bisect.
            share = at_low / (at_low - at_high) if math.isfinite(at_low) else 0.5
            following = low + (high - low) * share
        at = time(following) - limit
        if at > 0:
            low, at_low, at_high = following, at, at_high / 2
        else:
            high, at_high, at_low = following, at, at_low / 2
            if -at <= _EARLY * limit:
                break
        if high - low <= 1e-14 * high:
            break
        following = math.nan
    return high
