"""Write the files of a cycle, its tables and its page, and check that they are complete."""

import csv
import json
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import shapely

from pipeline._types import FloatArray
from pipeline.errors import StageError
from pipeline.findings import names, text
from pipeline.findings.choices import flips_text
from pipeline.formats.appearance import style_colours
from pipeline.formats.gis import layers
from pipeline.machine.store import load_artefact
from pipeline.nightly import records
from pipeline.nightly.cases import NONE
from pipeline.nightly.currents import Newest
from pipeline.nightly.cycles import Partial, Row, writing
from pipeline.nightly.planning import Planning
from pipeline.nightly.worker import PLANNED, NightChart
from pipeline.texts import cell, clean

# --- tables and the map layer ---


_TIME = pa.timestamp("ms", tz="UTC")
_COUNT = pa.int64()
_TYPES = {"text": pa.string(), "number": pa.float64(), "whole": _COUNT, "time": _TIME}


def _columns(table: str) -> list[tuple[str, pa.DataType]]:
    named: list[str] = records.COLUMNS[table]
    return [(name, _TYPES[kind]) for name, kind in map(str.split, named)]


_ROUTE = [
    *((name, _TYPES[names.COLUMNS[name].type]) for name in names.figure_columns("night")),
    ("arrival", _TIME),
    ("geometry", pa.binary()),
]
CASE_SCHEMA = pa.schema([*_columns("shared"), *_columns("cases"), *_ROUTE])
"""Columns of `cases.parquet`: a case, its best route, and what changed."""
ROUTE_SCHEMA = pa.schema([*_columns("shared"), ("rank", _COUNT), *_ROUTE])
"""Columns of `routes.parquet`."""
ROUTES_FILE = "routes.parquet"
# https://geoparquet.org/releases/v1.1.0/; without a crs, coordinates are lon/lat (OGC:CRS84).
_GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["LineString"]}},
}
HISTORY_SCHEMA = pa.schema(_columns("history"))
"""Columns of `history.parquet`: a row for each case of each cycle."""
CHANGES_FILE = "changes.csv"
GEOPACKAGE_FILE = "routes.gpkg"
LAYER = {
    "title": "Routes of the night",
    "description": "The best route of each case (rank 1), and its best route on each other side; "
    "routes.parquet has all routes",
    "geometry_type": "LineString",
}
_LAYER_TEXTS = (*(name for name, _ in _columns("shared") if name != "index"), "side", "class")
# Figures of a route in the layer: those of the layer of a run.
_FIGURES = tuple(
    name
    for name in names.figure_columns("layer")
    if name in names.figure_columns("night") and names.COLUMNS[name].type == "number"
)
# Date of the layer if the currents have none.
_NO_DATE = "1970-01-01T00:00:00.000Z"


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table as GeoParquet."""
    table = table.replace_schema_metadata({b"geo": json.dumps(_GEO).encode()})
    pq.write_table(table, path, compression="zstd")


def write_history(earlier: Path | None, tonight: Iterable[Row], path: Path, newest: Newest) -> None:
    """Write the earlier history, if there is one, and tonight's cases."""
    cycle = {"cycle": newest.cycle, "reference_time": newest.time}
    with path.open("wb") as file, pq.ParquetWriter(file, HISTORY_SCHEMA, compression="zstd") as new:
        if earlier is not None:
            for batch in pq.ParquetFile(earlier).iter_batches():
                new.write_batch(batch)
        new.write_table(pa.Table.from_pylist([row | cycle for row in tonight], HISTORY_SCHEMA))


