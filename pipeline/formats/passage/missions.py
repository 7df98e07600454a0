"""Missions for autopilots: plans of QGroundControl, and files that ArduPilot's tools read.

Both hold the same MAVLink commands: go to the start, then for each leg its speed and its end. The
speed is the speed over ground that the vessel makes there: in the case's current, at its planned
speed through the water. Altitudes are 0 above home: a surface vessel has none. A plan has a fence,
too, where one is found: where the autopilot may be. It draws the edges of its fence straight in
longitude and latitude. So polygons are made and checked in a plane where such lines are straight.

Ways to havens are written as one GPX. They have speeds and durations but no clock times: a vessel
turns off early, on time or late.

Sources: MAVLink's common message set (MAV_CMD_NAV_WAYPOINT, MAV_CMD_DO_CHANGE_SPEED); the Plan file
format of QGroundControl's developer guide, version 1; MAVLink's file formats, "QGC WPL 110".
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.findings.haven_rows import Way, haven_ways
from pipeline.findings.result import RankedRoute, RunCase, once_per_case
from pipeline.findings.route_profile import closest_approach, coast_edges
from pipeline.findings.text import speed_over_ground, write_json
from pipeline.formats.passage.routes import gpx_document
from pipeline.formats.passage.safe_corridor import Obstacles, kept_out, tracks
from pipeline.formats.passage.waypoints import (
    Waypoints,
    case_waypoints,
    limits_text,
    waypoint_names,
    waypoints,
    wrapped_longitude,
)
from pipeline.geo.projection import METRES_PER_DEGREE
from pipeline.model import RouteMetrics, Water
from renew.results import unite_soft_no_go

STORAGE_BYTES = 672
"""What ArduPilot Rover keeps its fence in: 8 bytes a vertex, 2 a polygon and 5 more."""
MAX_VERTICES = (STORAGE_BYTES - 5 - 2) // 8
"""Largest number of vertices of a fence: of one polygon; of several it is a little less."""
KEPT_SHARE = 0.98
"""Share of the cross-track limits that the fence leaves free beside the legs."""
# Where there is no other water, the fence runs this share of the least limit outside the strip that
# it leaves free. `KEPT_SHARE` leaves more, because a limit may end at V.
_USED_SHARE = 0.01
# Steps by which water is narrowed until few vertices enclose it, as shares of its size.
_STEPS = 2.0 ** np.arange(-9, -3, 0.5)
# Decimals of degrees of a vertex: autopilots hold whole numbers of 1e-7 degrees.
_DECIMALS = 7
# Edges of the planner's plane are projected in pieces: in between, they are off by a centimetre.
_PIECE_M = 1_000.0
# Largest error of the legs' drawing, metres.
_ERROR_M = 0.1
# Number of points tried as the next vertex.
_TRIED = 100


@once_per_case
def fence_of(case: RunCase) -> tuple[FloatArray, ...] | None:
    """Return the fence of a case's best route.

    It is the inclusion polygon (n, 2), then the exclusion polygons (m, 2) in it, degrees, not
    closed: they leave only water outside V. None if no fence of so few vertices was found, if a leg
    lies in V, where nothing is promised, or on a chart across 180 degrees.
    """
    points, flat = case_waypoints(case)[0], _Flat(case.run.water)
    least_m = float(np.minimum(points.port_m, points.starboard_m)[:-1].min())
    if flat.crosses_180 or least_m <= 0:
        return None
    parts = shapely.get_parts(flat.of(open_water(case)))
    kept = flat.of(_beside(points))
    used = shapely.buffer(kept, _USED_SHARE * least_m)
    water = parts[shapely.distance(parts, used).argmin()]
    shapely.prepare(water)
    return _fence(flat, water, used, kept)


def open_water(case: RunCase) -> shapely.Geometry:
    """Return the water of a case's best route in the planner's plane: off no-go and V."""
    route = case.routes[0].route
    shut = shapely.union_all([route.soft_no_go, *kept_out(case.case, route)])
    return shapely.difference(case.case.chart.water, shut)


class _Flat:
    """A plane in which lines are straight as in longitude and latitude; metres, nearly true."""

    def __init__(self, water: Water) -> None:
        self._projection = water.projection
        extent = self._projection.geometry_to_lonlat(water.chart.extent, _PIECE_M)
        west, south, east, north = extent.bounds
        self._origin = np.array([(west + east) / 2, (south + north) / 2])
        self._metres = METRES_PER_DEGREE * np.array([np.cos(np.radians(self._origin[1])), 1.0])
        self.crosses_180 = west < -180 or east >= 180

    def xy(self, lonlat: FloatArray) -> FloatArray:
        """Return points (n, 2), degrees, in this plane."""
        return np.asarray((lonlat - self._origin) * self._metres)

    def of(self, area: shapely.Geometry) -> shapely.Geometry:
        """Return an area of the planner's plane in this one."""
        lonlat = self._projection.geometry_to_lonlat(area, _PIECE_M)
        return shapely.make_valid(shapely.transform(lonlat, self.xy))

    def lonlat(self, ring: FloatArray) -> FloatArray:
        """Return points (n, 2) of this plane in degrees, as they will be written."""
        return np.asarray(np.round(ring / self._metres + self._origin, _DECIMALS))


