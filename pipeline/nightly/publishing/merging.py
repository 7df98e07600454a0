"""Merge part files into a cycle's tables: `cases.parquet`, one row per case, and `routes.parquet`.

Rows are in the order of the cases, whatever the order of planning. Parts are read and written one
by one, so that a million rows need little memory. Both tables are GeoParquet.
"""

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.nightly.cycle.part import CASE_SCHEMA, ROUTE_SCHEMA, Part, covering, read_part

ROUTES_FILE = "routes.parquet"
# Rows per row group: few, because a whole group is read to look up one case.
_GROUP_ROWS = 4096
# https://geoparquet.org/releases/v1.1.0/; without a crs, coordinates are lon/lat (OGC:CRS84).
_GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["LineString"]}},
}


def merge(parts: Sequence[Part], cases_path: Path, routes_path: Path) -> float:
    """Write both tables from parts that contain every case; return the planning time, s."""
    seconds = 0.0
    with (
        table_writer(cases_path, _geographic(CASE_SCHEMA)) as write_cases,
        table_writer(routes_path, _geographic(ROUTE_SCHEMA)) as write_routes,
    ):
        for part, first, end in covering(parts):
            table = read_part(part)
            index = table["index"]
            taken = table.filter(pc.and_(pc.greater_equal(index, first), pc.less(index, end)))
            seconds += pc.sum(taken["seconds"]).as_py() or 0.0
            is_case = pc.equal(taken["rank"], 0)
            write_cases(taken.filter(is_case).select(CASE_SCHEMA.names))
            write_routes(taken.filter(pc.invert(is_case)).select(ROUTE_SCHEMA.names))
    return float(seconds)


@contextlib.contextmanager
def table_writer(path: Path, schema: pa.Schema) -> Iterator[Callable[[pa.Table], None]]:
    """Yield a function that adds rows to a new file, in groups of at most _GROUP_ROWS."""
    waiting: list[pa.Table] = []
    with path.open("wb") as file, pq.ParquetWriter(file, schema, compression="zstd") as writer:

        def flush(least: int) -> None:
            if waiting and sum(table.num_rows for table in waiting) >= least:
                writer.write_table(pa.concat_tables(waiting).cast(schema), _GROUP_ROWS)
                waiting.clear()

        def write(table: pa.Table) -> None:
            waiting.append(table)
            flush(_GROUP_ROWS)

        yield write
        flush(1)


def _geographic(schema: pa.Schema) -> pa.Schema:
    """Add the metadata of GeoParquet to a schema."""
    return schema.with_metadata({b"geo": json.dumps(_GEO).encode()})
