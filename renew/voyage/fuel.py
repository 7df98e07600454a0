"""Fuel along a polyline at constant thrust (paper, Eq. 4), under both drift models.

A vessel that burns α vᵏ a second spends F = α vᵏ ∫ ds / g(s), where g is its speed over ground
along the unit tangent T in the current c:

- ``"projected"``, as published: g = v + c·T;
- ``"crab"``, exact: the vessel heads into the cross-current to stay on its course, so
  g = c·T + √(v² - |c - (c·T)T|²).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import shapely

from renew._compiled import for_kernels, kernel
from renew._types import FloatArray, IntArray
from renew.errors import ParameterError, as_floats, check_kind, is_finite, shown
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentField, CurrentLike, as_field
from renew.inputs.options import Drift, choice_faults
from renew.kernels.ground_speed import ground_speeds, made_at

# Composite Gauss-Legendre: four nodes on pieces of at most 1/256 of the path. On the published
# single gyre the error is below 1e-9 of the fuel.
_RULE = np.polynomial.legendre.leggauss(4)
# Weights of the nodes in a piece from -1 to 1.
_WEIGHTS = _RULE[1]
_PIECES = 256
# Largest coordinate of a path (m): beyond it squares overflow.
_MAX_PLACE = 1e150
WITHIN = (_RULE[0] + 1) / 2
"""Places of the nodes in a piece, from 0 to 1."""
# Largest number of rounds for the times in a changing current.
_ROUNDS = 12
# Change of these times, as a share of the time under way, up to which they count as settled: by
# Newton's method the next change would be 1e-12.
_SETTLED = 1e-7
# Least change between two rounds from which a slope is taken, as a share of the time under way.
_FAR = 1e-6
# Steepest slope that is taken.
_STEEP = 0.9


def as_path(given: object) -> FloatArray:
    """Take a path as an array (n, 2), m."""
    path = as_floats("path", given)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2:
        raise ParameterError(f"path has shape {path.shape}; it must be (n, 2) with n >= 2")
    if not (np.abs(path) <= _MAX_PLACE).all():
        raise ParameterError(f"path has points that are not finite, or beyond {_MAX_PLACE:g} m")
    return path


def ground_speed(
    velocity: FloatArray, tangent: FloatArray, speed: float | FloatArray, drift: Drift
) -> FloatArray:
    """Return the speed over ground (...) along unit tangents (..., 2) in currents (..., 2), m/s.

    At speeds (...) through water. Not positive, or NaN, where the vessel can't make way in that
    direction.
    """
    velocity, tangent = np.broadcast_arrays(velocity, tangent)
    flat = ground_speeds(
        for_kernels(velocity.reshape(-1, 2)),
        for_kernels(tangent.reshape(-1, 2)),
        for_kernels(np.broadcast_to(speed, velocity.shape[:-1]).ravel()),
        drift == "crab",
    )
    return flat.reshape(velocity.shape[:-1])


class Pieces(NamedTuple):
    """A path (n, 2) cut into pieces, each with the nodes of a quadrature.

    Attributes
    ----------
    leg : (p,), the leg of the path to which each belongs.
    points : (p, 4, 2), m, its nodes.
    tangent : (p, 1, 2), its course as a unit vector.
    length : (p,), m.
    """

    leg: IntArray
    points: FloatArray
    tangent: FloatArray
    length: FloatArray

    @classmethod
    def of(cls, path: FloatArray) -> "Pieces":
        """Cut a path."""
        return cls(*_cut(for_kernels(path)))

    def total(self, a_metre: FloatArray, chart: Chart) -> FloatArray:
        """Return the integral over each piece (p,) of a quantity per true metre at nodes (p, 4)."""
        a_metre = a_metre * chart.true_metres(self.points)
        whole = (a_metre * (_WEIGHTS / 2)).sum(axis=1) * self.length
        return np.asarray(np.where(self.length > 0, whole, 0))


@kernel
def _cut(path: FloatArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return fields of the :class:`Pieces` of a path (n, 2)."""
    legs = len(path) - 1
    lengths, pieces, whole = np.empty(legs), np.empty(legs, dtype=np.int64), 0.0
    for k in range(legs):
        lengths[k] = math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        whole += lengths[k]
    a_metre, count = _PIECES / max(whole, 1e-300), 0
    for k in range(legs):
        pieces[k] = max(1, math.ceil(lengths[k] * a_metre))
        count += pieces[k]
    leg = np.empty(count, dtype=np.int64)
    points, tangent, length = np.empty((count, 4, 2)), np.empty((count, 1, 2)), np.empty(count)
    at = 0
    for k in range(legs):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        scale = 1.0 / lengths[k] if lengths[k] > 0 else 1.0
        for piece in range(pieces[k]):
            leg[at], length[at] = k, lengths[k] / pieces[k]
            tangent[at, 0, 0], tangent[at, 0, 1] = dx * scale, dy * scale
            for node in range(4):
                place = (piece + WITHIN[node]) / pieces[k]
                points[at, node, 0] = path[k, 0] + place * dx
                points[at, node, 1] = path[k, 1] + place * dy
            at += 1
    return leg, points, tangent, length


