"""Layers of a run's havens: the places, the ways to them, and the stretches of the best routes."""

from collections.abc import Callable

import numpy as np
import shapely

from pipeline.findings.haven_rows import LAST_TURNS, haven_rows, haven_ways, stretch_line
from pipeline.findings.result import RunCase, RunResult
from pipeline.formats.gis.frames import ROUTE_STEP_M, GeoDataFrame, columns_of, frame, to_lonlat


def _covered(result: RunResult) -> list[RunCase]:
    """Return the cases with a coverage by havens."""
    return [case for case in result.cases if case.coverage is not None]


def _havens(result: RunResult) -> GeoDataFrame:
    """Return the havens of each case, with the reason why one is not used."""
    found = [
        (name, haven, reason)
        for name, coverage in result.coverages.items()
        for haven, reason in (
            *((haven, "") for haven in coverage.havens),
            *((haven, "no way was found to it") for haven, _ in coverage.left_out),
        )
    ]
    places = np.array([haven.place for _, haven, _ in found]).reshape(-1, 2)
    return frame(
        shapely.points(result.water.projection.to_lonlat(places)),
        {
            "season": [name for name, _, _ in found],
            "name": [haven.name for _, haven, _ in found],
            "reason": [reason for _, _, reason in found],
        },
    )


def _diversions(result: RunResult) -> GeoDataFrame:
    """Return the ways to havens, one line each."""
    found = [(case.name, way) for case in _covered(result) for way in haven_ways(case).values()]
    ways = [way for _, way in found]
    names = ("haven", "length_m", "duration_s", "longest_s", "fuel", "bearing_deg")
    return frame(
        to_lonlat(result, [shapely.LineString(way.route.path) for way in ways], ROUTE_STEP_M),
        {
            "season": [name for name, _ in found],
            "diversion": [way.number for way in ways],
            "time_s": [way.turn_off_s for way in ways],
            **columns_of(ways, *names),
        },
    )


def _coverage(result: RunResult) -> GeoDataFrame:
    """Return the stretches of the best routes, each in one state."""
    found = [
        (case, row)
        for case in _covered(result)
        for row in haven_rows(case)
        if row.kind not in LAST_TURNS
    ]
    ways = [row.way for _, row in found]
    lines = [stretch_line(case, row) for case, row in found]
    return frame(
        to_lonlat(result, lines, ROUTE_STEP_M),
        {
            "season": [case.name for case, _ in found],
            **columns_of([row for _, row in found], "begin_s", "end_s", "longest_s", "least_s"),
            "state": [row.kind for _, row in found],
            "haven": [way.haven if way else "" for way in ways],
            "diversion": [way.number if way else 0 for way in ways],
            "reason": [row.reason for _, row in found],
        },
    )


FRAMES: dict[str, Callable[[RunResult], GeoDataFrame]] = {
    "havens": _havens,
    "diversions": _diversions,
    "coverage": _coverage,
}
"""Layer -> its content; empty in a run without havens."""
