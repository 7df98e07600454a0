"""Ways to havens: all of a case as GPX, each as RTZ, and all missions in one archive.

They have speeds and durations but no clock times: a vessel turns off early, on time or late.
"""

import json
import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.findings.haven_rows import Way, haven_ways
from pipeline.findings.result import RankedRoute, RunCase
from pipeline.findings.route_profile import coast_index
from pipeline.findings.text import json_value
from pipeline.formats.passage.fence import Autopilot
from pipeline.formats.passage.missions import mission_text, plan_content
from pipeline.formats.passage.routes import gpx_document
from pipeline.formats.passage.rtz import rtz_text
from pipeline.formats.passage.safe_corridor import Obstacles
from pipeline.formats.passage.waypoints import Waypoints, waypoints
from pipeline.model import RouteMetrics
from renew.results import unite_soft_no_go

_CACHE = "_haven_waypoints"


def haven_waypoints(case: RunCase) -> tuple[Waypoints, ...]:
    """Return waypoints of a case's ways to havens, in their order; computed once."""
    cached: dict[str, tuple[Waypoints, ...]] = case.run.kept.setdefault(_CACHE, {})
    if case.name not in cached:
        ways = haven_ways(case).values()
        unite_soft_no_go([way.route for way in ways])
        # The ways pass no via point.
        alone = replace(case, planned=replace(case.case, via=np.empty((0, 2))))
        obstacles = Obstacles(alone.case)
        cached[case.name] = tuple(_waypoints(way, alone, obstacles) for way in ways)
    return cached[case.name]


def _waypoints(way: Way, case: RunCase, obstacles: Obstacles) -> Waypoints:
    """Return the waypoints of a way, the last one named after the haven."""
    found = waypoints(_ranked(way, case), obstacles)
    return replace(found, names=("Turn off", *found.names[1:-1], way.haven))


def _ranked(way: Way, case: RunCase) -> RankedRoute:
    """Return a way as a route, with the figures that the formats show."""
    route, water = way.route, case.run.water
    nearest = coast_index(water.land).closest_approach(route.path, water.projection)
    metrics = RouteMetrics(
        rank=way.number,
        homotopy=route.homotopy,
        fuel=way.fuel,
        fuel_per_distance=route.fuel_per_distance,
        length=route.length,
        length_m=way.length_m,
        clearance_m=math.inf if nearest is None else nearest.clearance_m,
        duration_s=way.duration_s,
        speed_m_s=float(route.speeds[0]),
    )
    return RankedRoute(case, way.number, route, metrics, f"to {way.haven}")


def write_haven_gpx(case: RunCase, path: Path) -> None:
    """Write all ways of a case as routes of one file."""
    path.write_bytes(gpx_document(haven_waypoints(case), None, []))


def write_haven_rtz(case: RunCase, path: Path, *, number: int) -> None:
    """Write one way of a case, by its number from 1."""
    points = haven_waypoints(case)[number - 1]
    path.write_text(rtz_text(points, path.stem, None), encoding="utf-8")


def write_haven_missions(case: RunCase, path: Path, *, names: list[str]) -> None:
    """Write all ways of a case as missions in an archive, named without their ends.

    They have no fence: a way to a haven may leave that of the route.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, points in zip(names, haven_waypoints(case), strict=True):
            content = plan_content(points, Autopilot(None, None))
            plan = json.dumps(json_value(content), indent=2)
            for end, text in ((".plan", plan), (".waypoints", mission_text(points))):
                # The time that an archive holds for a file is the same for all runs.
                archive.writestr(zipfile.ZipInfo(name + end), text, zipfile.ZIP_DEFLATED)
