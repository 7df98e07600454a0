"""A route for a navigator: few waypoints, with course, speed and limits of each leg, and texts."""

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray, IntArray
from pipeline.findings import route_profile
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RankedRoute, RunCase, RunResult, once_per_case, route_caveats
from pipeline.findings.text import capitalised, duration
from pipeline.formats.passage.safe_corridor import (
    DECIMALS,
    Curve,
    Drawing,
    Obstacles,
    SafeCorridor,
    Tracks,
    cross_track_limits,
    curve_for,
    initial_course_deg,
    kept_out,
    safe_corridor,
    tracks,
    turning_radii,
)
from pipeline.formats.passage.thinning import thin
from pipeline.model import RouteMetrics
from pipeline.scenario.model import Scenario
from renew.results import unite_soft_no_go
from renew.voyage.fuel import speeds_along

NAUTICAL_MILE_M = 1852.0
# Maximum distance of a leg from the planned line, as a share of the route's length.
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
# Largest error of the curves drawn for the chosen legs, as a share of that for legs in the
# corridor: small, because the cross-track limits are measured from these curves.
_FINAL_ERROR_SHARE = 0.01
# Largest ratio of the highest to the lowest speed of a leg: a vessel that sails the leg at its mean
# speed needs a few thousandths more fuel, by the propeller law.
_SAME_SPEED = 1.1
# Number of places along a leg at which its speed is looked up.
_PLACES = 200
# Least number of these places in a leg's first and in its last part.
_MIN_PART = 10


@dataclass(frozen=True)
class Waypoints:
    """A route's n waypoints, each with the leg that leaves it.

    No leg leaves the goal, so its leg figures are NaN.

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
    fuel : (n,) used since departure on these legs, in the planner's units.
    """

    ranked: RankedRoute
    names: tuple[str, ...]
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
    fuel: FloatArray

    @property
    def left(self) -> FloatArray | None:
        """Energy left (n,), over the reserve, in the unit for readers; None if not known."""
        energy = self.ranked.metrics.energy
        if energy is None or not np.isfinite(energy.on_board):
            return None
        return energy.units * (energy.on_board - self.fuel)

    @property
    def metrics(self) -> RouteMetrics:
        """The route's metrics, with length and duration of these legs."""
        length_m, duration_s = float(self.length_m[:-1].sum()), float(self.time_s[-1])
        return replace(self.ranked.metrics, length_m=length_m, duration_s=duration_s)


@once_per_case
def case_waypoints(case: RunCase) -> tuple[Waypoints, ...]:
    """Return waypoints of a case's routes, best first: of those not dear, and each side's."""
    if not case.routes:
        return ()
    unite_soft_no_go([ranked.route for ranked in case.routes])
    obstacles = Obstacles(case.case)
    return tuple(waypoints(ranked, obstacles) for ranked in case.followed)


def both_sides(case: RunCase) -> tuple[Waypoints, ...]:
    """Return the waypoints of a case's best route, and of the best one on another side."""
    best, *others = case_waypoints(case)
    side = best.ranked.metrics.main_passage
    return (best, *[other for other in others if other.ranked.metrics.main_passage != side][:1])


def waypoints(ranked: RankedRoute, obstacles: Obstacles) -> Waypoints:
    """Thin a route's path to waypoints whose legs, as sailed, avoid land and the soft no-go zone V.

    The legs stay within 0.1 % of the route's length (30 m on a short route) of the planned line,
    pass every island on the route's side, and need at most 0.3 % more fuel. The plan runs along V's
    edge; where there is room, the legs keep half of this tolerance from the edge. They enter V only
    where the path itself does, at a start or goal. Each via point is a waypoint, and so is each
    place where the speed through water changes by a tenth or more.
    """
    case, projection = ranked.case.case, ranked.case.case.projection
    shut = kept_out(case, ranked.route)
    obstacles = Obstacles(case, shut) if shut else obstacles
    pieces = [replace(ranked.route, path=piece) for piece in case.pieces(ranked.route.path)]
    curve = curve_for(projection.to_lonlat(ranked.route.path))
    length = ranked.route.length
    # Least tolerance and largest tolerance, as distances of the legs from the path, planar metres.
    least = min(MIN_TOLERANCE_M / projection.scale, _MAX_TOLERANCE * length)
    max_tolerance = max(TOLERANCE * length, least)
    for share in _TOLERANCE_SHARES:
        corridor = safe_corridor(ranked.route, obstacles, share * max_tolerance)
        drawing = Drawing(projection, curve, corridor.max_error * projection.scale)
        corridors = [corridor]
        if len(pieces) > 1:
            tolerance = share * max_tolerance
            corridors = [safe_corridor(piece, obstacles, tolerance) for piece in pieces]
        parts = [drawing.lonlat(thin(one, drawing).xy) for one in corridors]
        lonlat = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
        final_error_m = drawing.error_m * _FINAL_ERROR_SHARE
        legs = tracks(lonlat[:-1], lonlat[1:], curve, projection, final_error_m)
        if _fuel_along(legs.chain[0], ranked) <= (1 + MAX_EXTRA_FUEL) * ranked.route.fuel:
            break
    if len(parted := with_speed_changes(lonlat, ranked.route, drawing)) > len(lonlat):
        lonlat = parted
        legs = tracks(lonlat[:-1], lonlat[1:], curve, projection, final_error_m)
    return _described(ranked, obstacles, corridor, lonlat, legs)


