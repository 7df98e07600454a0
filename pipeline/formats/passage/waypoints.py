"""A route as a navigator uses it: few waypoints, with course, speed and limits of each leg."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.formats.passage.safe_corridor import (
    Obstacles,
    SafeCorridor,
    cross_track_limits,
    safe_corridor,
    turning_radii,
)
from pipeline.formats.passage.thinning import thin
from pipeline.formats.passage.tracks import (
    DECIMALS,
    Curve,
    Drawing,
    Tracks,
    curve_for,
    initial_course_deg,
    tracks,
)
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.formats.shared.route_profile import (
    at_speeds_sailed,
    cumulative,
    mean_speed,
    steps_along_legs,
)
from pipeline.model import RouteMetrics
from renew.results import unite_soft_no_go
from renew.voyage.fuel import speeds_along

NAUTICAL_MILE_M = 1852.0
# Maximum distance of a leg from the planned line, as a share of the route's length: 0.7 km on
# 700 km.
TOLERANCE = 1e-3
# The tolerance of short routes, true metres: no course can be kept more closely, as GNSS alone may
# be 10 m off (IMO A.1046). It is at most `_MAX_TOLERANCE` of the route's length.
MIN_TOLERANCE_M = 30.0
_MAX_TOLERANCE = 1e-2
# Shares of the tolerance, tried in turn until the legs need little enough fuel.
_TOLERANCE_SHARES = (1.0, 0.5, 0.25, 0.1)
# Maximum share by which the legs may need more fuel than the planned line.
MAX_EXTRA_FUEL = 3e-3
# Maximum cross-track limit, true metres: an alarm beyond a mile would be of no use.
MAX_CROSS_TRACK_M = NAUTICAL_MILE_M
# Maximum turning radius, true metres, that the schemas of RTZ 1.1 and 1.2 allow.
_MAX_RADIUS_M = 5 * NAUTICAL_MILE_M
# Drawing error of the chosen legs, as a share of the drawing error in the corridor: it is small, so
# that the limits are exact.
_FINAL_ERROR_SHARE = 0.01
_CACHE = "_exchange_waypoints"

# Largest ratio of the highest to the lowest speed of a leg: a vessel that sails the leg at its mean
# speed needs a few thousandths more fuel, by the propeller law.
_SAME_SPEED = 1.1
# Number of places along a leg at which its speed is looked up, and the least number of them in its
# first and its last part.
_PLACES, _MIN_PART = 200, 10


@dataclass(frozen=True)
class Waypoints:
    """A route's n waypoints, each with the leg that leaves it.

    No leg leaves the goal: its figures of a leg are NaN.

    Attributes
    ----------
    lonlat : (n, 2) degrees, continuous across 180; rounded to a millimetre, as in files.
    curve : geometry of the legs: loxodromes, or in high latitudes orthodromes.
    course_deg : (n,) true course at the leg's start.
    length_m : (n,) true metres along the leg.
    time_s : (n,) seconds since departure, on these legs: a little more than on the planned line.
    speed_m_s : (n,) mean speed over ground on the leg, in the current there.
    through_water_m_s : (n,) mean speed through water on the leg, over time.
    port_m, starboard_m : (n,) cross-track limits of the leg, true metres.
    radius_m : (n,) radius of the turn at the waypoint, true metres; 0 at start and goal.
    """

    ranked: RankedRoute
    lonlat: FloatArray
    curve: Curve
    course_deg: FloatArray
    length_m: FloatArray
    time_s: FloatArray
    speed_m_s: FloatArray
    through_water_m_s: FloatArray
    port_m: FloatArray
    starboard_m: FloatArray
    radius_m: FloatArray

    @property
    def metrics(self) -> RouteMetrics:
        """The route's metrics, with length and duration of these legs."""
        length_m, duration_s = float(self.length_m[:-1].sum()), float(self.time_s[-1])
        return replace(self.ranked.metrics, length_m=length_m, duration_s=duration_s)


