"""`history.parquet`: one row per case and cycle; each cycle copies the file and adds its rows."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.nightly.cycle.look_back import LookBack
from pipeline.nightly.publishing.merging import table_writer
from pipeline.nightly.request.newest_currents import cycle_time

_COLUMNS = ("case", "status", "outcome", "side", "class", "fuel", "arrival", "saving_percent")
SCHEMA = pa.schema(
    [
        ("cycle", pa.string()),
        ("reference_time", pa.timestamp("ms", tz="UTC")),
        ("case", pa.string()),
        ("status", pa.string()),
        ("outcome", pa.string()),
        ("side", pa.string()),
        ("class", pa.string()),
        ("fuel", pa.float64()),
        ("arrival", pa.timestamp("ms", tz="UTC")),
        ("saving_percent", pa.float64()),
    ]
)


def write_history(
    earlier: LookBack, cases_path: Path, path: Path, cycle: str, reference: datetime | None
) -> None:
    """Write the earlier history, the cases of cycles that it lacks, and tonight's cases."""
    with table_writer(path, SCHEMA) as write:
        if earlier.history is not None:
            before = pq.ParquetFile(earlier.history)
            for group in range(before.num_row_groups):
                write(before.read_row_group(group))
        for name, cases in earlier.later:
            _append(write, cases, name, cycle_time(name))
        _append(write, cases_path, cycle, reference)


def _append(
    write: Callable[[pa.Table], None], cases_path: Path, cycle: str, reference: datetime | None
) -> None:
    """Write the rows of a cycle's cases."""
    cases = pq.ParquetFile(cases_path)
    for group in range(cases.num_row_groups):
        table = cases.read_row_group(group, list(_COLUMNS))
        count = table.num_rows
        table = table.append_column("cycle", pa.array([cycle] * count, pa.string()))
        table = table.append_column(
            "reference_time", pa.array([reference] * count, SCHEMA.field("reference_time").type)
        )
        write(table.select(SCHEMA.names))
