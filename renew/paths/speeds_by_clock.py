"""Choose speeds along a given path for least fuel until a deadline, in a changing current.

In a steady current the price of time is constant along the path (:mod:`renew.paths.speed_profile`).
In a changing current the price varies, because a later passage meets another current: it may pay to
slow down and let a tide turn, or to hurry and catch it. The speeds come from
:mod:`renew.paths.timed_path`. Neighbouring legs with similar speeds are then joined, and their
speeds are improved until the current itself, not only its table, meets the deadline.

The path is then refined at these speeds on transversals, as in :mod:`renew.paths.least_fuel_path`,
but in windows of both place and time, which narrow from pass to pass. Fuel is minimised subject to
the deadline. The new path passes land as the given one does, or nearly so.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._types import FloatArray
from renew.kernels.capsules import capsules_near
from renew.kernels.cheapest_chain import legs_between
from renew.kernels.ground_speed import sailing_at
from renew.kernels.viterbi import Stream
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import BEND, MIN_SPACING, length_of, simplified
from renew.paths.refinement import Water, points_beside, with_transversals, without_detours
from renew.paths.speed_profile import SpeedProfile, alike_legs
from renew.paths.timed_path import TimedPath
from renew.voyage.fuel import passage
from renew.voyage.voyage import Voyage, shares

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


class _Pass(NamedTuple):
    """A pass over transversals: half-width and spacing (shares of the path), points on each.

    Legs beside a turn of more than `bend` (rad) are halved. In each row the least fuel is computed
    at `times` times, which span a share `leeway` of the possible times of passage.
    """

    window: float
    spacing: float
    points: int
    bend: float
    times: int
    leeway: float


_PASSES = (
    _Pass(0.1, 1 / 30, 9, math.inf, 24, 1.0),
    _Pass(0.03, 1 / 60, 7, math.inf, 14, 0.4),
    *(_Pass(0.012 * 0.42**step, 1 / 80, 7, BEND, 11, 0.2 * 0.6**step) for step in range(3)),
)


def path_by_clock(corridor: Corridor, profile: SpeedProfile) -> FloatArray:
    """Return a path (n, 2) near a profile's path; it nearly always needs less fuel.

    Post-condition: that of :func:`renew.paths.least_fuel_path.refined_path`, if the profile met it.
    """
    voyage = corridor.voyage
    closest = MIN_SPACING * voyage.vessel.turning_radius
    keep_whole = np.asarray(corridor.exempt.any(axis=1))
    mean = length_of(profile.path) / float(profile.times[-1] - profile.times[0])
    polar = sailing_at(min(mean, voyage.vessel.speed), voyage.drift == "crab", voyage.vessel.speed)
    water = Water(Stream(voyage.table, polar, voyage.clock), corridor.search_capsules)
    schedule = shares(profile.path), profile.times
    path = without_detours(profile.path, 2 * _PASSES[0].spacing * length_of(profile.path), water)
    best, least = path, math.inf
    for one in _PASSES:
        length = length_of(path)
        path = with_transversals(path, one.spacing * length, one.bend, closest, keep_whole)
        if len(path) < len(("start", "between", "goal")):
            break
        near = capsules_near(water.capsules, path, one.window * length)
        beside, exempt = water.near(near).capsules, corridor.exempt[:, near].copy()
        points = points_beside(path, one.window * length, one.points, beside)
        way = TimedPath(path, voyage, as_it_is=True)
        if not way.can_be_made:
            continue
        passed = np.interp(shares(path), *schedule)
        chain = way.cheapest(
            points,
            legs_between(points, beside, exempt),
            _times(way.window(voyage.deadline), passed, one, one.window * length / mean),
            np.tile(way.speeds, (len(path) - 1, 1)),
            voyage.deadline,
        )
        if not math.isfinite(chain.cost):
            continue
        path = points[np.arange(len(points)), chain.points]
        schedule = shares(path), chain.times
        path = without_detours(path, 2 * one.spacing * length, water.near(near))
        if chain.cost < least:
            best, least = path, chain.cost
    return simplified(corridor, best)


def _times(
    allowed: tuple[FloatArray, FloatArray], passed: FloatArray, one: _Pass, sideways: float
) -> FloatArray:
    """Return the times (n, q), s, at which the least fuel is computed in each row of a pass.

    They are centred on the row's earlier time of passage, `passed` (n,), or, with a leeway of 1, on
    the middle of the `allowed` times. They extend by a further `sideways` (s) on both sides.
    """
    early, late = allowed
    middle = (early + late) / 2 if one.leeway == 1 else passed
    half = one.leeway * (late - early) / 2 + sideways
    return np.linspace(middle - half, middle + half, one.times).T
