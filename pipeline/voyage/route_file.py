"""Read a route that somebody else drew: GPX, RTZ or GeoJSON.

A GPX route and an RTZ have few waypoints, between which a vessel holds a course: legs are
loxodromes, as plotters draw them, or what an RTZ says. A GPX track and GeoJSON are lines as they
are; by RFC 7946 those of GeoJSON are straight in degrees.
"""

import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import gpxpy
import numpy as np
from lxml import etree

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.formats.passage.safe_corridor import Curve, curve_for, in_pieces
from pipeline.geo.projection import GEOD, METRES_PER_DEGREE
from pipeline.machine.paths import shown, unreadable_reason
from pipeline.texts import clean
from pipeline.voyage.request import SNAP_M

# Largest file that is read, bytes: checkers of RTZ refuse 400 kB, and a track of a month has 10 MB.
_MOST_BYTES = 50_000_000
# Largest number of points of a line: a point each second of a day.
_MOST_POINTS = 100_000
# Longest piece of a leg, true metres: between its ends the plane's straight line is the leg.
_PIECE_M = 2_000.0
# A route ends where it begins if its ends are apart by less than this share of its farthest point.
_HOME_SHARE = 0.1
# What the libraries that read a file raise where it is damaged; lxml's error is a SyntaxError.
_DAMAGED = (OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError, SyntaxError)


class RoutePoint(NamedTuple):
    """A point of a route, degrees, and the geometry of the leg to it; None: straight in degrees."""

    lon: float
    lat: float
    name: str = ""
    time: datetime | None = None
    curve: Curve | None = None


@dataclass(frozen=True)
class GivenRoute:
    """A route of a file, of at least two points; `others` is the number of its further routes.

    Its parts were joined by straight lines, the longest of `joined_m` true metres.
    """

    name: str
    form: str
    points: tuple[RoutePoint, ...]
    others: int = 0
    joined_m: float = 0.0

    @cached_property
    def lonlat(self) -> FloatArray:
        """Its points (n, 2), degrees, continuous across 180."""
        lon, lat = np.array([point[:2] for point in self.points], dtype=float).T
        return np.column_stack([np.unwrap(lon, period=360.0), lat])

    @property
    def stops(self) -> dict[str, Any]:
        """Its ends, and of one that ends where it begins its farthest point, as `go` takes them."""
        off = (self.lonlat - self.lonlat[0]) * [np.cos(np.radians(self.lonlat[0, 1])), 1.0]
        far_m = METRES_PER_DEGREE * np.hypot(*off.T)
        is_closed = bool(far_m[-1] < min(SNAP_M, _HOME_SHARE * far_m.max()))
        places = self.lonlat[[0, *[far_m.argmax()] * is_closed, -1]]
        places[:, 0] = (places[:, 0] + 180) % 360 - 180
        start, *via, goal = (
            f"{abs(lat):.8f}{'NS'[lat < 0]} {abs(lon):.8f}{'EW'[lon < 0]}"
            for lon, lat in places.tolist()
        )
        return {"start": start, "via": via, "goal": goal}

    @property
    def drawn(self) -> tuple[FloatArray, list[int]]:
        """Its line in short pieces (m, 2), degrees, and the indices (n,) of its points in it."""
        line, at = [self.lonlat[:1]], [0]
        for ends, point in zip(itertools.pairwise(self.lonlat), self.points[1:], strict=True):
            begin, end = (one[None] for one in ends)
            if point.curve is None:
                far_m = METRES_PER_DEGREE * np.hypot(*(end - begin)[0])
                share = np.linspace(0.0, 1.0, 2 + int(far_m / _PIECE_M))[:, None]
                pieces = begin + share * (end - begin)
            else:
                pieces, _ = in_pieces(begin, end, point.curve, _PIECE_M)
            line.append(pieces[1:])
            at.append(at[-1] + len(pieces) - 1)
        return np.vstack(line), at


def read_route(path: Path) -> GivenRoute:
    """Read the first route of a file, or the first track or line.

    Raises RequestError if the file can't be read, or has no route.
    """
    try:
        why = unreadable_reason(path) or ""
        if not why and path.stat().st_size > _MOST_BYTES:
            why = f"has more than {_MOST_BYTES // 1_000_000} MB"
        if not why:
            content = path.read_bytes()
            head = content.lstrip(b"\xef\xbb\xbf \t\r\n")[:1]
            found = list(_of_json(content) if head in (b"{", b"[") else _of_xml(content))
            route, why = _first(found)
    except RecursionError:
        why = "is nested too deep"
    except (*_DAMAGED, gpxpy.gpx.GPXException) as error:
        why = f"is damaged ({clean(str(error))})"
    if why:
        raise RequestError(f"FILE: {shown(path)} {why}; give a route in GPX, RTZ or GeoJSON")
    return route


