"""The output of `renew nightly status` and `renew nightly show`."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pyarrow.parquet as pq

from pipeline.errors import RequestError, StageError
from pipeline.nightly.cases import matches
from pipeline.nightly.cycles import Cycles, holder_of, is_busy, rows_of_parts
from pipeline.nightly.outcome import OUTCOMES
from pipeline.nightly.records import CASES_FILE, record_of

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
