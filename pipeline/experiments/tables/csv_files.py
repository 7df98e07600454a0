"""Tables as CSV files."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.experiments.tables.summary import Cell, Table


def write_csv(table: Table, folder: Path) -> Path:
    """Write `<name>.csv` into a folder."""
    path = folder / f"{table.name}.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, table.columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {name: _spelled(value) for name, value in row.items()} for row in table.rows
        )
    return path


def _spelled(value: Cell) -> Cell:
    """A figure to six digits: more than any was measured to."""
    return f"{value:.6g}" if isinstance(value, float) else value
