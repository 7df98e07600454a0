"""What the page says of havens: how much of a route is covered, and a table of the ways to take."""

from typing import Any

from pipeline.findings.haven_rows import LAST_TURNS, MOMENTS, HavenRow, haven_rows
from pipeline.findings.result import RunCase
from pipeline.findings.text import duration
from pipeline.formats.haven_table import haven_facts, moment_cell
from pipeline.formats.report.map_data import place_on_map


def haven_section(case: RunCase) -> dict[str, Any] | None:
    """Return the sentences and rows of a case's havens; None without havens."""
    if case.coverage is None:
        return None
    return {
        "sentences": [one for one in haven_facts(case) if one],
        "rows": [_row(case, row) for row in haven_rows(case)],
    }


def _row(case: RunCase, row: HavenRow) -> dict[str, Any]:
    """Return a row of the table as text; `place` is where the vessel turns off, for a button."""
    way, departure, water = row.way, case.spec.departure, case.run.water
    place = None if way is None else water.projection.to_plane(way.place)
    is_last = row.kind in LAST_TURNS
    return {
        "kind": row.kind,
        "begin": "" if is_last else moment_cell(row.begin_s, departure),
        "end": "" if row.kind in MOMENTS else moment_cell(row.end_s, departure),
        "way": way,
        "turn_off": moment_cell(way.turn_off_s, departure) if way else "",
        "place": "" if place is None else place_on_map(water, place),
        "bearing": f"{round(way.bearing_deg) % 360:03d}°" if way else "",
        "takes": duration(way.duration_s) if way else "",
        "longest": duration(row.longest_s) if way else "",
    }
