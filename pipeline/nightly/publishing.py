"""Write the files of a cycle, and check that they are complete."""

import json
import sqlite3
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import shapely

from pipeline.errors import StageError
from pipeline.geo.lonlat import bounds_of
from pipeline.machine.store import load_artefact
from pipeline.nightly import records, tables
from pipeline.nightly.charts import NightChart
from pipeline.nightly.cycles import Partial, Row, writing
from pipeline.nightly.outcome import OUTCOMES
from pipeline.nightly.page import PAGE_FILE, page_text
from pipeline.nightly.planning import Planning
from pipeline.nightly.worker import PLANNED
from pipeline.texts import clean

ITEM_FILE = "item.json"
_VERSION = "1.1.0"
_PARQUET = "application/vnd.apache.parquet"
_ASSETS = {
    "cases": (
        records.CASES_FILE,
        _PARQUET,
        "One row per case: its best route, and what changed",
        ["data"],
    ),
    "routes": (tables.ROUTES_FILE, _PARQUET, "One row per route", ["data"]),
    "geopackage": (
        tables.GEOPACKAGE_FILE,
        "application/geopackage+sqlite3",
        "The best routes, for a GIS",
        ["data"],
    ),
    "changes": (
        tables.CHANGES_FILE,
        "text/csv",
        "What changed since the cycle before",
        ["metadata"],
    ),
    "history": (records.HISTORY_FILE, _PARQUET, "All cycles' cases and figures", ["metadata"]),
    "page": (PAGE_FILE, "text/html", "What to look at", ["overview"]),
}
RESULTS = (
    records.CASES_FILE,
    tables.ROUTES_FILE,
    tables.GEOPACKAGE_FILE,
    tables.CHANGES_FILE,
    records.HISTORY_FILE,
    PAGE_FILE,
    ITEM_FILE,
)
"""The files of a cycle except `night.json`, which is written after the others are checked."""


def item_text(cycle: str, moment: datetime, routes: pa.Table, counts: Mapping[str, int]) -> str:
    """Return a cycle as a static STAC item (https://stacspec.org, 1.1.0), for catalogues.

    `moment` is the time of the currents or else of the night. It is written without pystac, whose
    `Link` would turn the relative `self` into an absolute path; the tests read it with pystac.
    """
    lines = shapely.from_wkb(routes["geometry"].to_pylist())
    box = bounds_of(shapely.bounds(lines).tolist())
    item = {
        "type": "Feature",
        "stac_version": _VERSION,
        "stac_extensions": [],
        "id": cycle,
        "geometry": shapely.geometry.mapping(shapely.box(*box)),
        "bbox": list(box),
        "properties": {
            "datetime": moment.strftime("%Y-%m-%dT%H:%M:%SZ"),
            "title": f"Routes of the night {cycle}",
            **{f"renew:{outcome}": count for outcome, count in counts.items()},
        },
        "links": [{"rel": "self", "href": f"./{ITEM_FILE}", "type": "application/geo+json"}],
        "assets": {
            key: {"href": f"./{name}", "type": kind, "title": title, "roles": roles}
            for key, (name, kind, title, roles) in _ASSETS.items()
        },
    }
    return json.dumps(item, indent=2) + "\n"


def write_files(
    folder: Path, planning: Planning, look_back: records.LookBack, notes: Sequence[str]
) -> dict[str, Any]:
    """Write all files of a cycle into its unfinished folder; `notes` begin its page.

    Returns the numbers of cases and the planning time, s, under their names in `night.json`.

    Raises
    ------
    StageError
        No case could be planned, or a file can't be written.
    """
    newest, partial = planning.newest, planning.partial
    rows = [row for index in range(len(planning.cases)) for row in partial.rows[index]]
    counted = _counted(rows, partial)
    cases, routes = tables.tables_of(rows)
    case_rows, counts = cases.to_pylist(), counted["cases_by_outcome"]
    with writing(folder):
        tables.write_table(cases, folder / records.CASES_FILE)
        tables.write_table(routes, folder / tables.ROUTES_FILE)
        tables.write_changes(case_rows, folder / tables.CHANGES_FILE)
        tables.write_history(look_back, cases, folder / records.HISTORY_FILE, newest)
        routes_file = folder / tables.GEOPACKAGE_FILE
        tables.write_geopackage(routes.to_pylist(), routes_file, newest.time)
        page = page_text(newest, case_rows, notes, _charts(planning), planning.earlier)
        (folder / PAGE_FILE).write_text(page, encoding="utf-8")
        item = item_text(newest.cycle, newest.time or partial.started, routes, counts)
        (folder / ITEM_FILE).write_text(item, encoding="utf-8")
    return counted


