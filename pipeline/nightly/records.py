"""The results of finished cycles: `night.json`, yesterday's routes, and the history.

`night.json` has the time and inputs of a cycle, the outcomes of its cases, and hashes of its files.
It is written after all other files are on the disk. So a cycle with a record is complete, and the
hashes show later changes. No other file of a cycle contains the time when it was made.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import shapely

from pipeline._types import FloatArray
from pipeline.errors import RequestError, StageError
from pipeline.machine.files import flush_tree, write_whole
from pipeline.machine.store import file_hash
from pipeline.nightly.cases import matches
from pipeline.nightly.cycles import RECORD, Cycles, Row, holder_of, is_busy, rows_of_parts, writing
from pipeline.nightly.outcome import ACT, DONE, LOOK, LOOK_CODE, OUTCOMES
from pipeline.texts import clean

CASES_FILE = "cases.parquet"
_COLUMNS = ["case", "side", "island", "class", "fuel", "arrival", "geometry"]
HISTORY_FILE = "history.parquet"
_CONSEQUENCES = {
    CASES_FILE: "tonight is compared with an earlier night, if there is one",
    HISTORY_FILE: "the history is made again from the cycles that are kept",
}


def write_record(
    folder: Path,
    files: Sequence[str],
    made: Mapping[str, Any],
    notes: Sequence[str],
) -> None:
    """Flush a cycle's files to the disk, and then write its record.

    Parameters
    ----------
    files
        Names of the cycle's files.
    made
        The time and the inputs of the cycle, and the numbers of its cases.
    notes
        Other matters that an operator should look at.
    """
    from pipeline.formats.records import versions

    by_outcome = made["cases_by_outcome"]
    to_look_at = by_outcome[ACT] or by_outcome[LOOK] or notes
    with writing(folder):
        flush_tree(folder)
        content = {
            **made,
            "notes": list(notes),
            "exit_code": LOOK_CODE if to_look_at else DONE,
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": dict(versions()),
            "sha256": {name: file_hash(folder / name) for name in files},
        }
        write_whole(folder / RECORD, json.dumps(content, indent=2) + "\n")


def record_of(folder: Path) -> dict[str, Any]:
    """Read the record of a finished cycle.

    Raises
    ------
    StageError
        The record can't be read.
    """
    try:
        record: dict[str, Any] = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        record["sha256"].items()
        datetime.fromisoformat(record["finished"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = getattr(error, "strerror", None) or "damaged"
        raise StageError(
            f"{folder / RECORD} can't be read ({reason}); run a night, which plans it again"
        ) from error
    return record


def finished_at(folder: Path) -> datetime | None:
    """Return the time when a cycle was finished; None if its record can't be read."""
    try:
        return datetime.fromisoformat(record_of(folder)["finished"])
    except StageError:
        return None


def reason_to_revise(folder: Path, request: str, currents: str) -> str:
    """Return why a finished cycle must be planned again, or "" if it need not be.

    Parameters
    ----------
    request, currents
        Hashes of tonight's request and of the newest currents.
    """
    if faults := faults_of(folder):
        return "; ".join(f"{folder.name}/{name} {fault}" for name, fault in faults.items())
    record = record_of(folder)
    changed = [
        what
        for what, now in (("request", request), ("currents", currents))
        if record.get(what) != now
    ]
    return f"changed since {folder.name}: {' and '.join(changed)}" if changed else ""


def faults_of(folder: Path, files: Iterable[str] | None = None) -> dict[str, str]:
    """Return the faults of a cycle's files by name: missing, unreadable or damaged.

    By default the record and all files that it names are checked. If the record can't be read, the
    given files, which are tables, are read to the end instead.
    """
    try:
        hashes = record_of(folder)["sha256"]
    except StageError:
        if files is None:
            return {RECORD: "can't be read"}
        return {name: fault for name in files if (fault := _table_fault(folder / name))}
    found = {}
    for name in hashes if files is None else files:
        try:
            if file_hash(folder / name) != hashes.get(name):
                found[name] = "is damaged: its content has changed since it was written"
        except OSError as error:
            found[name] = _unreadable(error)
    return found


def _table_fault(path: Path) -> str:
    """Return why a Parquet table can't be read to its end, or ""."""
    try:
        pq.read_table(path)
    except FileNotFoundError as error:
        return _unreadable(error)
    except (OSError, pa.ArrowException) as error:
        return f"is damaged: {clean(str(error))[:100]}"
    return ""


def _unreadable(error: OSError) -> str:
    """Return a message that a file is missing, or why it can't be read."""
    if isinstance(error, FileNotFoundError):
        return "is missing"
    return f"can't be read ({error.strerror or type(error).__name__})"


def summary(record: Mapping[str, Any]) -> str:
    """Return one line with the outcomes of a cycle's cases."""
    outcomes = ", ".join(f"{record['cases_by_outcome'][name]:,} {name}" for name in OUTCOMES)
    others = ", ".join(
        f"{n:,} {name}"
        for name, n in sorted(record["cases_by_status"].items())
        if name != "planned"
    )
    return f"{record['cycle']}: {outcomes}" + (f"; {others}" if others else "")


@dataclass(frozen=True)
class EarlierRoute:
    """Yesterday's best route of a case; its path (n, 2) is lon/lat, degrees."""

    cycle: str
    side: str
    island: str
    homotopy: str
    fuel: float
    arrival: datetime | None
    path: FloatArray

    def columns(self) -> Row:
        """Return the columns that describe the route."""
        return {
            "earlier_cycle": self.cycle,
            "earlier_side": self.side,
            "earlier_class": self.homotopy,
            "earlier_arrival": self.arrival,
        }