def _described(
    ranked: RankedRoute,
    obstacles: Obstacles,
    corridor: SafeCorridor,
    lonlat: FloatArray,
    legs: Tracks,
) -> Waypoints:
    """Return waypoints with the figures of their legs."""
    case, projection = ranked.case.case, ranked.case.case.projection
    curve = curve_for(projection.to_lonlat(ranked.route.path))
    factor = np.zeros(len(lonlat) - 1)
    np.maximum.at(factor, legs.leg, projection.point_scale(legs.lonlat))
    # True metres per planar metre where the plane stretches the leg most, so that no limit is too
    # wide.
    true = projection.scale / factor
    error = corridor.max_error * _FINAL_ERROR_SHARE
    cap = MAX_CROSS_TRACK_M / float(true.min()) + error
    limits = np.array(cross_track_limits(legs, ranked.route.soft_no_go, obstacles, cap))
    port, starboard = np.maximum(limits - error, 0.0)
    radius = float(ranked.route.speeds.max()) / case.vessel.turn_rate
    turns = turning_radii(legs, corridor, min(radius, _MAX_RADIUS_M / float(true.max())))
    line, ends = legs.chain
    steps = route_profile.steps_along_legs(line, ranked)
    time = route_profile.cumulative(steps.true_s)[ends]
    through_water = np.add.reduceat(steps.through_water_m_s * steps.planner_s, ends[:-1])
    through_water /= np.add.reduceat(steps.planner_s, ends[:-1])
    fuel = route_profile.cumulative(case.vessel.rates(steps.through_water_m_s) * steps.planner_s)
    length = legs.length_m
    nothing = np.array([np.nan])
    return Waypoints(
        ranked=ranked,
        names=waypoint_names(projection.to_plane(lonlat), case.via, ranked.rank),
        lonlat=lonlat,
        curve=curve,
        course_deg=np.append(initial_course_deg(lonlat[:-1], lonlat[1:], curve), nothing),
        length_m=np.append(length, nothing),
        time_s=time,
        speed_m_s=np.append(route_profile.mean_speed(length, time), nothing),
        through_water_m_s=np.append(through_water, nothing),
        port_m=np.append(np.minimum(port * true, MAX_CROSS_TRACK_M), nothing),
        starboard_m=np.append(np.minimum(starboard * true, MAX_CROSS_TRACK_M), nothing),
        radius_m=np.concatenate([[0.0], turns * np.minimum(true[:-1], true[1:]), [0.0]]),
        fuel=fuel[ends],
    )


def _fuel_along(line: FloatArray, ranked: RankedRoute) -> float:
    """Return the fuel along a line (n, 2) of the plane, in the planner's units."""
    pieces, _, speeds = route_profile.at_speeds_sailed(line, ranked)
    case, drift = ranked.case.case, ranked.case.scenario.planner.drift
    return renew.fuel(
        pieces, case.current, case.vessel, drift=drift, speeds=speeds, chart=case.chart
    )