def _counted(rows: Sequence[Row], partial: Partial) -> dict[str, Any]:
    """Count the cases; StageError if none could be planned, which the next run tries again."""
    cases = [row for row in rows if not row["rank"]]
    status = Counter(row["status"] for row in cases)
    if not status[PLANNED]:
        reasons = list(dict.fromkeys(row["reason"] for row in cases))
        more = f" (and {len(reasons) - 3} other reasons)" if len(reasons) > 3 else ""
        partial.forget_parts()
        raise StageError(f"no case could be planned: {'; '.join(reasons[:3])}{more}")
    outcomes = Counter(row["outcome"] for row in cases)
    return {
        "cases_by_status": dict(status),
        "cases_by_outcome": {name: outcomes[name] for name in OUTCOMES},
        "planning_seconds": round(sum(row["seconds"] for row in cases), 3),
    }


def _charts(planning: Planning) -> Callable[[int], NightChart | None]:
    """Return a function that loads the chart of a case; None if it could not be made."""

    @cache
    def load(path: Path) -> NightChart | None:
        return load_artefact(path, NightChart)

    return lambda index: load(planning.chart_path(planning.cases[index]))


def check_files(folder: Path, count: int) -> None:
    """Check that every case has a row, every file can be opened, and counts agree.

    Raises
    ------
    StageError
        A check failed; the message lists all faults.
    """
    if faults := _faults(folder, count):
        raise StageError(f"{folder.name} is incomplete: {'; '.join(faults)}; run again")


def _faults(folder: Path, count: int) -> list[str]:
    """Return the faults of incomplete or damaged files."""
    faults = []
    try:
        index = pq.read_table(folder / records.CASES_FILE, columns=["index", "routes"])
        if not index["index"].equals(pa.chunked_array([pa.array(range(count), pa.int64())])):
            faults.append(f"{records.CASES_FILE} has {index.num_rows:,} rows for {count:,} cases")
        routes = pq.ParquetFile(folder / tables.ROUTES_FILE)
        rows = sum(
            routes.read_row_group(group, ["rank", "geometry"]).num_rows
            for group in range(routes.num_row_groups)
        )
        if rows != (expected := pc.sum(index["routes"]).as_py() or 0):
            faults.append(f"{tables.ROUTES_FILE} has {rows:,} rows for {expected:,} routes")
        pq.read_table(folder / records.HISTORY_FILE, columns=["cycle"])
        uri = f"{(folder / tables.GEOPACKAGE_FILE).as_uri()}?mode=ro"
        with closing(sqlite3.connect(uri, uri=True)) as database:
            if database.execute("PRAGMA quick_check").fetchone()[0] != "ok":
                faults.append(f"{tables.GEOPACKAGE_FILE} is damaged")
            database.execute(f'SELECT count(*) FROM "{tables.LAYER.name}"').fetchone()  # noqa: S608 - our own name
        json.loads((folder / ITEM_FILE).read_text(encoding="utf-8"))
        if "</html>" not in (folder / PAGE_FILE).read_text(encoding="utf-8")[-20:]:
            faults.append(f"{PAGE_FILE} has no end")
        (folder / tables.CHANGES_FILE).read_text(encoding="utf-8")
    except (OSError, ValueError, pa.ArrowException, sqlite3.Error) as error:
        faults.append(f"a file does not open: {clean(str(error))}")
    return faults
