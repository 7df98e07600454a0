"""Write the files of a cycle from its parts, and check that they are complete."""

import json
import sqlite3
from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import shapely

from pipeline.errors import StageError
from pipeline.geo.lonlat import bounds_of
from pipeline.machine.store import load_artefact
from pipeline.nightly.cycle import results
from pipeline.nightly.cycle.folders import writing
from pipeline.nightly.cycle.part_files import Row
from pipeline.nightly.outcome import OUTCOMES
from pipeline.nightly.planning.chart import NightChart
from pipeline.nightly.planning.planning import Planning
from pipeline.nightly.planning.worker import PLANNED
from pipeline.nightly.publishing import tables
from pipeline.nightly.publishing.page import PAGE_FILE, write_page
from pipeline.texts import clean

ITEM_FILE = "item.json"
_VERSION = "1.1.0"
_PARQUET = "application/vnd.apache.parquet"
_ASSETS = {
    "cases": (
        results.CASES_FILE,
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
    "history": (results.HISTORY_FILE, _PARQUET, "All cycles' cases and figures", ["metadata"]),
    "page": (PAGE_FILE, "text/html", "What to look at", ["overview"]),
}
RESULTS = (
    results.CASES_FILE,
    tables.ROUTES_FILE,
    tables.GEOPACKAGE_FILE,
    tables.CHANGES_FILE,
    results.HISTORY_FILE,
    PAGE_FILE,
    ITEM_FILE,
)
"""The files of a cycle except `night.json`, which is written after the others are checked."""


def item_text(cycle: str, moment: datetime, routes_path: Path, counts: Mapping[str, int]) -> str:
    """Return a cycle as a static STAC item (https://stacspec.org, 1.1.0), for catalogues.

    `moment` is the time of the currents or else of the night. It is written without pystac, whose
    `Link` would turn the relative `self` into an absolute path; the tests read it with pystac.
    """
    box = _bounds(routes_path)
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


def _bounds(routes_path: Path) -> tuple[float, float, float, float]:
    """Return the bounds (west, south, east, north) of all routes, degrees."""
    file = pq.ParquetFile(routes_path)
    bounds = []
    for group in range(file.num_row_groups):
        column = file.read_row_group(group, ["geometry"])["geometry"].to_pylist()
        if column:
            bounds.append(shapely.total_bounds(shapely.from_wkb(column)).tolist())
    return bounds_of(bounds)


@dataclass(frozen=True)
class Published:
    """Numbers of cases in the files by outcome and by status, and the planning time, s."""

    by_outcome: dict[str, int]
    by_status: dict[str, int]
    planning_s: float


@dataclass(frozen=True)
class Publishing:
    """Writes and checks the files of a cycle in its unfinished folder.

    `revises` is the reason why these currents are planned again, or "". `voyages` are sentences on
    vessels under way that somebody should look at.
    """

    planning: Planning
    folder: Path
    look_back: results.LookBack
    revises: str = ""
    voyages: tuple[str, ...] = ()

    def write(self) -> Published:
        """Write all files, and return the numbers of cases.

        Raises
        ------
        StageError
            No case could be planned, a part can't be read, or a file can't be written.
        """
        newest = self.planning.newest
        cases, routes = self.folder / results.CASES_FILE, self.folder / tables.ROUTES_FILE
        with writing(self.folder):
            try:
                seconds = tables.merge(self.planning.partial.parts(), cases, routes)
                published = self._counted(cases, seconds)
                tables.write_changes(cases, self.folder / tables.CHANGES_FILE)
                tables.write_history(
                    self.look_back,
                    cases,
                    self.folder / results.HISTORY_FILE,
                    newest.cycle,
                    newest.time,
                )
                tables.write_geopackage(routes, self.folder / tables.GEOPACKAGE_FILE, newest.time)
                write_page(
                    cases,
                    self.folder / PAGE_FILE,
                    newest.cycle,
                    newest.time,
                    (*filter(None, [self.revises]), *self.voyages, *self.look_back.notes),
                    self._chart,
                    self._earlier,
                )
                moment = newest.time or self.planning.partial.started
                text = item_text(newest.cycle, moment, routes, published.by_outcome)
                (self.folder / ITEM_FILE).write_text(text, encoding="utf-8")
            except pa.ArrowException as error:
                raise StageError(
                    f"a file in {self.folder} can't be read ({clean(str(error))}); run "
                    "again: damaged parts are planned again"
                ) from error
        return published

    def check(self) -> None:
        """Check that every case has a row, every file can be opened, and counts agree.

        Raises
        ------
        StageError
            A check failed; the message lists all faults.
        """
        faults = list(self._faults())
        if faults:
            raise StageError(f"{self.folder.name} is incomplete: {'; '.join(faults)}; run again")

    def _faults(self) -> list[str]:
        """Return the faults of incomplete or damaged files."""
        faults, count = [], len(self.planning.cases)
        try:
            index = pq.read_table(self.folder / results.CASES_FILE, columns=["index", "routes"])
            if not index["index"].equals(pa.chunked_array([pa.array(range(count), pa.int64())])):
                faults.append(
                    f"{results.CASES_FILE} has {index.num_rows:,} rows for {count:,} cases"
                )
            routes = pq.ParquetFile(self.folder / tables.ROUTES_FILE)
            rows = sum(
                routes.read_row_group(group, ["rank", "geometry"]).num_rows
                for group in range(routes.num_row_groups)
            )
            if rows != (expected := pc.sum(index["routes"]).as_py() or 0):
                faults.append(f"{tables.ROUTES_FILE} has {rows:,} rows for {expected:,} routes")
            pq.read_table(self.folder / results.HISTORY_FILE, columns=["cycle"])
            uri = f"{(self.folder / tables.GEOPACKAGE_FILE).as_uri()}?mode=ro"
            with closing(sqlite3.connect(uri, uri=True)) as database:
                if database.execute("PRAGMA quick_check").fetchone()[0] != "ok":
                    faults.append(f"{tables.GEOPACKAGE_FILE} is damaged")
                database.execute(f'SELECT count(*) FROM "{tables.LAYER.name}"').fetchone()  # noqa: S608 - our own name
            json.loads((self.folder / ITEM_FILE).read_text(encoding="utf-8"))
            if "</html>" not in (self.folder / PAGE_FILE).read_text(encoding="utf-8")[-20:]:
                faults.append(f"{PAGE_FILE} has no end")
            (self.folder / tables.CHANGES_FILE).read_text(encoding="utf-8")
        except (OSError, ValueError, pa.ArrowException, sqlite3.Error) as error:
            faults.append(f"a file does not open: {clean(str(error))}")
        return faults

    def _counted(self, cases: Path, seconds: float) -> Published:
        """Count the cases; raise StageError if none could be planned."""
        table = pq.read_table(cases, columns=["status", "outcome", "reason"])
        status = Counter(table["status"].to_pylist())
        if not status[PLANNED]:
            reasons = list(dict.fromkeys(table["reason"].to_pylist()))
            more = f" (and {len(reasons) - 3} other reasons)" if len(reasons) > 3 else ""
            self.planning.partial.forget_parts()
            raise StageError(f"no case could be planned: {'; '.join(reasons[:3])}{more}")
        outcome = Counter(table["outcome"].to_pylist())
        return Published({name: outcome[name] for name in OUTCOMES}, dict(status), seconds)

    def _chart(self, index: int) -> NightChart | None:
        """Return the chart of a case; None if it could not be made."""
        path = self.planning.chart_path(self.planning.cases[index])
        if path not in self._charts:
            self._charts[path] = load_artefact(path, NightChart)
        return self._charts[path]

    @cached_property
    def _charts(self) -> dict[Path, NightChart | None]:
        """Cache of the loaded charts, by path."""
        return {}

    def _earlier(self, row: Row) -> results.EarlierRoute | None:
        """Return yesterday's route of a case, or None."""
        earlier = self.planning.earlier
        place = -1 if earlier is None else earlier.row(row["case"])
        return None if earlier is None else earlier.read([place]).get(place)
