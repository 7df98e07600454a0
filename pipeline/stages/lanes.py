"""Traffic lanes that a line sails against; COLREGS rule 10 asks vessels to sail with them.

The planner does not know lanes. One that the best route sails against is shut like an area, and the
voyage is planned again; so no lane is shut to those that cross it or sail with it. What is broken
all the same, by a small vessel or a route of the user's, is said.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.geo.projection import GEOD
from pipeline.model import Case, CaseResult, Place, Zone
from pipeline.scenario.model import PlannerOptions
from pipeline.sources.land.shapes import in_plane

# Angle between course and lane, degrees, above which a vessel sails against it: one that crosses
# does so "as nearly as practicable at right angles".
_AGAINST_DEG = 120.0
# Longest step along a line, degrees, on which its course is taken as one: 10 km.
_STEP_DEG = 0.09
# Least true metres that count: less is a corner that is cut.
_LEAST_M = 50.0
# Length of a vessel, m, from which it keeps lanes by default: rule 10 forbids smaller ones only to
# impede those that follow a lane.
_KEPT_FROM_M = 20.0


class AgainstLane(NamedTuple):
    """A lane that is sailed against: for how far, and the middle of the longest part."""

    zone: Zone
    length_m: float
    place: Place


def kept_lanes(zones: Sequence[Zone], options: PlannerOptions, length_m: float) -> tuple[Zone, ...]:
    """Return the lanes among zones that a vessel of a length keeps, as asked or by default."""
    keeps = length_m >= _KEPT_FROM_M if options.lanes is None else options.lanes
    return tuple(zone for zone in zones if keeps and zone.course_deg is not None)


def keeping_lanes(case: Case, planned: Callable[[Case], CaseResult]) -> CaseResult:
    """Plan a case until its best route sails against no lane that it keeps.

    Other routes that do are left out. Where no way keeps a lane, the best plan stands that keeps
    the others.
    """
    result, shut = planned(case), list[Zone]()
    while broken := [one.zone for one in _broken(case, result.routes[:1]) if one.zone not in shut]:
        areas = tuple(
            renew.ShutArea(
                shapely.union_all(in_plane([zone.area], case.projection)),
                -math.inf,
                math.inf,
                zone.name,
            )
            for zone in (*shut, *broken)
        )
        again = planned(replace(case, areas=(*case.areas, *areas)))
        if again.plan is None:
            break
        shut += broken
        seconds, names = result.seconds + again.seconds, tuple(one.name for one in shut)
        result = replace(again, seconds=seconds, kept_lanes=names)
    return _without_others(case, result)


def _broken(case: Case, routes: Sequence[renew.Route]) -> list[AgainstLane]:
    """Return the case's lanes that some routes sail against."""
    lines = (case.projection.to_lonlat(route.path) for route in routes if case.lanes)
    return [one for line in lines for one in against_lanes(line, case.lanes)]


def _without_others(case: Case, result: CaseResult) -> CaseResult:
    """Return a result without the routes, other than the best, that sail against a lane."""
    plan = result.plan
    if plan is None or result.ensemble is not None or not case.lanes:
        return result
    best = plan.best
    routes = tuple(one for one in plan.routes if one is best or not _broken(case, [one]))
    return replace(result, plan=replace(plan, routes=routes, chosen=routes.index(best)))


def against_lanes(line: FloatArray, zones: Sequence[Zone]) -> Iterator[AgainstLane]:
    """Yield the lanes among zones that a line (n, 2), lon/lat degrees, sails against."""
    dense = shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), _STEP_DEG))
    course, _, _ = GEOD.inv(*dense[:-1].T, *dense[1:].T)
    steps = shapely.linestrings(np.stack([dense[:-1], dense[1:]], axis=1))
    for zone in zones:
        if zone.course_deg is None:
            continue
        off_deg = np.abs((np.asarray(course) - zone.course_deg + 180) % 360 - 180)
        parts = shapely.get_parts(
            shapely.line_merge(
                shapely.union_all(shapely.intersection(steps[off_deg > _AGAINST_DEG], zone.area))
            )
        )
        lengths = [GEOD.geometry_length(part) for part in parts]
        if sum(lengths) >= _LEAST_M:
            middle = parts[int(np.argmax(lengths))].interpolate(0.5, normalized=True)
            yield AgainstLane(zone, float(sum(lengths)), Place(middle.x, middle.y))
