"""Part files, each with the rows of neighbouring cases and of their routes.

A part has the cases from `first` to `end` - 1: one row of rank 0 for each case, and one row for
each of its routes, of which the best has rank 1. Geometries are WKB in lon/lat. A file consists of
a hash and a Parquet table. A damaged part is treated as missing, so its cases are planned again.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import StageError
from pipeline.machine.files import UNFINISHED
from pipeline.machine.store import read_checked, write_checked

_TIME = pa.timestamp("ms", tz="UTC")
# Columns of both kinds of rows, cases and routes.
_SHARED = (
    ("index", pa.int64()),
    ("case", pa.string()),
    ("scenario", pa.string()),
    ("season", pa.string()),
    ("pair", pa.string()),
    ("departure", pa.string()),
    ("vessel", pa.string()),
    ("member", pa.string()),
)
_ROUTE = (
    ("side", pa.string()),
    ("class", pa.string()),
    ("fuel", pa.float64()),
    ("fuel_per_distance", pa.float64()),
    ("length_m", pa.float64()),
    ("duration_s", pa.float64()),
    ("clearance_m", pa.float64()),
    ("optimality_gap", pa.float64()),
    ("trials", pa.int64()),
    ("collisions", pa.int64()),
    ("arrival", _TIME),
    ("geometry", pa.binary()),
)
_CASE = (
    ("status", pa.string()),
    ("reason", pa.string()),
    ("outcome", pa.string()),
    ("why", pa.string()),
    ("leaves", _TIME),
    ("currents", pa.string()),
    ("source", pa.string()),
    ("stand_in", pa.string()),
    ("routes", pa.int64()),
    ("rejected", pa.int64()),
    ("earlier_cycle", pa.string()),
    ("earlier_side", pa.string()),
    ("earlier_class", pa.string()),
    ("earlier_arrival", _TIME),
    ("keep_fuel", pa.float64()),
    ("keep_arrival", _TIME),
    ("saving_percent", pa.float64()),
    ("apart_m", pa.float64()),
)
CASE_SCHEMA = pa.schema([*_SHARED, *_CASE, *_ROUTE])
"""Columns of `cases.parquet`: a case, its best route, and what changed."""
ROUTE_SCHEMA = pa.schema([*_SHARED, ("rank", pa.int64()), *_ROUTE])
"""Columns of `routes.parquet`."""
PART_SCHEMA = pa.schema(
    [*_SHARED, ("rank", pa.int64()), *_CASE, *_ROUTE, ("seconds", pa.float64())]
)
"""Columns of a part; `seconds` is the planning time of the case."""
_PART_NAME = re.compile(r"(\d{8})-(\d{8})\.part", re.ASCII)

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Part:
    """A part file with the cases from `first` to `end` - 1."""

    path: Path
    first: int
    end: int


def part_path(folder: Path, first: int, end: int) -> Path:
    """Return the path of the part with the cases from `first` to `end` - 1."""
    return folder / f"{first:08}-{end:08}.part"


def write_part(path: Path, rows: Sequence[Row]) -> None:
    """Write a part file atomically; raise StageError if it can't be written."""
    content = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(list(rows), PART_SCHEMA), content)
    try:
        write_checked(path, content.getvalue().to_pybytes())
    except OSError as error:
        reason = error.strerror or error
        raise StageError(
            f"can't write {path.name} in {path.parent}: {reason}; free some space and run again"
        ) from error


def parts_in(folder: Path) -> list[Part]:
    """Return the undamaged parts of a folder, sorted by first case."""
    found = []
    for path in folder.glob("*.part"):
        name = _PART_NAME.fullmatch(path.name)
        if name is not None and _is_whole(path):
            found.append(Part(path, int(name[1]), int(name[2])))
    return sorted(found, key=lambda part: (part.first, -part.end))


def remove_unfinished(folder: Path) -> None:
    """Remove unfinished files of killed workers."""
    for path in folder.glob(f".*{UNFINISHED}"):
        path.unlink(missing_ok=True)


def read_part(part: Part) -> pa.Table:
    """Read a part's rows; raise pa.ArrowInvalid if the file is damaged or missing."""
    content = read_checked(part.path)
    if content is None:
        raise pa.ArrowInvalid(f"{part.path.name} is damaged")
    return pq.read_table(pa.BufferReader(content))


def covering(parts: Sequence[Part]) -> Iterator[tuple[Part, int, int]]:
    """Yield each part with the range (first, end) of its cases that no earlier part has.

    The parts are in the order of `parts_in`. They overlap if a worker outlived its job.
    """
    covered = 0
    for part in parts:
        first = max(part.first, covered)
        if first < part.end:
            yield part, first, part.end
            covered = part.end


def gaps(parts: Sequence[Part], first: int, end: int) -> list[tuple[int, int]]:
    """Return the ranges of cases from `first` to `end` - 1 that no part contains."""
    found, covered = [], first
    for part in parts:
        if part.end <= covered or part.first >= end:
            continue
        if part.first > covered:
            found.append((covered, part.first))
        covered = max(covered, part.end)
    if covered < end:
        found.append((covered, end))
    return found


def _is_whole(path: Path) -> bool:
    """Whether a part is undamaged and has the expected columns."""
    content = read_checked(path)
    return content is not None and pq.read_schema(pa.BufferReader(content)).equals(PART_SCHEMA)
