"""`<scenario>-<season>.kml`: the best route and the other side's best for Google Earth, KML 2.2.

Google Earth draws straight lines between points as great circles, so legs are drawn in small steps.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from pipeline._types import FloatArray
from pipeline.formats.exchange.text import (
    attribution,
    document_title,
    leg_text,
    limits_text,
    route_name,
    time_after,
    waypoint_name,
    wrapped_longitude,
)
from pipeline.formats.passage.tracks import tracks
from pipeline.formats.passage.waypoints import Waypoints, both_sides
from pipeline.formats.shared.antimeridian import split_at_antimeridian
from pipeline.formats.shared.palette import season_colour
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import route_summary
from pipeline.formats.shared.xml_text import xml_text

Element = Any  # lxml has no types

_NAMESPACE = "http://www.opengis.net/kml/2.2"
# Maximum distance, true metres, between a leg and the line drawn for it.
_ERROR_M = 10.0
# Widths of the lines, pixels, and opacities of the best route and of the other side's best.
_LINES = {"best": (4, 1.0), "other": (2, 0.6)}
# Names beside waypoints, and their symbols, as shares of the usual size.
_LABEL_SIZE, _ICON_SIZE = 0.7, 0.6


def write_kml(
    result: RunResult, season: str, path: Path, *, departure: datetime | None = None
) -> None:
    """Write a season's best route and the other side's best, with the best one's waypoints.

    With a departure (and its time zone) the waypoints have the time at which they are passed.

    Raises
    ------
    ValueError
        A departure without a time zone.
    OSError
        The file can't be written.
    """
    found = both_sides(result, season)
    root = etree.Element(f"{{{_NAMESPACE}}}kml", nsmap={None: _NAMESPACE})
    document = _child(root, "Document")
    _child(document, "name", document_title(result, season))
    known = limits_text(result, found[0].ranked.metrics)
    parts = (result.scenario.description, known, attribution(result))
    _child(document, "description", " ".join(part for part in parts if part))
    colour = season_colour([entry.season for entry in result.plans].index(season))
    for name, (width, opacity) in _LINES.items():
        _put_style(document, name, _abgr(colour, opacity), width)
    for points in found:
        _put_route(document, points, result)
    _put_waypoints(document, found[0], result, departure)
    path.write_bytes(
        etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    )


def _put_style(document: Element, name: str, colour: str, width: int) -> None:
    """Add the style of a route: its line, and the symbols and names of its waypoints."""
    style = _child(document, "Style", id=name)
    icon = _child(style, "IconStyle")
    _child(icon, "color", colour)
    _child(icon, "scale", f"{_ICON_SIZE:g}")
    _child(_child(style, "LabelStyle"), "scale", f"{_LABEL_SIZE:g}")
    line = _child(style, "LineStyle")
    _child(line, "color", colour)
    _child(line, "width", str(width))


def _put_route(document: Element, points: Waypoints, result: RunResult) -> None:
    """Add the legs of a route as one line; what crosses 180 degrees in parts."""
    placemark = _child(document, "Placemark")
    _child(placemark, "name", route_name(points.ranked, result))
    _child(placemark, "description", route_summary(points.metrics))
    _child(placemark, "styleUrl", "#best" if points.ranked.rank == 1 else "#other")
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, result.scene.projection, _ERROR_M).lonlat
    moved = np.any(np.diff(drawn, axis=0) != 0, axis=1)
    parts = split_at_antimeridian(drawn[np.concatenate([[True], moved])])
    parent = _child(placemark, "MultiGeometry") if len(parts) > 1 else placemark
    for part in parts:
        line = _child(parent, "LineString")
        _child(line, "tessellate", "1")
        _child(line, "coordinates", _coordinates(part))


def _put_waypoints(
    document: Element, points: Waypoints, result: RunResult, departure: datetime | None
) -> None:
    """Add a route's waypoints, each with the leg that leaves it."""
    folder = _child(document, "Folder")
    _child(folder, "name", f"Waypoints of {route_name(points.ranked, result)}")
    count = len(points.lonlat)
    for index, (longitude, latitude) in enumerate(points.lonlat):
        placemark = _child(folder, "Placemark")
        _child(placemark, "name", waypoint_name(index, count))
        text = leg_text(points, index) if index + 1 < count else "end of the route"
        _child(placemark, "description", text)
        if departure is not None:
            passed = time_after(departure, points.time_s[index])
            _child(_child(placemark, "TimeStamp"), "when", f"{passed:%Y-%m-%dT%H:%M:%SZ}")
        _child(placemark, "styleUrl", "#best")
        place = np.array([[wrapped_longitude(longitude), latitude]])
        _child(_child(placemark, "Point"), "coordinates", _coordinates(place))


def _child(parent: Element, tag: str, text: str = "", **values: str) -> Element:
    """Add an element with text and attributes."""
    element = etree.SubElement(parent, f"{{{_NAMESPACE}}}{tag}", values)
    if text:
        element.text = xml_text(text)
    return element


def _coordinates(points: Iterable[FloatArray]) -> str:
    """Write points as longitude,latitude."""
    return " ".join(f"{longitude:.8f},{latitude:.8f}" for longitude, latitude in points)


def _abgr(colour: str, opacity: float) -> str:
    """Write a colour such as "#c9a97c" as KML does: opacity, blue, green, red."""
    red, green, blue = (colour[at : at + 2] for at in (1, 3, 5))
    return f"{round(255 * opacity):02x}{blue}{green}{red}"
