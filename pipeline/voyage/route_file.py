"""Read a route that somebody else drew: GPX, RTZ or GeoJSON.

A GPX route and an RTZ have few waypoints, between which a vessel holds a course: legs are
loxodromes, as plotters draw them, or what an RTZ says. A GPX track and GeoJSON are lines as they
are; by RFC 7946 those of GeoJSON are straight in degrees.
"""

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import gpxpy
import gpxpy.gpx
import numpy as np
from lxml import etree

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.formats.passage.safe_corridor import Curve, curve_for, in_pieces
from pipeline.machine.paths import shown, unreadable_reason
from pipeline.texts import clean

# Largest file that is read, bytes: checkers of RTZ refuse 400 kB, and a track of a month has 10 MB.
_MOST_BYTES = 50_000_000
# Largest number of points of a line: a point each second of a day.
_MOST_POINTS = 100_000
# Longest piece of a leg, true metres: between its ends the plane's straight line is the leg.
_PIECE_M = 2_000.0
# Number of metres of a degree of latitude, roughly.
_DEGREE_M = 111_000.0


@dataclass(frozen=True, eq=False)
class GivenRoute:
    """A route of a file: n points, with names and times where the file has them.

    `lonlat` (n, 2) degrees, continuous across 180. `curves` are the geometries of its legs (n - 1),
    None for lines straight in degrees. `others` is the number of further routes of the file.
    """

    name: str
    form: str
    lonlat: FloatArray
    curves: tuple[Curve | None, ...]
    names: tuple[str, ...]
    times: tuple[datetime | None, ...]
    others: int = 0

    @property
    def is_by_legs(self) -> bool:
        """Whether it is given by legs on which a course is held, not as a line."""
        return self.curves[0] is not None

    @property
    def ends(self) -> tuple[str, str]:
        """Its ends as positions that have one meaning."""
        start, goal = (
            f"{abs(lat):.8f}{'NS'[lat < 0]} {abs(lon):.8f}{'EW'[lon < 0]}"
            for lon, lat in ((self.lonlat[[0, -1]] + [180, 0]) % [360, 360] - [180, 0]).tolist()
        )
        return start, goal

    @property
    def drawn(self) -> tuple[FloatArray, list[int]]:
        """Its line in short pieces (m, 2), degrees, and the indices (n,) of its points in it."""
        line, at = [self.lonlat[:1]], [0]
        for ends, curve in zip(itertools.pairwise(self.lonlat), self.curves, strict=True):
            begin, end = (one[None] for one in ends)
            if curve is None:
                far_m = _DEGREE_M * np.hypot(*(end - begin)[0])
                share = np.linspace(0.0, 1.0, 2 + int(far_m / _PIECE_M))[:, None]
                pieces = begin + share * (end - begin)
            else:
                pieces, _ = in_pieces(begin, end, curve, _PIECE_M)
            line.append(pieces[1:])
            at.append(at[-1] + len(pieces) - 1)
        return np.vstack(line), at


def read_route(path: Path) -> GivenRoute:
    """Read the first route of a file, or the first track or line.

    Raises
    ------
    RequestError
        The file can't be read, or has no route.
    """
    if reason := unreadable_reason(path):
        raise RequestError(f"FILE: {shown(path)} {reason}; give a route in GPX, RTZ or GeoJSON")
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"has more than {_MOST_BYTES // 1_000_000} MB; give the route alone")  # noqa: TRY301 - told with the file's name below
        content = path.read_bytes()
        head = content.lstrip(b"\xef\xbb\xbf \t\r\n")[:1]
        found = list(_of_json(content) if head in (b"{", b"[") else _of_xml(content))
        usable = [one for one in found if len(one.lonlat) > 1]
        if not usable:
            raise ValueError("has no route, track or line of at least two points")  # noqa: TRY301
        return _checked(usable)
    except RecursionError:
        raise RequestError(f"FILE: {shown(path)} is nested too deep for a route") from None
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        etree.XMLSyntaxError,
        gpxpy.gpx.GPXException,
    ) as error:
        why = (
            clean(str(error)) if type(error) is ValueError else f"is damaged ({clean(str(error))})"
        )
        raise RequestError(
            f"FILE: {shown(path)} {why}; give a route in GPX, RTZ or GeoJSON"
        ) from None


