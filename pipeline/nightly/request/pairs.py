"""Read the start–goal pairs of a night from a CSV file; every fault is reported with its row."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from pipeline.machine.paths import shown, unreadable_reason
from pipeline.scenario.strict import Name, Point

_LONLAT = ("start_lon", "start_lat", "goal_lon", "goal_lat")
_PLANE = ("start_x", "start_y", "goal_x", "goal_y")
# Largest size of a file, bytes: a million pairs are a file of 50 MB, and take 1 GB of memory.
_MAX_BYTES = 100 << 20
_NAME: TypeAdapter[str] = TypeAdapter(Name)


@dataclass(frozen=True, slots=True)
class Pair:
    """Start and goal (lon/lat degrees, or metres in a plane), and the pair's row in the file."""

    name: str
    start: Point
    goal: Point
    row: int


def read_pairs(path: Path, *, is_planar: bool) -> tuple[tuple[Pair, ...], list[str]]:
    """Read a file of pairs; return the valid pairs and the faults."""
    if reason := unreadable_reason(path) or _size_reason(path):
        return (), [
            f"{shown(path)} {reason}; give a CSV file with the columns {_columns(is_planar)}"
        ]
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return (), [f"{shown(path)} can't be read as CSV: {error}; save it as CSV in UTF-8"]
    keys = (*(_PLANE if is_planar else _LONLAT), "name")
    head = [cell.strip() for cell in rows[0]] if rows else []
    lacking = [key for key in keys if key not in head]
    if lacking:
        fault = f"has no column {', '.join(lacking)}; the columns are {_columns(is_planar)}"
        return (), [f"{path.name}, row 1: {fault}"]
    if len(set(head)) < len(head):
        return (), [f"{path.name}, row 1: a column comes twice; leave one out"]
    pairs, faults = [], []
    for number, cells in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        where = f"{path.name}, row {number}"
        if len(cells) != len(head):
            faults.append(
                f"{where}: has {len(cells)} cells, the header has {len(head)}; correct the row"
            )
            continue
        pair, found = _pair(dict(zip(head, cells, strict=True)), number, keys, is_planar=is_planar)
        faults += [f"{where}: {fault}" for fault in found]
        if pair is not None:
            pairs.append(pair)
    faults += _repeated(path, pairs)
    if not pairs and not faults:
        faults.append(f"{path.name} has no pairs; add a row for each below the header")
    return tuple(pairs), faults


def _size_reason(path: Path) -> str:
    """Return a message if a file of pairs is too large, or ""."""
    size = path.stat().st_size
    large = f"has {size >> 20:,} MB, more than {_MAX_BYTES >> 20}"
    return large if size > _MAX_BYTES else ""


def _columns(is_planar: bool) -> str:  # noqa: FBT001 - called with a name's value
    return ", ".join((*(_PLANE if is_planar else _LONLAT), "name"))


def _pair(
    row: dict[str, str], number: int, keys: tuple[str, ...], *, is_planar: bool
) -> tuple[Pair | None, list[str]]:
    """Read a row; return the pair, or None if it has faults, and the faults."""
    faults, figures = [], []
    for key in keys[:-1]:
        try:
            figure = float(row[key])
        except ValueError:
            faults.append(f"{key} = {row[key]!r} is not a number; give it as 120.30")
            continue
        limit = math.inf if is_planar else 90.0 if key.endswith("lat") else 360.0
        lowest = -180.0 if key.endswith("lon") else -limit
        if not (math.isfinite(figure) and lowest <= figure <= limit):
            what = "metres" if is_planar else "degrees on earth"
            faults.append(f"{key} = {row[key]} is not a valid number of {what}; correct it")
        figures.append(figure)
    name = row["name"].strip()
    try:
        _NAME.validate_python(name)
    except ValidationError:
        faults.append(
            f"name = {name!r} is no name; use up to 64 lower-case letters, digits, - and _"
        )
    if not faults and figures[:2] == figures[2:]:
        faults.append("start and goal are the same place; give two")
    if faults:
        return None, faults
    return Pair(name, (figures[0], figures[1]), (figures[2], figures[3]), number), []


def _repeated(path: Path, pairs: list[Pair]) -> list[str]:
    """Return a message for each name that an earlier row has, too."""
    first: dict[str, int] = {}
    faults = []
    for pair in pairs:
        if pair.name in first:
            faults.append(
                f"{path.name}, row {pair.row}: name = {pair.name!r} is also the name of row "
                f"{first[pair.name]}; rename one"
            )
        first.setdefault(pair.name, pair.row)
    return faults