def write_changes(cases: Iterable[Row], path: Path) -> None:
    """Write the changes of a cycle; without an earlier cycle, only the header."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(records.COLUMNS["changes"])
        for row in cases:
            if row["earlier_cycle"]:
                writer.writerow([_spelled(row[column]) for column in records.COLUMNS["changes"]])


def _spelled(value: object) -> object:
    """Return a CSV value: times in ISO 8601, floats with nine digits, None as ""."""
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%dT%H:%M:%SZ")
    if isinstance(value, float):
        return f"{value:.9g}"
    return "" if value is None else cell(value)


def write_geopackage(routes: Iterable[Row], path: Path, reference: datetime | None) -> None:
    """Write the layer from a cycle's routes; its date is the currents' reference time.

    Raises OSError if the file can't be written, or is incomplete afterwards.
    """
    path.unlink(missing_ok=True)
    best: dict[tuple[int, str], Row] = {}
    for row in routes:  # the best first
        best.setdefault((row["index"], row["side"]), row)
    shown = list(best.values())
    with layers.system_errors(path):
        layers.write_layer(path, _frame(shown), "routes", LAYER)
        with layers.opened(path) as database:
            stamp = reference.strftime("%Y-%m-%dT%H:%M:%S.000Z") if reference else _NO_DATE
            database.execute("UPDATE gpkg_contents SET last_change = ?", (stamp,))
            layers.check_count(database, "routes", len(shown))


def _frame(routes: list[Row]) -> layers.GeoDataFrame:
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


# --- the page ---


PAGE_FILE = "index.html"
# Largest number of cases in the table.
_MAX_ROWS = 200
# Largest number of routes on a map.
_MAX_LINES = 40
# Width of a map's frame; its height is at most 1.4 times as large.
_WIDTH = 480.0
# Tolerance to which lines of a map are simplified, in units of its frame.
_TOLERANCE = 0.4
# Least area of an island on a map, in square units of its frame: smaller ones can't be seen.
_LEAST_AREA = 0.6


@dataclass
class ChartMap:
    """A map of one chart in a frame of `width` x `height`: land, routes, counts and currents.

    `land` is an SVG path; `west` and `north` are the frame's planar origin, in metres. Each of the
    `lines` is a route: its SVG path, its case and outcome, and whether it is yesterday's.
    """

    title: str
    width: float = _WIDTH
    height: float = 1.0
    west: float = 0.0
    north: float = 0.0
    per_metre: float = 1.0
    land: str = ""
    lines: list[Row] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    currents: dict[str, None] = field(default_factory=dict)

    @classmethod
    def of(cls, row: Row, chart: NightChart | None) -> Self:
        """Draw the land of a case's chart, without details that are too small to see."""
        vessel = "" if row["vessel"] == NONE else f", {row['vessel']}"
        if chart is None:
            return cls(f"{row['scenario']}{vessel}")
        xmin, ymin, xmax, ymax = chart.water.chart.bounds
        per_metre = _WIDTH / max(xmax - xmin, (ymax - ymin) / 1.4)
        drawn = cls(
            f"{chart.scenario.title or chart.scenario.name}{vessel}",
            (xmax - xmin) * per_metre,
            (ymax - ymin) * per_metre,
            xmin,
            ymax,
            per_metre,
        )
        land = np.array(chart.water.chart.no_go, dtype=object)
        rings = [
            shapely.get_coordinates(ring)
            for polygon in shapely.simplify(land, _TOLERANCE / per_metre)
            if polygon.area * per_metre**2 >= _LEAST_AREA
            for part in shapely.get_parts(polygon)
            for ring in (part.exterior, *part.interiors)
        ]
        drawn.land = "".join(f"{drawn.path(ring)}Z" for ring in rings)
        return drawn

    def path(self, xy: FloatArray) -> str:
        """Return points (n, 2), planar metres, as an SVG path."""
        simple = shapely.get_coordinates(
            shapely.simplify(shapely.LineString(xy), _TOLERANCE / self.per_metre)
        )
        x = (simple[:, 0] - self.west) * self.per_metre
        y = (self.north - simple[:, 1]) * self.per_metre
        points = [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]
        return f"M{'L'.join(points)}"

    def add(self, row: Row, chart: NightChart, earlier: records.EarlierRoute | None) -> None:
        """Add a case's best route and, if given, yesterday's."""
        paths = [] if earlier is None else [(earlier.path, True)]
        if row["geometry"] is not None:
            paths.insert(0, (shapely.get_coordinates(shapely.from_wkb(row["geometry"])), False))
        for lonlat, is_earlier in paths:
            line = {"case": row["case"], "outcome": row["outcome"], "is_earlier": is_earlier}
            line["path"] = self.path(chart.water.projection.to_plane(lonlat))
            self.lines.append(line)

    @property
    def drawn(self) -> list[Row]:
        """The lines in the order of drawing; cases to look at are drawn last, on top."""
        return sorted(
            self.lines,
            key=lambda line: (records.OUTCOMES.index(line["outcome"]), line["is_earlier"]),
        )