def with_speed_changes(lonlat: FloatArray, route: renew.Route, drawing: Drawing) -> FloatArray:
    """Add points to waypoints (n, 2), degrees, where the speed of a route has changed by a tenth.

    Within each part of a leg, speeds then differ by hardly more than a tenth.
    """
    if route.speeds.max() <= _SAME_SPEED * route.speeds.min():
        return lonlat
    projection = drawing.projection
    parts = [lonlat[:1]]
    for begin, end in itertools.pairwise(lonlat):
        drawn = tracks(begin[None], end[None], drawing.curve, projection, drawing.error_m)
        evenly = np.linspace(0.0, 1.0, _PLACES + 1)
        line = shapely.LineString(drawn.xy)
        places = shapely.get_coordinates(line.interpolate(evenly, normalized=True))
        middles = (places[:-1] + places[1:]) / 2
        speeds = speeds_along(middles, np.asarray(route.path, dtype=float), route.speeds)
        shares = np.array(_changes(speeds)) / _PLACES
        parts += [_at_shares(drawn.lonlat, drawn.xy, shares), end[None]]
    return np.concatenate(parts)


def _changes(speeds: FloatArray) -> list[int]:
    """Return indices of the speeds at which a new part of a leg begins."""
    changes = list[int]()
    least = most = speeds[0]
    for at, speed in enumerate(speeds):
        least, most = min(least, speed), max(most, speed)
        if most > _SAME_SPEED * least:
            changes.append(at)
            least = most = speed
    return [at for at in changes if _MIN_PART <= at <= len(speeds) - _MIN_PART]


def _at_shares(lonlat: FloatArray, xy: FloatArray, shares: FloatArray) -> FloatArray:
    """Return positions (n, 2) at shares of a line's length in the plane, between its points."""
    along = route_profile.cumulative(np.linalg.norm(np.diff(xy, axis=0), axis=1))
    at = shares * along[-1]
    between = np.stack([np.interp(at, along, lonlat[:, axis]) for axis in (0, 1)], axis=-1)
    return np.round(between, DECIMALS)


KNOTS_PER_M_S = 3600 / NAUTICAL_MILE_M
# Maximum length of a vessel's name, in characters: checkers of RTZ warn above it.
_MAX_VESSEL_NAME = 32
# Maximum length of a waypoint's name, in characters: the shortest that plotters keep (NMEA 0183's
# WPL sentences in older receivers).
_MAX_NAME = 6
# A whole turn of longitude, degrees.
_TURN = np.array([360.0, 0.0])


def document_title(case: RunCase) -> str:
    """Return the title of a case's file, with the period of a current that stands in."""
    scenario, period = case.scenario, case.period_text
    used = f", in the current of {period}" if case.is_stand_in and period else ""
    return f"{scenario.title or scenario.name}: {case.title}{used}"


def vessel_name(scenario: Scenario) -> str:
    """Return the vessel's title, or its name if the title has more than 32 characters.

    It is "" for a vessel without a title or a name.
    """
    vessel = scenario.vessel
    short = vessel.label if len(vessel.label) <= _MAX_VESSEL_NAME else vessel.name
    return short[:_MAX_VESSEL_NAME]


def route_name(ranked: RankedRoute) -> str:
    """Return the name of a route in a plotter's list: "Palawan summer 01 west", sorted by rank.

    The scenario's name, the case, the rank, and how the route passes the main island.
    """
    digits = len(str(len(ranked.case.routes)))
    words = re.split(r"[-_\s]+", ranked.case.scenario.name)
    # Beside the case's own name the word "season" says nothing.
    place = " ".join(word for word in words if word.lower() != "season")
    rank = f"{ranked.rank:0{digits}d}"
    parts = (capitalised(place), ranked.case.name, rank, ranked.label or ranked.metrics.main_side)
    return " ".join(part for part in parts if part)


def attribution(result: RunResult) -> str:
    """Return credits that the sources' licences demand, in one line."""
    return "; ".join(dict.fromkeys(credit.text for credit in result.credits if credit.text))


def limits_text(ranked: RankedRoute) -> str:
    """Say how a route is not safe, what is not known and what was decided, in one line."""
    caveats = "; ".join(note_texts(route_caveats(ranked)))
    return f"{capitalised(caveats)}." if caveats else ""


def waypoint_names(
    places: FloatArray, via: FloatArray, rank: int, letters: Sequence[str] = ("S", "W", "V", "G")
) -> tuple[str, ...]:
    """Return names of waypoints (n, 2): S01-1, W02-1, V03-1, G04-1, with the route's rank.

    The letters are those of the start, of waypoints, of via points and of the goal. Names begin
    with the difference and have at most six characters, because that is where plotters cut first.
    """
    at_via = {int(np.linalg.norm(places - point, axis=1).argmin()) for point in via}
    start, inner, passed, goal = letters
    kinds = [passed if index in at_via else inner for index in range(len(places))]
    kinds[0], kinds[-1] = start, goal
    names = (f"{kind}{index + 1:02d}-{rank}" for index, kind in enumerate(kinds))
    return tuple(name[-_MAX_NAME:] for name in names)


