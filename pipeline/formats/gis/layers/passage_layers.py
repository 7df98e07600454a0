"""Layers of the passage: the waypoints that the bridge steers by, and the limits of each leg."""

from collections.abc import Sequence

import numpy as np
import shapely

from pipeline._types import Geometries
from pipeline.formats.exchange.text import waypoint_name
from pipeline.formats.gis.layers.frames import GeoDataFrame, frame, multi, route_key
from pipeline.formats.passage.tracks import tracks
from pipeline.formats.passage.waypoints import Waypoints, season_waypoints
from pipeline.formats.shared.result import RunResult

# Maximum distance, true metres, between a leg and the line drawn for it.
_ERROR_M = 1.0


def passage(result: RunResult) -> GeoDataFrame:
    """Waypoints of the routes, each with the leg that leaves it; the goal has none."""
    return waypoint_frame(_waypoints(result)).drop(columns=["port_m", "starboard_m"])


def legs(result: RunResult) -> GeoDataFrame:
    """The water within each leg's cross-track limits."""
    found = _waypoints(result)
    frame = waypoint_frame(found).drop(columns=["name", "time_s", "turn_radius_m"])
    frame = frame[frame.course_deg.notna()].reset_index(drop=True)
    areas = [area for points in found for area in _areas(points, result)]
    return frame.set_geometry(multi(areas), crs=frame.crs)


def waypoint_frame(found: Sequence[Waypoints]) -> GeoDataFrame:
    """Waypoints of some routes, each with the leg that leaves it and its cross-track limits."""
    counts = [len(points.lonlat) for points in found]
    return frame(
        [shapely.points(points.lonlat) for points in found],
        {
            **route_key([points.ranked for points in found]),
            "sequence": [np.arange(count) + 1 for count in counts],
            "name": [[waypoint_name(at, count) for at in range(count)] for count in counts],
            "course_deg": [points.course_deg for points in found],
            "leg_length_m": [points.length_m for points in found],
            "time_s": [points.time_s for points in found],
            "speed_over_ground_m_s": [points.speed_m_s for points in found],
            "speed_through_water_m_s": [points.through_water_m_s for points in found],
            "turn_radius_m": [points.radius_m for points in found],
            "port_m": [points.port_m for points in found],
            "starboard_m": [points.starboard_m for points in found],
        },
    )


def _waypoints(result: RunResult) -> list[Waypoints]:
    """Waypoints of all routes; none of a planar scenario, which lies nowhere on earth."""
    if result.scenario.is_planar:
        return []
    seasons = dict.fromkeys(ranked.season for ranked in result.routes)
    return [points for season in seasons for points in season_waypoints(result, season)]


def _areas(points: Waypoints, result: RunResult) -> Geometries:
    """Area of each leg between its limits; empty where both are 0."""
    import pyproj

    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, result.scene.projection, _ERROR_M)
    geod, line = pyproj.Geod(ellps="WGS84"), drawn.lonlat
    ahead = np.asarray(geod.inv(line[:-1, 0], line[:-1, 1], line[1:, 0], line[1:, 1])[0])
    # A leg's last point has the course by which it is reached.
    last = np.append(drawn.leg[1:] != drawn.leg[:-1], True)
    course = np.where(last, np.roll(np.append(ahead, 0.0), 1), np.append(ahead, 0.0))
    sides = []
    for turn, limits in ((-90, points.port_m), (90, points.starboard_m)):
        lon, lat, _ = geod.fwd(line[:, 0], line[:, 1], course + turn, limits[drawn.leg])
        lon = line[:, 0] + (lon - line[:, 0] + 180) % 360 - 180
        sides.append(np.stack([lon, lat], axis=-1))
    areas = [
        shapely.Polygon(np.vstack([sides[0][drawn.leg == leg], sides[1][drawn.leg == leg][::-1]]))
        for leg in range(len(begin))
    ]
    return np.asarray(shapely.make_valid(areas))
