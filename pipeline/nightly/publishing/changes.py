"""`changes.csv`: yesterday's and tonight's route of each case that had a route yesterday."""

import csv
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import pyarrow.parquet as pq

from pipeline.nightly.cycle.part import Row

CHANGES_FILE = "changes.csv"
COLUMNS = (
    "case",
    "outcome",
    "why",
    "earlier_cycle",
    "earlier_side",
    "side",
    "earlier_class",
    "class",
    "earlier_arrival",
    "keep_arrival",
    "arrival",
    "keep_fuel",
    "fuel",
    "saving_percent",
    "apart_m",
    "status",
    "reason",
)
"""Columns; `earlier_` is yesterday's route, `keep_` yesterday's route in tonight's current."""


def write_changes(cases_path: Path, path: Path) -> None:
    """Write the changes of a cycle; without an earlier cycle, only the header."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in rows_of(cases_path, COLUMNS):
            if row["earlier_cycle"]:
                writer.writerow([_spelled(row[column]) for column in COLUMNS])


def rows_of(path: Path, columns: tuple[str, ...]) -> Iterator[Row]:
    """Yield the rows of a table; only one row group is in memory at a time."""
    file = pq.ParquetFile(path)
    for group in range(file.num_row_groups):
        yield from file.read_row_group(group, list(columns)).to_pylist()


def _spelled(value: object) -> object:
    """Return a CSV value: times in ISO 8601, floats with nine digits, None as ""."""
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%dT%H:%M:%SZ")
    if isinstance(value, float):
        return f"{value:.9g}"
    return "" if value is None else value
