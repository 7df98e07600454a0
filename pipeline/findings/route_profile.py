"""The profile of a route: its legs as a navigator needs them, and its values at points along it."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries, IntArray
from pipeline.findings.result import RankedRoute
from pipeline.geo.projection import GEOD, Projection, cut, densified
from pipeline.model import Case
from renew.inputs.chart_and_vessel import edges_of
from renew.inputs.options import Drift
from renew.voyage.fuel import passage, speeds_along

# Maximum length, true metres, of a piece of a leg that is taken to have one scale of the plane and
# one course: the planner's straight line is then as long as the geodesic, to a millionth.
_PIECE_M = 10_000.0
# A line that is sailed at several speeds is cut into at least this number of pieces.
_PIECES = 500

# Difference from the planned arrival that counts as none, as a share of the time under way: one
# second in 11 days.
_IN_TIME = 1e-6
# Number of rounds of Newton's method in which that is reached.
_ROUNDS = 6


@dataclass(frozen=True)
class Legs:
    """A route's n vertices, each with the leg that leaves it; NaN at the goal, which no leg leaves.

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
    """n - 1 steps between points of the plane: (n - 1,) seconds over each, and mean speeds.

    `planner_s` are on the planner's clock, of a plane at a scale; the mean is over time.
    """

    planner_s: FloatArray
    true_s: FloatArray
    through_water_m_s: FloatArray


def legs(ranked: RankedRoute) -> Legs:
    """Return legs of a route as planned; they add up to the route's length and duration."""
    projection = ranked.case.case.projection
    path = np.asarray(ranked.route.path, dtype=float)
    longest = _PIECE_M / projection.scale
    points, first = cut(path, longest)
    lonlat = projection.to_lonlat(points)
    azimuth, _, step = GEOD.inv(*lonlat[:-1].T, *lonlat[1:].T)
    length = np.add.reduceat(np.asarray(step), first)
    time = planned_times(ranked)
    return Legs(
        lonlat=lonlat[np.append(first, -1)],
        course_deg=np.append(np.asarray(azimuth)[first] % 360, np.nan),
        length_m=np.append(length, np.nan),
        time_s=time,
        speed_m_s=np.append(mean_speed(length, time), np.nan),
        through_water_m_s=np.append(ranked.route.speeds, np.nan),
    )


def planned_times(ranked: RankedRoute) -> FloatArray:
    """Return seconds since departure (n,) at which each vertex of a route's path is reached."""
    path = np.asarray(ranked.route.path, dtype=float)
    return times_at(metres_along(path), path, ranked)


def times_at(along: FloatArray, path: FloatArray, ranked: RankedRoute) -> FloatArray:
    """Return seconds since departure (n,) at distances `along` (n,) a path (m, 2), planar m.

    The path is the route's own, or has more points; the goal is reached at the route's duration.
    """
    points = densified(path, _PIECE_M / ranked.case.case.projection.scale)
    taken = steps(points, ranked)
    return np.asarray(np.interp(along, metres_along(points), cumulative(taken.true_s)))


def steps(points: FloatArray, ranked: RankedRoute) -> Steps:
    """Return steps between points (n, 2) of a route's path; true times add up to its duration."""
    case, drift = ranked.case.case, ranked.case.scenario.planner.drift
    taken = sailed(*at_speeds_sailed(points, ranked), case, drift)
    whole = ranked.metrics.duration_s
    return replace(taken, true_s=taken.true_s * (whole / taken.true_s.sum()))


