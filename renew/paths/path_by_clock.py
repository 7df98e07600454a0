"""Find the least-fuel path in one class, with a speed for each leg, in a changing current.

A path found at other speeds is refined on transversals, as in :mod:`renew.paths.least_fuel_path`,
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
from renew.paths.speed_profile import SpeedProfile
from renew.paths.timed_path import TimedPath
from renew.voyage.voyage import shares


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
