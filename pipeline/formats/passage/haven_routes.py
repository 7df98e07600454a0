"""Ways to havens: all of a season as GPX, each as RTZ, and all missions in one archive.

They have speeds and durations but no clock times: a vessel turns off early, on time or late.
"""

import json
import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.findings.haven_rows import Way, haven_ways
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.findings.route_profile import coast_index
from pipeline.findings.text import json_value
from pipeline.formats.passage.fence import Autopilot
from pipeline.formats.passage.missions import mission_text, plan_content
from pipeline.formats.passage.routes import gpx_document
from pipeline.formats.passage.rtz import rtz_text
from pipeline.formats.passage.safe_corridor import Obstacles
from pipeline.formats.passage.waypoints import Waypoints, limits_text, waypoints
from pipeline.model import RouteMetrics
from renew.results import unite_soft_no_go

_CACHE = "_haven_waypoints"


def haven_waypoints(result: RunResult, season: str) -> tuple[Waypoints, ...]:
    """Return waypoints of a season's ways to havens, in their order; computed once."""
    cached: dict[str, tuple[Waypoints, ...]] = result.kept.setdefault(_CACHE, {})
    if season not in cached:
        ways = haven_ways(result, season).values()
        unite_soft_no_go([way.route for way in ways])
        # The ways pass no via point.
        scene = replace(result.scene.leg(season), via=np.empty((0, 2)))
        alone, obstacles = replace(result, scene=scene), Obstacles(scene)
        cached[season] = tuple(_waypoints(way, alone, season, obstacles) for way in ways)
    return cached[season]


def _waypoints(way: Way, result: RunResult, season: str, obstacles: Obstacles) -> Waypoints:
    """Return the waypoints of a way, the last one named after the haven."""
    found = waypoints(_ranked(way, result, season), result, obstacles)
    return replace(found, names=("Turn off", *found.names[1:-1], way.haven))


def _ranked(way: Way, result: RunResult, season: str) -> RankedRoute:
    """Return a way as a route, with the figures that the formats show."""
    route, projection = way.route, result.scene.projection
    nearest = coast_index(result.scene.land).closest_approach(route.path, projection)
    metrics = RouteMetrics(
        season=season,
        rank=way.number,
        homotopy=route.homotopy,
        fuel=way.fuel,
        fuel_per_distance=route.fuel_per_distance,
        length=route.length,
        length_m=way.length_m,
        clearance_m=math.inf if nearest is None else nearest.clearance_m,
        duration_s=way.duration_s,
        speed_m_s=float(route.speeds[0]),
        optimality_gap=math.nan,
        trials=0,
        collisions=0,
        land_m=0.0,
    )
    return RankedRoute(season, way.number, route, metrics, f"to {way.haven}")


def write_haven_gpx(result: RunResult, season: str, path: Path) -> None:
    """Write all ways of a season as routes of one file."""
    path.write_bytes(gpx_document(result, haven_waypoints(result, season), None, []))


def write_haven_rtz(
    result: RunResult, season: str, path: Path, *, number: int, version: str
) -> None:
    """Write one way of a season, by its number from 1."""
    points = haven_waypoints(result, season)[number - 1]
    path.write_text(rtz_text(result, points, path.stem, version, None), encoding="utf-8")


def write_haven_missions(result: RunResult, season: str, path: Path, *, names: list[str]) -> None:
    """Write all ways of a season as missions in an archive, named without their ends.

    They have no fence: a way to a haven may leave that of the route.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, points in zip(names, haven_waypoints(result, season), strict=True):
            limits = limits_text(result, points.ranked.metrics)
            content = plan_content(points, Autopilot(None, None), limits)
            plan = json.dumps(json_value(content), indent=2)
            for end, text in ((".plan", plan), (".waypoints", mission_text(points))):
                # The time that an archive holds for a file is the same for all runs.
                archive.writestr(zipfile.ZipInfo(name + end), text, zipfile.ZIP_DEFLATED)