def _first(found: list[GivenRoute]) -> tuple[GivenRoute, str]:
    """Return the first route of a file without points twice, and what is wrong with it, or ""."""
    route = next((one for one in found if len(one.points) > 1), None)
    if route is None:
        return GivenRoute("", "", ()), "has no route, track or line of at least two points"
    for number, (lon, lat, *_) in enumerate(route.points, start=1):
        if not (abs(lon) <= 360 and abs(lat) <= 90):
            where = f"longitude {lon:g}, latitude {lat:g}, which is not on earth: give degrees"
            return route, f"has point {number} at {where}, or exchange the two"
    moved = np.any(np.diff(route.lonlat, axis=0) != 0, axis=1).tolist()
    kept = tuple(itertools.compress(route.points, [True, *moved]))
    why = "has a route whose points are all at one place" if len(kept) < 2 else ""
    if len(kept) > _MOST_POINTS:
        why = f"has a line of {len(kept):,} points, and {_MOST_POINTS:,} are read"
    return replace(route, name=clean(route.name), points=kept, others=len(found) - 1), why


def _joined_m(parts: Sequence[Sequence[Any]]) -> float:
    """Return the longest true metres from the end (lon, lat) of a part to the next one's begin."""
    pairs = itertools.pairwise(filter(None, parts))
    apart = (float(GEOD.inv(*one[-1][:2], *other[0][:2])[2]) for one, other in pairs)
    return max(apart, default=0.0)


def _of_json(content: bytes) -> Iterator[GivenRoute]:
    """Yield the lines of a GeoJSON: our best route first, as its features are in order."""
    document = json.loads(content)
    for feature in document.get("features") or [document]:
        shape = feature.get("geometry") or feature
        name = (feature.get("properties") or {}).get("name")
        if shape.get("type") in ("LineString", "MultiLineString"):
            parts = shape["coordinates"]  # of a line across 180 degrees, in parts
            if shape["type"] == "LineString":
                parts = [parts]
            points = (RoutePoint(float(one[0]), float(one[1])) for one in itertools.chain(*parts))
            joined_m = _joined_m(parts)
            yield GivenRoute(str(name or ""), "GeoJSON", tuple(points), joined_m=joined_m)


def _of_xml(content: bytes) -> Iterator[GivenRoute]:
    """Yield the route of an RTZ; or the routes of a GPX, and then its tracks."""
    root = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
    if etree.QName(root).localname == "route":
        yield _of_rtz(root)
        return
    gpx = gpxpy.parse(etree.tostring(root, encoding="unicode"))
    drawn: list[tuple[Any, str, list[list[Any]]]] = [
        *((one, "GPX route", [one.points]) for one in gpx.routes),
        *((one, "GPX track", [part.points for part in one.segments]) for one in gpx.tracks),
    ]
    for line, form, parts in drawn:
        joined_m = _joined_m([[(p.longitude, p.latitude) for p in part] for part in parts])
        places = [*itertools.chain(*parts)]
        lonlat = np.array([(one.longitude, one.latitude) for one in places] or [(0, 0)])
        curve = curve_for(lonlat) if form == "GPX route" else None
        points = (
            RoutePoint(
                one.longitude, one.latitude, clean(str(one.name or "")), _utc(one.time), curve
            )
            for one in places
        )
        yield GivenRoute(str(line.name or ""), form, tuple(points), joined_m=joined_m)


def _of_rtz(root: Any) -> GivenRoute:  # noqa: ANN401 - lxml has no types
    """Return the route of an RTZ, with the times of the first schedule that has any."""
    stated: dict[str, datetime | None] = {}
    for one in root.iterfind(".//{*}schedules//*[@waypointId]"):
        if time := one.get("eta") or one.get("etd"):
            stated.setdefault(one.get("waypointId"), _utc(datetime.fromisoformat(time)))
    points, usual = [], root.find("{*}waypoints/{*}defaultWaypoint/{*}leg")
    for point in root.iterfind("{*}waypoints/{*}waypoint"):
        place, legs = point.find("{*}position"), (point.find("{*}leg"), usual)
        kinds = (leg.get("geometryType") for leg in legs if leg is not None)
        is_orthodrome = next(filter(None, kinds), "") == "Orthodrome"
        curve: Curve = "Orthodrome" if is_orthodrome else "Loxodrome"
        lon, lat = float(place.get("lon")), float(place.get("lat"))
        named = clean(point.get("name") or ""), stated.get(point.get("id"))
        points.append(RoutePoint(lon, lat, *named, curve))
    info = root.find("{*}routeInfo")
    return GivenRoute("" if info is None else info.get("routeName", ""), "RTZ", tuple(points))


def _utc(time: datetime | None) -> datetime | None:
    """Return a time in UTC; without a zone it is in UTC, as both formats demand."""
    return time and (time if time.tzinfo else time.replace(tzinfo=UTC)).astimezone(UTC)
