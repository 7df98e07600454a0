"""`report.html`: one page that works offline and loads nothing.

Its content is gathered here; its layout is in `templates/`. Jinja2 escapes everything that comes
from a scenario or a source. Without scripts, and on paper, the page shows static maps; on a screen
the scripts replace them by the interactive one.
"""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.findings import text
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import MAX_STRAITS, RunCase, RunResult, addressed
from pipeline.findings.text import environment
from pipeline.formats.figures.map_marks import has_arrows, speed_labels, speed_limits
from pipeline.formats.palette import style_colours
from pipeline.formats.records import versions
from pipeline.formats.report import assets
from pipeline.formats.report.map_data import json_for_script, map_data, place_on_map
from pipeline.formats.report.season import case_section
from pipeline.geo.projection import position_text
from pipeline.model import Credit, CurrentGrid

Notice = tuple[str, tuple[tuple[str, str], ...]]
"""What a reader must know of the answer: a title, and items that are each about a season."""
_FILTERS = (
    *("number", "fuel", "hours", "days", "percent", "share", "plain"),
    "capitalised",
)


def write_report(result: RunResult, path: Path) -> None:
    """Write the page to a new file at `path`."""
    path.write_text(render(gather(result)), encoding="utf-8")


def render(report: dict[str, Any]) -> str:
    """Fill in the template; everything but our own figures, scripts and styles is escaped."""
    result = report["result"]
    loaded = environment("pipeline.formats.report")
    loaded.filters.update({name: getattr(text, name) for name in _FILTERS})
    loaded.filters.update({kind: partial(_quantity, kind) for kind in ("distance", "clearance")})
    loaded.filters.update(note_texts=note_texts, season_title=lambda name: result.case(name).title)
    return loaded.get_template("report.html.jinja").render(
        report=report,
        result=result,
        scenario=result.scenario,
        land=result.fetched.land,
        straits=result.straits[:MAX_STRAITS],
        position_text=position_text,
        # A strait's place, for a button.
        place_on_map=lambda strait: place_on_map(
            result.water, result.water.projection.to_plane(np.array([strait.lon, strait.lat]))
        ),
        versions=versions(),
        **style_colours(),
        # Files of this package, without text from elsewhere.
        script=Markup(assets.script()),  # noqa: S704 - our own
        script_hash=assets.content_hash(assets.script()),
        leaflet_style=Markup(assets.leaflet_style()),  # noqa: S704 - our own
    )


def _quantity(kind: str, value: float | None) -> Markup:
    """Write a distance or clearance, true metres, as text that the page can turn to other units."""
    written = getattr(text, kind)(value)
    if value is None or not math.isfinite(value):
        return Markup(written)  # noqa: S704 - our own
    return Markup('<span data-{}="{}">{}</span>').format(kind, f"{value:.9g}", written)


def gather(result: RunResult) -> dict[str, Any]:
    """Gather what the templates show of a run, besides the run's own figures.

    On the routes in `lacking`, current or depths are not known everywhere.
    """
    limits = speed_limits(result)
    # Decisions and unknown facts have parts of their own.
    shown = {*result.decisions, *result.unknowns}
    crossed = [
        (case.title, f": {_crossed(case)}")
        for case in result.cases
        if case.measures.shore_crossings
    ]
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    return {
        "result": result,
        "notices": [("Land of another shoreline on the route", crossed)] if crossed else [],
        "doubts": [(title, items) for title, items in _doubts(result) if items],
        "notes": note_texts(note for note in result.fetched.notes if note not in shown),
        "lacking": [
            one
            for one in result.routes
            if not result.scenario.is_planar
            and (one.metrics.filled_share > 0 or one.metrics.uncharted_share > 0)
        ],
        "has_crossings": bool(crossed),
        "seasons": [case_section(case) for case in result.cases],
        "speed_labels": speed_labels(limits) if has_arrows(result) else (),
        # JSON without characters that could end its element.
        "map_json": Markup(json_for_script(map_data(result, limits))),  # noqa: S704 - our own
        # The interactive map's width to its height, so that the chart fills it.
        "map_ratio": min(2.5, max(0.6, (xmax - xmin) / (ymax - ymin))),
        "comparison": comparison(result),
        "zones": list(dict.fromkeys(text.zone_text(zone) for zone, _ in result.open_zones)),
        "sources": _sources(result),
    }