def sailed(
    pieces: FloatArray, first: IntArray, speeds: FloatArray, case: Case, drift: Drift
) -> Steps:
    """Return steps sailed in a case's current; each begins at its `first` (n - 1,) piece.

    The pieces' ends (m, 2) are in the plane; their speeds (m - 1,) are through water.
    """
    passed = passage(
        pieces, case.current, case.vessel, drift=drift, speeds=speeds, chart=case.chart
    )
    planner_s = np.add.reduceat(passed.durations, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.add.reduceat(passed.durations * speeds, first) / planner_s
    return Steps(
        planner_s,
        planner_s * case.projection.scale,
        # No time passes between points that are the same.
        np.where(planner_s > 0, mean, speeds[first]),
    )


def at_speeds_sailed(
    points: FloatArray, ranked: RankedRoute
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return steps between points (n, 2) along a route, cut where speeds differ on the way.

    Returns the pieces' ends (m, 2), the first piece (n - 1,) of each step, and the speed (m - 1,)
    through water at which each piece is sailed, m/s.
    """
    path, speeds = np.asarray(ranked.route.path, dtype=float), ranked.route.speeds
    longest = float(metres_along(points)[-1]) / _PIECES if np.ptp(speeds) > 0 else np.inf
    pieces, first = cut(points, longest)
    return pieces, first, speeds_along((pieces[:-1] + pieces[1:]) / 2, path, speeds)


def metres_along(path: FloatArray) -> FloatArray:
    """Return metres (n,) from the start of a path (n, 2) to each of its vertices."""
    return cumulative(np.linalg.norm(np.diff(path, axis=0), axis=1))


def cumulative(steps: FloatArray) -> FloatArray:
    """Return sums (n + 1,) of steps (n,), from 0."""
    return np.append(0.0, np.cumsum(steps))


def mean_speed(length_m: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the mean speed over ground (n - 1,), m/s, of legs; NaN if no time passes."""
    passage = np.diff(time_s)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed: FloatArray = np.where(passage > 0, length_m / passage, np.nan)
    return speed


def steps_along_legs(line: FloatArray, ranked: RankedRoute) -> Steps:
    """Return steps between points (n, 2) along a route's legs, with the bow into cross-currents."""
    pieces, first, speeds = at_speeds_sailed(line, ranked)

    def at(speeds: FloatArray) -> Steps:
        return sailed(pieces, first, speeds, ranked.case.case, "crab")

    choice = ranked.case.case.speeds
    if choice is None:
        return at(speeds)
    taken = at(speeds)
    if not np.isfinite(taken.true_s).all():
        # A speed chosen by the projected drift can be too low to head into the cross-current.
        speeds = np.full_like(speeds, choice.most)
        taken = at(speeds)
    length = np.linalg.norm(np.diff(line, axis=0), axis=1)
    moved = length > 0
    for _ in range(_ROUNDS):
        late = taken.true_s.sum() / ranked.metrics.duration_s
        if abs(late - 1) <= _IN_TIME:
            break
        # Relative change of the time, for a relative change of all speeds.
        slopes = (taken.through_water_m_s * taken.planner_s**2)[moved] / length[moved]
        change = late ** (taken.planner_s.sum() / slopes.sum())
        speeds = np.clip(speeds * change, choice.least, choice.most)
        nearer = at(speeds)
        if not np.isfinite(nearer.true_s).all():
            break
        taken = nearer
    return taken


# Maximum distance between points, true metres: between them the plane has one scale, and geodesics
# are its straight lines.
_MAX_STEP_M = 10_000.0
# Coast up to this multiple of the least planar distance may be the nearest on earth.
_NEAREST_FACTOR = 1.02
# Distance, as a share of the route's length, below which two points count as one.
_SAME_POINT = 1e-9


@dataclass(frozen=True)
class RouteProfile:
    """A route at n points from start to goal, in order: arrays (n,), `lonlat` (n, 2).

    All of the path's vertices and the point of least clearance are among them.

    Attributes
    ----------
    distance_m : true geodesic metres from the start.
    time_s : true-scale seconds since departure.
    lonlat : degrees.
    course_deg : true course towards the next point; at the goal, on arrival.
    fuel : used since departure, in the planner's units.
    speed_m_s : mean speed over ground to the next point; at the goal, on arrival.
    through_water_m_s : speed through water to the next point; at the goal, on arrival.
    current_along_m_s : component of the current along the course, positive if following.
    clearance_m : true metres to the original land; inf without any land.
    """

    distance_m: FloatArray
    time_s: FloatArray
    lonlat: FloatArray
    course_deg: FloatArray
    fuel: FloatArray
    speed_m_s: FloatArray
    through_water_m_s: FloatArray
    current_along_m_s: FloatArray
    clearance_m: FloatArray


def route_profile(ranked: RankedRoute, *, points: int = 200) -> RouteProfile:
    """Sample a route every 1/points of its length and at its vertices.

    Fuel and time end at the route's own figures, and the least clearance is the route's.
    """
    case, metrics = ranked.case.case, ranked.metrics
    projection = case.projection
    path = np.asarray(ranked.route.path, dtype=float)
    # Without vertices that repeat the one before them.
    path = path[np.append(True, np.diff(path, axis=0).any(axis=1))]
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    sampled = densified(path, min(length / points, _MAX_STEP_M / projection.scale))
    coast = coast_edges(case.water.land)
    closest = closest_approach(coast, sampled, projection)
    if closest is not None:
        sampled = _with_point(sampled, closest[0], _SAME_POINT * length)

    lonlat = projection.to_lonlat(sampled)
    azimuth, back, step_m = GEOD.inv(*lonlat[:-1].T, *lonlat[1:].T)
    taken = steps(sampled, ranked)
    way = np.diff(sampled, axis=0)
    tangent = _with_last_repeated(way / np.linalg.norm(way, axis=1, keepdims=True))
    step_fuel = taken.planner_s * case.vessel.rates(taken.through_water_m_s)
    clearance = _to_coast_m(coast, sampled, projection)
    if closest is not None:
        if metrics.land_m > 0:
            tree = shapely.STRtree(shapely.points(sampled))
            land = np.array(case.water.land, dtype=object)
            clearance[tree.query(land, predicate="intersects")[1]] = 0.0
        nearest = np.argmin(np.linalg.norm(sampled - closest[0], axis=1))
        # A route over land has no clearance, however far the coastline may be.
        least_m = 0.0 if metrics.land_m > 0 else closest[1]
        clearance = np.maximum(clearance, least_m)
        clearance[nearest] = least_m
    return RouteProfile(
        distance_m=cumulative(step_m),
        time_s=cumulative(taken.true_s),
        lonlat=lonlat,
        course_deg=np.append(azimuth, back[-1] + 180) % 360,
        fuel=cumulative(step_fuel * (metrics.fuel / step_fuel.sum())),
        speed_m_s=_with_last_repeated(step_m / taken.true_s),
        through_water_m_s=_with_last_repeated(taken.through_water_m_s),
        current_along_m_s=(
            case.current.velocity(sampled, cumulative(taken.planner_s)) * tangent
        ).sum(axis=1),
        clearance_m=clearance,
    )


def _to_coast_m(coast: shapely.STRtree, xy: FloatArray, projection: Projection) -> FloatArray:
    """Return true metres (n,) from points (n, 2) to the nearest edge of a coast; inf without."""
    if not len(coast):
        return np.full(len(xy), math.inf)
    points = shapely.points(xy)
    nearest = coast.query_nearest(points, all_matches=False)[1]
    gaps = shapely.shortest_line(points, coast.geometries[nearest])
    ends = projection.to_lonlat(shapely.get_coordinates(gaps))
    return np.asarray(GEOD.inv(*ends[::2].T, *ends[1::2].T)[2])


def closest_approach(
    coast: shapely.STRtree, sampled: FloatArray, projection: Projection
) -> tuple[FloatArray, float] | None:
    """Return the point (2,) of a line (n, 2) where a coast is nearest, and how far, true metres.

    The coast is a tree of edges, or of areas of land; None without one. The nearest coast in the
    plane need not be the nearest on earth, so all gaps that are nearly as small are measured.
    """
    if not len(coast):
        return None
    steps = _segments(sampled)
    apart = coast.query_nearest(steps, return_distance=True, all_matches=False)[1]
    middles = projection.to_lonlat((sampled[:-1] + sampled[1:]) / 2)
    true = apart / projection.point_scale(middles)
    near = true <= true.min() * _NEAREST_FACTOR
    step, edge = coast.query(
        steps[near], predicate="dwithin", distance=apart[near] * _NEAREST_FACTOR
    )
    lines = shapely.shortest_line(steps[near][step], coast.geometries[edge])
    gaps = shapely.get_coordinates(lines).reshape(-1, 2, 2)
    lengths = [projection.geodesic_length_m(gap) for gap in gaps]
    best = int(np.argmin(lengths))
    return gaps[best, 0], lengths[best]


# Polygons are hashed by their coordinates, which takes a hundredth of the time of the tree.
@lru_cache(maxsize=2)
def coast_edges(land: tuple[shapely.Polygon, ...]) -> shapely.STRtree:
    """Return a tree of the edges of the land, each a line."""
    return shapely.STRtree(shapely.linestrings(edges_of(land)))


def _with_point(line: FloatArray, point: FloatArray, same: float) -> FloatArray:
    """Insert a point (2,) that lies on a line (n, 2), unless a vertex is within `same` of it."""
    if np.linalg.norm(line - point, axis=1).min() <= same:
        return line
    after = int(np.argmin(shapely.distance(_segments(line), shapely.Point(point))))
    return np.insert(line, after + 1, point, axis=0)


def _segments(line: FloatArray) -> Geometries:
    """Return LineStrings (n - 1,) between the points (n, 2) of a line."""
    return np.asarray(shapely.linestrings(np.stack([line[:-1], line[1:]], axis=1)))


def _with_last_repeated(values: FloatArray) -> FloatArray:
    """Append the last value: at the goal, the values of the last step hold."""
    return np.concatenate([values, values[-1:]])
