"""`index.html` of a cycle: maps and the cases to look at, in one file that works offline."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import shapely

from pipeline.findings import text
from pipeline.findings.ensembles import flips_text
from pipeline.formats.palette import style_colours
from pipeline.nightly.cycle.part_files import Row
from pipeline.nightly.cycle.results import EarlierRoute
from pipeline.nightly.outcome import ACT, LOOK, OUTCOMES, SAME
from pipeline.nightly.planning.chart import NightChart
from pipeline.nightly.publishing.tables import rows_of

PAGE_FILE = "index.html"
# Largest numbers of cases in the table, and of routes on a map.
_MAX_ROWS, _MAX_LINES = 200, 40
# fmt: off
_COLUMNS = (
    "index", "case", "scenario", "season", "vessel", "outcome", "why", "status", "reason", "side",
    "class", "earlier_class", "fuel", "keep_fuel", "saving_percent", "arrival", "earlier_arrival",
    "apart_m", "earlier_cycle", "source", "currents", "geometry", "members_count", "members_flips",
    "members_sides", "members_mean_fuel", "members_p90_fuel", "members_cvar90_fuel",
    "members_regret", "members_waiting_saves", "members_gap", "members_left_out",
)
# fmt: on


@dataclass(frozen=True)
class Line:
    """A route on a map: its SVG path, its case and outcome, and whether it is yesterday's."""

    path: str
    case: str
    outcome: str
    is_earlier: bool = False


@dataclass
class ChartMap:
    """A map of one chart with its routes, and the counts and currents of its cases."""

    title: str
    width: float
    height: float
    land: str
    lines: list[Line] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    currents: dict[str, None] = field(default_factory=dict)

    @property
    def drawn(self) -> list[Line]:
        """The lines in the order of drawing; cases to look at are drawn last, on top."""
        return sorted(self.lines, key=lambda line: (OUTCOMES.index(line.outcome), line.is_earlier))


def write_page(
    cases_path: Path,
    path: Path,
    cycle: str,
    reference: datetime | None,
    notes: Sequence[str],
    chart_of: Callable[[int], NightChart | None],
    earlier_of: Callable[[Row], EarlierRoute | None],
) -> None:
    """Write the page of a cycle.

    Parameters
    ----------
    cases_path
        The cycle's table of cases.
    reference
        Reference time of the cycle's currents.
    notes
        Sentences at the top of the page.
    chart_of
        Returns the chart of a case by its index; None if it could not be made.
    earlier_of
        Returns the route that a case had yesterday.
    """
    counts: Counter[str] = Counter(dict.fromkeys(OUTCOMES, 0))
    maps: dict[tuple[str, str], ChartMap] = {}
    rows: dict[str, list[Row]] = {ACT: [], LOOK: [], SAME: []}
    earlier_cycle, in_members = "", list[Row]()
    for row in rows_of(cases_path, _COLUMNS):
        outcome = row["outcome"]
        counts[outcome] += 1
        earlier_cycle = row["earlier_cycle"] or earlier_cycle
        if len(rows[outcome]) < _MAX_ROWS:
            rows[outcome].append({key: row[key] for key in row if key != "geometry"})
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
                _add_lines(chart_map, row, chart, earlier_of(row) if outcome != SAME else None)
    shown = [*rows[ACT], *rows[LOOK]][:_MAX_ROWS]
    loaded = text.environment("pipeline.nightly.publishing", "pipeline.formats.report")
    loaded.filters.update({"number": text.number, "distance": text.distance})
    page = loaded.get_template("night.html.jinja").render(
        cycle=cycle,
        reference=reference.strftime("%Y-%m-%d %H:%M UTC") if reference else "no time",
        earlier=earlier_cycle,
        notes=notes,
        counts=counts,
        rows=shown,
        hidden=counts[ACT] + counts[LOOK] - len(shown),
        in_members=in_members,
        maps=maps.values(),
        **style_colours(),
    )
    path.write_text(page, "utf-8")


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
    if row["geometry"] is not None:
        lonlat = shapely.get_coordinates(shapely.from_wkb(row["geometry"]))
        path = chart.small_map.path(chart.water.projection.to_plane(lonlat))
        chart_map.lines.append(Line(path, row["case"], row["outcome"]))
    if earlier is not None:
        path = chart.small_map.path(chart.water.projection.to_plane(earlier.path))
        chart_map.lines.append(Line(path, row["case"], row["outcome"], is_earlier=True))