def season_waypoints(result: RunResult, season: str) -> tuple[Waypoints, ...]:
    """Waypoints of a season's routes, best first.

    Computed once for each result and cached with it, since every exchange format needs them.
    """
    attributes = vars(result)
    if _CACHE not in attributes:
        attributes[_CACHE] = (Obstacles(result.scene), {})
    obstacles, cached = attributes[_CACHE]
    if season not in cached:
        routes = result.season_routes(season)
        unite_soft_no_go([ranked.route for ranked in routes])
        cached[season] = tuple(waypoints(ranked, result, obstacles) for ranked in routes)
    found: tuple[Waypoints, ...] = cached[season]
    return found


def both_sides(result: RunResult, season: str) -> tuple[Waypoints, ...]:
    """Waypoints of a season's best route, and of the best on another side of the main island."""
    best, *others = season_waypoints(result, season)
    side = best.ranked.metrics.main_passage
    return (best, *[other for other in others if other.ranked.metrics.main_passage != side][:1])


def waypoints(ranked: RankedRoute, result: RunResult, obstacles: Obstacles) -> Waypoints:
    """Thin a route's path to waypoints whose legs, as sailed, keep off land and off V.

    The legs stay within 0.1 % of the route's length (30 m on a short route) of the planned line,
    pass every island on the route's side, and need at most 0.3 % more fuel. The plan runs along V's
    edge; where there is room, the legs keep half of this tolerance from the edge. They enter V only
    where the path itself does, at a start or goal. Each via point is a waypoint, and so is each
    place where the speed through water changes by a tenth or more.
    """
    scene = result.scene
    line = shapely.LineString(ranked.route.path)
    areas = [area.polygon for area in scene.areas.get(ranked.season, ())]
    # An area that the path itself crosses is open when the vessel passes.
    kept_out = [area for area in areas if not line.intersects(area)]
    obstacles = Obstacles(scene, kept_out) if kept_out else obstacles
    pieces = [replace(ranked.route, path=piece) for piece in scene.pieces(ranked.route.path)]
    curve = curve_for(scene.projection.to_lonlat(ranked.route.path))
    length = ranked.route.length
    # Least tolerance and largest tolerance, as distances of the legs from the path, planar metres.
    least = min(MIN_TOLERANCE_M / scene.projection.scale, _MAX_TOLERANCE * length)
    max_tolerance = max(TOLERANCE * length, least)
    for share in _TOLERANCE_SHARES:
        corridor = safe_corridor(ranked.route, obstacles, share * max_tolerance)
        drawing = Drawing(scene.projection, curve, corridor.max_error * scene.projection.scale)
        # Each via point is a waypoint.
        corridors = [corridor]
        if len(pieces) > 1:
            tolerance = share * max_tolerance
            corridors = [safe_corridor(piece, obstacles, tolerance) for piece in pieces]
        parts = [drawing.lonlat(thin(one, drawing).xy) for one in corridors]
        lonlat = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
        final_error_m = drawing.error_m * _FINAL_ERROR_SHARE
        legs = tracks(lonlat[:-1], lonlat[1:], curve, scene.projection, final_error_m)
        if _fuel_along(legs.chain[0], ranked, result) <= (1 + MAX_EXTRA_FUEL) * ranked.route.fuel:
            break
    if len(parted := with_speed_changes(lonlat, ranked.route, drawing)) > len(lonlat):
        lonlat = parted
        legs = tracks(lonlat[:-1], lonlat[1:], curve, scene.projection, final_error_m)
    return _described(ranked, result, obstacles, corridor, lonlat, legs, curve)


