"""The tables of a cycle: cases, routes, history and changes, and the map layer `routes.gpkg`.

Parts are read and written one by one, in the order of the cases, so that a million rows need little
memory. The first two tables are GeoParquet. Each cycle copies the history and adds its rows.
"""

import contextlib
import csv
import json
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.findings import columns
from pipeline.formats.gis import frames
from pipeline.nightly.cycle.part_files import (
    CASE_SCHEMA,
    ROUTE_SCHEMA,
    PartFile,
    Row,
    covering,
    read_part,
)
from pipeline.nightly.cycle.results import LookBack
from pipeline.nightly.request.newest_currents import cycle_time
from pipeline.texts import cell

ROUTES_FILE = "routes.parquet"
# Rows per row group: few, because a whole group is read to look up one case.
_GROUP_ROWS = 4096
# https://geoparquet.org/releases/v1.1.0/; without a crs, coordinates are lon/lat (OGC:CRS84).
_GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["LineString"]}},
}
_COLUMNS = ("case", "status", "outcome", "side", "class", "fuel", "arrival", "saving_percent")
SCHEMA = pa.schema(
    [
        ("cycle", pa.string()),
        ("reference_time", pa.timestamp("ms", tz="UTC")),
        *(CASE_SCHEMA.field(name) for name in _COLUMNS),
    ]
)
CHANGES_FILE = "changes.csv"
# fmt: off
COLUMNS = (
    "case", "outcome", "why", "earlier_cycle", "earlier_side", "side", "earlier_class", "class",
    "earlier_arrival", "keep_arrival", "arrival", "keep_fuel", "fuel", "saving_percent", "apart_m",
    "members_count", "members_flips", "members_sides", "members_mean_fuel", "members_p90_fuel",
    "members_cvar90_fuel", "members_regret", "members_waiting_saves", "members_gap",
    "status", "reason",
)
# fmt: on
"""Columns; `earlier_` is yesterday's route, `keep_` yesterday's route in tonight's current."""
GEOPACKAGE_FILE = "routes.gpkg"
LAYER = frames.Layer(
    "routes",
    title="Routes of the night",
    description="The best route of each case (rank 1), and its best route on each other side; "
    "routes.parquet has all routes",
    geometry_type="LineString",
)
_TEXT = ("case", "scenario", "season", "pair", "departure", "vessel", "member", "side", "class")
# Figures of a route in the layer: those of the layer of a run.
_FIGURES = tuple(
    name
    for name in columns.figure_columns("layer")
    if name in columns.figure_columns("night") and columns.COLUMNS[name].type == "number"
)
_CHUNK = 4096
# Date of the layer if the currents have none.
_NO_DATE = "1970-01-01T00:00:00.000Z"


def merge(parts: Sequence[PartFile], cases_path: Path, routes_path: Path) -> float:
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


def write_changes(cases_path: Path, path: Path) -> None:
    """Write the changes of a cycle; without an earlier cycle, only the header."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in rows_of(cases_path, COLUMNS):
            if row["earlier_cycle"]:
                writer.writerow([_spelled(row[column]) for column in COLUMNS])


def rows_of(path: Path, names: tuple[str, ...]) -> Iterator[Row]:
    """Yield the rows of a table; only one row group is in memory at a time."""
    file = pq.ParquetFile(path)
    for group in range(file.num_row_groups):
        yield from file.read_row_group(group, list(names)).to_pylist()


def _spelled(value: object) -> object:
    """Return a CSV value: times in ISO 8601, floats with nine digits, None as ""."""
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%dT%H:%M:%SZ")
    if isinstance(value, float):
        return f"{value:.9g}"
    return "" if value is None else cell(value)


def write_geopackage(routes_path: Path, path: Path, reference: datetime | None) -> None:
    """Write the layer from a cycle's routes; its date is the currents' reference time.

    Raises
    ------
    OSError
        The file can't be written, or is incomplete afterwards.
    """
    path.unlink(missing_ok=True)
    count = 0
    with frames.system_errors(path):
        for chunk in _chunks(routes_path):
            frames.write_layer(path, _frame(chunk), LAYER, append=count > 0)
            count += len(chunk)
        with frames.opened(path) as database:
            stamp = reference.strftime("%Y-%m-%dT%H:%M:%S.000Z") if reference else _NO_DATE
            database.execute("UPDATE gpkg_contents SET last_change = ?", (stamp,))
            frames.check_count(database, LAYER.name, count)


def _chunks(routes_path: Path) -> Iterator[list[Row]]:
    """Yield the routes of the layer in chunks: the best route of each case on each side."""
    chunk: list[Row] = []
    shown, case = set[str](), -1
    names = ("index", *_TEXT, "rank", *_FIGURES, "arrival", "geometry")
    for row in rows_of(routes_path, names):
        if row["index"] != case:
            shown, case = set(), row["index"]
        if row["side"] not in shown:
            shown.add(row["side"])
            chunk.append(row)
        if len(chunk) == _CHUNK:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _frame(chunk: list[Row]) -> frames.GeoDataFrame:
    """Return rows as a GeoDataFrame in lon/lat."""
    import geopandas

    # Without a zone: a GIS converts times with a zone to local time, and shows others unchanged.
    arrivals = [row["arrival"] and row["arrival"].replace(tzinfo=None) for row in chunk]
    return (
        geopandas.GeoDataFrame(
            chunk,
            columns=[*_TEXT, "rank", *_FIGURES],
            geometry=geopandas.GeoSeries.from_wkb([row["geometry"] for row in chunk]),
            crs="EPSG:4326",
        )
        .assign(arrival=np.array(arrivals, dtype="datetime64[ms]"))
        .astype({"rank": "int32", **dict.fromkeys(_FIGURES, float)})
    )
