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
    """A waypoint's cells as text, with the figures of the leg that leads to it, if there is one."""

    name: str
    latitude: str
    longitude: str
    course: str = ""
    leg_nm: str = ""
    to_go_nm: str = ""
    speed_kn: str = ""
    passed: str = ""
    limits_m: str = ""
    current: str = ""
    clearance: str = ""
    nearest_land: str = ""


_HEADINGS = Row(
    *("Waypoint", "Latitude", "Longitude", "Course\n° true", "Leg\nNM", "To go\nNM"),
    *("Speed over\nground, kn", "Passed", "Limits, m\nport / stbd"),
    *("Current on leg\nto ° true, kn", "Least\nclearance", "from where on the leg"),
)


def headings(points: Waypoints) -> Row:
    """Headings of a route's table: speeds over ground and through water where speeds are chosen."""
    two = "Speed, kn\nSOG / STW"
    return _HEADINGS._replace(speed_kn=two) if has_speeds(points) else _HEADINGS


def has_speeds(points: Waypoints) -> bool:
    """Whether a route is sailed at several speeds through water."""
    return bool(np.ptp(points.ranked.route.speeds) > 0)


def rows(points: Waypoints, result: RunResult, departure: datetime | None) -> list[Row]:
    """Rows of a route's waypoints, from start to goal."""
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, result.scene.projection, _ERROR_M)
    currents = _currents(drawn, points, result)
    to_go = np.append(np.cumsum(points.length_m[:-1][::-1])[::-1], 0.0) / NAUTICAL_MILE_M
    found = []
    for index, (longitude, latitude) in enumerate(points.lonlat):
        seconds = float(points.time_s[index])
        passed = f"+ {nautical.duration(seconds)}"
        if departure is not None:
            passed = f"{to_minute(nautical.time_after(departure, seconds)):%Y-%m-%d %H:%M}"
        row = Row(
            name=nautical.waypoint_name(index, len(points.lonlat)),
            latitude=position(float(latitude), "NS", 2),
            longitude=position(float(longitude), "EW", 3),
            to_go_nm=f"{to_go[index]:.1f}",
            passed=passed,
        )
        if index:
            nearest = _nearest_land(drawn.xy[drawn.leg == index - 1], result)
            row = row._replace(**_leg(points, index - 1), current=currents[index - 1], **nearest)
        found.append(row)
    return found


def _leg(points: Waypoints, leg: int) -> dict[str, str]:
    """Course, length, speed and limits of a leg."""
    speed_kn = f"{points.speed_m_s[leg] * nautical.KNOTS_PER_M_S:.2f}"
    if has_speeds(points):
        speed_kn += f" / {points.through_water_m_s[leg] * nautical.KNOTS_PER_M_S:.2f}"
    return {
        "course": f"{round(float(points.course_deg[leg]), 1) % 360:05.1f}",
        "leg_nm": f"{points.length_m[leg] / NAUTICAL_MILE_M:.2f}",
        "speed_kn": speed_kn,
        "limits_m": f"{int(points.port_m[leg])} / {int(points.starboard_m[leg])}",
    }


def position(degrees: float, sides: str, digits: int) -> str:
    """Write a coordinate in degrees and minutes: 12° 39.510' N; a longitude within 180 degrees."""
    degrees = nautical.wrapped_longitude(degrees) if sides == "EW" else degrees
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


def _currents(drawn: Tracks, points: Waypoints, result: RunResult) -> list[str]:
    """Mean current on each leg at the time of passage: direction of set, and speed in knots."""
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


def _nearest_land(line: FloatArray, result: RunResult) -> dict[str, str]:
    """Least clearance of a leg from the original land, and the point of the leg where it is."""
    closest = coast_index(result.scene.land).closest_approach(line, result.scene.projection)
    if closest is None:
        return {"clearance": "no land"}
    longitude, latitude = result.scene.projection.to_lonlat(closest.point)
    where = f"{position(float(latitude), 'NS', 2)}  {position(float(longitude), 'EW', 3)}"
    return {"clearance": distance_text(closest.clearance_m), "nearest_land": where}


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
