"""A season's routes and waypoints for the web and for scripts, by RFC 7946: `.geojson`."""

from pathlib import Path
from typing import Any

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.formats.exchange import nautical
from pipeline.formats.gis.frames import GeoDataFrame
from pipeline.formats.gis.layers import LAYERS, waypoint_frame
from pipeline.formats.passage.waypoints import season_waypoints
from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import write_json

# Decimals of degrees, to resolve a centimetre: RFC 7946 asks for no more than is needed.
_DECIMALS = 7


def write_geojson(result: RunResult, season: str, path: Path) -> None:
    """Write a season's routes and their waypoints, best first.

    Routes have the geometry and columns of the GeoPackage's layer `routes`: their pieces, straight
    in degrees, lie within a metre of the planned line. Lines are cut at 180 degrees. The property
    `feature` of each feature is "route" or "waypoint".
    """
    routes = next(layer for layer in LAYERS if layer.name == "routes").frame(result)
    routes = routes[routes.season == season]
    lines = [_line(shapely.get_coordinates(line)) for line in routes.geometry]
    found = season_waypoints(result, season)
    waypoints = waypoint_frame(found)
    waypoints["geometry_type"] = [points.curve for points in found for _ in points.lonlat]
    places = nautical.within_180(np.concatenate([points.lonlat for points in found]))
    collection = {
        "type": "FeatureCollection",
        "bbox": bounding_box(routes.total_bounds.reshape(2, 2)),
        "title": nautical.document_title(result, season),
        "credits": nautical.attribution(result),
        "unknown": note_texts(result.unknowns),
        "features": [
            *_features("route", routes.set_geometry(lines)),
            *_features("waypoint", waypoints.set_geometry(shapely.points(places))),
        ],
    }
    write_json(path, collection, indent=None)


def _features(kind: str, frame: GeoDataFrame) -> list[dict[str, Any]]:
    """Features of a kind, their coordinates rounded."""
    shapes = shapely.transform(frame.geometry.array, lambda points: np.round(points, _DECIMALS))
    frame = frame.set_geometry(shapes).assign(feature=kind)
    return list(frame.iterfeatures(na="null", drop_id=True))


def _line(points: FloatArray) -> shapely.Geometry:
    """Make a LineString, or a MultiLineString if the line crosses 180 degrees."""
    parts = nautical.split_at_antimeridian(points)
    return shapely.LineString(parts[0]) if len(parts) == 1 else shapely.MultiLineString(parts)


def bounding_box(corners: FloatArray) -> list[float]:
    """West, south, east, north; west is greater than east if the box crosses 180 degrees."""
    (west, south), (east, north) = corners
    if east - west >= 360:
        west, east = -180.0, 180.0
    ends = nautical.within_180(np.array([[west, south], [east, north]]))
    # An eastern limit of 180 degrees must not become -180.
    ends[1, 0] = 180.0 if ends[1, 0] == -180 else ends[1, 0]
    return [float(value) for value in np.round(ends, _DECIMALS).ravel()]