def page_text(
    newest: Newest,
    cases: Sequence[Row],
    notes: Sequence[str],
    chart_of: Callable[[int], NightChart | None],
    earlier: Mapping[str, records.EarlierRoute],
) -> str:
    """Return the page of a cycle, with the rows of its `cases`, and `notes` at its top.

    `chart_of` returns the chart of a case by its index, None if it could not be made; `earlier` are
    yesterday's routes by the case.
    """
    counts: Counter[str] = Counter(dict.fromkeys(records.OUTCOMES, 0))
    maps: dict[tuple[str, str], ChartMap] = {}
    rows: dict[str, list[Row]] = {records.ACT: [], records.LOOK: [], records.SAME: []}
    earlier_cycle, in_members = "", list[Row]()
    for row in cases:
        outcome = row["outcome"]
        counts[outcome] += 1
        earlier_cycle = row["earlier_cycle"] or earlier_cycle
        if len(rows[outcome]) < _MAX_ROWS:
            rows[outcome].append(row)
        if row["members_count"] and len(in_members) < _MAX_ROWS:
            in_members.append(_over_members(row))
        key = row["scenario"], row["vessel"]
        chart = chart_of(row["index"])
        if key not in maps:
            maps[key] = ChartMap.of(row, chart)
        chart_map = maps[key]
        chart_map.counts[outcome] += 1
        if row["source"] and len(chart_map.currents) < 4:
            chart_map.currents[f"{row['source']}, {row['currents']}"] = None
        if len(chart_map.lines) < _MAX_LINES and chart is not None:
            chart_map.add(row, chart, earlier.get(row["case"]) if outcome != records.SAME else None)
    shown = [*rows[records.ACT], *rows[records.LOOK]][:_MAX_ROWS]
    loaded = text.environment("pipeline.nightly", "pipeline.formats.report")
    loaded.filters.update({"number": text.number, "distance": text.distance})
    return loaded.get_template("night.html.jinja").render(
        cycle=newest.cycle,
        reference=f"{newest.time:%Y-%m-%d %H:%M UTC}" if newest.time else "no time",
        earlier=earlier_cycle,
        notes=notes,
        counts=counts,
        rows=shown,
        hidden=counts[records.ACT] + counts[records.LOOK] - len(shown),
        in_members=in_members,
        maps=maps.values(),
        **style_colours(),
    )


def _over_members(row: Row) -> Row:
    """Return how sure a case's side is, for the page; figures are shares of the mean fuel."""
    mean = row["members_mean_fuel"]

    def share(name: str, base: float = 0.0) -> str:
        value = row[f"members_{name}"]
        return "–" if value is None or not mean else text.at_most_percent(value / mean - base)

    return {
        "case": row["case"],
        "said": flips_text(row).removeprefix("the side flips in ").removesuffix(" members"),
        "sides": row["members_sides"],
        "mean": mean,
        "shares": {
            "P90, above the mean": share("p90_fuel", 1.0),
            "CVaR, above the mean": share("cvar90_fuel", 1.0),
            "Regret, at most": share("regret"),
            "Waiting saves": share("waiting_saves"),
            "Gap": "–" if row["members_gap"] is None else text.gap_figure(row["members_gap"]),
        },
        "left_out": row["members_left_out"],
    }


# --- all files ---


RESULTS = (
    records.CASES_FILE,
    ROUTES_FILE,
    GEOPACKAGE_FILE,
    CHANGES_FILE,
    records.HISTORY_FILE,
    PAGE_FILE,
)
"""The files of a cycle except `night.json`, which is written after the others are checked."""


