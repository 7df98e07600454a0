"""Write the files of a cycle, and check that they are complete; its page `index.html`."""

import json
import sqlite3
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import shapely

from pipeline.errors import StageError
from pipeline.findings import text
from pipeline.findings.choices import flips_text
from pipeline.formats.appearance import style_colours
from pipeline.geo.lonlat import bounds_of
from pipeline.machine.store import load_artefact
from pipeline.nightly import records, tables
from pipeline.nightly.charts import NightChart
from pipeline.nightly.cycles import Partial, Row, writing
from pipeline.nightly.newest_currents import Newest
from pipeline.nightly.outcome import ACT, LOOK, OUTCOMES, SAME
from pipeline.nightly.planning import Planning
from pipeline.nightly.records import EarlierRoute
from pipeline.nightly.worker import PLANNED
from pipeline.texts import clean

PAGE_FILE = "index.html"
# Largest number of cases in the table.
_MAX_ROWS = 200
# Largest number of routes on a map.
_MAX_LINES = 40


@dataclass
class ChartMap:
    """A map of one chart, and the counts and currents of its cases.

    Each of the `lines` is a route: its SVG path, its case and outcome, and whether it is
    yesterday's.
    """

    title: str
    width: float
    height: float
    land: str
    lines: list[Row] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    currents: dict[str, None] = field(default_factory=dict)

    @property
    def drawn(self) -> list[Row]:
        """The lines in the order of drawing; cases to look at are drawn last, on top."""
        return sorted(
            self.lines, key=lambda line: (OUTCOMES.index(line["outcome"]), line["is_earlier"])
        )


def page_text(
    newest: Newest,
    cases: Sequence[Row],
    notes: Sequence[str],
    chart_of: Callable[[int], NightChart | None],
    earlier: Mapping[str, EarlierRoute],
) -> str:
    """Return the page of a cycle.

    Parameters
    ----------
    newest
        The cycle's currents.
    cases
        The rows of its cases.
    notes
        Sentences at the top of the page.
    chart_of
        Returns the chart of a case by its index; None if it could not be made.
    earlier
        Yesterday's routes by the case.
    """
    counts: Counter[str] = Counter(dict.fromkeys(OUTCOMES, 0))
    maps: dict[tuple[str, str], ChartMap] = {}
    rows: dict[str, list[Row]] = {ACT: [], LOOK: [], SAME: []}
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
        if key not in maps:
            maps[key] = _map(row, chart_of(row["index"]))
        chart_map = maps[key]
        chart_map.counts[outcome] += 1
        if row["source"] and len(chart_map.currents) < 4:
            chart_map.currents[f"{row['source']}, {row['currents']}"] = None
        if len(chart_map.lines) < _MAX_LINES and chart_map.land is not None:
            chart = chart_of(row["index"])
            if chart is not None:
                _add_lines(
                    chart_map, row, chart, earlier.get(row["case"]) if outcome != SAME else None
                )
    shown = [*rows[ACT], *rows[LOOK]][:_MAX_ROWS]
    loaded = text.environment("pipeline.nightly", "pipeline.formats.report")
    loaded.filters.update({"number": text.number, "distance": text.distance})
    return loaded.get_template("night.html.jinja").render(
        cycle=newest.cycle,
        reference=f"{newest.time:%Y-%m-%d %H:%M UTC}" if newest.time else "no time",
        earlier=earlier_cycle,
        notes=notes,
        counts=counts,
        rows=shown,
        hidden=counts[ACT] + counts[LOOK] - len(shown),
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


def _map(row: Row, chart: NightChart | None) -> ChartMap:
    """Return a chart's map without routes."""
    vessel = "" if row["vessel"] == "-" else f", {row['vessel']}"
    if chart is None:
        return ChartMap(f"{row['scenario']}{vessel}", 480.0, 1.0, "")
    title = chart.scenario.title or chart.scenario.name
    small = chart.small_map
    return ChartMap(f"{title}{vessel}", small.width, small.height, small.land)


def _add_lines(
    chart_map: ChartMap, row: Row, chart: NightChart, earlier: EarlierRoute | None
) -> None:
    """Add a case's best route and, if given, yesterday's."""
    paths = [] if earlier is None else [(earlier.path, True)]
    if row["geometry"] is not None:
        paths.insert(0, (shapely.get_coordinates(shapely.from_wkb(row["geometry"])), False))
    for lonlat, is_earlier in paths:
        line = {"case": row["case"], "outcome": row["outcome"], "is_earlier": is_earlier}
        path = chart.small_map.path(chart.water.projection.to_plane(lonlat))
        chart_map.lines.append(line | {"path": path})


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
            database.execute("SELECT count(*) FROM routes").fetchone()
        json.loads((folder / ITEM_FILE).read_text(encoding="utf-8"))
        if "</html>" not in (folder / PAGE_FILE).read_text(encoding="utf-8")[-20:]:
            faults.append(f"{PAGE_FILE} has no end")
        (folder / tables.CHANGES_FILE).read_text(encoding="utf-8")
    except (OSError, ValueError, pa.ArrowException, sqlite3.Error) as error:
        faults.append(f"a file does not open: {clean(str(error))}")
    return faults
