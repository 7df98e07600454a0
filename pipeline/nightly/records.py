"""The results of finished cycles: their record `night.json`, the outcomes, and yesterday's routes.

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

import pyarrow.parquet as pq
import shapely

from pipeline._types import FloatArray
from pipeline.errors import RequestError, StageError
from pipeline.machine.files import flush_tree, write_whole
from pipeline.machine.store import file_hash
from pipeline.nightly.cases import matches
from pipeline.nightly.cycles import RECORD, Cycles, Row, holder_of, is_busy, rows_of_parts, writing
from pipeline.texts import table_beside

CASES_FILE = "cases.parquet"
HISTORY_FILE = "history.parquet"
DONE = 0
"""Exit code of a night that has nothing to tell."""
LOOK_CODE = 10
"""Exit code of a night that published, and an operator should look at some cases or notes."""
SAME = "same"
"""Outcome of a case: yesterday's way is still the best, or nearly."""
LOOK = "look"
"""Outcome of a case that an operator should look at."""
ACT = "act"
"""Outcome of a case: yesterday's way can't be sailed any more, or there is no route."""
OUTCOMES = (SAME, LOOK, ACT)
COLUMNS = table_beside(__file__, "tables.toml")
"""Columns of a night's tables."""


def write_record(
    folder: Path, files: Sequence[str], made: Mapping[str, Any], notes: Sequence[str]
) -> None:
    """Flush a cycle's files to the disk, and then write its record.

    `made` is the time and the inputs of the cycle, and the numbers of its cases; `notes` are other
    matters that an operator should look at.
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
    """Read the record of a finished cycle; StageError if the record can't be read."""
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

    `request` and `currents` are hashes of tonight's request and of the newest currents.
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


def faults_of(folder: Path, files: Iterable[str] = ()) -> dict[str, str]:
    """Return the faults of a cycle's files by name: missing, unreadable or damaged.

    The given files are checked or, by default, all that the record names.
    """
    try:
        hashes = record_of(folder)["sha256"]
    except StageError:
        return {RECORD: "can't be read"}
    faults = {}
    for name in files or hashes:
        try:
            if file_hash(folder / name) != hashes.get(name):
                faults[name] = "is damaged: its content has changed since it was written"
        except FileNotFoundError:
            faults[name] = "is missing"
        except OSError as error:
            faults[name] = f"can't be read ({error.strerror or type(error).__name__})"
    return faults


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
    return {
        row["case"]: EarlierRoute(
            cycle,
            row["side"],
            row.get("island", ""),  # which an earlier version's table lacks
            row["class"],
            row["fuel"],
            row["arrival"] and row["arrival"].astimezone(UTC),  # plain: the store holds no others
            shapely.get_coordinates(shapely.from_wkb(row["geometry"])),
        )
        for row in pq.read_table(path).to_pylist()
        if row["geometry"] is not None
    }


def readable_cycle(cycles: Cycles) -> tuple[str, list[str]]:
    """Return the newest cycle up to `latest` whose tables can be read, and why newer ones can't.

    The name is "" if there is no such cycle. There is a note for each damaged table.
    """
    notes = list[str]()
    for cycle in reversed(cycles.up_to_latest()):
        faults = faults_of(cycles.folder(cycle), (CASES_FILE, HISTORY_FILE))
        if not faults:
            return cycle, notes
        notes += [
            f"{cycle}/{name} {fault}; tonight is compared with an earlier night, if there is one, "
            "and the history goes on from there"
            for name, fault in faults.items()
        ]
    return "", notes


# Largest number of cases that `show` prints.
_MAX_SHOWN = 20


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

    Raises RequestError if there is no cycle, or it has no such case.
    """
    cycles = Cycles(output)
    if not cycles.latest:
        raise RequestError(f"{output} has no finished cycle; `renew nightly run` makes one")
    folder, count = cycles.folder(cycles.latest), 0
    for row in pq.read_table(folder / CASES_FILE, columns=COLUMNS["shown"]).to_pylist():
        if not matches(row["case"], asked):
            continue
        count += 1
        if count > _MAX_SHOWN:
            yield f"… more than {_MAX_SHOWN}; give more of the name"
            return
        if count > 1:
            yield ""
        for key, value in row.items():
            if value not in {None, ""}:
                yield f"{key}: {_spelled(value)}"
    if not count:
        raise RequestError(f"no case is called {asked!r} in {cycles.latest}; see {CASES_FILE}")


def _spelled(value: object) -> str:
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%d %H:%MZ")
    return f"{value:.6g}" if isinstance(value, float) else str(value)