@kernel
def _durations(
    velocity: FloatArray, tangent: FloatArray, length: FloatArray, speed: FloatArray, crab: bool
) -> FloatArray:
    """Return the time (s,), s, over `Pieces` in currents (s, 4, 2) at their nodes, at speeds.

    `length` (s, 4), m, is a piece's, in the metres at each node.
    """
    durations = np.zeros(len(length))
    for k in range(len(length)):
        tx, ty = tangent[k, 0]
        for node in range(4 if length[k, 0] > 0 else 0):
            made = made_at(velocity[k, node, 0], velocity[k, node, 1], tx, ty, speed[k], crab)
            durations[k] += _WEIGHTS[node] / 2 * length[k, node] / made if made > 0 else math.inf
    return durations


class TimesOfPassage(NamedTuple):
    """Times (p + 1,), s, at the ends of the pieces of a path, and the leg (p,) of each piece.

    The first time is the departure, on the current's clock. A place that the vessel can't reach has
    an infinite time.
    """

    leg: IntArray
    times: FloatArray

    @property
    def durations(self) -> FloatArray:
        """Time (n - 1,), s, over each leg; inf where no way can be made."""
        with np.errstate(invalid="ignore"):
            lasts = np.diff(self.times)
        durations = np.zeros(self.leg[-1] + 1)
        # Nothing is known of legs after one that can't be sailed.
        np.add.at(durations, self.leg, np.where(np.isfinite(lasts), lasts, math.inf))
        return durations

    @property
    def at_points(self) -> FloatArray:
        """Times (n,), s, at the points of the path."""
        first = np.searchsorted(self.leg, np.arange(self.leg[-1] + 1))
        return np.append(self.times[first], self.times[-1])


