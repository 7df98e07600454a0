"""Choose speeds through water along a given path, for least fuel until a deadline.

In a steady current, legs depend on each other only through the remaining time. With a price λ of
time, the Lagrange multiplier of the deadline, the best speed at each place has the least
(R(v) + λ) / g, with the fuel rate R. The duration falls as λ rises, so least fuel has the λ that
just meets the deadline, or 0 if time is free.

The best speed changes from place to place. So the path is cut into legs in which this speed changes
little. Each leg gets the mean of its speeds, at a price that meets the deadline with these means.

In a changing current least fuel is first searched over places and times together, which finds the
right tide. Then the speeds are improved (both: :mod:`renew.kernels.cheapest_speeds`), and an
augmented Lagrangian keeps the deadline (Nocedal & Wright, Numerical Optimization, 2006, 17.3); its
multiplier is the price of time at the end. Everything uses the current's table.

In a steady current the price of time is constant along the path. In a changing current it varies,
because a later passage meets another current: it may pay to slow down and let a tide turn, or to
hurry and catch it. At last neighbouring legs with similar speeds are joined, and their speeds are
improved until the current itself, not only its table, meets the deadline.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from renew._compiled import for_kernels
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.cheapest_speeds import (
    Chain,
    CostModel,
    Rows,
    SailedLegs,
    SpeedProblem,
    cheapest_chain,
    cheapest_speeds,
    sailed,
)
from renew.kernels.fuel_law import efforts, exponent_near, marginal
from renew.kernels.ground_speed import chosen_speeds, sailing_at
from renew.kernels.viterbi import Stream, arrivals
from renew.voyage.fuel import WITHIN, Pieces, ground_speed, passage
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
    # Prices for which the best speeds in still water are evenly spaced, by a power of the speed; a
    # hotel load is a price of time, too.
    vessel, (exponent, hotel, nodes) = voyage.vessel, voyage.vessel.law
    power = vessel.fuel_exponent if len(nodes) else exponent
    highest = way.highest_price + hotel
    still = np.linspace(1.0, (hotel / highest) ** (1 / power), _PRICES) ** power
    prices = np.maximum(highest * still - hotel, 0.0)
    points = [way.cost(way.speeds(price)) for price in prices.tolist()]
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
        speed, law = self._voyage.vessel.speed, self._voyage.vessel.law
        made = self._made(np.array(speed))
        along = (self._velocity * self._tangent).sum(axis=-1)
        # Derivative of speed over ground by speed through water: v / √(v² - c⊥²), or 1.
        gain = speed / (made - along) if self._voyage.drift == "crab" else np.ones(made.shape)
        burnt = float(efforts(speed, law))
        highest = marginal(speed, law) * made / gain - burnt
        return float(np.nanmax(highest, initial=burnt)) * (1 + 1e-6)

    def speeds(self, price: float) -> FloatArray:
        """Return the cheapest speeds (p, 4), m/s, at the nodes, at a price of time over α."""
        price_of_time = price * self._voyage.vessel.fuel_coefficient
        polar = replace(self._voyage, price=price_of_time).polar
        return chosen_speeds(self._velocity, self._tangent, polar)

    def time(self, speeds: FloatArray) -> float:
        """Return the duration (s) at speeds (p, 4) through water."""
        return float(self._total(self._slowness(speeds)).sum())

    def cost(self, speeds: FloatArray) -> tuple[float, float]:
        """Return duration (s) and fuel at speeds (p, 4)."""
        slowness, vessel = self._slowness(speeds), self._voyage.vessel
        fuel = self._total(slowness * efforts(speeds, vessel.law)).sum()
        return float(self._total(slowness).sum()), vessel.fuel_coefficient * float(fuel)

    def legs(self, speeds: FloatArray) -> IntArray:
        """Return the leg (p,) of each piece: straight, of similar speeds."""
        return alike_legs(speeds.min(axis=1), speeds.max(axis=1), self._pieces.leg)

    def leg_speeds(self, legs: IntArray, price: float) -> FloatArray:
        """Return each leg's speed (l,), m/s: the mean over time of the cheapest speeds."""
        speeds = self.speeds(price)
        slowness = self._slowness(speeds)
        first = np.flatnonzero(np.diff(legs, prepend=-1))
        way = np.add.reduceat(self._total(slowness * speeds), first)
        return np.asarray(way / np.add.reduceat(self._total(slowness), first))

    def profile(self, speeds: FloatArray, legs: IntArray) -> SpeedProfile:
        """Return the profile at one speed per leg (p,) of the pieces."""
        pieces, voyage = self._pieces, self._voyage
        taken = self._total(self._slowness(speeds[legs][:, None]))
        first = np.flatnonzero(np.diff(legs, prepend=-1))
        # The place where a piece begins is computed back from its first node.
        step = pieces.length[first, None] * pieces.tangent[first, 0]
        begin = pieces.points[first, 0] - WITHIN[0] * step
        # Legs that begin at the path's own points do so exactly.
        own = np.flatnonzero(np.diff(pieces.leg[first], prepend=-1))
        begin[own] = self._path[pieces.leg[first[own]]]
        time = np.add.reduceat(taken, first)
        vessel = voyage.vessel
        fuel = vessel.fuel_coefficient * (time * efforts(speeds, vessel.law)).sum()
        times = voyage.departure + np.concatenate([[0.0], np.cumsum(time)])
        path = np.concatenate([begin, self._path[-1:]])
        return SpeedProfile(path, speeds, times, float(fuel), math.inf)

    def _slowness(self, speeds: FloatArray) -> FloatArray:
        """Return seconds per true metre (p, 4) at speeds through water; inf if no way is made."""
        made = self._made(speeds)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(made > 0, 1 / made, np.inf)

    def _total(self, a_metre: FloatArray) -> FloatArray:
        """Return the integral over each piece (p,) of a quantity per true metre (p, 4)."""
        return self._pieces.total(a_metre, self._voyage.chart)

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