def _checked(found: list[GivenRoute]) -> GivenRoute:
    """Return the first route of a file, its longitudes continuous; ValueError for bad figures."""
    route = found[0]
    lon, lat = route.lonlat.T
    if len(lon) > _MOST_POINTS:
        raise ValueError(f"has a line of {len(lon):,} points, more than {_MOST_POINTS:,}; thin it")
    wrong = ~((np.abs(lon) <= 360) & (np.abs(lat) <= 90))
    if wrong.any():
        at = int(wrong.argmax())
        raise ValueError(f"has a point {at + 1} at longitude {lon[at]:g}, latitude {lat[at]:g}")
    lonlat = np.column_stack([np.unwrap(lon, period=360.0), lat])
    kept = np.append(True, np.any(np.diff(lonlat, axis=0) != 0, axis=1))
    if kept.sum() < 2:
        raise ValueError("has a route whose points are all at one place")
    which = np.flatnonzero(kept)
    return GivenRoute(
        route.name,
        route.form,
        lonlat[kept],
        tuple(route.curves[at - 1] for at in which[1:]),
        tuple(route.names[at] for at in which),
        tuple(route.times[at] for at in which),
        len(found) - 1,
    )


def _line(name: str, form: str, lonlat: Any) -> GivenRoute:  # noqa: ANN401 - as a file has it
    """Return a line as it is, without names and times of its points."""
    points = np.array([one[:2] for one in lonlat], dtype=float).reshape(-1, 2)
    count = len(points)
    return GivenRoute(
        name, form, points, (None,) * max(0, count - 1), ("",) * count, (None,) * count
    )


def _of_json(content: bytes) -> Iterator[GivenRoute]:
    """Yield the lines of a GeoJSON: our best route first, as its features are in order."""
    document = json.loads(content)
    for feature in document.get("features") or [document]:
        shape = feature.get("geometry") or feature
        name = str((feature.get("properties") or {}).get("name") or "")
        if shape.get("type") == "LineString":
            yield _line(name, "GeoJSON", shape["coordinates"])
        elif shape.get("type") == "MultiLineString":
            # A line across 180 degrees is written in parts.
            yield _line(name, "GeoJSON", list(itertools.chain(*shape["coordinates"])))


def _of_xml(content: bytes) -> Iterator[GivenRoute]:
    """Yield the routes of an RTZ; or the routes of a GPX, and then its tracks."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    root = etree.fromstring(content, parser)
    kind = etree.QName(root).localname
    if kind == "route":
        yield _of_rtz(root)
    elif kind == "gpx":
        gpx = gpxpy.parse(etree.tostring(root, encoding="unicode"))
        for route in gpx.routes:
            yield _of_points(str(route.name or ""), "GPX route", route.points)
        for track in gpx.tracks:
            points = [point for segment in track.segments for point in segment.points]
            lonlat = [(point.longitude, point.latitude) for point in points]
            yield _line(str(track.name or ""), "GPX track", lonlat)
    else:
        raise ValueError(f"is XML with the root {clean(kind)!r}, which is no route")


def _of_points(name: str, form: str, points: list[Any]) -> GivenRoute:
    """Return a route of a GPX."""
    lonlat = np.array([(one.longitude, one.latitude) for one in points]).reshape(-1, 2)
    curve = curve_for(lonlat) if len(lonlat) else "Loxodrome"
    return GivenRoute(
        clean(name),
        form,
        lonlat,
        (curve,) * max(0, len(points) - 1),
        tuple(clean(str(one.name or "")) for one in points),
        tuple(None if one.time is None else _utc(one.time) for one in points),
    )


def _of_rtz(root: Any) -> GivenRoute:  # noqa: ANN401 - lxml has no types
    """Return the route of an RTZ, with the times of its first schedule that has any."""
    stated: dict[str, datetime] = {}
    for one in root.iterfind(".//{*}schedules//*[@waypointId]"):
        time = one.get("eta") or one.get("etd")
        if time and one.get("waypointId") not in stated:
            stated[one.get("waypointId")] = _utc(datetime.fromisoformat(time))
    points = list(root.iterfind("{*}waypoints/{*}waypoint"))
    places = [point.find("{*}position") for point in points]
    if any(place is None for place in places):
        raise ValueError("has a waypoint without a position")
    legs = [point.find("{*}leg") for point in points[1:]]
    info = root.find("{*}routeInfo")
    return GivenRoute(
        clean("" if info is None else info.get("routeName", "")),
        "RTZ",
        np.array([(place.get("lon"), place.get("lat")) for place in places], dtype=float),
        tuple(
            "Orthodrome"
            if leg is not None and leg.get("geometryType") == "Orthodrome"
            else "Loxodrome"
            for leg in legs
        ),
        tuple(clean(point.get("name") or "") for point in points),
        tuple(stated.get(point.get("id", "")) for point in points),
    )


def _utc(time: datetime) -> datetime:
    """Return a time in UTC; without a zone it is in UTC, as both formats demand."""
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).astimezone(UTC)