def earlier_routes(cycle: str, path: Path) -> dict[str, EarlierRoute]:
    """Return the routes in a cycle's table of cases by the case, without cases that have none."""
    known = set(pq.read_schema(path).names)  # an earlier version's table lacks the island
    table = pq.read_table(path, columns=[name for name in _COLUMNS if name in known])
    return {
        row["case"]: EarlierRoute(
            cycle,
            row["side"],
            row.get("island", ""),
            row["class"],
            row["fuel"],
            row["arrival"] and row["arrival"].astimezone(UTC),  # plain: the store holds no others
            shapely.get_coordinates(shapely.from_wkb(row["geometry"])),
        )
        for row in table.to_pylist()
        if row["geometry"] is not None
    }


@dataclass(frozen=True, slots=True)
class LookBack:
    """The readable results of earlier nights.

    Attributes
    ----------
    cycle : the newest cycle with a readable table of cases, for the comparison with tonight; or "".
    history : the newest readable history, or None.
    later : cycles newer than that history, oldest first: name and readable table of cases.
    notes : one line for each file that could not be read.
    """

    cycle: str = ""
    history: Path | None = None
    later: tuple[tuple[str, Path], ...] = ()
    notes: tuple[str, ...] = ()


def look_back(cycles: Cycles) -> LookBack:
    """Find the readable results of earlier nights; set unreadable files aside, with a note.

    The search goes backwards and usually ends after two files of the last cycle.
    """
    compared, history, notes = "", None, list[str]()
    later: list[tuple[str, Path]] = []
    for cycle in reversed(cycles.up_to_latest()):
        folder = cycles.folder(cycle)
        wanted = (CASES_FILE,) if history is not None else (CASES_FILE, HISTORY_FILE)
        faults = faults_of(folder, wanted)
        for name, fault in faults.items():
            cycles.set_aside(folder / name)
            notes.append(f"{cycle}/{name} {fault}; {_CONSEQUENCES[name]}")
        if CASES_FILE not in faults:
            compared = compared or cycle
        if history is None and HISTORY_FILE not in faults:
            history = folder / HISTORY_FILE
        elif history is None and CASES_FILE not in faults:
            later.insert(0, (cycle, folder / CASES_FILE))
        if compared and history is not None:
            break
    return LookBack(compared, history, tuple(later), tuple(notes))


# Largest number of cases that `show` prints.
_MAX_SHOWN = 20
# fmt: off
_SHOWN = (
    "case", "outcome", "why", "status", "reason", "currents", "source", "stand_in", "leaves",
    "arrival", "side", "class", "fuel", "length_m", "duration_s", "clearance_m", "optimality_gap",
    "routes", "rejected", "collisions", "earlier_cycle", "earlier_side", "earlier_class",
    "earlier_arrival", "keep_fuel", "keep_arrival", "saving_percent", "apart_m",
)
# fmt: on


def status_lines(output: Path) -> Iterator[str]:
    """Yield lines on the latest cycle, unfinished cycles, the running job, and all cycles."""
    cycles = Cycles(output)
    latest = cycles.latest
    if latest:
        yield f"latest: {latest}, {_described(cycles.folder(latest))}"
    else:
        yield f"latest: none in {output}"
    for cycle in cycles.partials():
        parts = rows_of_parts(cycles.partial(cycle))
        done = {row["index"] for rows in parts for row in rows}
        yield f"under way: {cycle}, {len(done):,} cases done"
    yield f"at work: {holder_of(output)}" if is_busy(output) else "at work: nobody"
    yield f"kept: {', '.join(cycles.finished()) or 'none'}"


def _described(folder: Path) -> str:
    """Return a cycle's record in one line, or why it can't be read."""
    try:
        record = record_of(folder)
    except StageError as error:
        return str(error)
    finished = datetime.fromisoformat(record["finished"])
    hours = (datetime.now(UTC) - finished).total_seconds() / 3600
    counts = ", ".join(f"{record['cases_by_outcome'][name]:,} {name}" for name in OUTCOMES)
    return f"{record['cases']:,} cases ({counts}), made {hours:.1f} h ago"


def case_lines(output: Path, asked: str) -> Iterator[str]:
    """Yield the last cycle's values of all cases whose names are or begin with `asked`.

    Raises
    ------
    RequestError
        There is no cycle, or it has no such case.
    """
    cycles = Cycles(output)
    if not cycles.latest:
        raise RequestError(f"{output} has no finished cycle; `renew nightly run` makes one")
    folder, found = cycles.folder(cycles.latest), 0
    for row in pq.read_table(folder / CASES_FILE, columns=list(_SHOWN)).to_pylist():
        if not matches(row["case"], asked):
            continue
        found += 1
        if found > _MAX_SHOWN:
            yield f"… more than {_MAX_SHOWN}; give more of the name"
            return
        if found > 1:
            yield ""
        for key, value in row.items():
            if value not in {None, ""}:
                yield f"{key}: {_spelled(value)}"
    if not found:
        raise RequestError(f"no case is called {asked!r} in {cycles.latest}; see {CASES_FILE}")


def _spelled(value: object) -> str:
    """Return a value as text."""
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%d %H:%MZ")
    return f"{value:.6g}" if isinstance(value, float) else str(value)