def _beside(points: Waypoints) -> shapely.Geometry:
    """Return the area that the fence leaves free beside the legs, planner's plane."""
    projection = points.ranked.case.run.water.projection
    legs = tracks(points.lonlat[:-1], points.lonlat[1:], points.curve, projection, _ERROR_M)
    # A limit is narrowest in the plane where the plane stretches the leg least.
    least = np.full(len(legs.lines), np.inf)
    np.minimum.at(least, legs.leg, projection.point_scale(legs.lonlat))
    planar = KEPT_SHARE * least / projection.scale
    port, starboard = points.port_m[:-1] * planar, points.starboard_m[:-1] * planar
    both = shapely.buffer(legs.lines, np.minimum(port, starboard), quad_segs=64)
    left = shapely.buffer(legs.lines, port, cap_style="flat", single_sided=True)
    right = shapely.buffer(legs.lines, -starboard, cap_style="flat", single_sided=True)
    return shapely.union_all([both, left, right])


def _fence(
    flat: _Flat, water: shapely.Polygon, used: shapely.Geometry, kept: shapely.Geometry
) -> tuple[FloatArray, ...] | None:
    """Narrow the water step by step, except for what is used, and return the first fence found."""
    edges, narrowed = shapely.boundary(shapely.difference(water, kept)), water
    shapely.prepare(edges)
    # An island is inside a ring that does not meet it if its first vertex is.
    islands = np.array([ring.coords[0] for ring in water.interiors]).reshape(-1, 2)
    inside = shapely.get_coordinates(shapely.point_on_surface(kept))
    for step in np.sqrt(water.area) * _STEPS:
        if narrowed.is_empty:
            break
        wide = shapely.buffer(shapely.simplify(narrowed, step / 4), -step)
        narrowed = shapely.simplify(wide, step / 2)
        parts = shapely.get_parts(shapely.union(used, narrowed))
        joined = parts[shapely.intersects(parts, used)][0]
        # A hole that is all water needs no fence.
        holes = shapely.polygons(np.array(joined.interiors, dtype=object))
        holes = holes[~shapely.covers(water, holes)]
        if 3 * len(holes) > MAX_VERTICES:
            continue
        outside = islands[~shapely.contains_xy(shapely.Polygon(joined.exterior), islands)]
        apart = [outside, *(islands[shapely.contains_xy(hole, islands)] for hole in holes)]
        # In the same way the legs stay on their side of a ring.
        apart = [np.concatenate([one, inside]) for one in apart]
        outlines = [joined.exterior, *(hole.exterior for hole in holes)]
        rings = [flat.xy(flat.lonlat(shapely.get_coordinates(one)[:-1])) for one in outlines]
        if not _are_few(rings):
            rings[0] = _fewest(rings[0], apart[0], edges)
            if len(rings[0]) > MAX_VERTICES:
                continue
            rings[1:] = [_fewest(*one, edges) for one in zip(rings[1:], apart[1:], strict=True)]
        polygons = np.array([shapely.Polygon(ring) for ring in rings], dtype=object)
        if not (_are_few(rings) and shapely.is_valid(polygons).all()):
            continue
        allowed = shapely.difference(polygons[0], shapely.union_all(polygons[1:]))
        if allowed.covers(kept) and water.covers(allowed):
            return tuple(map(flat.lonlat, rings))
    return None


