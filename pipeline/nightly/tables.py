"""The tables of a cycle: cases, routes, history and changes, and the map layer `routes.gpkg`.

The first two tables are GeoParquet. Each cycle copies the history and adds its rows.
"""

import contextlib
import csv
import json
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.findings import names as columns
from pipeline.formats.gis import layers as frames
from pipeline.nightly.cycles import Row
from pipeline.nightly.newest_currents import Newest, cycle_time
from pipeline.nightly.records import LookBack
from pipeline.texts import cell

_TIME = pa.timestamp("ms", tz="UTC")
_STRING = pa.string()
_NUMBER = pa.float64()
_COUNT = pa.int64()


def _fields(kind: pa.DataType, names: str) -> list[tuple[str, pa.DataType]]:
    """Return columns of one type."""
    return [(name, kind) for name in names.split()]


# Columns of both kinds of rows, cases and routes.
_SHARED = [
    ("index", _COUNT),
    *_fields(_STRING, "case scenario season pair departure vessel member"),
]
_TYPES = {"text": _STRING, "number": _NUMBER, "whole": _COUNT}
_ROUTE = [
    *((name, _TYPES[columns.COLUMNS[name].type]) for name in columns.figure_columns("night")),
    ("arrival", _TIME),
    ("geometry", pa.binary()),
]
_CASE = [
    *_fields(_STRING, "status reason outcome why"),
    ("leaves", _TIME),
    *_fields(_STRING, "currents source stand_in"),
    *_fields(_COUNT, "routes rejected"),
    *_fields(_STRING, "earlier_cycle earlier_side earlier_class"),
    ("earlier_arrival", _TIME),
    ("keep_fuel", _NUMBER),
    ("keep_arrival", _TIME),
    *_fields(_NUMBER, "saving_percent apart_m members_waiting_saves members_gap"),
    *_fields(_COUNT, "members_count members_flips"),
    *_fields(_STRING, "members_sides members_left_out"),
]
CASE_SCHEMA = pa.schema([*_SHARED, *_CASE, *_ROUTE])
"""Columns of `cases.parquet`: a case, its best route, and what changed."""
ROUTE_SCHEMA = pa.schema([*_SHARED, ("rank", _COUNT), *_ROUTE])
"""Columns of `routes.parquet`."""
ROUTES_FILE = "routes.parquet"
# Rows per row group.
_GROUP_ROWS = 4096
# https://geoparquet.org/releases/v1.1.0/; without a crs, coordinates are lon/lat (OGC:CRS84).
_GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["LineString"]}},
}
# Columns of a case that the history keeps.
_HISTORY_COLUMNS = (
    "case",
    "status",
    "outcome",
    "side",
    "class",
    "fuel",
    "arrival",
    "saving_percent",
)
HISTORY_SCHEMA = pa.schema(
    [
        ("cycle", pa.string()),
        ("reference_time", pa.timestamp("ms", tz="UTC")),
        *(CASE_SCHEMA.field(name) for name in _HISTORY_COLUMNS),
    ]
)
CHANGES_FILE = "changes.csv"
# fmt: off
CHANGES_COLUMNS = (
    "case", "outcome", "why", "earlier_cycle", "earlier_side", "side", "earlier_class", "class",
    "earlier_arrival", "keep_arrival", "arrival", "keep_fuel", "fuel", "saving_percent", "apart_m",
    "members_count", "members_flips", "members_sides", "members_mean_fuel", "members_p90_fuel",
    "members_cvar90_fuel", "members_regret", "members_waiting_saves", "members_gap",
    "status", "reason",
)
# fmt: on
"""Columns; `earlier_` is yesterday's route, `keep_` the same route in tonight's current."""
GEOPACKAGE_FILE = "routes.gpkg"
LAYER = {
    "title": "Routes of the night",
    "description": "The best route of each case (rank 1), and its best route on each other side; "
    "routes.parquet has all routes",
    "geometry_type": "LineString",
}
_LAYER_TEXTS = (
    "case",
    "scenario",
    "season",
    "pair",
    "departure",
    "vessel",
    "member",
    "side",
    "class",
)
# Figures of a route in the layer: those of the layer of a run.
_FIGURES = tuple(
    name
    for name in columns.figure_columns("layer")
    if name in columns.figure_columns("night") and columns.COLUMNS[name].type == "number"
)
# Date of the layer if the currents have none.
_NO_DATE = "1970-01-01T00:00:00.000Z"


