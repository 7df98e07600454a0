"""Routes for plotters, phones and Google Earth: GPX, KML.

`<scenario>-<season>.gpx` has the best route and the best one on the other side; the file with
`-all` has all routes of the case. GPX has no speed on a route, and OpenCPN ignores the times of
its points: the speed, and the departure if there is one, are in the extensions that OpenCPN reads.

Google Earth draws straight lines between points as great circles, so legs are drawn in small steps.

The KML file is a template, because simplekml fails on characters that XML forbids, and importing
fastkml (128 ms) takes longer than writing the file.
"""

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.sax import saxutils

import gpxpy.gpx
import numpy as np
from lxml import etree

from pipeline._types import FloatArray
from pipeline.findings.result import RankedRoute, RunCase
from pipeline.findings.route_profile import metres_along, times_at
from pipeline.findings.text import (
    route_summary,
    speed_over_ground,
    xml_environment,
)
from pipeline.formats.palette import season_colour
from pipeline.formats.passage.tracks import tracks
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    Waypoints,
    attribution,
    both_sides,
    case_waypoints,
    document_title,
    leg_text,
    limits_text,
    route_name,
    split_at_antimeridian,
    time_after,
    wrapped_longitude,
)
from pipeline.geo.projection import densified
from pipeline.model import RouteMetrics

# Maximum distance between points of the track, true metres: between them, the planned line and the
# line that a plotter draws are at most 0.2 m apart.
_TRACK_STEP_M = 2_000.0
_OPENCPN = "http://www.opencpn.org"


def write_gpx(
    case: RunCase, path: Path, *, departure: datetime | None = None, every: bool = False
) -> None:
    """Write a case's best route and the other side's best, or `every` route, as GPX 1.1.

    A `rte` holds a route's few waypoints, with its rank as number; the `trk` is the best route's
    path as planned. With a departure, which needs a time zone, all points have times.
    """
    found = case_waypoints(case) if every else both_sides(case)
    tracks = [_track(found[0].ranked, departure)]
    path.write_bytes(gpx_document(found, departure, tracks))


def gpx_document(
    found: Sequence[Waypoints], departure: datetime | None, tracks: list[gpxpy.gpx.GPXTrack]
) -> bytes:
    """Return the file of some routes of a case, at least one, and tracks."""
    gpx, ranked = gpxpy.gpx.GPX(), found[0].ranked
    result = ranked.case.run
    gpx.creator = "RENEW"
    gpx.name = document_title(ranked.case)
    known = limits_text(ranked)
    parts = (result.scenario.description, known, attribution(result))
    gpx.description = " ".join(filter(None, parts))
    gpx.author_name = "RENEW"
    # gpxpy escapes text between tags, but leaves attributes to its caller.
    gpx.copyright_author = saxutils.escape(attribution(result), {'"': "&quot;"})
    gpx.copyright_year = str(result.created.year)
    gpx.time = result.created
    gpx.nsmap = {"opencpn": _OPENCPN}
    gpx.routes = [_route(points, departure) for points in found]
    gpx.tracks = tracks
    return bytes(gpx.to_xml(version="1.1").encode())


def _route(points: Waypoints, departure: datetime | None) -> gpxpy.gpx.GPXRoute:
    """Return waypoints of a route, each describing the leg that leaves it."""
    ranked, count = points.ranked, len(points.lonlat)
    route = gpxpy.gpx.GPXRoute(
        name=route_name(ranked),
        description=_summary(points.metrics, ranked),
        number=ranked.rank,
    )
    for index, (longitude, latitude) in enumerate(points.lonlat):
        name = f"{ranked.case.name} {ranked.rank} {points.names[index]}"
        point = gpxpy.gpx.GPXRoutePoint(
            latitude=float(latitude),
            longitude=wrapped_longitude(longitude),
            time=None if departure is None else time_after(departure, points.time_s[index]),
            name=name,
            description=leg_text(points, index) if index + 1 < count else "end of the route",
        )
        if index:  # as in RTZ, a waypoint has the speed of the leg that leads to it
            speed = _knots(points.speed_m_s[index - 1])
            point.extensions = [_opencpn("rte_properties", planned_speed=speed)]
        route.points.append(point)
    extensions = {
        "start": points.names[0],
        "end": points.names[-1],
        "planned_speed": _knots(speed_over_ground(points.metrics)),
    }
    if departure is not None:
        extensions["planned_departure"] = f"{time_after(departure, 0.0):%Y-%m-%dT%H:%M:%SZ}"
    route.extensions = [_opencpn(name, text) for name, text in extensions.items()]
    return route


