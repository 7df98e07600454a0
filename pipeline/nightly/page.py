"""`index.html` of a cycle: maps and the cases to look at, in one file that works offline."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import shapely

from pipeline.findings import text
from pipeline.findings.ensembles import flips_text
from pipeline.formats.palette import style_colours
from pipeline.nightly.charts import NightChart
from pipeline.nightly.cycles import Row
from pipeline.nightly.newest_currents import Newest
from pipeline.nightly.outcome import ACT, LOOK, OUTCOMES, SAME
from pipeline.nightly.records import EarlierRoute

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
