"""`report.html`: one page that works offline and asks for nothing outside.

Figures (numbers) are gathered here, pictures in `pictures`, words in `phrases`, the interactive
map's data in `map_data`, and the page's form stands in `templates/`; Jinja2 escapes whatever comes
from a scenario or a source. Static pictures stand in the page for everybody; the scripts put the
map in their place on a screen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import shapely

from pipeline.formats.figures.palette import COLOURS, DARK
from pipeline.formats.shared import text as phrases
from pipeline.formats.tables.manifest import versions

if TYPE_CHECKING:
    from pathlib import Path

    from markupsafe import Markup

    from pipeline.formats.report.comparison import Comparison
    from pipeline.formats.shared.result import RankedRoute, RunResult
    from pipeline.model import Credit, RouteMetrics, SeasonPlan, Simplified
    from pipeline.scenario.model import PlannerOptions, VesselSpec
    from renew import Rejected

_FILTERS = ("number", "distance", "hours", "days", "percent", "plain")


@dataclass(frozen=True)
class Row:
    """A route in a season's table.

    `excess` is its fuel above the best's, as a share; `bar_percent` the same on the scale of the
    season's dearest route.
    """

    metrics: RouteMetrics
    excess: float
    bar_percent: float


@dataclass(frozen=True)
class RejectedGroup:
    """Classes that fell away for one reason, and the least fuel that one needs with no padding."""

    reason: str
    homotopies: tuple[str, ...]
    unpadded_fuel: float


@dataclass(frozen=True)
class StandIn:
    """A season that was planned on another current than the preferred one."""

    season: str
    asked: str
    current: str
    valid: str


@dataclass(frozen=True)
class Source:
    """A source that was used, and what for: land, or the currents of some seasons."""

    purpose: str
    credit: Credit


@dataclass(frozen=True)
class SeasonPart:
    """What the page says of a season; `best` is None where `failure` says why.

    `saving` is what the best route takes less than one on another side, in words; `profile` and
    `padding` are plots of the best route, empty where there is nothing to plot.
    """

    title: str
    anchor: str
    failure: str
    current: str
    valid: str
    best: RouteMetrics | None
    saving: str
    verdict: tuple[str, ...]
    remarks: tuple[str, ...]
    rows: tuple[Row, ...]
    rejected: tuple[RejectedGroup, ...]
    picture: Markup
    profile: Markup
    padding: Markup


@dataclass(frozen=True)
class Report:
    """All that the template shows, in words and numbers."""

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
    """Fill the template in; everything but the pictures is escaped."""
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
    environment.filters.update({name: getattr(phrases, name) for name in _FILTERS})
    template = environment.get_template("report.html.jinja")
    return template.render(
        report=report,
        light=COLOURS,
        dark=DARK,
        # Files of this package, in which nobody else writes.
        script=Markup(script()),  # noqa: S704 - our own
        script_hash=content_hash(script()),
        leaflet_style=Markup(leaflet_style()),  # noqa: S704 - our own
    )


def gather(result: RunResult) -> Report:
    """Gather all that the page shows."""
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
        seasons=tuple(_season(result, entry, i) for i, entry in enumerate(result.plans, start=1)),
        speed_labels=speeds.labels,
        # JSON in which no character can end the element that it stands in.
        map_json=Markup(json_for_script(map_data(result, speeds.limits))),  # noqa: S704 - our own
        map_ratio=_ratio(result.scene.chart.bounds),
        comparison=comparison(result),
        comparison_origin=scenario.published.origin if scenario.published else "",
        polygons=len(result.fetched.land.polygons),
        has_shoals=bool(result.shoals),
        accuracy_m=result.fetched.land.accuracy_m,
        simplified=result.simplified,
        zones=tuple(dict.fromkeys(phrases.zone_words(zone) for zone, _ in result.open_zones)),
        zone_kinds=frozenset(zone.kind for zone, _ in result.open_zones),
        sources=_sources(result),
        versions=tuple(versions().items()),
        timings=tuple(result.timings.items()),
    )


def _ratio(bounds: tuple[float, float, float, float]) -> float:
    """Width of the interactive map to its height, so that the chart fills it."""
    xmin, ymin, xmax, ymax = bounds
    return min(2.5, max(0.6, (xmax - xmin) / (ymax - ymin)))


def _valid(result: RunResult, season: str) -> str:
    """Say which time the season's current stands for; empty where the source doesn't."""
    valid = next((grid.valid for grid in result.fetched.currents if grid.season == season), "")
    return f"valid {valid.replace('/', ' to ')}" if valid else ""


def _sources(result: RunResult) -> tuple[Source, ...]:
    """Every source with what it was used for: land first."""
    seasons: dict[Credit, list[str]] = {}
    for grid in result.fetched.currents:
        seasons.setdefault(grid.credit, []).append(result.season_title(grid.season))
    return (
        *(Source("Land", credit) for credit in result.fetched.land.credits),
        *(Source(f"Currents, {', '.join(of)}", credit) for credit, of in seasons.items()),
    )


def _stand_ins(result: RunResult) -> tuple[StandIn, ...]:
    """Seasons whose current is not the preferred one."""
    asked = {spec.name: spec.title or spec.valid for spec in result.scenario.seasons}
    return tuple(
        StandIn(
            season=result.season_title(grid.season),
            asked=asked.get(grid.season, ""),
            current=grid.credit.name,
            valid=_valid(result, grid.season),
        )
        for grid in result.fetched.currents
        if result.is_stand_in(grid.season)
    )


def _other_notes(result: RunResult) -> tuple[str, ...]:
    """What came up on the way, but for the names of the stand-ins, which are told already."""
    names = [credit.name for credit in result.current_credits]
    return tuple(note for note in result.fetched.notes if not any(name in note for name in names))


def _season(result: RunResult, entry: SeasonPlan, number: int) -> SeasonPart:
    """Gather a season's part."""
    from markupsafe import Markup

    from pipeline.formats.figures.figures import season_svg

    ranked = result.season_routes(entry.season)
    metrics = [r.metrics for r in ranked]
    anchor = f"season-{number}"
    title = result.season_title(entry.season)
    picture = season_svg(
        result, entry.season, identity=anchor, label=f"Map of {title}: {_spoken(metrics)}"
    )
    profile, padding = _plots(result, ranked[0], title, anchor) if ranked else ("", "")
    return SeasonPart(
        title=title,
        anchor=anchor,
        failure=entry.failure,
        current=_current(result, entry.season),
        valid=_valid(result, entry.season),
        best=metrics[0] if metrics else None,
        saving=_saving(metrics),
        verdict=phrases.verdict(metrics, result.scene.vessel.speed) if metrics else (),
        remarks=_remarks(result, ranked[0]) if ranked else (),
        rows=_rows(metrics),
        rejected=_rejected(entry),
        # What pictures return holds no text of anybody's but its label, which they escape.
        picture=Markup(picture),  # noqa: S704 - our own SVG
        profile=Markup(profile),  # noqa: S704 - our own
        padding=Markup(padding),  # noqa: S704 - our own
    )