# Least number of rows of a path.
_ROWS = 96
# Largest number of rows of a path.
_MAX_ROWS = 400
# Number of clock steps between two rows.
_STEPS_A_ROW = 3.0
# Number of times at which the least fuel is known in a row.
_TIMES = 48
# Least width of a window of times, as a share of the duration at the highest speed.
_NARROWEST = 1e-6
# Price of lateness, as a multiple of k vᵏ at the highest speed v (with the k that the law is near
# it): so high that lateness never pays.
_LATE = 3.0
# Largest number of rounds to find the multiplier.
_ROUNDS = 12
# Lateness that is allowed when the multiplier changes for the first time, as a share of the
# duration.
_FIRST_LATE = 0.02
# The same when it changes for the last time.
_LATE_AT_LAST = 1e-7
# Number of constant speeds tried.
_CONSTANT = 24
# Number of halvings, between two of these, to find the slowest speed that is in time.
_HALVINGS = 30


class TimedPath:
    """A path cut into rows or, `as_it_is`, with its own points as rows. Fuel is divided by α.

    `rows` (r + 1, 2), m; `own_leg` (r,) is the path's leg between each pair of rows.
    """

    def __init__(self, path: FloatArray, voyage: Voyage, *, as_it_is: bool = False) -> None:
        self._voyage = voyage
        legs = np.diff(path, axis=0)
        lengths = np.linalg.norm(legs, axis=1)
        length, step = lengths.sum(), _STEPS_A_ROW * voyage.clock.step
        longest = length if as_it_is else max(min(length / _ROWS, step), length / _MAX_ROWS)
        pieces = np.maximum(1, np.ceil(lengths / longest).astype(int))
        leg = np.repeat(np.arange(len(legs)), pieces)
        place = (np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[leg]
        self.own_leg: IntArray = leg
        self.rows = for_kernels(np.vstack([path[leg] + place[:, None] * legs[leg], path[-1:]]))

    @property
    def every(self) -> IntArray:
        """The leg (r,) of each piece between two rows, if each piece is a leg of its own."""
        return np.arange(len(self.own_leg))

    def costs(self, deadline: float = math.inf) -> CostModel:
        """Return the cost model, with a deadline (s) or with the last useful arrival."""
        vessel, voyage = self._voyage.vessel, self._voyage
        return CostModel(
            voyage.table,
            vessel.speed,
            voyage.drift == "crab",
            vessel.law,
            voyage.clock.step,
            min(deadline, self.last_arrival),
            _LATE * exponent_near(vessel.speed, vessel.law) * self._effort(vessel.speed),
        )

    def arrivals(self, speed: float) -> FloatArray:
        """Return the times (r + 1,), s, at the rows at a constant speed (m/s)."""
        voyage, vessel = self._voyage, self._voyage.vessel
        polar = sailing_at(speed, voyage.drift == "crab", vessel.speed, vessel.law)
        return np.asarray(arrivals(self.rows, Stream(voyage.table, polar, voyage.clock)))

    @cached_property
    def constant(self) -> tuple[float, float]:
        """Return the constant speed (m/s) of least fuel that is in time, and its fuel.

        If no speed is in time, it is the highest.
        """
        deadline, (least, most) = self._voyage.deadline, self.speeds
        tried = np.geomspace(most, least, _CONSTANT).tolist()
        found = [self._at_constant(speed) for speed in tried]
        # The slowest speed that is just in time lies between two of the tried ones.
        for at in np.flatnonzero(np.diff([arrival <= deadline for arrival, _ in found])).tolist():
            low, high = tried[at + 1], tried[at]
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                is_late = self._at_constant(middle)[0] > deadline
                low, high = (middle, high) if is_late else (low, middle)
            tried.append(high)
            found.append(self._at_constant(high))
        fuels = [fuel if arrival <= deadline else math.inf for arrival, fuel in found]
        best = int(np.argmin(fuels))
        return tried[best], found[best][1]

    def _at_constant(self, speed: float) -> tuple[float, float]:
        """Return arrival (s) and fuel at a constant speed (m/s)."""
        arrival = float(self.arrivals(speed)[-1])
        under_way = arrival - self._voyage.departure
        return arrival, under_way * self._effort(speed)

    def _effort(self, speed: float) -> float:
        """Return fuel a second over α at a speed (m/s)."""
        return float(efforts(speed, self._voyage.vessel.law))

    @cached_property
    def last_arrival(self) -> float:
        """Return the time (s) after which no voyage of least fuel arrives, without a deadline.

        Even at the lowest speed, a longer voyage burns more than a known one.
        """
        voyage = self._voyage
        slowest = voyage.departure + self.constant[1] / self._effort(voyage.least_speed)
        return float(min(slowest, voyage.current.span[1]))

    def chain(self, deadline: float) -> Chain:
        """Return the chain of least fuel over places and times that meets a deadline (s)."""
        rows = len(self.rows)
        early, late = self.window(deadline)
        clear = np.ones((rows - 1, 1, 1), dtype=np.bool_)
        every = np.tile(self.speeds, (rows - 1, 1))
        points = self.rows[:, None].copy()
        return self.cheapest(points, clear, np.linspace(early, late, _TIMES).T, every, deadline)

    def cheapest(
        self,
        points: FloatArray,
        clear: BoolArray,
        times: FloatArray,
        speeds: FloatArray,
        deadline: float,
    ) -> Chain:
        """Return the chain of least fuel over points (r + 1, m, 2), if legs (r, m, m) are clear.

        Least fuel is computed at `times` (r + 1, q), s; `speeds` (r, 2), m/s, are each leg's
        limits.
        """
        times[0] = self._voyage.departure
        rows = Rows(for_kernels(points), clear, for_kernels(times), for_kernels(speeds))
        return Chain(*cheapest_chain(rows, self.costs(deadline)))

    @property
    def can_be_made(self) -> bool:
        """Whether the highest speed reaches the end, by the table of the current."""
        return math.isfinite(self.arrivals(self.speeds[1])[-1])

    @property
    def speeds(self) -> tuple[float, float]:
        """Lowest and highest speed (m/s)."""
        return self._voyage.least_speed, self._voyage.vessel.speed

    def window(self, deadline: float) -> tuple[FloatArray, FloatArray]:
        """Return the earliest and latest times (r + 1,), s, at the rows that meet a deadline."""
        least, most = self.speeds
        early = self.arrivals(most)
        slack = max(min(deadline, self.last_arrival) - early[-1], 0.0)
        late = np.minimum(early + slack, self.arrivals(least))
        return early, np.maximum(late, early + _NARROWEST * (early[-1] - early[0]))

    def sailed(self, speeds: FloatArray) -> SailedLegs:
        """Sail the rows at speeds (r,), m/s."""
        voyage = self._voyage
        return SailedLegs(*sailed(self.rows, speeds, voyage.departure, self.costs()))

    def fuel(self, speeds: FloatArray) -> float:
        """Return the fuel at speeds (r,), m/s."""
        burnt = efforts(speeds, self._voyage.vessel.law)
        return float((burnt * np.diff(self.sailed(speeds).times)).sum())

    def least_fuel(
        self,
        speeds: FloatArray,
        legs: IntArray,
        deadline: float,
        price: float = math.nan,
        rounds: int = _ROUNDS,
    ) -> tuple[FloatArray, float]:
        """Return speeds (l,) of legs (r,) with least fuel, near given ones, and the price of time.

        The price, also the first guess, is divided by α. Post-condition: the end is reached nearly
        by the deadline, if that is possible and the rounds are enough.
        """
        law, (least, most) = self._voyage.vessel.law, self.speeds
        first = np.flatnonzero(np.diff(legs, prepend=-1))
        if not math.isfinite(self.sailed(speeds[legs]).times[-1]):
            # Too slow for some water: begin at the highest speed.
            speeds = np.full(len(speeds), most)
        times = np.diff(self.sailed(speeds[legs]).times)
        total = float(times.sum())
        if not math.isfinite(total):
            return speeds, exponent_near(most, law) * self._effort(most)
        mean = float((speeds[legs] * times).sum() / total)
        # In these units a change of any leg's speed costs about the same.
        scale = np.sqrt(np.maximum(np.add.reduceat(times, first) / total, 1e-12))
        unit = self._effort(mean) * total
        usual = max(exponent_near(mean, law) - 1, 0.1) * self._effort(mean)
        price = usual if math.isnan(price) else price
        stiffness = usual / (_FIRST_LATE * total)
        low, high = least * scale, most * scale
        for _ in range(rounds):
            problem = SpeedProblem(
                self.rows,
                legs,
                scale,
                low,
                high,
                self._voyage.departure,
                self.costs(),
                deadline,
                price,
                stiffness,
                unit,
            )
            speeds = cheapest_speeds(problem, np.clip(speeds * scale, low, high)) / scale
            late = float(self.sailed(speeds[legs]).times[-1]) - deadline
            before, price = price, max(0.0, price + stiffness * late)
            if abs(late) <= _LATE_AT_LAST * total or before == price == 0:
                break
        return speeds, price


# Number of rounds that adjust the deadline in the table, so that the vessel meets its own deadline
# in the current itself.
_CLOCK_ROUNDS = 6
# How early the vessel may arrive, as a share of the duration.
_EARLY_BY_CLOCK = 1e-6
# Number of arrivals for which a trade-off is computed.
_ARRIVALS = 13
# Number of rounds to find the multiplier for each of them.
_QUICK_ROUNDS = 2
# Number of arrivals at which the trade-off is returned.
_GIVEN = 97


def speeds_by_clock(path: FloatArray, voyage: Voyage) -> SpeedProfile:
    """Return the speeds of least fuel along a path (n, 2) that meet the voyage's deadline.

    Post-condition: the arrival is not after the deadline, unless the fuel is infinite.
    """
    way = TimedPath(path, voyage)
    most = np.full(len(path) - 1, voyage.vessel.speed)
    fastest = _flown(path, most, voyage)
    if not (math.isfinite(fastest.arrival) and fastest.arrival <= voyage.deadline):
        return fastest._replace(fuel=math.inf)
    if not voyage.has_choice or not way.can_be_made:
        return fastest
    speeds, price = way.least_fuel(way.chain(voyage.deadline).speeds, way.every, voyage.deadline)
    legs = alike_legs(speeds, speeds, way.own_leg)
    first = np.flatnonzero(np.diff(legs, prepend=-1))
    corners = np.vstack([way.rows[first], path[-1:]])
    time = np.diff(way.sailed(speeds).times)
    speeds = np.add.reduceat(time * speeds, first) / np.add.reduceat(time, first)
    # The profile at the highest speed has a finite price, too: any one gives a lower bound on fuel.
    vessel = voyage.vessel
    usual = exponent_near(vessel.speed, vessel.law) * vessel.fuel_rate
    target, least = voyage.deadline, fastest._replace(price=usual)
    for _ in range(_CLOCK_ROUNDS):
        speeds, price = way.least_fuel(speeds, legs, target, price)
        price_of_time = price * vessel.fuel_coefficient
        found = _flown(corners, speeds, voyage)._replace(price=price_of_time)
        late = found.arrival - voyage.deadline
        if late <= 0 and found.fuel < least.fuel:
            least = found
        under_way = found.arrival - voyage.departure
        if late <= 0 and (price == 0 or late >= -_EARLY_BY_CLOCK * under_way):
            break
        # The table differs a little from the current.
        target -= late + _EARLY_BY_CLOCK / 2 * under_way
    return least


def constant_speed(path: FloatArray, voyage: Voyage) -> float:
    """Return the constant speed (m/s) along a path that needs least fuel and arrives in time.

    If no speed arrives in time, it is the highest. Arrivals are by the current itself.
    """
    deadline = voyage.deadline
    for _ in range(_CLOCK_ROUNDS):
        speed = TimedPath(path, replace(voyage, deadline=deadline)).constant[0]
        late = _flown(path, np.full(len(path) - 1, speed), voyage).arrival - voyage.deadline
        if not late > 0 or speed == voyage.vessel.speed:
            break
        # The table differs a little from the current.
        deadline -= late * (1 + _EARLY_BY_CLOCK)
    return speed


def trade_off_by_clock(path: FloatArray, voyage: Voyage) -> tuple[FloatArray, FloatArray]:
    """Return ascending arrivals (m,), s, and the least fuel (m,) for each along a path (n, 2).

    They range from the highest speed to the arrival after which more time saves no fuel.
    """
    way, vessel = TimedPath(path, voyage), voyage.vessel
    if not way.can_be_made:
        flown = _flown(path, np.full(len(path) - 1, vessel.speed), voyage)
        return np.array([flown.arrival]), np.array([flown.fuel])
    fastest = np.full(len(way.own_leg), vessel.speed)
    earliest = float(way.sailed(fastest).times[-1])
    if not voyage.has_choice:
        return np.array([earliest]), np.array([vessel.fuel_coefficient * way.fuel(fastest)])
    # The latest useful arrival: time is free there.
    slowest, _ = way.least_fuel(way.chain(math.inf).speeds, way.every, way.last_arrival)
    latest = float(way.sailed(slowest).times[-1])
    begun = voyage.departure
    if latest - earliest <= _EARLY_BY_CLOCK * (earliest - begun):
        return np.array([earliest]), np.array([vessel.fuel_coefficient * way.fuel(slowest)])
    from scipy.interpolate import PchipInterpolator

    # Evenly spaced in speed.
    deadlines = begun + 1 / np.linspace(1 / (earliest - begun), 1 / (latest - begun), _ARRIVALS)
    fuels = [way.fuel(fastest)]
    for deadline in deadlines[1:-1].tolist():
        first = way.chain(deadline).speeds
        found, price = way.least_fuel(first, way.every, deadline, rounds=_QUICK_ROUNDS)
        late = float(way.sailed(found).times[-1]) - deadline
        fuels.append(way.fuel(found) + price * late)
    fuels.append(way.fuel(slowest))
    arrivals = np.linspace(deadlines[0], deadlines[-1], _GIVEN)
    curve = PchipInterpolator(deadlines, np.minimum.accumulate(fuels))
    return arrivals, vessel.fuel_coefficient * np.asarray(curve(arrivals))


def _flown(path: FloatArray, speeds: FloatArray, voyage: Voyage) -> SpeedProfile:
    """Return a path (n, 2) sailed at speeds (n - 1,) in the current itself."""
    vessel = voyage.vessel
    passed = passage(
        path,
        voyage.current,
        vessel,
        speeds=speeds,
        drift=voyage.drift,
        departure=voyage.departure,
        chart=voyage.chart,
    )
    at_points = passed.at_points
    rate = vessel.rates(speeds)
    fuel = float((rate * np.diff(at_points)).sum()) if math.isfinite(at_points[-1]) else math.inf
    return SpeedProfile(path, speeds, at_points, fuel, math.inf)
