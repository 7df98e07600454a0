"""`<scenario>-<season>.rtz`: the case's best route for an ECDIS, by IEC 61174 (route exchange).

In RTZ a waypoint holds the leg that leads to it. Versions of the format differ in their namespace,
in the spelling of some names, and in how extensions are wrapped.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TypeAlias

from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunCase, route_caveats
from pipeline.findings.text import duration, turns_text, xml_environment
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    NAUTICAL_MILE_M,
    Waypoints,
    attribution,
    case_waypoints,
    document_title,
    leg_text,
    limits_text,
    time_after,
    vessel_name,
    wrapped_longitude,
)
from pipeline.texts import clean

_Attributes: TypeAlias = dict[str, str]

PROVENANCE = "urn:renew:provenance:1"
"""Namespace of our own elements, in the extensions."""

# Maximum length of each text, in characters, to keep files small: checkers refuse 400 kB.
_MAX_TEXT_LENGTH = 4_000
# Decimal places of nautical miles; the last one stands for 2 cm.
_MILE_DIGITS = 5


@dataclass(frozen=True)
class _Version:
    """What differs between versions of the format."""

    namespace: str
    schedule_element: str = "scheduleElement"
    wraps_extensions: bool = True


VERSIONS = {
    "1.0": _Version("http://www.cirm.org/RTZ/1/0", "sheduleElement", wraps_extensions=False),
    "1.1": _Version("http://www.cirm.org/RTZ/1/1"),
    "1.2": _Version("http://www.cirm.org/RTZ/1/2"),
}
"""The versions that can be written: number -> what differs."""


def write_rtz(case: RunCase, path: Path, *, departure: datetime | None = None) -> None:
    """Write the best route of a case that has one.

    The stem of the file becomes the route's name, since ECDIS want the two to be equal. Without a
    departure (and its time zone) the file has the speed and duration of each leg, but no times.

    Raises
    ------
    ValueError
        A departure without a time zone.
    """
    text = rtz_text(case_waypoints(case)[0], path.stem, departure)
    path.write_text(text, encoding="utf-8")


def rtz_text(points: Waypoints, name: str, departure: datetime | None) -> str:
    """Return the file of a route under a name; see `write_rtz`."""
    planned, scenario = points.ranked.metrics, points.ranked.case.scenario
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
                "routeName": clean(name, _MAX_TEXT_LENGTH),
                "routeAuthor": "RENEW",
                "routeStatus": "planned",
                **({"vesselName": vessel} if (vessel := vessel_name(scenario)) else {}),
                "optimizationMethod": clean(method, _MAX_TEXT_LENGTH),
            },
            waypoints=list(_waypoints(points)),
            schedule=list(_schedule(points, departure)),
            provenance=_provenance(points),
            namespace=PROVENANCE,
        )
    )
    return content.lstrip()


def _waypoints(points: Waypoints) -> Iterator[tuple[_Attributes, _Attributes, _Attributes]]:
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
                "legInfo": leg_text(points, index - 1),
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
            values["speed"] = f"{points.speed_m_s[index - 1] * KNOTS_PER_M_S:.4f}"
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
