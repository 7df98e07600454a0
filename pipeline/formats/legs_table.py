"""The rows of a passage plan: each waypoint with the figures of the leg that leads to it."""

import itertools
import math
from datetime import datetime
from typing import NamedTuple

import numpy as np

import renew
from pipeline._types import FloatArray
from pipeline.formats.exchange import nautical
from pipeline.formats.passage.tracks import Tracks, tracks
from pipeline.formats.passage.waypoints import NAUTICAL_MILE_M, Waypoints
from pipeline.formats.shared.legs import cumulative, steps_along_legs
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.route_profile import coast_index
from pipeline.formats.shared.text import to_minute

# Maximum distance, true metres, between a leg and the line on which it is measured.
_ERROR_M = 5.0
# Current below which no direction is given, knots.
_NO_CURRENT_KN = 0.05


class Row(NamedTuple):
    """A waypoint's cells as text; those of the leg that leads to it are empty for the start."""

    name: str
    latitude: str
    longitude: str
    course: str
    leg_nm: str
    to_go_nm: str
    speed_kn: str
    passed: str
    limits_m: str
    current: str
    clearance: str
    nearest_land: str


HEADINGS = Row(
    "Waypoint",
    "Latitude",
    "Longitude",
    "Course\n° true",
    "Leg\nNM",
    "To go\nNM",
    "Speed over\nground, kn",
    "Passed",
    "Limits, m\nport / stbd",
    "Current on leg\nto ° true, kn",
    "Least\nclearance",
    "from where on the leg",
)


# Of a route whose speeds are chosen: over ground, and through water.
_TWO_SPEEDS = "Speed, kn\nSOG / STW"


def headings(points: Waypoints) -> Row:
    """Headings of the table of a route."""
    return HEADINGS._replace(speed_kn=_TWO_SPEEDS) if has_speeds(points) else HEADINGS


def has_speeds(points: Waypoints) -> bool:
    """Whether a route is sailed at several speeds through water."""
    return bool(np.ptp(points.ranked.route.speeds) > 0)


def rows(points: Waypoints, result: RunResult, departure: datetime | None) -> list[Row]:
    """Rows of a route's waypoints, from start to goal."""
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, result.scene.projection, _ERROR_M)
    currents = _currents(drawn, points, result)
    nearest = [_nearest_land(drawn.xy[drawn.leg == leg], result) for leg in range(len(begin))]
    to_go = np.append(np.cumsum(points.length_m[:-1][::-1])[::-1], 0.0) / NAUTICAL_MILE_M
    found = []
    for index, (longitude, latitude) in enumerate(points.lonlat):
        leg = index - 1
        own = ("",) * 6
        if index:
            speed_kn = f"{points.speed_m_s[leg] * nautical.KNOTS_PER_M_S:.2f}"
            if has_speeds(points):
                speed_kn += f" / {points.through_water_m_s[leg] * nautical.KNOTS_PER_M_S:.2f}"
            own = (
                f"{round(float(points.course_deg[leg]), 1) % 360:05.1f}",
                f"{points.length_m[leg] / NAUTICAL_MILE_M:.2f}",
                speed_kn,
                f"{int(points.port_m[leg])} / {int(points.starboard_m[leg])}",
                currents[leg],
                "\t".join(nearest[leg]),
            )
        course, length, speed, limits, current, land = own
        clearance, _, where = land.partition("\t")
        found.append(
            Row(
                nautical.waypoint_name(index, len(points.lonlat)),
                position(float(latitude), "NS", 2),
                position(nautical.wrapped_longitude(longitude), "EW", 3),
                course,
                length,
                f"{to_go[index]:.1f}",
                speed,
                _passed(float(points.time_s[index]), departure),
                limits,
                current,
                clearance,
                where,
            )
        )
    return found


def position(degrees: float, sides: str, digits: int) -> str:
    """Write a coordinate in degrees and minutes: 12° 39.510' N."""
    minutes = round(abs(degrees) * 60, 3)
    whole, rest = divmod(minutes, 60)
    return f"{int(whole):0{digits}d}° {rest:06.3f}' {sides[degrees < 0]}"


def distance_text(metres: float) -> str:
    """Write a distance, rounded down so that it is never overstated: "1.24 NM", "820 m"."""
    if not math.isfinite(metres):
        return "no land"
    if metres >= NAUTICAL_MILE_M:
        return f"{math.floor(100 * metres / NAUTICAL_MILE_M) / 100:.2f} NM"
    return f"{math.floor(metres)} m"


def _passed(seconds: float, departure: datetime | None) -> str:
    """Time at which a waypoint is passed, or the time since departure."""
    if departure is None:
        return f"+ {nautical.duration(seconds)}"
    return f"{to_minute(nautical.time_after(departure, seconds)):%Y-%m-%d %H:%M}"


def _currents(drawn: Tracks, points: Waypoints, result: RunResult) -> list[str]:
    """Mean current on each leg, when it is sailed: where it sets to, and its speed in knots."""
    scene = result.scene
    line, ends = drawn.chain
    times = cumulative(steps_along_legs(line, points.ranked, result).planner_s)
    field = scene.currents[points.ranked.season]
    lonlat = scene.projection.to_lonlat(line)
    velocity = scene.projection.rotate_to_lonlat(lonlat, field.velocity(line, times))
    texts = []
    for first, last in itertools.pairwise(ends.tolist()):
        lengths = np.linalg.norm(np.diff(line[first : last + 1], axis=0), axis=1)
        middles = (velocity[first:last] + velocity[first + 1 : last + 1]) / 2
        east, north = np.average(middles, axis=0, weights=lengths)
        knots = float(np.hypot(east, north)) * nautical.KNOTS_PER_M_S
        to = round(math.degrees(math.atan2(east, north))) % 360
        texts.append(f"{to:03d}  {knots:.2f}" if knots >= _NO_CURRENT_KN else f"–  {knots:.2f}")
    return texts


def _nearest_land(line: FloatArray, result: RunResult) -> tuple[str, str]:
    """Least clearance of a leg from the original land, and the point of the leg where it is."""
    closest = coast_index(result.scene.land).closest_approach(line, result.scene.projection)
    if closest is None:
        return "no land", ""
    longitude, latitude = result.scene.projection.to_lonlat(closest.point)
    where = f"{position(float(latitude), 'NS', 2)}  {position(float(longitude), 'EW', 3)}"
    return distance_text(closest.clearance_m), where


def tightest_text(points: Waypoints, result: RunResult) -> str:
    """Say the padding where the route is nearest to a padded edge; empty without padding."""
    scene, ranked = result.scene, points.ranked
    found = renew.tightest(
        ranked.route, scene.currents[ranked.season], scene.vessel_in(ranked.season)
    )
    if found is None:
        return ""
    longitude, latitude = scene.projection.to_lonlat(found.point)
    scale = scene.projection.scale
    return (
        f"Padding at the tightest place, {position(float(latitude), 'NS', 2)} "
        f"{position(float(longitude), 'EW', 3)}: {found.padding * scale:,.0f} m, and the planned "
        f"path keeps {found.gap * scale:,.0f} m from the hard no-go zone there."
    )