def _opencpn(name: str, text: str | None = None, **values: str) -> Any:  # noqa: ANN401 - lxml has no types
    """Make an element that OpenCPN reads."""
    element = etree.Element(f"{{{_OPENCPN}}}{name}", values)
    element.text = text
    return element


def _knots(speed_m_s: float) -> str:
    """Write a speed in knots."""
    return f"{speed_m_s * KNOTS_PER_M_S:.4f}"


def _track(ranked: RankedRoute, departure: datetime | None) -> gpxpy.gpx.GPXTrack:
    """Return the path of a route as planned, in small steps."""
    projection = ranked.case.run.water.projection
    path = np.asarray(ranked.route.path, dtype=float)
    dense = densified(path, _TRACK_STEP_M / projection.scale)
    times = times_at(metres_along(dense), path, ranked)
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
        name=f"{route_name(ranked)}, as planned",
        description=_summary(ranked.metrics, ranked),
    )
    track.segments = [segment]
    return track


def _summary(metrics: RouteMetrics, ranked: RankedRoute) -> str:
    """Return way, length, duration and clearance of a route, and what is not known about it."""
    return " ".join(filter(None, (route_summary(metrics), limits_text(ranked))))


# Maximum distance, true metres, between a leg and the line drawn for it.
_ERROR_M = 10.0
# Widths of the lines, pixels, and opacities of the best route and of the other side's best.
_LINES = {"best": (4, 1.0), "other": (2, 0.6)}


def write_kml(case: RunCase, path: Path, *, departure: datetime | None = None) -> None:
    """Write a case's best route and the other side's best, with the best one's waypoints.

    With a departure, which needs a time zone, the waypoints have times.
    """
    best, *_ = found = both_sides(case)
    parts = (case.scenario.description, limits_text(best.ranked), attribution(case.run))
    colour = season_colour(case.number)
    content = (
        xml_environment("pipeline.formats.passage")
        .get_template("route.kml.jinja")
        .render(
            title=document_title(case),
            description=" ".join(part for part in parts if part),
            styles={name: (_abgr(colour, seen), width) for name, (width, seen) in _LINES.items()},
            routes=[
                {
                    "name": route_name(points.ranked),
                    "description": route_summary(points.metrics),
                    "parts": _line(points),
                }
                for points in found
            ],
            waypoints=list(_waypoints(best, departure)),
        )
    )
    path.write_text(content.lstrip(), encoding="utf-8")


def _line(points: Waypoints) -> list[FloatArray]:
    """Return a route's legs as one line (n, 2), degrees; in parts if it crosses 180 degrees."""
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(
        begin, end, points.curve, points.ranked.case.run.water.projection, _ERROR_M
    ).lonlat
    moved = np.any(np.diff(drawn, axis=0) != 0, axis=1)
    return split_at_antimeridian(drawn[np.concatenate([[True], moved])])


def _waypoints(points: Waypoints, departure: datetime | None) -> Iterator[dict[str, object]]:
    """Yield a route's waypoints, each with the leg that leaves it."""
    count = len(points.lonlat)
    for index, (longitude, latitude) in enumerate(points.lonlat):
        yield {
            "name": points.names[index],
            "description": leg_text(points, index) if index + 1 < count else "end of the route",
            "passed": departure and time_after(departure, points.time_s[index]),
            "place": (wrapped_longitude(longitude), latitude),
        }


def _abgr(colour: str, opacity: float) -> str:
    """Write a colour such as "#c9a97c" as KML does: opacity, blue, green, red."""
    red, green, blue = (colour[at : at + 2] for at in (1, 3, 5))
    return f"{round(255 * opacity):02x}{blue}{green}{red}"
