"""Stretches of routes without room for a hard-over turn, measured against the original land.

The planner lists stretches against its chart, whose land has a margin and a simpler coast. A
stretch on which all turns are free of the original land is dropped, unless the vessel has to turn
faster there than it can.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
import shapely
from shapely.ops import substring

import renew
from pipeline._types import FloatArray, IndexArray
from pipeline.model import Case, NarrowStretch
from renew.planner.narrow_water import Room, room_to_turn
from renew.planner.problem import Problem
from renew.request import Request

# A stretch is listed if a turn on a circle this much wider meets land.
_TO_SPARE = 1.05
# Water this many times as wide as a turn's reach to a side is not what is narrow: an islet is.
_WIDE = 2.0
# Steps in which turning circles are told, as a share of the vessel's.
_STEP = 0.05
# A vessel turns faster than it can where it turns by this factor more than its turn rate.
_FASTER = 1.05


def narrow_stretches(
    case: Case, route: renew.Route, rank: int, land: renew.Chart, options: renew.PlanOptions
) -> Iterator[NarrowStretch]:
    """Yield the stretches of a route, in order; `land` is the original land near it."""
    if not route.shortfalls:
        return
    vessel, line = case.vessel, shapely.LineString(route.path)
    wider = replace(vessel, turn_rate=vessel.turn_rate / _TO_SPARE)
    asked = Request.of(
        land,
        case.current,
        wider,
        (case.start, case.goal),
        options=options,
        departure=float(route.times[0]),
    )
    problem = Problem(asked.voyage(asked.waters, wider), asked.options)
    room = room_to_turn(route.path, problem, route.speeds)
    for one in route.shortfalls:
        inside = np.flatnonzero((room.along >= one.begin) & (room.along <= one.end))
        share = _STEP * math.floor(_TO_SPARE * float(room.share[inside].min()) / _STEP)
        if room.share[inside].min() == 1:
            if not _turns_faster(route, line, one, vessel):
                continue
            share = one.kept / one.needed
        tight = inside[room.share[inside] == room.share[inside].min()]
        at, width = min(
            ((at, _width(room, at, line, land)) for at in tight.tolist()), key=lambda pair: pair[1]
        )
        piece = shapely.get_coordinates(substring(line, one.begin, one.end))
        projection, scale = case.projection, case.projection.scale
        before = shapely.get_coordinates(substring(line, 0.0, max(one.begin, 1e-6)))
        yield NarrowStretch(
            rank=rank,
            line=piece,
            place=room.points[at],
            begin_m=projection.geodesic_length_m(before),
            length_m=projection.geodesic_length_m(piece),
            width_m=scale * width,
            needed_m=scale * one.needed,
            kept_m=scale * share * one.needed,
            side=_side(room, inside, line, land),
        )


def _turns_faster(
    route: renew.Route, line: shapely.LineString, one: renew.Shortfall, vessel: renew.Vessel
) -> bool:
    """Whether a route's trajectory turns faster in a stretch than the vessel can."""
    times, x, y, heading = route.trajectory.T
    along = shapely.line_locate_point(line, shapely.points(x, y))
    fast = np.abs(np.diff(heading)) > _FASTER * vessel.turn_rate * np.diff(times)
    return bool((fast & (along[1:] >= one.begin) & (along[:-1] <= one.end)).any())


def _aside(room: Room, at: int, line: shapely.LineString) -> FloatArray:
    """Return the unit vector (2,) to port of a path at a station."""
    ahead = shapely.line_interpolate_point(line, room.along[at] + np.array([-1.0, 1.0]))
    x, y = np.diff(shapely.get_coordinates(ahead), axis=0)[0]
    return np.array([-y, x]) / max(math.hypot(x, y), 1e-12)


def _width(room: Room, at: int, line: shapely.LineString, land: renew.Chart) -> float:
    """Return the width of the water across a path at a station, m; inf if it is wide there."""
    aside, point = _aside(room, at, line), room.points[at]
    xmin, ymin, xmax, ymax = land.bounds
    far = math.hypot(xmax - xmin, ymax - ymin)
    here, width = shapely.Point(point), 0.0
    for side in (1, -1):
        ray = shapely.LineString([point, point + side * far * aside])
        width += shapely.distance(here, shapely.intersection(ray, land.hard_no_go))
    return width if width < _WIDE * room.needed[at] else math.inf


def _side(
    room: Room, stations: IndexArray, line: shapely.LineString, land: renew.Chart
) -> Literal["port", "starboard", "either side"]:
    """Say to which side turns from stations meet land: on circles, as in still water."""
    short = [at for at in stations.tolist() if room.share[at] < 1] or stations.tolist()
    meets = []
    for side in (1, -1):
        radius = [room.needed[at] / 2 for at in short]
        centres = [
            room.points[at] + side * r * _aside(room, at, line)
            for at, r in zip(short, radius, strict=True)
        ]
        apart = shapely.distance(shapely.points(centres), land.hard_no_go)
        meets.append(bool((apart <= radius).any()))
    if meets[0] == meets[1]:
        return "either side"
    return "port" if meets[0] else "starboard"
