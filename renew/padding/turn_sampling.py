"""How far hard-over turns reach in a current that is known by its mean and spread: drawn, compiled.

The draws are those of the paper: speed and direction of the current about their means, the heading
at which a turn begins about the course.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import ndtri

from renew._types import FloatArray, IntArray
from renew.inputs.current import CurrentStatistics
from renew.inputs.vessel import Vessel

HEADING_SPREAD = math.radians(20)
"""Δφ: how far a route's heading may be off the line between the passing edges' midpoints (rad).
Larger values change little, since a turn reaches furthest when begun along the edge."""


class _Drawn(NamedTuple):
    """Headings (t, draws) rad, their cosines and sines, and currents u and v (t, draws), m/s."""

    heading: FloatArray
    cos: FloatArray
    sin: FloatArray
    u: FloatArray
    v: FloatArray


class Draws:
    """So many draws; the same for every place, so that its figures depend on itself alone."""

    def __init__(self, seed: int, count: int) -> None:
        speed, turn, heading = _even_draws(seed, count)
        self.count = count
        self._speed, self._turn = ndtri(speed), ndtri(turn)
        self._heading = HEADING_SPREAD * (2 * heading - 1)

    def reaches(
        self,
        statistics: CurrentStatistics,
        course: FloatArray,
        row: IntArray,
        normals: FloatArray,
        vessel: Vessel,
    ) -> FloatArray:
        """Reach (p, draws) of turns along unit normals (p, 2), m, the worse of both sides.

        Turn p begins in the current `row[p]` of some (t,), on the course (t,) rad there.
        """
        drawn = self._drawn(statistics, course)
        return np.asarray(_reaches(row, normals, drawn, vessel.speed, vessel.turn_rate))

    def exceeded_by(
        self,
        statistics: CurrentStatistics,
        course: FloatArray,
        row: IntArray,
        normals: FloatArray,
        vessel: Vessel,
        share: float,
    ) -> FloatArray:
        """Reach (p,) in metres, which no more than a share of the draws exceed; see `reaches`."""
        drawn = self._drawn(statistics, course)
        beyond = math.floor((self.count - 1) * share)
        return np.asarray(_exceeded_by(row, normals, drawn, vessel.speed, vessel.turn_rate, beyond))

    def _drawn(self, statistics: CurrentStatistics, course: FloatArray) -> _Drawn:
        """Draws of some currents' spread, and of headings about a course (t,) rad in each."""
        s = statistics
        heading = course[:, None] + self._heading
        speed = np.maximum(0.0, s.speed[:, None] + s.speed_std[:, None] * self._speed)
        towards = s.direction[:, None] + s.direction_std[:, None] * self._turn
        return _Drawn(
            heading,
            np.cos(heading),
            np.sin(heading),
            speed * np.cos(towards),
            speed * np.sin(towards),
        )


def _even_draws(seed: int, count: int) -> FloatArray:
    """Draws (3, count), evenly in the unit cube: Hammersley's points, shifted by the seed.

    Their quantiles are off by 0.5 % where those of random draws are by 1.5 % (512 draws, risk 5 %),
    no more than those of Sobol's scrambled sequence, which takes SciPy half a second to import.
    """
    index = np.arange(count)
    draws = np.stack([index / count, _mirrored(index, 2), _mirrored(index, 3)])
    draws = (draws + np.random.default_rng(seed).random((3, 1))) % 1.0
    # Neither 0 nor 1, where a normal draw would be infinite.
    return np.asarray((draws * (count - 1) + 0.5) / count)


def _mirrored(index: IntArray, base: int) -> FloatArray:
    """Mirror whole numbers (n,) at the point: 6, 110 in base 2, is 0.011 (van der Corput)."""
    mirrored = np.zeros(len(index))
    worth = 1.0 / base
    while index.any():
        mirrored += worth * (index % base)
        index, worth = index // base, worth / base
    return mirrored


@njit(cache=True, error_model="numpy")
def _reaches(
    row: IntArray, normals: FloatArray, drawn: _Drawn, speed: float, turn_rate: float
) -> FloatArray:
    """Reach (p, draws) along normals (p, 2), in the draws of a row each, m."""
    reach = np.empty((len(row), drawn.heading.shape[1]))
    for p in range(len(row)):
        _reach(normals[p], row[p], drawn, speed, turn_rate, reach[p])
    return reach


@njit(cache=True, error_model="numpy")
def _exceeded_by(
    row: IntArray,
    normals: FloatArray,
    drawn: _Drawn,
    speed: float,
    turn_rate: float,
    beyond: int,
) -> FloatArray:
    """Reach (p,) which so many of the draws exceed: the largest after `beyond` others."""
    found = np.empty(len(row))
    reach = np.empty(drawn.heading.shape[1])
    largest = np.empty(beyond + 1)
    for p in range(len(row)):
        _reach(normals[p], row[p], drawn, speed, turn_rate, reach)
        # The largest so far, the least of them first.
        largest[:] = -1.0
        for one in reach:
            if one > largest[0]:
                place = 0
                while place < beyond and largest[place + 1] < one:
                    largest[place] = largest[place + 1]
                    place += 1
                largest[place] = one
        found[p] = largest[0]
    return found


@njit(cache=True, error_model="numpy")
def _reach(
    normal: FloatArray, row: int, drawn: _Drawn, speed: float, turn_rate: float, reach: FloatArray
) -> None:
    """Fill in the reach (draws,) of turns along a normal (2,): `turn_reach`."""
    nx, ny = normal
    bearing = math.atan2(ny, nx)
    radius, period = speed / turn_rate, 2 * math.pi / turn_rate
    for k in range(len(reach)):
        drift = drawn.u[row, k] * nx + drawn.v[row, k] * ny
        ratio = min(max(-drift / speed, -1.0), 1.0)
        turned_to = math.acos(ratio)
        furthest = math.sqrt(1.0 - ratio * ratio)
        begin = drawn.heading[row, k] - bearing
        sine = drawn.sin[row, k] * nx - drawn.cos[row, k] * ny
        port, starboard = turned_to - begin, turned_to + begin
        port -= 2 * math.pi * math.floor(port / (2 * math.pi))
        starboard -= 2 * math.pi * math.floor(starboard / (2 * math.pi))
        reach[k] = max(
            radius * (furthest - sine) + drift * port / turn_rate,
            radius * (furthest + sine) + drift * starboard / turn_rate,
            drift * period,
            0.0,
        )


def normals_away(edges: FloatArray, from_points: FloatArray) -> FloatArray:
    """Unit normals (e, 2) of edges (e, 2, 2), each on the side that points away from a point."""
    along = edges[:, 1] - edges[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = ((edges[:, 0] - from_points) * normal).sum(-1)
    return np.where(away[:, None] < 0, -normal, normal)
