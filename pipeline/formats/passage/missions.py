"""Missions for autopilots, as plans of QGroundControl and as ArduPilot's tools read them.

Both files hold the same MAVLink commands: go to the start, then for each leg its speed and its end.
The speed is the speed over ground that the vessel makes there: in the case's current, at its
planned speed through the water. Altitudes are 0 above home: a surface vessel has none. A plan has a
fence and rally points, too, where they are found (:mod:`.fence`).

Sources: MAVLink's common message set (MAV_CMD_NAV_WAYPOINT, MAV_CMD_DO_CHANGE_SPEED); the Plan file
format of QGroundControl's developer guide, version 1; MAVLink's file formats, "QGC WPL 110".
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.findings.result import RunCase
from pipeline.findings.text import speed_over_ground, write_json
from pipeline.formats.passage.fence import Autopilot, autopilot
from pipeline.formats.passage.waypoints import (
    Waypoints,
    case_waypoints,
    limits_text,
    wrapped_longitude,
)

# MAV_CMD_NAV_WAYPOINT and MAV_CMD_DO_CHANGE_SPEED, which sets the speed over ground and leaves the
# throttle as it is; positions are relative to home (MAV_FRAME_GLOBAL_RELATIVE_ALT).
_WAYPOINT, _CHANGE_SPEED = 16, 178
_OVER_GROUND, _SAME_THROTTLE = 1.0, -1.0
_ABSOLUTE, _NO_POSITION, _RELATIVE = 0, 2, 3
# MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_TYPE_SURFACE_BOAT.
_ARDUPILOT, _SURFACE_BOAT = 3, 11
# QGroundControl's mode of altitudes that are relative to home.
_RELATIVE_ALTITUDE = 1
# Decimals of a speed, m/s.
_SPEED_DIGITS = 3


@dataclass(frozen=True)
class _Command:
    """A mission's command with its seven parameters; a position is the last three."""

    number: int
    frame: int
    params: tuple[float, ...]


def write_plan(case: RunCase, path: Path) -> None:
    """Write the best route of a case, which must have one, as a plan of QGroundControl."""
    write_json(path, plan_content(case_waypoints(case)[0], autopilot(case)))


def plan_content(points: Waypoints, told: Autopilot) -> dict[str, object]:
    """Return a route's plan, with what an autopilot is told beside the way.

    Programs pass over the key `renew`: how the route is not safe, what is not known or was decided.
    """
    start = _position(points, 0)
    speed = round(speed_over_ground(points.metrics), _SPEED_DIGITS)
    items = [
        {
            "type": "SimpleItem",
            "autoContinue": True,
            "command": command.number,
            "doJumpId": number,
            "frame": command.frame,
            "params": command.params,
            **(
                {"Altitude": 0, "AltitudeMode": _RELATIVE_ALTITUDE, "AMSLAltAboveTerrain": None}
                if command.number == _WAYPOINT
                else {}
            ),
        }
        for number, command in enumerate(_commands(points), start=1)
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
        "geoFence": {"version": 2, "circles": [], "polygons": _polygons(told)},
        "rallyPoints": {"version": 2, "points": _rally_points(told)},
    }


def _polygons(told: Autopilot) -> list[dict[str, object]]:
    """Return the fence's polygons, the inclusion first, as (latitude, longitude) degrees."""
    rings = () if told.fence is None else (told.fence.inclusion, *told.fence.exclusions)
    return [
        {"version": 1, "inclusion": number == 0, "polygon": ring[:, ::-1].tolist()}
        for number, ring in enumerate(rings)
    ]


def _rally_points(told: Autopilot) -> list[list[float]]:
    """Return the rally points as (latitude, longitude) degrees and altitude above home, 0."""
    return [] if told.rally is None else [[lat, lon, 0.0] for lon, lat in told.rally.tolist()]


def write_mission(case: RunCase, path: Path) -> None:
    """Write the best route of a case, which must have one, as a mission for ArduPilot's tools."""
    path.write_text(mission_text(case_waypoints(case)[0]), encoding="ascii")


def mission_text(points: Waypoints) -> str:
    """Return a route as a mission for ArduPilot's tools."""
    home = _Command(_WAYPOINT, _ABSOLUTE, (0.0, 0.0, 0.0, 0.0, *_position(points, 0), 0.0))
    lines = ["QGC WPL 110"]
    for index, command in enumerate((home, *_commands(points))):
        cells = [index, int(index == 0), command.frame, command.number]
        lines.append("\t".join([*map(str, cells), *(f"{p:.8f}" for p in command.params), "1"]))
    return "\n".join(lines) + "\n"


def _commands(points: Waypoints) -> Iterator[_Command]:
    """Yield a route's commands: the start, then for each leg its speed and its end.

    A radius of 0 leaves it to the vehicle when a waypoint counts as reached.
    """
    for index in range(len(points.lonlat)):
        if index:
            speed = round(float(points.speed_m_s[index - 1]), _SPEED_DIGITS)
            params = (_OVER_GROUND, speed, _SAME_THROTTLE, 0.0, 0.0, 0.0, 0.0)
            yield _Command(_CHANGE_SPEED, _NO_POSITION, params)
        yield _Command(_WAYPOINT, _RELATIVE, (0.0, 0.0, 0.0, 0.0, *_position(points, index), 0.0))


def _position(points: Waypoints, index: int) -> tuple[float, float]:
    """Return the latitude and longitude of a waypoint, degrees."""
    longitude, latitude = points.lonlat[index]
    return float(latitude), wrapped_longitude(longitude)