def _described(
    ranked: RankedRoute,
    result: RunResult,
    obstacles: Obstacles,
    corridor: SafeCorridor,
    lonlat: FloatArray,
    legs: Tracks,
    curve: Curve,
) -> Waypoints:
    """Waypoints with the figures of their legs."""
    scene = result.scene
    factor = np.zeros(len(lonlat) - 1)
    np.maximum.at(factor, legs.leg, scene.projection.point_scale(legs.lonlat))
    # True metres per metre of the plane where the plane stretches the leg most, so that no limit is
    # too wide.
    true = scene.projection.scale / factor
    error = corridor.max_error * _FINAL_ERROR_SHARE
    cap = MAX_CROSS_TRACK_M / float(true.min()) + error
    limits = np.array(cross_track_limits(legs, ranked.route.soft_no_go, obstacles, cap))
    port, starboard = np.maximum(limits - error, 0.0)
    radius = float(ranked.route.speeds.max()) / scene.vessel.turn_rate
    turns = turning_radii(legs, corridor, min(radius, _MAX_RADIUS_M / float(true.max())))
    line, ends = legs.chain
    found = steps_along_legs(line, ranked, result)
    time = cumulative(found.true_s)[ends]
    through_water = np.add.reduceat(found.through_water_m_s * found.planner_s, ends[:-1])
    through_water /= np.add.reduceat(found.planner_s, ends[:-1])
    length = legs.length_m
    nothing = np.array([np.nan])
    return Waypoints(
        ranked=ranked,
        lonlat=lonlat,
        curve=curve,
        course_deg=np.append(initial_course_deg(lonlat[:-1], lonlat[1:], curve), nothing),
        length_m=np.append(length, nothing),
        time_s=time,
        speed_m_s=np.append(mean_speed(length, time), nothing),
        through_water_m_s=np.append(through_water, nothing),
        port_m=np.append(np.minimum(port * true, MAX_CROSS_TRACK_M), nothing),
        starboard_m=np.append(np.minimum(starboard * true, MAX_CROSS_TRACK_M), nothing),
        radius_m=np.concatenate([[0.0], turns * np.minimum(true[:-1], true[1:]), [0.0]]),
    )


def _fuel_along(line: FloatArray, ranked: RankedRoute, result: RunResult) -> float:
    """Fuel along a line (n, 2) of the plane, in the planner's units."""
    pieces, _, speeds = at_speeds_sailed(line, ranked)
    return renew.fuel(
        pieces,
        result.scene.currents[ranked.season],
        result.scene.vessel_in(ranked.season),
        drift=result.scenario.planner.drift,
        speeds=speeds,
    )


def with_speed_changes(lonlat: FloatArray, route: renew.Route, drawing: Drawing) -> FloatArray:
    """Add points to waypoints (n, 2), degrees, where the speed of a route has changed by a tenth.

    Within each part of a leg, speeds then differ by hardly more than a tenth.
    """
    if route.speeds.max() <= _SAME_SPEED * route.speeds.min():
        return lonlat
    projection = drawing.projection
    found = [lonlat[:1]]
    for begin, end in itertools.pairwise(lonlat):
        drawn = tracks(begin[None], end[None], drawing.curve, projection, drawing.error_m)
        evenly = np.linspace(0.0, 1.0, _PLACES + 1)
        line = shapely.LineString(drawn.xy)
        places = shapely.get_coordinates(line.interpolate(evenly, normalized=True))
        middles = (places[:-1] + places[1:]) / 2
        speeds = speeds_along(middles, np.asarray(route.path, dtype=float), route.speeds)
        shares = np.array(_changes(speeds)) / _PLACES
        found += [_at_shares(drawn.lonlat, drawn.xy, shares), end[None]]
    return np.concatenate(found)


def _changes(speeds: FloatArray) -> list[int]:
    """Indices of the speeds at which a new part of a leg begins."""
    changes = list[int]()
    least = most = speeds[0]
    for at, speed in enumerate(speeds):
        least, most = min(least, speed), max(most, speed)
        if most > _SAME_SPEED * least:
            changes.append(at)
            least = most = speed
    return [at for at in changes if _MIN_PART <= at <= len(speeds) - _MIN_PART]


def _at_shares(lonlat: FloatArray, xy: FloatArray, shares: FloatArray) -> FloatArray:
    """Positions (n, 2) at shares of a line's length in the plane, between its points."""
    along = cumulative(np.linalg.norm(np.diff(xy, axis=0), axis=1))
    at = shares * along[-1]
    between = np.stack([np.interp(at, along, lonlat[:, axis]) for axis in (0, 1)], axis=-1)
    return np.round(between, DECIMALS)
