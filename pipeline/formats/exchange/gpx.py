"""Routes for a plotter or a phone, and the best one as planned, as a track: GPX 1.1.

`<scenario>-<season>.gpx` has the best route and the best one on the other side; the file with
`-all` has all routes of the season. GPX has no speed on a route, and OpenCPN ignores the times of
its points: the speed, and the departure if there is one, are in the extensions that OpenCPN reads.
"""

from datetime import datetime
from pathlib import Path
from typing import Any
from xml.sax import saxutils

import gpxpy.gpx
import numpy as np
from lxml import etree

from pipeline.formats.exchange import nautical
from pipeline.formats.passage.waypoints import Waypoints, both_sides, season_waypoints
from pipeline.formats.shared.legs import metres_along, times_at
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.formats.shared.text import route_summary, speed_over_ground
from pipeline.formats.shared.writing import xml_text
from pipeline.geo.projection import densified
from pipeline.model import RouteMetrics

# Maximum distance between points of the track, true metres: between them, the planned line and the
# line that a plotter draws are at most 0.2 m apart.
_TRACK_STEP_M = 2_000.0
_OPENCPN = "http://www.opencpn.org"


def write_gpx(
    result: RunResult,
    season: str,
    path: Path,
    *,
    departure: datetime | None = None,
    every: bool = False,
) -> None:
    """Write a season's best route and the other side's best, or `every` route, as GPX 1.1.

    A `rte` holds a route's few waypoints, with its rank as number; the `trk` is the best route's
    path as planned. With a departure, which needs a time zone, all points have times.
    """
    gpx = gpxpy.gpx.GPX()
    gpx.creator = "RENEW"
    gpx.name = xml_text(nautical.document_title(result, season))
    found = season_waypoints(result, season) if every else both_sides(result, season)
    known = nautical.limits_text(result, found[0].ranked.metrics)
    gpx.description = xml_text(
        " ".join(
            part
            for part in (result.scenario.description, known, nautical.attribution(result))
            if part
        )
    )
    gpx.author_name = "RENEW"
    # gpxpy escapes text between tags, but leaves attributes to its caller.
    gpx.copyright_author = saxutils.escape(xml_text(nautical.attribution(result)), {'"': "&quot;"})
    gpx.copyright_year = str(result.created.year)
    gpx.time = result.created
    gpx.nsmap = {"opencpn": _OPENCPN}
    gpx.routes = [_route(points, result, departure) for points in found]
    gpx.tracks = [_track(found[0].ranked, result, departure)]
    path.write_bytes(gpx.to_xml(version="1.1").encode())


def _route(points: Waypoints, result: RunResult, departure: datetime | None) -> gpxpy.gpx.GPXRoute:
    """Waypoints of a route, each describing the leg that leaves it."""
    ranked, count = points.ranked, len(points.lonlat)
    route = gpxpy.gpx.GPXRoute(
        name=xml_text(nautical.route_name(ranked, result)),
        description=xml_text(_summary(points.metrics, result)),
        number=ranked.rank,
    )
    for index, (longitude, latitude) in enumerate(points.lonlat):
        name = f"{ranked.season} {ranked.rank} {nautical.waypoint_name(index, count)}"
        point = gpxpy.gpx.GPXRoutePoint(
            latitude=float(latitude),
            longitude=nautical.wrapped_longitude(longitude),
            time=None
            if departure is None
            else nautical.time_after(departure, points.time_s[index]),
            name=xml_text(name),
            description=nautical.leg_text(points, index)
            if index + 1 < count
            else "end of the route",
        )
        if index:  # as in RTZ, a waypoint has the speed of the leg that leads to it
            speed = _knots(points.speed_m_s[index - 1])
            point.extensions = [_opencpn("rte_properties", planned_speed=speed)]
        route.points.append(point)
    told = {
        "start": nautical.waypoint_name(0, count),
        "end": nautical.waypoint_name(count - 1, count),
        "planned_speed": _knots(speed_over_ground(points.metrics)),
    }
    if departure is not None:
        told["planned_departure"] = f"{nautical.time_after(departure, 0.0):%Y-%m-%dT%H:%M:%SZ}"
    route.extensions = [_opencpn(name, text) for name, text in told.items()]
    return route


def _opencpn(name: str, text: str | None = None, **values: str) -> Any:  # noqa: ANN401 - lxml has no types
    """Make an element that OpenCPN reads."""
    element = etree.Element(f"{{{_OPENCPN}}}{name}", values)
    element.text = text
    return element


def _knots(speed_m_s: float) -> str:
    """Write a speed in knots."""
    return f"{speed_m_s * nautical.KNOTS_PER_M_S:.4f}"


def _track(
    ranked: RankedRoute, result: RunResult, departure: datetime | None
) -> gpxpy.gpx.GPXTrack:
    """Path of a route as planned, in small steps."""
    projection = result.scene.projection
    path = np.asarray(ranked.route.path, dtype=float)
    dense = densified(path, _TRACK_STEP_M / projection.scale)
    times = times_at(metres_along(dense), path, ranked, result)
    lonlat = projection.to_lonlat(dense)
    segment = gpxpy.gpx.GPXTrackSegment()
    segment.points = [
        gpxpy.gpx.GPXTrackPoint(
            latitude=round(float(latitude), 8),
            longitude=nautical.wrapped_longitude(longitude),
            time=None if departure is None else nautical.time_after(departure, seconds),
        )
        for (longitude, latitude), seconds in zip(lonlat, times, strict=True)
    ]
    track = gpxpy.gpx.GPXTrack(
        name=xml_text(f"{nautical.route_name(ranked, result)}, as planned"),
        description=xml_text(_summary(ranked.metrics, result)),
    )
    track.segments = [segment]
    return track


def _summary(metrics: RouteMetrics, result: RunResult) -> str:
    """Way, length, duration and clearance of a route, and what is not known about it."""
    known = nautical.limits_text(result, metrics)
    return " ".join(part for part in (route_summary(metrics), known) if part)
