"""Choose speeds along a given path for least fuel until a deadline, in a changing current.

In a steady current the price of time is constant along the path (:mod:`renew.paths.speed_profile`).
In a changing current the price varies, because a later passage meets another current: it may pay to
slow down and let a tide turn, or to hurry and catch it. The speeds come from
:mod:`renew.paths.timed_path`. Neighbouring legs with similar speeds are then joined, and their
speeds are improved until the current itself, not only its table, meets the deadline.
"""

import math

import numpy as np

from renew._types import FloatArray
from renew.paths.speed_profile import SpeedProfile, alike_legs
from renew.paths.timed_path import TimedPath
from renew.voyage.fuel import passage
from renew.voyage.voyage import Voyage

# Rounds that adjust the table's deadline so that the real current meets the real one, and largest
# early arrival, as a share of the duration.
_CLOCK_ROUNDS, _EARLY = 6, 1e-6
# Number of arrivals for which a trade-off is computed, rounds for each, and number of arrivals at
# which it is returned.
_ARRIVALS, _QUICK_ROUNDS, _GIVEN = 13, 2, 97


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
    # The highest speed has a price, too: any finite one gives a lower bound.
    vessel = voyage.vessel
    target, least = voyage.deadline, fastest._replace(price=vessel.fuel_exponent * vessel.fuel_rate)
    for _ in range(_CLOCK_ROUNDS):
        speeds, price = way.least_fuel(speeds, legs, target, price)
        price_of_time = price * vessel.fuel_coefficient
        found = _flown(corners, speeds, voyage)._replace(price=price_of_time)
        late = found.arrival - voyage.deadline
        if late <= 0 and found.fuel < least.fuel:
            least = found
        under_way = found.arrival - voyage.departure
        if late <= 0 and (price == 0 or late >= -_EARLY * under_way):
            break
        # The table differs a little from the current.
        target -= late + _EARLY / 2 * under_way
    return least


def constant_speed(path: FloatArray, voyage: Voyage) -> float:
    """Return the constant speed (m/s) along a path that needs least fuel and arrives in time.

    If no speed arrives in time, it is the highest. Arrivals are by the current itself.
    """
    deadline = voyage.deadline
    for _ in range(_CLOCK_ROUNDS):
        speed = TimedPath(path, voyage.due(deadline)).constant[0]
        late = _flown(path, np.full(len(path) - 1, speed), voyage).arrival - voyage.deadline
        if not late > 0 or speed == voyage.vessel.speed:
            break
        # The table differs a little from the current.
        deadline -= late * (1 + _EARLY)
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
    if latest - earliest <= _EARLY * (earliest - begun):
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
    drift, departure = voyage.drift, voyage.departure
    passed = passage(path, voyage.current, vessel, speeds=speeds, drift=drift, departure=departure)
    at_points = passed.at_points
    rate = vessel.fuel_coefficient * speeds**vessel.fuel_exponent
    fuel = float((rate * np.diff(at_points)).sum()) if math.isfinite(at_points[-1]) else math.inf
    return SpeedProfile(path, speeds, at_points, fuel, math.inf)