def _are_few(rings: list[FloatArray]) -> bool:
    """Whether an autopilot has room for all polygons together."""
    return 5 + sum(2 + 8 * len(ring) for ring in rings) <= STORAGE_BYTES


def _fewest(ring: FloatArray, islands: FloatArray, edges: shapely.Geometry) -> FloatArray:
    """Return few of a ring's points (n, 2), three or more, with no line between them over an edge.

    From each point, the line goes on to the last point that is found in reach, at most a third of
    the way round, without an island (k, 2) between the line and the ring. The search ends when
    there are too many points.
    """
    count = len(ring)
    steps = np.unique(np.geomspace(1, max(count // 3, 1), _TRIED).astype(int))[::-1]
    chosen = [0]
    while (at := chosen[-1]) < count - 1 and len(chosen) <= MAX_VERTICES:
        ahead = at + steps[at + steps <= count]
        lines = np.stack([np.broadcast_to(ring[at], (len(ahead), 2)), ring[ahead % count]], axis=1)
        free = ahead[~shapely.intersects(edges, shapely.linestrings(lines))]
        passed = (to for to in free[free > at + 1] if not _parts(ring, at, to, islands))
        chosen.append(next(passed, at + 1))
    return ring[[one for one in chosen if one < count]]


def _parts(ring: FloatArray, at: int, to: int, islands: FloatArray) -> bool:
    """Whether an island lies between a ring's points from `at` to `to` and the line past them."""
    between = shapely.Polygon(ring[np.arange(at, to + 1) % len(ring)])
    return bool(shapely.contains_xy(between, islands).any())


# MAV_CMD_NAV_WAYPOINT.
_WAYPOINT = 16
# MAV_CMD_DO_CHANGE_SPEED.
_CHANGE_SPEED = 178
# Its first parameter, for a speed over ground (SPEED_TYPE_GROUNDSPEED).
_OVER_GROUND = 1.0
# Its third parameter, which leaves the throttle as it is.
_SAME_THROTTLE = -1.0
# MAV_FRAME_GLOBAL: altitudes over the sea, as home has.
_ABSOLUTE = 0
# MAV_FRAME_MISSION: a command without a position.
_NO_POSITION = 2
# MAV_FRAME_GLOBAL_RELATIVE_ALT: altitudes above home.
_RELATIVE = 3
# MAV_AUTOPILOT_ARDUPILOTMEGA.
_ARDUPILOT = 3
# MAV_TYPE_SURFACE_BOAT.
_SURFACE_BOAT = 11
# QGroundControl's mode of altitudes that are relative to home.
_RELATIVE_ALTITUDE = 1
# Decimals of a speed, m/s.
_SPEED_DIGITS = 3


_Command: TypeAlias = tuple[int, int, tuple[float, ...]]
"""A mission's command: its number, frame and seven parameters; a position is the last three."""


def write_plan(case: RunCase, path: Path) -> None:
    """Write the best route of a case, which must have one, as a plan of QGroundControl."""
    write_json(path, plan_content(case_waypoints(case)[0], fence_of(case)))


def plan_content(points: Waypoints, fence: tuple[FloatArray, ...] | None) -> dict[str, object]:
    """Return a route's plan, with its fence.

    The key `renew`, which programs ignore, says how the route is not safe, and what is not known.
    """
    start = _position(points, 0)
    speed = round(speed_over_ground(points.metrics), _SPEED_DIGITS)
    items = [
        {
            "type": "SimpleItem",
            "autoContinue": True,
            "command": command,
            "doJumpId": number,
            "frame": frame,
            "params": params,
            **(
                {"Altitude": 0, "AltitudeMode": _RELATIVE_ALTITUDE, "AMSLAltAboveTerrain": None}
                if command == _WAYPOINT
                else {}
            ),
        }
        for number, (command, frame, params) in enumerate(_commands(points), start=1)
    ]
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "renew": limits_text(points.ranked),
        "mission": {
            "version": 2,
            "firmwareType": _ARDUPILOT,
            "vehicleType": _SURFACE_BOAT,
            "cruiseSpeed": speed,
            "hoverSpeed": speed,
            "globalPlanAltitudeMode": _RELATIVE_ALTITUDE,
            "plannedHomePosition": [*start, 0],
            "items": items,
        },
        "geoFence": {"version": 2, "circles": [], "polygons": _polygons(fence)},
        "rallyPoints": {"version": 2, "points": []},
    }


def _polygons(fence: tuple[FloatArray, ...] | None) -> list[dict[str, object]]:
    """Return the fence's polygons, the inclusion first, as (latitude, longitude) degrees."""
    return [
        {"version": 1, "inclusion": number == 0, "polygon": ring[:, ::-1].tolist()}
        for number, ring in enumerate(fence or ())
    ]


def write_mission(case: RunCase, path: Path) -> None:
    """Write the best route of a case, which must have one, as a mission for ArduPilot's tools."""
    path.write_text(mission_text(case_waypoints(case)[0]), encoding="ascii")


def mission_text(points: Waypoints) -> str:
    """Return a route as a mission for ArduPilot's tools."""
    home = (_WAYPOINT, _ABSOLUTE, (0.0, 0.0, 0.0, 0.0, *_position(points, 0), 0.0))
    lines = ["QGC WPL 110"]
    for index, (command, frame, params) in enumerate((home, *_commands(points))):
        cells = [index, int(index == 0), frame, command]
        lines.append("\t".join([*map(str, cells), *(f"{p:.8f}" for p in params), "1"]))
    return "\n".join(lines) + "\n"


def _commands(points: Waypoints) -> Iterator[_Command]:
    """Yield a route's commands: the start, then for each leg its speed and its end.

    A radius of 0 leaves it to the vehicle when a waypoint counts as reached.
    """
    for index in range(len(points.lonlat)):
        if index:
            speed = round(float(points.speed_m_s[index - 1]), _SPEED_DIGITS)
            params = (_OVER_GROUND, speed, _SAME_THROTTLE, 0.0, 0.0, 0.0, 0.0)
            yield _CHANGE_SPEED, _NO_POSITION, params
        yield _WAYPOINT, _RELATIVE, (0.0, 0.0, 0.0, 0.0, *_position(points, index), 0.0)


def _position(points: Waypoints, index: int) -> tuple[float, float]:
    """Return the latitude and longitude of a waypoint, degrees."""
    longitude, latitude = points.lonlat[index]
    return float(latitude), wrapped_longitude(longitude)


@once_per_case
def haven_waypoints(case: RunCase) -> tuple[Waypoints, ...]:
    """Return waypoints of a case's ways to havens, in their order."""
    ways = haven_ways(case).values()
    unite_soft_no_go([way.route for way in ways])
    # The ways pass no via point.
    alone = replace(case, planned=replace(case.case, via=np.empty((0, 2))))
    obstacles = Obstacles(alone.case)
    return tuple(_waypoints(way, alone, obstacles) for way in ways)


def _waypoints(way: Way, case: RunCase, obstacles: Obstacles) -> Waypoints:
    """Return the waypoints of a way, with names that no route has."""
    found, nowhere = waypoints(_ranked(way, case), obstacles), np.empty((0, 2))
    return replace(found, names=waypoint_names(found.lonlat, nowhere, way.number, tuple("THHH")))


def _ranked(way: Way, case: RunCase) -> RankedRoute:
    """Return a way as a route, with the figures that the formats show."""
    route, water = way.route, case.run.water
    nearest = closest_approach(coast_edges(water.land), route.path, water.projection)
    metrics = RouteMetrics(
        rank=way.number,
        homotopy=route.homotopy,
        fuel=way.fuel,
        fuel_per_distance=route.fuel_per_distance,
        length=route.length,
        length_m=way.length_m,
        clearance_m=math.inf if nearest is None else nearest[1],
        duration_s=way.duration_s,
        speed_m_s=float(route.speeds[0]),
    )
    return RankedRoute(case, way.number, route, metrics, f"to {way.haven}")


def write_haven_gpx(case: RunCase, path: Path) -> None:
    """Write all ways of a case as routes of one file."""
    path.write_bytes(gpx_document(haven_waypoints(case), None, []))
