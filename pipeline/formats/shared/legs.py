"""The legs of a route as a navigator needs them: course, distance, time, speed over ground."""

from dataclasses import dataclass, replace

import numpy as np
import pyproj

from pipeline._types import FloatArray, IntArray
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.geo.projection import cut, densified
from pipeline.model import Scene
from renew.inputs.options import Drift
from renew.voyage.fuel import passage, speeds_along

# Maximum length, true metres, of a piece of a leg that is taken to have one scale of the plane and
# one course: the planner's straight line is then as long as the geodesic, to a millionth.
_PIECE_M = 10_000.0
# Number of pieces, at least, into which a line is cut that is sailed at several speeds.
_PIECES = 500

# Difference from the planned arrival that counts as none, as a share of the time under way (a
# second in 11 days), and the number of rounds of Newton's method in which it is reached.
_IN_TIME, _ROUNDS = 1e-6, 6


@dataclass(frozen=True)
class Legs:
    """A route's n vertices, each with the leg that leaves it; NaN for the goal's, which has none.

    `lonlat` (n, 2) degrees; `course_deg` (n,) true, at the leg's start; `length_m` (n,) true metres
    along the planned line; `time_s` (n,) seconds since departure; `speed_m_s` (n,) mean speed over
    ground; `through_water_m_s` (n,) speed through water.
    """

    lonlat: FloatArray
    course_deg: FloatArray
    length_m: FloatArray
    time_s: FloatArray
    speed_m_s: FloatArray
    through_water_m_s: FloatArray


@dataclass(frozen=True)
class Steps:
    """n - 1 steps between points of the plane.

    Attributes
    ----------
    planner_s : (n - 1,) by the drift model in planar metres.
    true_s : (n - 1,) at true scale.
    through_water_m_s : (n - 1,) mean speed through water, over time.
    """

    planner_s: FloatArray
    true_s: FloatArray
    through_water_m_s: FloatArray


def legs(ranked: RankedRoute, result: RunResult) -> Legs:
    """Legs of a route as planned; they add up to the route's length and duration."""
    projection = result.scene.projection
    path = np.asarray(ranked.route.path, dtype=float)
    longest = _PIECE_M / projection.scale
    points, first = cut(path, longest)
    lonlat = projection.to_lonlat(points)
    azimuth, _, step = pyproj.Geod(ellps="WGS84").inv(
        lonlat[:-1, 0], lonlat[:-1, 1], lonlat[1:, 0], lonlat[1:, 1]
    )
    length = np.add.reduceat(np.asarray(step), first)
    time = planned_times(ranked, result)
    return Legs(
        lonlat=lonlat[np.append(first, -1)],
        course_deg=np.append(np.asarray(azimuth)[first] % 360, np.nan),
        length_m=np.append(length, np.nan),
        time_s=time,
        speed_m_s=np.append(mean_speed(length, time), np.nan),
        through_water_m_s=np.append(ranked.route.speeds, np.nan),
    )


def planned_times(ranked: RankedRoute, result: RunResult) -> FloatArray:
    """Seconds since departure (n,) at which each vertex of a route's path is reached."""
    path = np.asarray(ranked.route.path, dtype=float)
    return times_at(metres_along(path), path, ranked, result)


def times_at(
    along: FloatArray, path: FloatArray, ranked: RankedRoute, result: RunResult
) -> FloatArray:
    """Seconds since departure (n,) at distances `along` (n,) a path (m, 2), in planar metres.

    The path is the route's own, or has more points; the goal is reached at the route's duration.
    """
    points = densified(path, _PIECE_M / result.scene.projection.scale)
    found = steps(points, ranked, result)
    return np.asarray(np.interp(along, metres_along(points), cumulative(found.true_s)))


def steps(points: FloatArray, ranked: RankedRoute, result: RunResult) -> Steps:
    """Steps between points (n, 2) of a route's path; their true times add up to its duration.

    In a changing current the planner's own times count, since it read the current at them.
    """
    scene, drift = result.scene, result.scenario.planner.drift
    found = sailed(*at_speeds_sailed(points, ranked), scene, ranked.season, drift)
    times = found.true_s if scene.currents[ranked.season].is_steady else found.planner_s
    return replace(found, true_s=times * (ranked.metrics.duration_s / times.sum()))


