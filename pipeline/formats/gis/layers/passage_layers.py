"""Layers of the passage: the waypoints that the bridge steers by, and the limits of each leg."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

from pipeline.formats.exchange.text import waypoint_name
from pipeline.formats.gis.layers.columns import (
    Table,
    concatenated,
    integer,
    multi,
    route_key,
    stack,
    text,
)
from pipeline.formats.passage.tracks import tracks
from pipeline.formats.passage.waypoints import Waypoints, season_waypoints
from pipeline.formats.shared.result import RunResult

# Maximum distance, true metres, between a leg and the line drawn for it.
_ERROR_M = 1.0


def passage(result: RunResult) -> Table:
    """Waypoints of the routes, each with the leg that leaves it; the goal has none."""
    found = _waypoints(result)
    counts = [len(points.lonlat) for points in found]
    return Table(
        shapely.points(stack([points.lonlat for points in found])),
        {
            **route_key(tuple(points.ranked for points in found), counts),
            "sequence": _numbers(counts),
            "name": text([waypoint_name(at, n) for n in counts for at in range(n)]),
            "course_deg": concatenated([points.course_deg for points in found]),
            "leg_length_m": concatenated([points.length_m for points in found]),
            "time_s": concatenated([points.time_s for points in found]),
            "speed_over_ground_m_s": concatenated([points.speed_m_s for points in found]),
            "speed_through_water_m_s": concatenated([points.through_water_m_s for points in found]),
            "turn_radius_m": concatenated([points.radius_m for points in found]),
        },
    )


def legs(result: RunResult) -> Table:
    """The water within each leg's cross-track limits."""
    found = _waypoints(result)
    counts = [len(points.lonlat) - 1 for points in found]
    areas = [area for points in found for area in _areas(points, result)]
    return Table(
        multi(areas),
        {
            **route_key(tuple(points.ranked for points in found), counts),
            "sequence": _numbers(counts),
            "course_deg": concatenated([points.course_deg[:-1] for points in found]),
            "leg_length_m": concatenated([points.length_m[:-1] for points in found]),
            "speed_over_ground_m_s": concatenated([points.speed_m_s[:-1] for points in found]),
            "speed_through_water_m_s": concatenated(
                [points.through_water_m_s[:-1] for points in found]
            ),
            "port_m": concatenated([points.port_m[:-1] for points in found]),
            "starboard_m": concatenated([points.starboard_m[:-1] for points in found]),
        },
    )


def _waypoints(result: RunResult) -> list[Waypoints]:
    """Waypoints of all routes; none of a planar scenario, which lies nowhere on earth."""
    if result.scenario.is_planar:
        return []
    seasons = dict.fromkeys(ranked.season for ranked in result.routes)
    return [points for season in seasons for points in season_waypoints(result, season)]


def _areas(points: Waypoints, result: RunResult) -> npt.NDArray[np.object_]:
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


def _numbers(counts: list[int]) -> npt.NDArray[np.int64]:
    """1 to n for each count n, one after the other."""
    return integer([number for count in counts for number in range(1, count + 1)])