def passage(
    path: FloatArray,
    current: CurrentLike,
    vessel: Vessel,
    *,
    speeds: FloatArray | None = None,
    guess: FloatArray | None = None,
    drift: Drift = "projected",
    departure: float = 0.0,
    chart: Chart | None = None,
) -> TimesOfPassage:
    """Return the passage along a path (n, 2), with the clock running from the departure (s).

    Legs are sailed at `speeds` (n - 1,) through water, m/s, or all at the vessel's. With a `guess`
    of the times (n,) at the path's points, s, it is found sooner. With a `chart`, by its metres.
    """
    path = as_path(path)
    for fault in choice_faults("drift", drift):
        raise ParameterError(fault)
    check_kind("vessel", vessel, Vessel)
    if not is_finite(departure):
        raise ParameterError(f"departure = {shown(departure)} s must be finite")
    field = as_field(current)
    pieces = Pieces.of(path)
    leg = pieces.leg
    through_water = speeds_by_leg(speeds, vessel, len(path) - 1)[leg]
    metres = (
        np.ones(pieces.points.shape[:-1]) if chart is None else chart.true_metres(pieces.points)
    )
    lengths = for_kernels(pieces.length[:, None] * metres)

    def durations(some: slice, times: FloatArray) -> FloatArray:
        """Return the time (p,), s, over some pieces, given the times (p + 1,) at their ends."""
        when = times[:-1, None] + WITHIN * np.diff(times)[:, None]
        velocity = for_kernels(field.velocity(pieces.points[some], when))
        tangent, length = pieces.tangent[some], lengths[some]
        return _durations(velocity, tangent, length, through_water[some], drift == "crab")

    if guess is not None:
        first = np.searchsorted(leg, np.arange(len(path)))
        guess = np.interp(np.arange(len(leg) + 1), first, guess)
    is_steady = field.is_steady
    times = times_under_way(durations, len(leg), departure, is_steady=is_steady, guess=guess)
    return TimesOfPassage(leg, times)


def speeds_by_leg(speeds: FloatArray | None, vessel: Vessel, legs: int) -> FloatArray:
    """Return speeds (n,) through water of n legs: as given, or the vessel's."""
    if speeds is None:
        return np.full(legs, vessel.speed)
    speeds = as_floats("speeds", speeds)
    if speeds.shape != (legs,) or not (np.isfinite(speeds) & (speeds > 0)).all():
        raise ParameterError(
            f"speeds has shape {speeds.shape}; it must be ({legs},), one a leg, all above 0 m/s"
        )
    return speeds


def reading_times(
    path: FloatArray,
    current: CurrentField,
    vessel: Vessel,
    drift: Drift,
    begin: float,
    speeds: FloatArray,
    chart: Chart | None = None,
) -> FloatArray:
    """Return times (n,), s, at which the current at the points of a path (n, 2) is to be read.

    They are times of passage at speeds (n - 1,), m/s, with `begin` as the first; in a steady
    current all are `begin`. At a leg that can't be sailed the clock stops.
    """
    if current.is_steady or len(path) < 2:
        return np.full(len(path), begin)
    passed = passage(
        path, current, vessel, drift=drift, departure=begin, speeds=speeds, chart=chart
    )
    return np.asarray(np.minimum(passed.at_points, passed.times[np.isfinite(passed.times)][-1]))


def times_under_way(
    durations: Callable[[slice, FloatArray], FloatArray],
    count: int,
    departure: float,
    *,
    is_steady: bool,
    guess: FloatArray | None = None,
) -> FloatArray:
    """Return times (count + 1,), s, at the ends of the pieces of a path, the first at departure.

    `durations` gives the time over some pieces from the times at their ends. In a steady current it
    is called once. In a changing current it is called with the times that it returned before (first
    with a `guess`) until they no longer change; a stretch of the path on which they do not settle
    is halved.
    """
    times = np.full(count + 1, float(departure))
    if is_steady:
        times[1:] += np.cumsum(durations(slice(0, count), times))
        return times
    if guess is not None and math.isfinite(guess[-1]):
        since, is_settled = _settled(durations, slice(0, count), guess - guess[0], departure)
        if is_settled:
            return departure + since
    first, size, pace = 0, count, 0.0
    while first < count:
        last = min(first + size, count)
        # Guess that each piece takes about as long as the last known one.
        guess = np.linspace(0.0, pace * (last - first), last - first + 1)
        since, is_settled = _settled(durations, slice(first, last), guess, times[first])
        if is_settled or size == 1:
            times[first : last + 1] = times[first] + since
            if not math.isfinite(since[-1]):
                times[last:] = math.inf
                break
            first, size, pace = last, 2 * size, float(since[-1]) / (last - first)
        else:
            size //= 2
    return times


