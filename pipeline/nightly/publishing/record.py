"""`night.json`: when and by what a cycle was made, and how its cases ended.

The one file of a cycle with times of making.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from pipeline.errors import StageError
from pipeline.nightly.cycle.folders import writing
from pipeline.nightly.outcome import ACT, DONE, LOOK, LOOK_CODE, OUTCOMES

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from pipeline.nightly.publishing.publishing import Published

RECORD = "night.json"


def write_record(folder: Path, made: Mapping[str, Any], published: Published) -> None:
    """Write how a cycle was made, and how its cases ended."""
    from pipeline.formats.tables.manifest import versions
    from pipeline.nightly.cycle.partial import write_whole

    by_outcome = published.by_outcome
    content = {
        **made,
        "cases_by_outcome": by_outcome,
        "cases_by_status": published.by_status,
        "exit_code": LOOK_CODE if by_outcome[ACT] or by_outcome[LOOK] else DONE,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "planning_seconds": round(published.planning_s, 3),
        "versions": dict(versions()),
    }
    with writing(folder):
        write_whole(folder / RECORD, json.dumps(content, indent=2) + "\n")


def record_of(folder: Path) -> dict[str, Any]:
    """Read what a finished cycle says of its making.

    Raises
    ------
    StageError
        It can't be read: somebody has changed the cycle.
    """
    try:
        said: dict[str, Any] = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StageError(f"{folder / RECORD} can't be read ({error}); remove {folder}") from error
    return said


def summary(record: Mapping[str, Any]) -> str:
    """Say in one line how a cycle ended."""
    outcomes = ", ".join(f"{record['cases_by_outcome'][name]:,} {name}" for name in OUTCOMES)
    others = ", ".join(
        f"{n:,} {name}"
        for name, n in sorted(record["cases_by_status"].items())
        if name != "planned"
    )
    return f"{record['cycle']}: {outcomes}" + (f"; {others}" if others else "")
