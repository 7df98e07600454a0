"""`<scenario>-<season>.kml`: the best route and the other side's best for Google Earth, KML 2.2.

Google Earth draws straight lines between points as great circles, so legs are drawn in small steps.

The file is a template: simplekml fails on characters that XML forbids, and fastkml takes longer to
import (128 ms) than the file to write.
"""

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import numpy as np

from pipeline._types import FloatArray
from pipeline.formats.exchange import nautical
from pipeline.formats.passage.tracks import tracks
from pipeline.formats.passage.waypoints import Waypoints, both_sides
from pipeline.formats.shared.palette import season_colour
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import route_summary
from pipeline.formats.shared.writing import xml_environment

# Maximum distance, true metres, between a leg and the line drawn for it.
_ERROR_M = 10.0
# Widths of the lines, pixels, and opacities of the best route and of the other side's best.
_LINES = {"best": (4, 1.0), "other": (2, 0.6)}


def write_kml(
    result: RunResult, season: str, path: Path, *, departure: datetime | None = None
) -> None:
    """Write a season's best route and the other side's best, with the best one's waypoints.

    With a departure, which needs a time zone, the waypoints have times.
    """
    best, *_ = found = both_sides(result, season)
    known = nautical.limits_text(result, best.ranked.metrics)
    parts = (result.scenario.description, known, nautical.attribution(result))
    colour = season_colour(result.season_index(season))
    content = (
        xml_environment("pipeline.formats.exchange")
        .get_template("route.kml.jinja")
        .render(
            title=nautical.document_title(result, season),
            description=" ".join(part for part in parts if part),
            styles={name: (_abgr(colour, seen), width) for name, (width, seen) in _LINES.items()},
            routes=[
                {
                    "name": nautical.route_name(points.ranked, result),
                    "description": route_summary(points.metrics),
                    "parts": _line(points, result),
                }
                for points in found
            ],
            waypoints=list(_waypoints(best, departure)),
        )
    )
    path.write_text(content.lstrip(), encoding="utf-8")


def _line(points: Waypoints, result: RunResult) -> list[FloatArray]:
    """The legs of a route as one line (n, 2) in degrees, in parts if it crosses 180 degrees."""
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, result.scene.projection, _ERROR_M).lonlat
    moved = np.any(np.diff(drawn, axis=0) != 0, axis=1)
    return nautical.split_at_antimeridian(drawn[np.concatenate([[True], moved])])


def _waypoints(points: Waypoints, departure: datetime | None) -> Iterator[dict[str, object]]:
    """Yield a route's waypoints, each with the leg that leaves it."""
    count = len(points.lonlat)
    for index, (longitude, latitude) in enumerate(points.lonlat):
        yield {
            "name": nautical.waypoint_name(index, count),
            "description": nautical.leg_text(points, index)
            if index + 1 < count
            else "end of the route",
            "passed": departure and nautical.time_after(departure, points.time_s[index]),
            "place": (nautical.wrapped_longitude(longitude), latitude),
        }


def _abgr(colour: str, opacity: float) -> str:
    """Write a colour such as "#c9a97c" as KML does: opacity, blue, green, red."""
    red, green, blue = (colour[at : at + 2] for at in (1, 3, 5))
    return f"{round(255 * opacity):02x}{blue}{green}{red}"