def _settled(
    durations: Callable[[slice, FloatArray], FloatArray],
    some: slice,
    since: FloatArray,
    begin: float,
) -> tuple[FloatArray, bool]:
    """Return times (s + 1,), s, since `begin` at the ends of pieces, and whether they settled.

    `since` is a guess. By Newton's method the time over a piece is taken as linear in the time at
    its middle, with the slope that the last two rounds show.
    """
    middle, lasts, slope = (np.zeros(len(since) - 1) for _ in range(3))
    for at_round in range(_ROUNDS):
        last_middle, last_lasts = middle, lasts
        middle, lasts = (since[:-1] + since[1:]) / 2, durations(some, begin + since)
        if not np.isfinite(lasts).all():
            return np.append(0.0, np.cumsum(lasts)), False
        moved = middle - last_middle
        if at_round:
            # Ignore slopes from rounding, and clip steep ones: a later start gives a later arrival.
            far = np.abs(moved) > _FAR * since[-1]
            slope[far] = np.clip((lasts - last_lasts)[far] / moved[far], -_STEEP, _STEEP)
        newer = _chained(middle, lasts, slope)
        if not (np.diff(newer) >= 0).all():
            # Where the current nearly stops the vessel, slopes are unreliable: take the sum of the
            # times.
            return np.append(0.0, np.cumsum(lasts)), False
        change = np.abs(newer - since).max()
        since = newer
        if change <= _SETTLED * since[-1]:
            return since, True
    return since, False


@kernel
def _chained(middle: FloatArray, lasts: FloatArray, slope: FloatArray) -> FloatArray:
    """Return times (s + 1,), s, at the ends of pieces, which last `lasts` if passed at `middle`."""
    since = np.zeros(len(lasts) + 1)
    for k in range(len(lasts)):
        half = slope[k] / 2
        since[k + 1] = ((1 + half) * since[k] + lasts[k] - 2 * half * middle[k]) / (1 - half)
    return since


def speeds_along(points: FloatArray, path: FloatArray, speeds: FloatArray) -> FloatArray:
    """Return speeds (m,), m/s, at points (m, 2) on or near a path, from its legs' (n - 1,)."""
    if np.ptp(speeds) == 0:
        return np.full(len(points), speeds[0])
    ends = np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))
    along = shapely.line_locate_point(shapely.LineString(path), shapely.points(points))
    return np.asarray(speeds[np.minimum(np.searchsorted(ends, along, "right"), len(speeds) - 1)])


def fuel(
    path: FloatArray,
    current: CurrentLike,
    vessel: Vessel,
    *,
    drift: Drift = "projected",
    departure: float = 0.0,
    speeds: FloatArray | None = None,
    chart: Chart | None = None,
) -> float:
    """Return fuel to follow a path (paper, Eq. 4), at constant thrust or at a speed for each leg.

    Parameters
    ----------
    path : array_like
        Polyline (n, 2) in metres, n >= 2.
    current : CurrentField or callable
        Velocity (..., 2) m/s at points (..., 2) m.
    vessel : Vessel
        Gives v and the fuel law.
    drift : {"projected", "crab"}
        Drift model; see the module.
    departure : float
        When the path is begun (s), on the clock of a current that changes.
    speeds : array_like, optional
        Speeds through water (n - 1,), m/s, one a leg; by default all are the vessel's.
    chart : Chart, optional
        Where the path lies: with a `point_scale` its metres count, not the plane's.

    Returns
    -------
    float
        Fuel a second times the time under way, leg by leg; ``inf`` where the vessel can't make way
        along the path.

    Raises
    ------
    ParameterError
        A path or speeds of another shape or not finite, no vessel, or an unknown drift model.
    """
    leg, times = passage(
        path, current, vessel, drift=drift, departure=departure, speeds=speeds, chart=chart
    )
    if speeds is None:
        return float(vessel.fuel_rate * (times[-1] - departure))
    rate = vessel.rates(as_floats("speeds", speeds)[leg])
    return float((rate * np.diff(times)).sum()) if math.isfinite(times[-1]) else math.inf
