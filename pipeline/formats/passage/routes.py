"""Routes for plotters, phones and an ECDIS: GPX, and RTZ by IEC 61174.

`<scenario>-<season>.gpx` has the best route and the best one on the other side; the file with
`-all` has all that one may follow. GPX has no speed on a route, and OpenCPN ignores the times of
its points: the speed, and the departure if there is one, are in the extensions that OpenCPN reads.

In RTZ a waypoint holds the leg that leads to it. Versions of the format differ in their namespace,
in the spelling of some names, and in how extensions are wrapped.
"""

import math
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, TypeAlias
from xml.sax import saxutils

import gpxpy.gpx
import numpy as np
from lxml import etree

from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RankedRoute, RunCase, route_caveats
from pipeline.findings.route_profile import metres_along, times_at
from pipeline.findings.text import (
    duration,
    route_summary,
    speed_over_ground,
    turns_text,
    xml_environment,
)
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    NAUTICAL_MILE_M,
    Waypoints,
    attribution,
    both_sides,
    case_waypoints,
    document_title,
    left_text,
    leg_text,
    limits_text,
    point_text,
    route_name,
    time_after,
    vessel_name,
    wrapped_longitude,
)
from pipeline.geo.projection import densified
from pipeline.model import RouteMetrics
from pipeline.texts import clean

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
    routes = case_waypoints(case) if every else both_sides(case)
    tracks = [_track(routes[0].ranked, departure)]
    path.write_bytes(gpx_document(routes, departure, tracks))


def gpx_document(
    routes: Sequence[Waypoints], departure: datetime | None, tracks: list[gpxpy.gpx.GPXTrack]
) -> bytes:
    """Return the file of some routes of a case, at least one, and tracks."""
    gpx, ranked = gpxpy.gpx.GPX(), routes[0].ranked
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
    gpx.routes = [_route(points, departure) for points in routes]
    gpx.tracks = tracks
    return bytes(gpx.to_xml(version="1.1").encode())


def _route(points: Waypoints, departure: datetime | None) -> gpxpy.gpx.GPXRoute:
    """Return waypoints of a route, each describing the leg that leaves it."""
    ranked = points.ranked
    route = gpxpy.gpx.GPXRoute(
        name=route_name(ranked), description=_summary(points.metrics, ranked), number=ranked.rank
    )
    for index, (longitude, latitude) in enumerate(points.lonlat):
        point = gpxpy.gpx.GPXRoutePoint(
            latitude=float(latitude),
            longitude=wrapped_longitude(longitude),
            time=None if departure is None else time_after(departure, points.time_s[index]),
            name=points.names[index],
            description=point_text(points, index),
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
        name=f"{route_name(ranked)}, as planned", description=_summary(ranked.metrics, ranked)
    )
    track.segments = [segment]
    return track


def _summary(metrics: RouteMetrics, ranked: RankedRoute) -> str:
    """Return way, length, duration and clearance of a route, and what is not known about it."""
    return " ".join(filter(None, (route_summary(metrics), limits_text(ranked))))


_Attributes: TypeAlias = dict[str, str]

PROVENANCE = "urn:renew:provenance:1"
"""Namespace of our own elements, in the extensions."""

# Maximum length of each text, in characters, to keep files small: checkers refuse 400 kB.
_MAX_TEXT_LENGTH = 4_000
# Decimal places of nautical miles; the last one stands for 2 cm.
_MILE_DIGITS = 5


VERSIONS = {
    number: {
        "namespace": f"http://www.cirm.org/RTZ/{number.replace('.', '/')}",
        # The schema of version 1.0 spells it so.
        "schedule_element": "sheduleElement" if number == "1.0" else "scheduleElement",
        "wraps_extensions": number != "1.0",
    }
    for number in ("1.0", "1.1", "1.2")
}
"""The versions that can be written: number -> what differs."""


def write_rtz(case: RunCase, path: Path, *, departure: datetime | None = None) -> None:
    """Write the best route of a case that has one.

    The stem of the file becomes the route's name, since ECDIS want the two to be equal. Without a
    departure (and its time zone) the file has the speed and duration of each leg, but no times.
    Raises ValueError for a departure without a time zone.
    """
    points, scenario = case_waypoints(case)[0], case.scenario
    planned = points.ranked.metrics
    version = scenario.outputs.rtz_version
    # RTZ has no place for what is not known about a route, nor for what was decided for it.
    caveats = note_texts(route_caveats(points.ranked))
    method = "; ".join(("least fuel in the current", turns_text(planned), *caveats))
    content = (
        xml_environment("pipeline.formats.passage")
        .get_template("route.rtz.jinja")
        .render(
            version=version,
            form=VERSIONS[version],
            info={
                "routeName": clean(path.stem, _MAX_TEXT_LENGTH),
                "routeAuthor": "RENEW",
                "routeStatus": "planned",
                **({"vesselName": vessel} if (vessel := vessel_name(scenario)) else {}),
                "optimizationMethod": clean(method, _MAX_TEXT_LENGTH),
            },
            waypoints=list(_rtz_waypoints(points)),
            schedule=list(_schedule(points, departure)),
            provenance=_provenance(points),
            namespace=PROVENANCE,
        )
    )
    path.write_text(content.lstrip(), encoding="utf-8")


def _rtz_waypoints(points: Waypoints) -> Iterator[tuple[_Attributes, _Attributes, _Attributes]]:
    """Yield each waypoint, its position, and the leg that leads to it (empty for the first)."""
    for index, (longitude, latitude) in enumerate(points.lonlat):
        waypoint = {
            "id": str(index + 1),
            "revision": "0",
            "name": points.names[index],
            "radius": _miles(points.radius_m[index]),
        }
        place = {"lat": f"{latitude:.8f}", "lon": f"{wrapped_longitude(longitude):.8f}"}
        leg = {}
        if index:
            leg = {
                "starboardXTD": _miles(points.starboard_m[index - 1]),
                "portsideXTD": _miles(points.port_m[index - 1]),
                "geometryType": points.curve,
                "legInfo": leg_text(points, index - 1) + left_text(points, index),
                "legNote1": f"ends {duration(points.time_s[index])} after departure",
            }
        yield waypoint, place, leg


def _schedule(points: Waypoints, departure: datetime | None) -> Iterator[_Attributes]:
    """Yield each waypoint's time, if a departure is given, and the speed of the leg to it."""
    for index, seconds in enumerate(points.time_s):
        values = {"waypointId": str(index + 1)}
        if departure is not None:
            time = time_after(departure, seconds)
            values["eta" if index else "etd"] = f"{time:%Y-%m-%dT%H:%M:%SZ}"
        if index:
            values["speed"] = _knots(points.speed_m_s[index - 1])
        yield values


def _provenance(points: Waypoints) -> _Attributes:
    """Return the route's origin, what is not known about it, and the credits of its sources."""
    case = points.ranked.case
    texts = {
        "title": document_title(case),
        "description": case.scenario.description,
        "way": points.ranked.metrics.way,
        "unknown": limits_text(points.ranked),
        "credits": attribution(case.run),
        "created": f"{case.run.created:%Y-%m-%dT%H:%M:%SZ}",
    }
    return {name: clean(text, _MAX_TEXT_LENGTH) for name, text in texts.items()}


def _miles(metres: float) -> str:
    """Return nautical miles as text, rounded down so that limits are never overstated."""
    scale = 10**_MILE_DIGITS
    return f"{math.floor(metres / NAUTICAL_MILE_M * scale) / scale:.{_MILE_DIGITS}f}"