def write_files(
    folder: Path, planning: Planning, history: Path | None, notes: Sequence[str]
) -> dict[str, Any]:
    """Write all files of a cycle into its unfinished folder.

    `history` is that of earlier nights; `notes` begin the cycle's page. Returns the numbers of
    cases and the planning time, s, under their names in `night.json`. Raises StageError if no case
    could be planned, or a file can't be written.
    """
    newest, partial = planning.newest, planning.partial
    rows = [row for case in planning.cases for row in partial.rows[case.index]]
    of_cases = [row for row in rows if not row["rank"]]
    routes = [row for row in rows if row["rank"]]
    counted = _counted(of_cases, partial)
    cases = pa.Table.from_pylist(of_cases, CASE_SCHEMA)
    case_rows = cases.to_pylist()  # with all columns, which the rows of some cases lack
    load = cache(lambda path: load_artefact(path, NightChart))
    with writing(folder):
        write_table(cases, folder / records.CASES_FILE)
        write_table(pa.Table.from_pylist(routes, ROUTE_SCHEMA), folder / ROUTES_FILE)
        write_changes(case_rows, folder / CHANGES_FILE)
        write_history(history, case_rows, folder / records.HISTORY_FILE, newest)
        write_geopackage(routes, folder / GEOPACKAGE_FILE, newest.time)
        page = page_text(
            newest,
            case_rows,
            notes,
            lambda index: load(planning.chart_path(planning.cases[index])),
            planning.earlier,
        )
        (folder / PAGE_FILE).write_text(page, encoding="utf-8")
    return counted


def _counted(cases: Sequence[Row], partial: Partial) -> dict[str, Any]:
    """Count the cases; StageError if none could be planned, which the next run tries again."""
    status = Counter(row["status"] for row in cases)
    if not status[PLANNED]:
        reasons = list(dict.fromkeys(row["reason"] for row in cases))
        left = len(reasons) - 3
        more = f" (and {left} other reason{'s' * (left > 1)})" if left > 0 else ""
        partial.clear()
        raise StageError(f"no case could be planned: {'; '.join(reasons[:3])}{more}")
    outcomes = Counter(row["outcome"] for row in cases)
    return {
        "cases_by_status": dict(status),
        "cases_by_outcome": {name: outcomes[name] for name in records.OUTCOMES},
        "planning_seconds": round(sum(row["seconds"] for row in cases), 3),
    }


def check_files(folder: Path, count: int) -> None:
    """Check that every case has a row, every file can be opened, and counts agree.

    Raises StageError if a check failed; the message lists all faults.
    """
    faults = []
    try:
        cases = pq.read_table(folder / records.CASES_FILE, columns=["index", "routes"])
        if cases["index"].to_pylist() != list(range(count)):
            faults.append(f"{records.CASES_FILE} has {cases.num_rows:,} rows for {count:,} cases")
        batches = pq.ParquetFile(folder / ROUTES_FILE).iter_batches()
        rows = sum(batch.num_rows for batch in batches)
        if rows != (expected := pc.sum(cases["routes"]).as_py() or 0):
            faults.append(f"{ROUTES_FILE} has {rows:,} rows for {expected:,} routes")
        pq.read_table(folder / records.HISTORY_FILE, columns=["cycle"])
        uri = f"{(folder / GEOPACKAGE_FILE).as_uri()}?mode=ro"
        with closing(sqlite3.connect(uri, uri=True)) as database:
            if database.execute("PRAGMA quick_check").fetchone()[0] != "ok":
                faults.append(f"{GEOPACKAGE_FILE} is damaged")
            database.execute("SELECT count(*) FROM routes").fetchone()
        if "</html>" not in (folder / PAGE_FILE).read_text(encoding="utf-8")[-20:]:
            faults.append(f"{PAGE_FILE} has no end")
        (folder / CHANGES_FILE).read_text(encoding="utf-8")
    except (OSError, ValueError, pa.ArrowException, sqlite3.Error) as error:
        faults.append(f"a file does not open: {clean(str(error))}")
    if faults:
        raise StageError(f"{folder.name} is incomplete: {'; '.join(faults)}; run again")