def sailed(
    pieces: FloatArray,
    first: IntArray,
    speeds: FloatArray,
    scene: Scene,
    season: str,
    drift: Drift,
) -> Steps:
    """Steps sailed in a season's current; each begins at its `first` (n - 1,) piece.

    The pieces' ends (m, 2) are in the plane; their speeds (m - 1,) are through water. Where the
    plane is stretched, a planar metre takes less true time.
    """
    projection = scene.projection
    planar = passage(
        pieces, scene.currents[season], scene.vessel_in(season), drift=drift, speeds=speeds
    ).durations
    middles = projection.to_lonlat((pieces[:-1] + pieces[1:]) / 2)
    true = planar * projection.scale / projection.point_scale(middles)
    planner_s = np.add.reduceat(planar, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.add.reduceat(planar * speeds, first) / planner_s
    return Steps(
        planner_s,
        np.add.reduceat(true, first),
        # No time passes between points that are the same.
        np.where(planner_s > 0, mean, speeds[first]),
    )


def at_speeds_sailed(
    points: FloatArray, ranked: RankedRoute
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Steps between points (n, 2) along a route, cut where speeds differ on the way.

    Returns the pieces' ends (m, 2), the first piece (n - 1,) of each step, and the speed (m - 1,)
    through water at which each piece is sailed, m/s.
    """
    path, speeds = np.asarray(ranked.route.path, dtype=float), ranked.route.speeds
    longest = float(metres_along(points)[-1]) / _PIECES if np.ptp(speeds) > 0 else np.inf
    pieces, first = cut(points, longest)
    return pieces, first, speeds_along((pieces[:-1] + pieces[1:]) / 2, path, speeds)


def metres_along(path: FloatArray) -> FloatArray:
    """Metres (n,) from the start of a path (n, 2) to each of its vertices."""
    return cumulative(np.linalg.norm(np.diff(path, axis=0), axis=1))


def cumulative(steps: FloatArray) -> FloatArray:
    """Sums (n + 1,) of steps (n,), from 0."""
    return np.append(0.0, np.cumsum(steps))


def mean_speed(length_m: FloatArray, time_s: FloatArray) -> FloatArray:
    """Mean speed over ground (n - 1,), m/s, of legs between times (n,); NaN if no time passes."""
    passage = np.diff(time_s)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed: FloatArray = np.where(passage > 0, length_m / passage, np.nan)
    return speed


def steps_along_legs(line: FloatArray, ranked: RankedRoute, result: RunResult) -> Steps:
    """Steps between points (n, 2) of the plane along a route's legs, as it can be sailed."""
    pieces, first, speeds = at_speeds_sailed(line, ranked)

    def at(speeds: FloatArray) -> Steps:
        return sailed(pieces, first, speeds, result.scene, ranked.season, "crab")

    choice = result.scene.speeds.get(ranked.season)
    if choice is None:
        return at(speeds)
    found = at(speeds)
    if not np.isfinite(found.true_s).all():
        # A speed chosen by the projected drift can be too low to head into the cross-current.
        speeds = np.full_like(speeds, choice.most)
        found = at(speeds)
    length = np.linalg.norm(np.diff(line, axis=0), axis=1)
    moved = length > 0
    for _ in range(_ROUNDS):
        late = found.true_s.sum() / ranked.metrics.duration_s
        if abs(late - 1) <= _IN_TIME:
            break
        # Relative change of the time, for a relative change of all speeds.
        slopes = (found.through_water_m_s * found.planner_s**2)[moved] / length[moved]
        change = late ** (found.planner_s.sum() / slopes.sum())
        speeds = np.clip(speeds * change, choice.least, choice.most)
        nearer = at(speeds)
        if not np.isfinite(nearer.true_s).all():
            break
        found = nearer
    return found
