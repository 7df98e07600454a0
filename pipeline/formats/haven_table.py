"""`havens.csv`: from where along each best route a haven is reached in time, and where to turn."""

import math
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from pipeline.formats.passage.waypoints import time_after, wrapped_longitude
from pipeline.formats.shared.haven_rows import HavenRow, haven_rows
from pipeline.formats.shared.result import RunResult
from pipeline.formats.tables import utc_text, write_csv

COLUMNS = (
    *("season", "kind", "begin", "end", "begin_s", "end_s", "haven", "way", "turn_off"),
    *("turn_off_s", "lon", "lat", "haven_lon", "haven_lat", "bearing_deg", "length_m", "hours"),
    *("fuel", "longest_hours", "least_hours", "reason"),
)
"""Times are UTC, empty without a departure; `_s` are seconds since departure. `way` is the number
of the way among the season's; lengths are true metres, fuel is in the planner's units."""


def write_havens(result: RunResult, path: Path) -> None:
    """Write the coverage of all seasons as CSV: stretches first, then the last places to turn."""
    rows = (
        _cells(season, row, result.spec_of(season).departure)
        for season in result.coverages
        for row in haven_rows(result, season)
    )
    write_csv(path, COLUMNS, rows)


def _cells(season: str, row: HavenRow, departure: datetime | None) -> dict[str, Any]:
    """Return a row's cells by column; figures that are not finite are left empty."""

    def moment(seconds: float) -> str:
        return "" if departure is None else utc_text(time_after(departure, seconds))

    cells = {
        "season": season,
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


def _place(prefix: str, place: list[float]) -> dict[str, float]:
    """Return the columns of a place (lon, lat), degrees."""
    return {f"{prefix}lon": wrapped_longitude(place[0]), f"{prefix}lat": round(place[1], 8)}


def _finite(cells: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield cells, with nothing in place of figures that are not finite."""
    for column, value in cells.items():
        yield column, "" if isinstance(value, float) and not math.isfinite(value) else value
