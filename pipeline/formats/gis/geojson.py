"""A season's routes and waypoints for the web and for scripts, by RFC 7946: `.geojson`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.formats.exchange.text import attribution, document_title, waypoint_name
from pipeline.formats.gis.layers.all_layers import LAYERS
from pipeline.formats.passage.waypoints import Waypoints, season_waypoints
from pipeline.formats.shared.antimeridian import split_at_antimeridian, within_180
from pipeline.formats.shared.json_values import json_value
from pipeline.formats.shared.result import RunResult

Feature = dict[str, Any]

# Decimals of degrees, a centimetre: RFC 7946 asks for no more precision than is needed.
_DECIMALS = 7


def write_geojson(result: RunResult, season: str, path: Path) -> None:
    """Write a season's routes and their waypoints, best first.

    Routes have the geometry and columns of the GeoPackage's layer `routes`: straight lines in
    degrees are within a metre of the planned line. What crosses 180 degrees is cut there. Each
    feature's property `feature` is "route" or "waypoint".

    Raises
    ------
    OSError
        The file can't be written.
    """
    routes, longitudes = _routes(result, season)
    features = [*routes]
    for points in season_waypoints(result, season):
        features += _waypoints(points)
    collection = {
        "type": "FeatureCollection",
        "bbox": bounding_box(longitudes),
        "title": document_title(result, season),
        "credits": attribution(result),
        "unknown": list(result.unknowns),
        "features": features,
    }
    text = json.dumps(json_value(collection), ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _routes(result: RunResult, season: str) -> tuple[list[Feature], FloatArray]:
    """Features of the season's routes, and the corners (2, 2) of their bounding box in degrees."""
    table = next(layer for layer in LAYERS if layer.name == "routes").table(result)
    chosen = np.flatnonzero(table.columns["season"] == season)
    lines = [shapely.get_coordinates(table.geometry[row]) for row in chosen]
    features = [
        _feature(
            _line(split_at_antimeridian(line)),
            "route",
            {name: column[row] for name, column in table.columns.items()},
        )
        for row, line in zip(chosen, lines, strict=True)
    ]
    points = np.concatenate(lines)
    return features, np.stack([points.min(axis=0), points.max(axis=0)])


def _waypoints(points: Waypoints) -> list[Feature]:
    """Features of a route's waypoints, each with the leg that leaves it; null for the goal's."""
    count = len(points.lonlat)
    columns = {
        "course_deg": points.course_deg,
        "leg_length_m": points.length_m,
        "time_s": points.time_s,
        "speed_over_ground_m_s": points.speed_m_s,
        "speed_through_water_m_s": points.through_water_m_s,
        "port_m": points.port_m,
        "starboard_m": points.starboard_m,
        "turn_radius_m": points.radius_m,
    }
    return [
        _feature(
            {"type": "Point", "coordinates": _positions(within_180(point[None]))[0]},
            "waypoint",
            {
                "season": points.ranked.season,
                "rank": points.ranked.rank,
                "sequence": index + 1,
                "name": waypoint_name(index, count),
                "geometry_type": points.curve,
                **{name: column[index] for name, column in columns.items()},
            },
        )
        for index, point in enumerate(points.lonlat)
    ]


def _feature(geometry: dict[str, Any], kind: str, properties: dict[str, Any]) -> Feature:
    """Make a Feature of a kind."""
    return {
        "type": "Feature",
        "geometry": geometry,
        "properties": {"feature": kind, **properties},
    }


def _line(parts: list[FloatArray]) -> dict[str, Any]:
    """Make a LineString of one part, a MultiLineString of several."""
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": _positions(parts[0])}
    return {"type": "MultiLineString", "coordinates": [_positions(part) for part in parts]}


def bounding_box(corners: FloatArray) -> list[float]:
    """West, south, east, north; west is the greater where 180 degrees lie between them."""
    (west, south), (east, north) = corners
    if east - west >= 360:
        west, east = -180.0, 180.0
    ends = within_180(np.array([[west, south]])), within_180(np.array([[east, north]]))
    # An eastern limit of 180 degrees must not become -180.
    ends[1][0, 0] = 180.0 if ends[1][0, 0] == -180 else ends[1][0, 0]
    return [float(value) for end in ends for value in np.round(end[0], _DECIMALS)]


def _positions(points: FloatArray) -> list[list[float]]:
    """Coordinates as JSON lists, rounded."""
    rounded: list[list[float]] = np.round(points, _DECIMALS).tolist()
    return rounded
