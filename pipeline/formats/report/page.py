"""`report.html`: one page that works offline and loads nothing.

Its content is gathered here, from the figures of `formats.figures`, the texts of
`formats.shared.text` and the interactive map's data of `map_data`; its layout is in `templates/`.
Jinja2 escapes everything that comes from a scenario or a source. Without scripts, and on paper, the
page shows static maps; on a screen the scripts replace them by the interactive one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import shapely

from pipeline.formats.figures.palette import COLOURS, DARK
from pipeline.formats.report.unknown import Unknown
from pipeline.formats.shared import text
from pipeline.formats.shared.departure_text import departure_text
from pipeline.formats.tables.manifest import versions

if TYPE_CHECKING:
    from pathlib import Path

    from markupsafe import Markup

    from pipeline.formats.report.comparison import Comparison
    from pipeline.formats.shared.result import RankedRoute, RunResult
    from pipeline.model import Credit, RouteMetrics, SeasonPlan, Simplified
    from pipeline.scenario.model import PlannerOptions
    from pipeline.scenario.vessel import VesselSpec
    from renew import Rejected

_FILTERS = ("number", "distance", "hours", "days", "percent", "plain")


@dataclass(frozen=True)
class Row:
    """A route in a season's table.

    `excess` is its fuel above the best route's, as a share; `bar_percent` is the length of its bar,
    100 for the season's greatest excess.
    """

    metrics: RouteMetrics
    excess: float
    bar_percent: float


@dataclass(frozen=True)
class RejectedGroup:
    """Classes rejected for the same reason, and the least fuel of any of them without padding."""

    reason: str
    homotopies: tuple[str, ...]
    unpadded_fuel: float


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
class SeasonPart:
    """A season's part of the page; `best` is None if `failure` gives a reason.

    `passage` is departure and arrival of the best route, empty where no departure is given;
    `saving` says how much less fuel it needs than its rival; `picture` is the static map; `profile`
    and `padding` are plots of the best route, empty if there is nothing to plot. `departure` says
    when to leave, with a plot, where that was to be chosen.
    """

    title: str
    anchor: str
    failure: str
    current: str
    valid: str
    best: RouteMetrics | None
    passage: tuple[str, ...]
    saving: str
    verdict: tuple[str, ...]
    remarks: tuple[str, ...]
    rows: tuple[Row, ...]
    rejected: tuple[RejectedGroup, ...]
    picture: Markup
    profile: Markup
    padding: Markup
    departure: tuple[str, ...] = ()
    departure_plot: Markup | str = ""


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
    speed_labels: tuple[str, ...]
    map_json: Markup
    map_ratio: float
    comparison: tuple[Comparison, ...]
    comparison_origin: str
    polygons: int
    has_shoals: bool
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
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    from pipeline.formats.report.assets import content_hash, leaflet_style, script

    environment = Environment(
        loader=PackageLoader("pipeline.formats.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update({name: getattr(text, name) for name in _FILTERS})
    template = environment.get_template("report.html.jinja")
    return template.render(
        report=report,
        light=COLOURS,
        dark=DARK,
        # Files of this package, without text from elsewhere.
        script=Markup(script()),  # noqa: S704 - our own
        script_hash=content_hash(script()),
        leaflet_style=Markup(leaflet_style()),  # noqa: S704 - our own
    )


def gather(result: RunResult) -> Report:
    """Gather the page's content."""
    from markupsafe import Markup

    from pipeline.formats.figures.arrows import speed_scale
    from pipeline.formats.report.comparison import comparison
    from pipeline.formats.report.encode import json_for_script
    from pipeline.formats.report.map_data import map_data

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
        seasons=tuple(_season(result, entry, i) for i, entry in enumerate(result.plans, start=1)),
        speed_labels=speeds.labels,
        # JSON without characters that could end its element.
        map_json=Markup(json_for_script(map_data(result, speeds.limits))),  # noqa: S704 - our own
        map_ratio=_ratio(result.scene.chart.bounds),
        comparison=comparison(result),
        comparison_origin=scenario.published.origin if scenario.published else "",
        polygons=len(result.fetched.land.polygons),
        has_shoals=bool(result.shoals),
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
    return tuple(note for note in result.fetched.notes if note not in shown)


def _season(result: RunResult, entry: SeasonPlan, number: int) -> SeasonPart:
    """Gather a season's part."""
    from markupsafe import Markup

    from pipeline.formats.figures.season_map import season_svg

    ranked = result.season_routes(entry.season)
    metrics = [r.metrics for r in ranked]
    anchor = f"season-{number}"
    title = result.season_title(entry.season)
    picture = season_svg(
        result, entry.season, identity=anchor, label=f"Map of {title}: {_map_label(metrics)}"
    )
    profile, padding = _plots(result, ranked[0], title, anchor) if ranked else ("", "")
    passage = result.scenario.passage(entry.season, metrics[0].duration_s) if ranked else None
    return SeasonPart(
        title=title,
        anchor=anchor,
        failure=entry.failure,
        current=_current(result, entry.season),
        valid=result.valid_text(entry.season),
        best=metrics[0] if metrics else None,
        passage=tuple(map(text.moment_text, passage or ())),
        saving=_saving(metrics),
        verdict=_verdict(result, metrics),
        remarks=_remarks(result, ranked[0]) if ranked else (),
        rows=_rows(metrics),
        rejected=_rejected(result, entry),
        # The only text from elsewhere in figures is their label, which they escape.
        picture=Markup(picture),  # noqa: S704 - our own SVG
        profile=Markup(profile),  # noqa: S704 - our own
        padding=Markup(padding),  # noqa: S704 - our own
        **_departure(result, entry.season, anchor),
    )


