"""`report.html`: one page that works offline and loads nothing.

Its content is gathered here, from the figures of `formats.figures`, the texts of
`formats.shared.text` and the interactive map's data of `map_data`; its layout is in `templates/`.
Jinja2 escapes everything that comes from a scenario or a source. Without scripts, and on paper, the
page shows static maps; on a screen the scripts replace them by the interactive one.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from pipeline.formats.report.parts.comparison import Comparison
from pipeline.formats.report.parts.season import SeasonPart
from pipeline.formats.report.parts.unknown import Unknown
from pipeline.formats.shared import text
from pipeline.formats.shared.note_words import note_texts
from pipeline.formats.shared.palette import SEASON_COLOURS
from pipeline.formats.shared.result import RunResult
from pipeline.formats.tables.manifest import versions
from pipeline.model import Credit, Simplified
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import PlannerOptions

_FILTERS = ("number", "fuel", "hours", "days", "percent", "share", "plain", "gap_figure")


@dataclass(frozen=True)
class StandIn:
    """A season that was planned with another current than the requested one."""

    season: str
    requested: str
    current: str
    valid: str


@dataclass(frozen=True)
class Source:
    """A source and its use: land, or the currents of some seasons."""

    purpose: str
    credit: Credit


@dataclass(frozen=True)
class Report:
    """Everything that the template shows."""

    title: str
    name: str
    summary: str
    created: str
    scale: float
    is_planar: bool
    vessel: VesselSpec
    planner: PlannerOptions
    stand_ins: tuple[StandIn, ...]
    notes: tuple[str, ...]
    unknown: Unknown
    seasons: tuple[SeasonPart, ...]
    season_colours: int
    speed_labels: tuple[str, ...]
    map_json: Markup
    map_ratio: float
    comparison: tuple[Comparison, ...]
    comparison_origin: str
    polygons: int
    no_go_name: str
    land_label: str
    has_shoals: bool
    has_hazards: bool
    has_class_islands: bool
    accuracy_m: float
    simplified: Simplified
    zones: tuple[str, ...]
    zone_kinds: frozenset[str]
    sources: tuple[Source, ...]
    versions: tuple[tuple[str, str], ...]
    timings: tuple[tuple[str, float], ...]


def write_report(result: RunResult, path: Path) -> None:
    """Write the page to a new file at `path`."""
    path.write_text(render(gather(result)), encoding="utf-8")


def render(report: Report) -> str:
    """Fill in the template; everything but our own figures, scripts and styles is escaped."""
    from pipeline.formats.report.assets import content_hash, leaflet_style, script, style_colours
    from pipeline.formats.shared.templates import environment

    loaded = environment("pipeline.formats.report")
    loaded.filters.update({name: getattr(text, name) for name in _FILTERS})
    loaded.filters.update(distance=_distance, clearance=_clearance)
    template = loaded.get_template("report.html.jinja")
    return template.render(
        report=report,
        **style_colours(),
        # Files of this package, without text from elsewhere.
        script=Markup(script()),  # noqa: S704 - our own
        script_hash=content_hash(script()),
        leaflet_style=Markup(leaflet_style()),  # noqa: S704 - our own
    )


def _distance(metres: float | None) -> Markup:
    """True metres as text that the page can write in other units."""
    return _quantity("distance", text.distance(metres), metres)


def _clearance(metres: float | None) -> Markup:
    """True metres of clearance, rounded down, as text that the page can write in other units."""
    return _quantity("clearance", text.clearance(metres), metres)


def _quantity(kind: str, written: str, value: float | None) -> Markup:

    if value is None or not math.isfinite(value):
        return Markup(written)  # noqa: S704 - our own
    return Markup('<span data-{}="{}">{}</span>').format(kind, f"{value:.9g}", written)


def gather(result: RunResult) -> Report:
    """Gather the page's content."""
    from pipeline.formats.figures.maps.arrows import has_arrows, speed_scale
    from pipeline.formats.report.live_map.encode import json_for_script
    from pipeline.formats.report.live_map.map_data import map_data
    from pipeline.formats.report.parts.comparison import comparison
    from pipeline.formats.report.parts.season import season_part

    scenario, speeds = result.scenario, speed_scale(result)
    return Report(
        title=scenario.title or scenario.name,
        name=scenario.name,
        summary=scenario.description,
        created=result.created.strftime("%Y-%m-%d %H:%M UTC"),
        scale=scenario.scale,
        is_planar=scenario.is_planar,
        vessel=scenario.vessel,
        planner=scenario.planner,
        stand_ins=_stand_ins(result),
        notes=_other_notes(result),
        unknown=Unknown.of(result),
        seasons=tuple(
            season_part(result, entry, i) for i, entry in enumerate(result.plans, start=1)
        ),
        season_colours=len(SEASON_COLOURS),
        speed_labels=speeds.labels if has_arrows(result) else (),
        # JSON without characters that could end its element.
        map_json=Markup(json_for_script(map_data(result, speeds.limits))),  # noqa: S704 - our own
        map_ratio=_ratio(result.scene.chart.bounds),
        comparison=comparison(result),
        comparison_origin=scenario.published.origin if scenario.published else "",
        polygons=len(result.fetched.land.polygons),
        no_go_name=result.fetched.land.no_go_name,
        land_label=result.land_label,
        has_shoals=bool(result.shoals),
        has_hazards=bool(result.hazards),
        has_class_islands=bool(result.evaluation.class_islands),
        accuracy_m=result.fetched.land.accuracy_m,
        simplified=result.simplified,
        zones=tuple(dict.fromkeys(text.zone_text(zone) for zone, _ in result.open_zones)),
        zone_kinds=frozenset(zone.kind for zone, _ in result.open_zones),
        sources=_sources(result),
        versions=tuple(versions().items()),
        timings=tuple(result.timings.items()),
    )


def _ratio(bounds: tuple[float, float, float, float]) -> float:
    """Ratio of the interactive map's width to its height, so that the chart fills it."""
    xmin, ymin, xmax, ymax = bounds
    return min(2.5, max(0.6, (xmax - xmin) / (ymax - ymin)))


def _sources(result: RunResult) -> tuple[Source, ...]:
    """Every source with its use, land first."""
    seasons: dict[Credit, list[str]] = {}
    for grid in result.fetched.currents:
        seasons.setdefault(grid.credit, []).append(result.season_title(grid.season))
    return (
        *(Source("Land", credit) for credit in result.fetched.land.credits),
        *(Source(f"Currents, {', '.join(of)}", credit) for credit, of in seasons.items()),
    )


def _stand_ins(result: RunResult) -> tuple[StandIn, ...]:
    """Seasons whose current is not the requested one."""
    requested = {spec.name: spec.title or spec.valid for spec in result.scenario.seasons}
    return tuple(
        StandIn(
            season=result.season_title(grid.season),
            requested=requested.get(grid.season, ""),
            current=grid.credit.name,
            valid=result.valid_text(grid.season),
        )
        for grid in result.fetched.currents
        if result.is_stand_in(grid.season)
    )


def _other_notes(result: RunResult) -> tuple[str, ...]:
    """Notes of the run, without those that `_stand_ins` and `Unknown` show already."""
    shown = {*result.fetched.stand_in_notes, *result.unknowns}
    return tuple(note_texts(note for note in result.fetched.notes if note not in shown))
