"""`havens.csv`: from where along each best route a haven is reached in time, and where to turn."""

import math
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, get_args

from pipeline.findings.haven_rows import LAST_TURNS, MOMENTS, HavenRow, coverage_of, haven_rows
from pipeline.findings.result import RunCase, RunResult
from pipeline.findings.text import duration, fuel, percent, to_minute
from pipeline.formats.figures.artists import drawable
from pipeline.formats.passage.waypoints import NAUTICAL_MILE_M, time_after, wrapped_longitude
from pipeline.formats.tables import position, utc_text, write_csv
from renew.underway.coverage import State

STATES: tuple[State, ...] = get_args(State)
# Maximum length of a haven's name in the printed table, in characters.
_MAX_NAME = 20
COLUMNS = (
    *("season", "kind", "begin", "end", "begin_s", "end_s", "haven", "way", "turn_off"),
    *("turn_off_s", "lon", "lat", "haven_lon", "haven_lat", "bearing_deg", "length_m", "hours"),
    *("fuel", "longest_hours", "least_hours", "reason"),
)
"""Times are UTC, empty without a departure; `_s` are seconds since departure. `way` is the number
of the way among the season's; lengths are true metres, fuel is in the planner's units."""


def write_havens(result: RunResult, path: Path) -> None:
    """Write the coverage of all cases as CSV: stretches first, then the last places to turn."""
    rows = (
        _cells(case.name, row, case.spec.departure)
        for case in result.cases
        if case.coverage is not None
        for row in haven_rows(case)
    )
    write_csv(path, COLUMNS, rows)


def _cells(case: str, row: HavenRow, departure: datetime | None) -> dict[str, Any]:
    """Return a row's cells by column; figures that are not finite are left empty."""

    def moment(seconds: float) -> str:
        return "" if departure is None else utc_text(time_after(departure, seconds))

    cells = {
        "season": case,
        "kind": row.kind,
        "begin": moment(row.begin_s),
        "end": moment(row.end_s),
        "begin_s": row.begin_s,
        "end_s": row.end_s,
        "longest_hours": row.longest_s / 3600,
        "least_hours": row.least_s / 3600,
        "reason": row.reason,
    }
    if (way := row.way) is not None:
        cells |= {
            "haven": way.haven,
            "way": way.number,
            "turn_off": moment(way.turn_off_s),
            "turn_off_s": way.turn_off_s,
            **_place("", way.place.tolist()),
            **_place("haven_", way.haven_place.tolist()),
            "bearing_deg": round(way.bearing_deg, 3),
            "length_m": way.length_m,
            "hours": way.duration_s / 3600,
            "fuel": way.fuel,
        }
    return dict(_finite(cells))


PRINTED_HEADINGS = (
    *("State", "From", "Until, or\ntoo late after", "Haven", "Turn off", "Latitude", "Longitude"),
    *("Bearing\n° true", "Length\nNM", "Time to\nhaven", "At most,\nin all", "Fuel"),
)
"""Headings of the printed table; the fuel is in the planner's units."""


def printed_rows(case: RunCase) -> list[tuple[str, ...]]:
    """Return the rows of a case for the passage plan, under `PRINTED_HEADINGS`."""
    return [_printed(row, case.spec.departure) for row in haven_rows(case)]


def moment_cell(seconds: float, departure: datetime | None) -> str:
    """Write a time as UTC, to the minute, or since departure if none is given."""
    if departure is None:
        return f"+ {duration(seconds)}"
    return f"{to_minute(time_after(departure, seconds)):%Y-%m-%d %H:%M}"


def _printed(row: HavenRow, departure: datetime | None) -> tuple[str, ...]:
    """Return a row as text; the last place to turn has no begin."""
    way = row.way
    begin = "" if row.kind in LAST_TURNS else moment_cell(row.begin_s, departure)
    end = "" if row.kind in MOMENTS else moment_cell(row.end_s, departure)
    if way is None:
        return row.kind, begin, end, *[""] * (len(PRINTED_HEADINGS) - 3)
    lon, lat = way.place.tolist()
    return (
        row.kind,
        begin,
        end,
        drawable(way.haven, _MAX_NAME),
        moment_cell(way.turn_off_s, departure),
        position(lat, "NS", 2),
        position(lon, "EW", 3),
        f"{round(way.bearing_deg) % 360:03d}",
        f"{way.length_m / NAUTICAL_MILE_M:.1f}",
        duration(way.duration_s),
        duration(row.longest_s),
        fuel(way.fuel),
    )


def haven_facts(case: RunCase) -> list[str]:
    """Return what a reader needs to know beside the table: limits, shares, how to use it."""
    coverage, limits = coverage_of(case), case.scenario.havens
    shares = ", ".join(f"{percent(coverage.share(state))} {state}" for state in STATES)
    left_out = ", ".join(haven.name for haven, _ in coverage.left_out)
    return [
        f"Ways to havens {limits.text if limits else ''}, by time under way: {shares}.",
        (
            "Covered: early, on time or late, carry on to the place named, turn off there, and be "
            "at the haven in time. Uncovered: by a bound, nobody on time gets to a haven of the "
            "list in time. Not settled: neither is shown."
        ),
        (
            "Last change: up to there the vessel can change to the other route, for a voyage that "
            "needs at most 2 % more fuel than that route from the start."
            if coverage.class_turns
            else ""
        ),
        f"No way was found to {left_out}." if left_out else "",
    ]


def _place(prefix: str, place: list[float]) -> dict[str, float]:
    """Return the columns of a place (lon, lat), degrees."""
    return {f"{prefix}lon": wrapped_longitude(place[0]), f"{prefix}lat": round(place[1], 8)}


def _finite(cells: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield cells, with nothing in place of figures that are not finite."""
    for column, value in cells.items():
        yield column, "" if isinstance(value, float) and not math.isfinite(value) else value