def tables_of(rows: Iterable[Row]) -> tuple[pa.Table, pa.Table]:
    """Return the tables of cases and of routes from the rows of all cases, in their order."""
    by_kind: tuple[list[Row], list[Row]] = [], []
    for row in rows:
        by_kind[row["rank"] > 0].append(row)
    cases, routes = by_kind
    return pa.Table.from_pylist(cases, CASE_SCHEMA), pa.Table.from_pylist(routes, ROUTE_SCHEMA)


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table as GeoParquet."""
    table = table.replace_schema_metadata({b"geo": json.dumps(_GEO).encode()})
    pq.write_table(table, path, row_group_size=_GROUP_ROWS, compression="zstd")


def write_history(earlier: LookBack, tonight: pa.Table, path: Path, newest: Newest) -> None:
    """Write the earlier history, the cases of cycles that it lacks, and tonight's cases."""
    with _history_writer(path) as write:
        if earlier.history is not None:
            before = pq.ParquetFile(earlier.history)
            for group in range(before.num_row_groups):
                write(before.read_row_group(group))
        for name, cases_path in earlier.later:
            cases = pq.read_table(cases_path, columns=list(_HISTORY_COLUMNS))
            write(_with_cycle(cases, name, cycle_time(name)))
        write(_with_cycle(tonight.select(_HISTORY_COLUMNS), newest.cycle, newest.time))


@contextlib.contextmanager
def _history_writer(path: Path) -> Iterator[Callable[[pa.Table], None]]:
    """Yield a function that adds rows to the new history, in groups of _GROUP_ROWS or more."""
    waiting: list[pa.Table] = []
    with (
        path.open("wb") as file,
        pq.ParquetWriter(file, HISTORY_SCHEMA, compression="zstd") as writer,
    ):

        def flush(least: int) -> None:
            if waiting and sum(table.num_rows for table in waiting) >= least:
                writer.write_table(pa.concat_tables(waiting).cast(HISTORY_SCHEMA), _GROUP_ROWS)
                waiting.clear()

        def write(table: pa.Table) -> None:
            waiting.append(table)
            flush(_GROUP_ROWS)

        yield write
        flush(1)


def _with_cycle(cases: pa.Table, cycle: str, reference: datetime | None) -> pa.Table:
    """Return rows of the history from a cycle's cases."""
    count = cases.num_rows
    times = pa.array([reference] * count, HISTORY_SCHEMA.field("reference_time").type)
    table = cases.append_column("cycle", pa.array([cycle] * count, pa.string()))
    return table.append_column("reference_time", times).select(HISTORY_SCHEMA.names)


def write_changes(cases: Iterable[Row], path: Path) -> None:
    """Write the changes of a cycle; without an earlier cycle, only the header."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(CHANGES_COLUMNS)
        for row in cases:
            if row["earlier_cycle"]:
                writer.writerow([_spelled(row[column]) for column in CHANGES_COLUMNS])


def _spelled(value: object) -> object:
    """Return a CSV value: times in ISO 8601, floats with nine digits, None as ""."""
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%dT%H:%M:%SZ")
    if isinstance(value, float):
        return f"{value:.9g}"
    return "" if value is None else cell(value)


def write_geopackage(routes: Iterable[Row], path: Path, reference: datetime | None) -> None:
    """Write the layer from a cycle's routes; its date is the currents' reference time.

    Raises
    ------
    OSError
        The file can't be written, or is incomplete afterwards.
    """
    path.unlink(missing_ok=True)
    # The best route of each case on each side comes first.
    best = {(row["index"], row["side"]): row for row in reversed(list(routes))}
    shown = sorted(best.values(), key=lambda row: (row["index"], row["rank"]))
    with frames.system_errors(path):
        frames.write_layer(path, _frame(shown), "routes", LAYER)
        with frames.opened(path) as database:
            stamp = reference.strftime("%Y-%m-%dT%H:%M:%S.000Z") if reference else _NO_DATE
            database.execute("UPDATE gpkg_contents SET last_change = ?", (stamp,))
            frames.check_count(database, "routes", len(shown))


def _frame(routes: list[Row]) -> frames.GeoDataFrame:
    """Return rows as a GeoDataFrame in lon/lat."""
    import geopandas

    # Without a zone: a GIS converts times with a zone to local time, and shows others unchanged.
    arrivals = [row["arrival"] and row["arrival"].replace(tzinfo=None) for row in routes]
    return (
        geopandas.GeoDataFrame(
            routes,
            columns=[*_LAYER_TEXTS, "rank", *_FIGURES],
            geometry=geopandas.GeoSeries.from_wkb([row["geometry"] for row in routes]),
            crs="EPSG:4326",
        )
        .assign(arrival=np.array(arrivals, dtype="datetime64[ms]"))
        .astype({"rank": "int32", **dict.fromkeys(_FIGURES, float)})
    )
