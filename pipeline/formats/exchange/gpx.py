"""`<season>.gpx`: all routes of a season for a plotter or a phone, and the best one as a track."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING
from xml.sax import saxutils

import gpxpy.gpx
import numpy as np

from pipeline.formats.exchange.text import (
    attribution,
    document_title,
    leg_text,
    limits_text,
    time_after,
    waypoint_name,
    wrapped_longitude,
)
from pipeline.formats.exchange.waypoints import season_waypoints
from pipeline.formats.shared.legs import metres_along, times_at
from pipeline.formats.shared.text import distance, hours
from pipeline.formats.shared.xml_text import xml_text
from pipeline.geo.projection import densified

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

    from pipeline.formats.exchange.waypoints import Waypoints
    from pipeline.formats.shared.result import RankedRoute, RunResult

# Maximum distance between points of the track, true metres: between them, the planned line and the
# line that a plotter draws are at most 0.2 m apart.
_TRACK_STEP_M = 2_000.0


def write_gpx(
    result: RunResult, season: str, path: Path, *, departure: datetime | None = None
) -> None:
    """Write a season's routes, best first, as GPX 1.1.

    A `rte` holds a route's few waypoints, with its rank as number; the `trk` is the best route's
    path as planned. With a departure (and its time zone) all points have times.

    Raises
    ------
    ValueError
        A departure without a time zone.
    OSError
        The file can't be written.
    """
    gpx = gpxpy.gpx.GPX()
    gpx.creator = "RENEW"
    gpx.name = xml_text(document_title(result, season))
    found = season_waypoints(result, season)
    known = limits_text(result, found[0].ranked.metrics)
    gpx.description = xml_text(
        " ".join(part for part in (result.scenario.description, known, attribution(result)) if part)
    )
    gpx.author_name = "RENEW"
    # gpxpy escapes text between tags, but leaves attributes to its caller.
    gpx.copyright_author = saxutils.escape(xml_text(attribution(result)), {'"': "&quot;"})
    gpx.copyright_year = str(result.created.year)
    gpx.time = result.created
    gpx.routes = [_route(points, result, departure) for points in found]
    gpx.tracks = [_track(found[0].ranked, result, departure)]
    path.write_bytes(gpx.to_xml(version="1.1").encode())


def _route(points: Waypoints, result: RunResult, departure: datetime | None) -> gpxpy.gpx.GPXRoute:
    """Waypoints of a route, each describing the leg that leaves it."""
    ranked, count = points.ranked, len(points.lonlat)
    route = gpxpy.gpx.GPXRoute(
        name=xml_text(" ".join([ranked.season, str(ranked.rank), ranked.metrics.way]).strip()),
        description=xml_text(_summary(ranked, result)),
        number=ranked.rank,
    )
    route.points = [
        gpxpy.gpx.GPXRoutePoint(
            latitude=float(latitude),
            longitude=wrapped_longitude(longitude),
            time=None if departure is None else time_after(departure, points.time_s[index]),
            name=waypoint_name(index, count),
            description=leg_text(points, index) if index + 1 < count else "end of the route",
        )
        for index, (longitude, latitude) in enumerate(points.lonlat)
    ]
    return route


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
            longitude=wrapped_longitude(longitude),
            time=None if departure is None else time_after(departure, seconds),
        )
        for (longitude, latitude), seconds in zip(lonlat, times, strict=True)
    ]
    track = gpxpy.gpx.GPXTrack(
        name=xml_text(f"{ranked.season} {ranked.rank}, as planned"),
        description=xml_text(_summary(ranked, result)),
    )
    track.segments = [segment]
    return track


def _summary(ranked: RankedRoute, result: RunResult) -> str:
    """Way, length, duration and clearance of a route, and what is not known of it."""
    metrics = ranked.metrics
    parts = [metrics.way] if metrics.way else []
    parts += [distance(metrics.length_m), hours(metrics.duration_s)]
    if math.isfinite(metrics.clearance_m):
        parts.append(f"{distance(metrics.clearance_m)} or more from land")
    return " ".join(part for part in (f"{', '.join(parts)}.", limits_text(result, metrics)) if part)
