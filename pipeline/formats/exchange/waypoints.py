"""A route as a navigator uses it: few waypoints, and what holds on the legs between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.formats.exchange.cross_track_limits import rooms, turning_radii
from pipeline.formats.exchange.safe_corridor import Shores, lane
from pipeline.formats.exchange.thinning import Drawing, thin
from pipeline.formats.exchange.tracks import Tracks, curve_for, initial_course_deg, tracks
from pipeline.formats.shared.legs import mean_speed, metres_along, times_at

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.formats.exchange.safe_corridor import Lane
    from pipeline.formats.exchange.tracks import Curve
    from pipeline.formats.shared.result import RankedRoute, RunResult

    FloatArray = npt.NDArray[np.float64]

NAUTICAL_MILE_M = 1852.0
# How far a leg may be from the planned line, as a share of the route's length: 0.7 km on 700 km.
TOLERANCE = 1e-3
# On short routes, where no course can be kept to that, it is so many true metres: GNSS alone may
# be 10 m off (IMO A.1046). But it is no more than a hundredth of the route.
LEAST_TOLERANCE_M = 30.0
_MOST_TOLERANCE = 1e-2
# Finer ones are tried while the thinned route would need more fuel than the limit.
_FINER = (1.0, 0.5, 0.25, 0.1)
MOST_MORE_FUEL = 3e-3
# Beyond a mile a cross-track alarm would tell nobody anything.
MOST_ROOM_M = NAUTICAL_MILE_M
# The schemas of RTZ 1.1 and 1.2 allow no larger turn.
_LARGEST_RADIUS_M = 5 * NAUTICAL_MILE_M
# The legs that were chosen are drawn so much finer, that rooms beside them are exact.
_FINENESS = 0.01
_KEPT_AS = "_exchange_waypoints"


@dataclass(frozen=True)
class Waypoints:
    """A route's n waypoints, each with the leg that leaves it; NaN for the goal's, which has none.

    Attributes
    ----------
    lonlat : (n, 2) degrees, continuous across 180; as written, to a millimetre.
    curve : what a leg is: a loxodrome, or in high latitudes an orthodrome.
    course_deg : (n,) true course at the leg's start.
    length_m : (n,) true metres along the leg.
    time_s : (n,) seconds since departure, on these legs; at the goal, the route's duration.
    speed_m_s : (n,) mean speed over ground on the leg.
    port_m, starboard_m : (n,) cross-track limits of the leg, true metres; see `rooms`.
    radius_m : (n,) of the turn at the waypoint, true metres; 0 at start and goal.
    """

    ranked: RankedRoute
    lonlat: FloatArray
    curve: Curve
    course_deg: FloatArray
    length_m: FloatArray
    time_s: FloatArray
    speed_m_s: FloatArray
    port_m: FloatArray
    starboard_m: FloatArray
    radius_m: FloatArray


def season_waypoints(result: RunResult, season: str) -> tuple[Waypoints, ...]:
    """Waypoints of a season's routes, best first.

    Worked out once a result, for the formats all want them; kept with it, as its cached
    properties are.
    """
    memory = vars(result)
    if _KEPT_AS not in memory:
        memory[_KEPT_AS] = (Shores(result.scene), {})
    shores, kept = memory[_KEPT_AS]
    if season not in kept:
        kept[season] = tuple(
            waypoints(ranked, result, shores) for ranked in result.season_routes(season)
        )
    found: tuple[Waypoints, ...] = kept[season]
    return found


def waypoints(ranked: RankedRoute, result: RunResult, shores: Shores) -> Waypoints:
    """Thin a route's path to waypoints whose legs, as sailed, stay off land and off V.

    The legs stay within 0.1 % of the route's length (30 m on a short one) from the planned line and
    on its side of every island, and need at most 0.3 % more fuel than it. The plan runs along V's
    edge; where there is water for it, they keep half so far from that. Only where the path itself
    lies in V, at a start or a goal in it, do the legs as well.
    """
    scene = result.scene
    curve = curve_for(scene.projection.to_lonlat(ranked.route.path))
    widest = _widest_lane(ranked.route.length, scene.projection.scale)
    # The last tolerance, or the first whose legs are as good as the plan.
    for share in _FINER:
        water = lane(ranked.route, shores, share * widest)
        drawing = Drawing(scene.projection, curve, water.error * scene.projection.scale)
        lonlat = drawing.lonlat(thin(water, drawing).xy)
        fine = drawing.error_m * _FINENESS
        legs = tracks(lonlat[:-1], lonlat[1:], curve, scene.projection, fine)
        if _needs(legs.chain[0], ranked, result) <= (1 + MOST_MORE_FUEL) * ranked.route.fuel:
            break
    return _described(ranked, result, shores, water, lonlat, legs, curve)


def _widest_lane(length: float, scale: float) -> float:
    """How far legs may be from a path of such a length, both in metres of the plane."""
    return max(TOLERANCE * length, min(LEAST_TOLERANCE_M / scale, _MOST_TOLERANCE * length))


def _described(
    ranked: RankedRoute,
    result: RunResult,
    shores: Shores,
    water: Lane,
    lonlat: FloatArray,
    legs: Tracks,
    curve: Curve,
) -> Waypoints:
    """Say what holds on the legs."""
    scene = result.scene
    factor = np.zeros(len(lonlat) - 1)
    np.maximum.at(factor, legs.leg, scene.projection.point_scale(legs.lonlat))
    # True metres to one of the plane, where the plane stretches most.
    true = scene.projection.scale / factor
    inexact = water.error * _FINENESS
    cap = MOST_ROOM_M / float(true.min()) + inexact
    found = np.array(rooms(legs, ranked.route.soft_no_go, shores, cap))
    port, starboard = np.maximum(found - inexact, 0.0)
    radius = scene.vessel.turning_radius
    turns = turning_radii(legs, water, min(radius, _LARGEST_RADIUS_M / float(true.max())))
    line, ends = legs.chain
    time = times_at(metres_along(line)[ends], line, ranked, result)
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
        port_m=np.append(np.minimum(port * true, MOST_ROOM_M), nothing),
        starboard_m=np.append(np.minimum(starboard * true, MOST_ROOM_M), nothing),
        radius_m=np.concatenate([[0.0], turns * np.minimum(true[:-1], true[1:]), [0.0]]),
    )


def _needs(line: FloatArray, ranked: RankedRoute, result: RunResult) -> float:
    """Fuel along a line (n, 2) of the plane, in the planner's units."""
    import renew

    return renew.fuel(
        line,
        result.scene.currents[ranked.season],
        result.scene.vessel,
        drift=result.scenario.planner.drift,
    )