def _departure(result: RunResult, season: str, anchor: str) -> dict[str, Any]:
    """When to leave, as text and plot; nothing where the departure was given."""
    from markupsafe import Markup

    from pipeline.formats.figures.departure_plot import departure_svg

    choice = result.departure_choice(season)
    if choice is None:
        return {}
    sentences = departure_text(choice)
    plot = departure_svg(choice, identity=f"{anchor}-departure", label=sentences[0])
    return {"departure": sentences, "departure_plot": Markup(plot)}  # noqa: S704 - our own SVG


def _verdict(result: RunResult, metrics: list[RouteMetrics]) -> tuple[str, ...]:
    """Why a season's best route was chosen, in sentences; none without a route."""
    if not metrics:
        return ()
    season, evaluation = metrics[0].season, result.evaluation
    gap, worth = evaluation.gap_shares_of(season), evaluation.clock_worth_of(season)
    return text.verdict(metrics, result.scene.vessel.speed, gap, worth)


def _plots(result: RunResult, best: RankedRoute, title: str, anchor: str) -> tuple[str, str]:
    """Plot the best route's profile, and the reach of turns at its tightest place."""
    from pipeline.formats.figures.plots import padding_svg, profile_svg

    m = best.metrics
    profile = profile_svg(
        result,
        best,
        identity=f"{anchor}-profile",
        label=f"Along the best route of {title}: fuel up to {text.number(m.fuel)}, speed over "
        f"ground, current along the course, and distance to land, at least "
        f"{text.distance(m.clearance_m)}",
    )
    padding = padding_svg(
        result,
        best,
        identity=f"{anchor}-padding",
        label=f"How far hard-over turns reach at the tightest place of the best route of {title}",
    )
    return profile, padding


def _saving(metrics: list[RouteMetrics]) -> str:
    """Say how much less fuel the best route needs than its closest rival; empty if it does not."""
    rival = text.closest_rival(metrics) if metrics else None
    if rival is None:
        return ""
    best = metrics[0]
    share = 1 - best.fuel / rival.fuel
    if share <= 0:
        return ""
    is_other = rival.main_passage != best.main_passage
    name = f"the best way {rival.main_passage}" if is_other else "the next best route"
    return f"{text.percent(share)} less fuel than {name}"


def _map_label(metrics: list[RouteMetrics]) -> str:
    """Describe a map for a screen reader."""
    if not metrics:
        return "land and currents; no route was found"
    way = f", {metrics[0].way}," if metrics[0].way else ""
    return (
        f"the best route{way} of {text.distance(metrics[0].length_m)} and "
        f"{len(metrics) - 1} other routes among land and currents"
    )


def _current(result: RunResult, season: str) -> str:
    """Name of the source of a season's current."""
    for grid in result.fetched.currents:
        if grid.season == season:
            return grid.credit.name
    return "given in the scenario" if season in result.scene.currents else "none found"


def _rows(metrics: list[RouteMetrics]) -> tuple[Row, ...]:
    """Compare each route's fuel with the best route's."""
    excesses = [row.fuel / metrics[0].fuel - 1 for row in metrics]
    largest = max([abs(e) for e in excesses], default=0.0)
    return tuple(
        Row(row, excess, 100 * abs(excess) / largest if largest > 0 else 0.0)
        for row, excess in zip(metrics, excesses, strict=True)
    )


def _rejected(result: RunResult, entry: SeasonPlan) -> tuple[RejectedGroup, ...]:
    """Group the rejected classes by reason, in order of first appearance."""
    groups: dict[str, list[Rejected]] = {}
    for rejected in entry.plan.rejected if entry.plan else ():
        groups.setdefault(result.rejection_reason(entry.season, rejected), []).append(rejected)
    return tuple(
        RejectedGroup(reason, tuple(r.homotopy for r in group), min(r.unpadded_fuel for r in group))
        for reason, group in groups.items()
    )


def _remarks(result: RunResult, best: RankedRoute) -> tuple[str, ...]:
    """Warnings about the best route: its start and goal, and areas that it passes through."""
    remarks = []
    ends = [
        name
        for name, inside in (
            ("start", best.route.starts_in_soft_no_go),
            ("goal", best.route.ends_in_soft_no_go),
        )
        if inside
    ]
    if ends:
        remarks.append(
            f"The {' and the '.join(ends)} lie{'s' if len(ends) == 1 else ''} in the soft no-go "
            "zone, as harbours do; inside it, a hard-over turn is not guaranteed to be safe."
        )
    if best.metrics.land_m > 0:
        remarks.append(
            f"{text.distance(best.metrics.land_m)} of the route lies over land, the most at "
            f"{text.place(best.metrics.land_lon, best.metrics.land_lat)}."
        )
    path = shapely.LineString(best.route.path)
    crossed = dict.fromkeys(
        text.zone_text(zone) for zone, area in result.open_zones if area.intersects(path)
    )
    if crossed:
        remarks.append(
            f"The route runs through restricted areas or traffic schemes: {'; '.join(crossed)}."
        )
    return tuple(remarks)