def point_text(points: Waypoints, index: int) -> str:
    """Describe a waypoint: its route, and the leg that leaves it."""
    is_last = index + 1 == len(points.lonlat)
    leg = "end of the route" if is_last else leg_text(points, index)
    return f"{route_name(points.ranked)}: {leg}{left_text(points, index)}"


def left_text(points: Waypoints, index: int) -> str:
    """Say what energy is left at a waypoint: "; 512 Wh left"; empty if that is not known."""
    if points.left is None or points.ranked.metrics.energy is None:
        return ""
    return f"; {math.floor(points.left[index]):,} {points.ranked.metrics.energy.unit} left"


def leg_text(points: Waypoints, leg: int) -> str:
    """Describe the leg that leaves waypoint `leg`: "course 239.5°, 7.07 NM, 1.81 kn, 3 h 54 min".

    The speed through water follows if speeds are chosen, then the cross-track limits, rounded down.
    """
    speed = points.speed_m_s[leg] * KNOTS_PER_M_S
    through_water = ""
    if np.ptp(points.ranked.route.speeds) > 0:
        through_water = f" ({points.through_water_m_s[leg] * KNOTS_PER_M_S:.2f} kn through water)"
    length = points.length_m[leg] / NAUTICAL_MILE_M
    port, starboard = int(points.port_m[leg]), int(points.starboard_m[leg])
    return (
        f"course {round(points.course_deg[leg], 1) % 360:05.1f}°, {length:.2f} NM, "
        f"{speed:.2f} kn{through_water}, {duration(points.time_s[leg + 1] - points.time_s[leg])}; "
        f"cross-track limits {port} m to port, {starboard} m to starboard"
    )


def time_after(departure: datetime, seconds: float) -> datetime:
    """Return the time (UTC, whole seconds) at `seconds` after departure.

    Raises ValueError for a departure without a time zone, which is ambiguous.
    """
    if departure.tzinfo is None:
        raise ValueError(f"departure {departure.isoformat()} has no time zone; add one, such as Z")
    return (departure.astimezone(UTC) + timedelta(seconds=round(seconds))).replace(microsecond=0)


def wrapped_longitude(longitude: float) -> float:
    """Wrap a longitude to -180 to below 180 degrees, rounded as it is written."""
    wrapped = round((float(longitude) + 180) % 360 - 180, DECIMALS)
    return wrapped if wrapped < 180 else -180.0


def split_at_antimeridian(points: FloatArray) -> list[FloatArray]:
    """Cut a line (n, 2) in degrees, continuous across 180, into parts within -180 to 180 degrees.

    Both parts end at the cut, at an interpolated latitude. A line that only touches 180 degrees
    stays whole; one that runs along it is at -180.
    """
    turn = _whole_turns(points[:, 0])
    parts: list[list[FloatArray]] = [[points[0] - turn[0] * _TURN]]
    for (one, other), (begin, end) in zip(
        itertools.pairwise(points), itertools.pairwise(turn), strict=True
    ):
        step = int(np.sign(end - begin))
        for band in range(begin, end, step or 1):
            edge = 360.0 * (band + (step > 0)) - 180.0
            share = (edge - one[0]) / (other[0] - one[0])
            crossing = np.array([edge, one[1] + share * (other[1] - one[1])])
            parts[-1].append(crossing - band * _TURN)
            parts.append([crossing - (band + step) * _TURN])
        parts[-1].append(other - end * _TURN)
    whole = [part for part in map(np.array, parts) if len(np.unique(part, axis=0)) > 1]
    return whole or [np.array(parts[-1])]


def within_180(points: FloatArray) -> FloatArray:
    """Return points (n, 2) with longitudes from -180 to below 180 degrees."""
    return points - np.stack([360.0 * _whole_turns(points[:, 0]), np.zeros(len(points))], axis=-1)


def _whole_turns(longitude: FloatArray) -> IntArray:
    """Return by how many whole turns (n,) longitudes exceed the range of -180 to 180 degrees."""
    return np.floor((longitude + 180) / 360).astype(np.int64)
