"""Part files: each holds the rows of neighbouring cases and of the cases' routes.

A part has the cases from `first` to `end` - 1: one row of rank 0 for each case, and one row for
each route of the case; the best route has rank 1. Geometries are WKB in lon/lat. A file consists
of a hash and a Parquet table. A damaged part counts as missing, so its cases are planned again.
"""

import contextlib
import json
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import StageError
from pipeline.findings.columns import COLUMNS, figure_columns
from pipeline.machine.files import UNFINISHED, file_lock, needed, write_whole
from pipeline.machine.store import read_checked, write_checked
from pipeline.nightly.cycle.folders import writing

_TIME, _TEXT, _NUMBER, _COUNT = pa.timestamp("ms", tz="UTC"), pa.string(), pa.float64(), pa.int64()


def _fields(kind: pa.DataType, names: str) -> list[tuple[str, pa.DataType]]:
    """Return columns of one type."""
    return [(name, kind) for name in names.split()]


# Columns of both kinds of rows, cases and routes.
_SHARED = [("index", _COUNT), *_fields(_TEXT, "case scenario season pair departure vessel member")]
_TYPES = {"text": _TEXT, "number": _NUMBER, "whole": _COUNT}
_ROUTE = [
    *((name, _TYPES[COLUMNS[name].type]) for name in figure_columns("night")),
    ("arrival", _TIME),
    ("geometry", pa.binary()),
]
_CASE = [
    *_fields(_TEXT, "status reason outcome why"),
    ("leaves", _TIME),
    *_fields(_TEXT, "currents source stand_in"),
    *_fields(_COUNT, "routes rejected"),
    *_fields(_TEXT, "earlier_cycle earlier_side earlier_class"),
    ("earlier_arrival", _TIME),
    ("keep_fuel", _NUMBER),
    ("keep_arrival", _TIME),
    *_fields(_NUMBER, "saving_percent apart_m members_waiting_saves members_gap"),
    *_fields(_COUNT, "members_count members_flips"),
    *_fields(_TEXT, "members_sides members_left_out"),
]
CASE_SCHEMA = pa.schema([*_SHARED, *_CASE, *_ROUTE])
"""Columns of `cases.parquet`: a case, its best route, and what changed."""
ROUTE_SCHEMA = pa.schema([*_SHARED, ("rank", _COUNT), *_ROUTE])
"""Columns of `routes.parquet`."""
PART_SCHEMA = pa.schema([*_SHARED, ("rank", _COUNT), *_CASE, *_ROUTE, ("seconds", _NUMBER)])
"""Columns of a part; `seconds` is the planning time of the case."""
_PART_NAME = re.compile(r"(\d{8})-(\d{8})\.part", re.ASCII)

Row = dict[str, Any]
_REQUEST, _PARTS, _LOCK = "request.json", "parts", "setup.lock"
# Time to wait while another job of the night prepares the folder, s.
_SETUP_S = 60.0


@dataclass(frozen=True, slots=True)
class PartFile:
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
    with needed(f"can't write {path.name} in {path.parent}", "free some space and run again"):
        write_checked(path, content.getvalue().to_pybytes())


def parts_in(folder: Path) -> list[PartFile]:
    """Return the undamaged parts of a folder, sorted by first case."""
    found = []
    for path in folder.glob("*.part"):
        name = _PART_NAME.fullmatch(path.name)
        if name is not None and _is_whole(path):
            found.append(PartFile(path, int(name[1]), int(name[2])))
    return sorted(found, key=lambda part: (part.first, -part.end))


def remove_unfinished(folder: Path) -> None:
    """Remove unfinished files of killed workers."""
    for path in folder.glob(f".*{UNFINISHED}"):
        path.unlink(missing_ok=True)


def read_part(part: PartFile) -> pa.Table:
    """Read a part's rows; raise pa.ArrowInvalid if the file is damaged or missing."""
    content = read_checked(part.path)
    if content is None:
        raise pa.ArrowInvalid(f"{part.path.name} is damaged")
    return pq.read_table(pa.BufferReader(content))


def covering(parts: Sequence[PartFile]) -> Iterator[tuple[PartFile, int, int]]:
    """Yield each part with the range (first, end) of its cases that no earlier part has.

    The parts are in the order of `parts_in`. They overlap if a worker outlived its job.
    """
    covered = 0
    for part in parts:
        first = max(part.first, covered)
        if first < part.end:
            yield part, first, part.end
            covered = part.end


def gaps(parts: Sequence[PartFile], first: int, end: int) -> list[tuple[int, int]]:
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


@dataclass(frozen=True)
class Partial:
    """The folder of an unfinished cycle; `started` is the start of its first run (UTC)."""

    folder: Path
    started: datetime

    @classmethod
    def opened(cls, folder: Path, request: str, *, is_alone: bool) -> "Partial":
        """Create the folder, or open the one of an earlier run.

        Parameters
        ----------
        request
            Identifies all inputs of the results; part files of another request are removed.
        is_alone
            Whether no other job uses the folder.

        Raises
        ------
        StageError
            Nothing can be written, or the folder has another request and may be in use.
        """
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            with file_lock(folder / _LOCK, wait_s=_SETUP_S):
                found = _request(folder / _REQUEST)
                if found.get("request") != request:
                    if found and not is_alone:
                        raise StageError(
                            f"{folder.name} was begun by another request; run once without --part, "
                            "or remove it"
                        )
                    _empty(folder)
                    now = datetime.now(UTC).isoformat(timespec="seconds")
                    found = {"request": request, "started": now}
                    write_whole(folder / _REQUEST, json.dumps(found) + "\n")
                (folder / _PARTS).mkdir(exist_ok=True)
                if is_alone:
                    remove_unfinished(folder / _PARTS)
        return cls(folder, datetime.fromisoformat(found["started"]))

    @property
    def request_file(self) -> Path:
        """A file that all workers must be able to read."""
        return self.folder / _REQUEST

    @property
    def parts_folder(self) -> Path:
        """Folder of the part files."""
        return self.folder / _PARTS

    def parts(self) -> list[PartFile]:
        """Return the undamaged parts, sorted by first case."""
        return parts_in(self.parts_folder)

    def forget_parts(self) -> None:
        """Remove all parts, so that the next run plans all cases again."""
        with contextlib.suppress(OSError):
            shutil.rmtree(self.parts_folder)

    def clear(self) -> None:
        """Remove everything except the results."""
        with writing(self.folder):
            shutil.rmtree(self.folder / _PARTS, ignore_errors=True)
            for name in (_REQUEST, _LOCK):
                (self.folder / name).unlink(missing_ok=True)


def _request(path: Path) -> dict[str, str]:
    """Read the file of the request; return {} if it is missing or damaged."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        datetime.fromisoformat(found["started"])
        return {key: str(found[key]) for key in ("request", "started")}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _empty(folder: Path) -> None:
    """Remove everything in the folder except the lock's file."""
    for path in folder.iterdir():
        if path.name == _LOCK:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