def _plots(result: RunResult, best: RankedRoute, title: str, anchor: str) -> tuple[str, str]:
    """Draw what the best route meets on its way, and the padding at its tightest place."""
    from pipeline.formats.figures.plots import padding_svg, profile_svg

    m = best.metrics
    profile = profile_svg(
        result,
        best,
        identity=f"{anchor}-profile",
        label=f"Along the best route of {title}: fuel up to {phrases.number(m.fuel)}, speed over "
        f"ground, current along the track, and distance to land, at least "
        f"{phrases.distance(m.clearance_m)}",
    )
    padding = padding_svg(
        result,
        best,
        identity=f"{anchor}-padding",
        label=f"How far hard-over turns reach at the tightest place of the best route of {title}",
    )
    return profile, padding


def _saving(metrics: list[RouteMetrics]) -> str:
    """Say how much less fuel the best takes than the best on another side, or the next best."""
    if len(metrics) < 2:
        return ""
    best, others = metrics[0], metrics[1:]
    rival = next((m for m in others if m.side != best.side), others[0])
    share = 1 - best.fuel / rival.fuel
    if share <= 0:
        return ""
    way = f"{rival.side} about" if rival.side != best.side else "the next best way"
    return f"{phrases.percent(share)} less fuel than {way}"


def _spoken(metrics: list[RouteMetrics]) -> str:
    """Describe a map for who can't see it."""
    if not metrics:
        return "land and currents; no route was found"
    side = f", {metrics[0].side} about," if metrics[0].side else ""
    return (
        f"the best route{side} of {phrases.distance(metrics[0].length_m)} and "
        f"{len(metrics) - 1} other candidates among land and currents"
    )


def _current(result: RunResult, season: str) -> str:
    """Name the season's current."""
    for grid in result.fetched.currents:
        if grid.season == season:
            return grid.credit.name
    return "given as figures in the scenario" if season in result.scene.currents else "none found"


def _rows(metrics: list[RouteMetrics]) -> tuple[Row, ...]:
    """Set each route's fuel beside the best's."""
    excesses = [row.fuel / metrics[0].fuel - 1 for row in metrics]
    largest = max([abs(e) for e in excesses], default=0.0)
    return tuple(
        Row(row, excess, 100 * abs(excess) / largest if largest > 0 else 0.0)
        for row, excess in zip(metrics, excesses, strict=True)
    )


def _rejected(entry: SeasonPlan) -> tuple[RejectedGroup, ...]:
    """Group the classes that fell away by reason, in the order of first appearance."""
    groups: dict[str, list[Rejected]] = {}
    for rejected in entry.plan.rejected if entry.plan else ():
        groups.setdefault(rejected.reason, []).append(rejected)
    return tuple(
        RejectedGroup(reason, tuple(r.homotopy for r in group), min(r.unpadded_fuel for r in group))
        for reason, group in groups.items()
    )


def _remarks(result: RunResult, best: RankedRoute) -> tuple[str, ...]:
    """Say what the reader must know of the best route's ends, and of what it runs over."""
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
            "zone, as harbours do: within it a hard-over turn is not proven safe."
        )
    if best.metrics.land_m > 0:
        remarks.append(f"{phrases.distance(best.metrics.land_m)} of the route lies over land.")
    path = shapely.LineString(best.route.path)
    met = dict.fromkeys(
        phrases.zone_words(zone) for zone, area in result.open_zones if area.intersects(path)
    )
    if met:
        remarks.append(f"It runs through areas that the chart puts under a rule: {'; '.join(met)}.")
    return tuple(remarks)
