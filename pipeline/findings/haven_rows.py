"""The coverage of a route by havens, as rows for tables, maps and the passage plan.

Times and distances are true. In a steady current the planner's differ a little, by the scale of its
plane.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.findings.result import RunCase
from pipeline.findings.text import planner_text
from pipeline.geo.projection import GEOD

MOMENTS = ("equal point", "last change")
"""Kinds of rows for which nothing is proven of later places."""
LAST_TURNS = ("abort point", "point of no return", *MOMENTS)
"""Kinds of rows that are one place of the route; the others are stretches."""


@dataclass(frozen=True)
class Way:
    """A way to a haven, with its number among the case's, from 1.

    Attributes
    ----------
    turn_off_s : when a vessel on time turns off, seconds since departure.
    place, haven_place : (lon, lat) degrees, where it turns off, and of the haven.
    bearing_deg : true bearing of the haven from there.
    length_m : true metres along the way.
    duration_s : time to the haven, for a vessel on time; `longest_s`: the most early or late.
    fuel : in the planner's units.
    """

    number: int
    haven: str
    turn_off_s: float
    place: FloatArray
    haven_place: FloatArray
    length_m: float
    duration_s: float
    longest_s: float
    fuel: float
    route: renew.Route

    @cached_property
    def bearing_deg(self) -> float:
        """True bearing of the haven from where the vessel turns off, 0 to below 360."""
        return float(GEOD.inv(*self.place, *self.haven_place)[0]) % 360


@dataclass(frozen=True)
class HavenRow:
    """A stretch of a route in one state, or the last place from which a haven is reached.

    Attributes
    ----------
    kind : "covered", "uncovered", "not settled", or one of `LAST_TURNS`.
    begin_s, end_s : when a vessel on time is at its ends, seconds since departure; of an abort
        point or a point of no return, when it turns off, and after when that is too late.
    way : the way to take, if there is one.
    longest_s : the most time to the haven from any place of it; inf if it is not covered.
    least_s : nobody on time gets to a haven in less; 0 for a place.
    reason : why nothing is settled, if that is known.
    """

    kind: str
    begin_s: float
    end_s: float
    way: Way | None = None
    longest_s: float = math.inf
    least_s: float = 0.0
    reason: str = ""


def haven_ways(case: RunCase) -> dict[renew.Diversion, Way]:
    """Return the ways to havens of a case's best route, in the order of their times, if any."""
    if case.coverage is None:
        return {}
    projection, (begin, stretch) = case.case.projection, _clock(case)
    return {
        one: Way(
            number=number,
            haven=one.haven.name,
            turn_off_s=stretch * (one.time - begin),
            place=projection.to_lonlat(one.place),
            haven_place=projection.to_lonlat(one.haven.place),
            length_m=projection.geodesic_length_m(one.route.path),
            duration_s=stretch * one.duration,
            longest_s=stretch * one.longest,
            fuel=one.fuel,
            route=one.route,
        )
        for number, one in enumerate(case.coverage.diversions, start=1)
    }


def haven_rows(case: RunCase) -> list[HavenRow]:
    """Return the rows of a case's best route: its stretches, then its last places to turn off.

    These are abort points, the point of no return, equal points, and last changes. There are no
    rows without havens.
    """
    coverage, ways = case.coverage, haven_ways(case)
    if coverage is None:
        return []
    begin, stretch = _clock(case)
    rows = [
        HavenRow(
            one.state,
            stretch * (one.begin - begin),
            stretch * (one.end - begin),
            None if one.diversion is None else ways[one.diversion],
            stretch * one.longest,
            stretch * one.least,
            "" if one.cause is None else planner_text(one.cause.text, case.case),
        )
        for one in coverage.stretches
    ]
    last = [("abort point", one.diversion, one.not_after) for one in coverage.abort_points]
    if (turn := coverage.no_return) is not None:
        last.append(("point of no return", turn.diversion, turn.not_after))
    for point in coverage.equal_points:
        last += [("equal point", one, one.time) for one in (point.before, point.after)]
    last += [("last change", one.diversion, one.diversion.time) for one in coverage.class_turns]
    for kind, diversion, not_after in last:
        way = ways[diversion]
        end_s = stretch * (not_after - begin)
        rows.append(HavenRow(kind, way.turn_off_s, end_s, way, way.longest_s))
    return rows


def stretch_line(case: RunCase, row: HavenRow) -> shapely.LineString:
    """Return the part of a case's best route, planar metres, that a row is about."""
    route, (departure, stretch) = case.routes[0].route, _clock(case)
    begin, end = (one / stretch + departure for one in (row.begin_s, row.end_s))
    track = route.trajectory[:, 0]
    times = np.concatenate([[begin], track[(track > begin) & (track < end)], [end]])
    x, y = (np.interp(times, track, column) for column in route.trajectory.T[1:3])
    return shapely.LineString(np.stack([x, y], axis=-1))


def _clock(case: RunCase) -> tuple[float, float]:
    """Return a case's departure on the planner's clock, s, and true seconds to one of the clock."""
    best = case.routes[0]
    return float(best.route.times[0]), best.metrics.duration_s / best.route.duration