def _sources(result: RunResult) -> tuple[tuple[str, Credit], ...]:
    """Return every source with its use, land first."""
    titles: dict[Credit, list[str]] = {}
    for case in result.cases:
        if case.grid is not None:
            titles.setdefault(case.grid.credit, []).append(case.title)
    return (
        *(("Land", credit) for credit in result.fetched.land.credits),
        *((f"Currents, {', '.join(of)}", credit) for credit, of in titles.items()),
    )


def _doubts(result: RunResult) -> Iterator[Notice]:
    """Yield the notices directly below the answer: doubtful currents, and what was decided."""
    with_grid = [case for case in result.cases if case.grid is not None]
    yield (
        "Planned with stand-in currents",
        tuple((case.title, _stand_in(case)) for case in with_grid if case.is_stand_in),
    )
    yield (
        "The current is not known",
        tuple(
            (case.title, f": {_lacking(case.source_grid)}")
            for case in with_grid
            if case.lacks_current
        ),
    )
    stand_ins = addressed(result.fetched.stand_in_notes, result.scenario)
    told = {*stand_ins, *(note for note in result.decisions if note.kind == "current-used")}
    others = [note for note in result.decisions if note not in told]
    yield "What was decided", tuple(("", f"{text.capitalised(one)}.") for one in note_texts(others))


def _stand_in(case: RunCase) -> str:
    """Say which current stands in for the requested one."""
    requested, valid = case.spec.title or case.spec.valid, case.valid_text
    asked = f", requested for {requested}" if requested else ""
    return f"{asked}: {case.source_grid.credit.name}{f', {valid}' if valid else ''}"


def _lacking(grid: CurrentGrid) -> str:
    """Say why a current is not known."""
    if grid.is_left_out:
        return "planned without a current. Fuel, times and bounds are those of still water."
    return (
        f"{grid.credit.name} has no values anywhere on the best route. The current was filled "
        "from the water around; nothing is proven for the real one."
    )


def _crossed(case: RunCase) -> str:
    """Say how much of a case's best route, or of others, crosses land of another shoreline."""
    crossings = case.measures.shore_crossings
    best = [one.length_m for one in crossings if one.rank == 1]
    check = "Check the official chart there: the places are on the map and below."
    if best:
        places = text.count(len(best), "place", "places")
        return f"{text.distance(sum(best))} of the best route, at {places}. {check}"
    routes = text.count(len({one.rank for one in crossings}), "other route", "other routes")
    return f"none of the best route, but parts of {routes}. {check}"


def comparison(result: RunResult) -> tuple[dict[str, Any], ...]:
    """Return each case's best route, followed by the published routes of its season.

    `fuel` and `length` are in the scaled units of the route's own planner, `length_m` and
    `clearance_m` true metres; unknown figures are None.
    """
    published = result.scenario.published
    if published is None:
        return ()
    rows = []
    titles = {case.name: case.title for case in result.cases}
    for case in result.cases:
        for ranked in case.routes[:1]:
            metrics = ranked.metrics
            rows.append(
                {
                    "season": case.title,
                    "planner": "This run",
                    "is_ours": True,
                    "scale": result.scenario.scale,
                    "way": metrics.main_passage,
                    "fuel_per_distance": metrics.fuel_per_distance,
                    "fuel": metrics.fuel,
                    "length": metrics.length,
                    "length_m": metrics.length_m,
                    "clearance_m": metrics.clearance_m,
                }
            )
        rows += [
            {
                "season": titles.get(row.season, row.season),
                "planner": row.label,
                "is_ours": False,
                "scale": published.scale,
                "way": row.side,
                # F/D as published, or from fuel and length.
                "fuel_per_distance": row.fuel / row.length
                if row.fuel_per_distance is None and row.fuel is not None and row.length is not None
                else row.fuel_per_distance,
                "fuel": row.fuel,
                "length": row.length,
                "length_m": None if row.length is None else row.length * published.scale,
                "clearance_m": None if row.clearance is None else row.clearance * published.scale,
            }
            for row in published.rows
            if row.season == case.name or (not row.season and not case.number)
        ]
    return tuple(rows)
