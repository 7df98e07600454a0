"""A season's card and section: the best route, why, its plots, all classes, the rejected ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from markupsafe import Markup, escape

from pipeline._types import FloatArray
from pipeline.formats.figures.choice_plots import departure_svg, trade_off_svg
from pipeline.formats.figures.map_marks import arrows
from pipeline.formats.figures.plots import profile_svg
from pipeline.formats.figures.season_map import season_svg
from pipeline.formats.figures.turning import padding_svg
from pipeline.formats.report.map_data import coarser, place_on_map, within
from pipeline.formats.report.sentences import SeasonFacts
from pipeline.formats.shared import departures_and_speeds, text
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.geo.lonlat import position_text
from pipeline.model import RouteMetrics, SeasonPlan
from renew import Rejected

# Longer side of the picture, in its units, and size of the smallest details, as a share of that
# side.
_SIDE, _DETAIL = 100.0, 0.006
_MAX_VERTICES = 900
# Ratio of the sides beyond which a chart is cropped around its routes.
_MAX_RATIO = 1.6


@dataclass(frozen=True)
class Row:
    """A route in a season's table.

    `excess` is its fuel above the best route's, as a share; `bar_percent` is the length of its bar,
    100 for the season's greatest excess. `of_still` is its fuel as a share of the fuel that this
    way takes in still water, `of_shortest` as a share of the shortest way's fuel.
    """

    metrics: RouteMetrics
    excess: float
    bar_percent: float
    of_still: float
    of_shortest: float


@dataclass(frozen=True)
class RejectedGroup:
    """Classes rejected for the same reason, and the least fuel of any of them without padding.

    `place` is the place for the map, or empty.
    """

    reason: str
    homotopies: tuple[str, ...]
    unpadded_fuel: float
    place: str


@dataclass(frozen=True)
class SeasonSection:
    """A season's part of the page; `rows` are empty if `failure` gives a reason.

    `passage` is departure and arrival of the best route, empty if no departure is given. `lead`
    says how much more fuel the second-best route needs, `because` why to take the best one,
    `certainty` whether the choice is proven. `thumbnail` and `picture` are static maps; `profile`
    and `padding` are plots of the best route, empty if there is nothing to plot. `departure` and
    `departure_plot` say when to leave, `how_fast` and `trade_off_plot` how fast to go, if that was
    to be chosen; `speeds` are the best route's lowest and highest, m/s.
    """

    title: str
    anchor: str
    failure: str
    current: str
    valid: str
    passage: tuple[str, ...]
    lead: str
    because: str
    certainty: str
    verdict: tuple[str, ...]
    remarks: tuple[str, ...]
    rows: tuple[Row, ...]
    rejected: tuple[RejectedGroup, ...]
    thumbnail: Markup
    picture: Markup
    profile: Markup | str
    padding: Markup | str
    departure: tuple[str, ...] = ()
    departure_plot: Markup | str = ""
    how_fast: tuple[str, ...] = ()
    trade_off_plot: Markup | str = ""
    speeds: tuple[float, float] | None = None

    @property
    def best(self) -> RouteMetrics | None:
        """The best route's figures."""
        return self.rows[0].metrics if self.rows else None


def season_section(result: RunResult, entry: SeasonPlan, number: int) -> SeasonSection:
    """Gather a season's part."""
    ranked = result.season_routes(entry.season)
    metrics = [r.metrics for r in ranked]
    anchor = f"season-{number}"
    title = result.season_title(entry.season)
    label = f"{title}: {_map_label(metrics, result.fetched.land.no_go_name)}"
    profile, padding = _plots(result, ranked[0], title, anchor) if ranked else ("", "")
    passage = result.scenario.passage(entry.season, round(metrics[0].duration_s)) if ranked else ()
    said = _sentences(result, metrics)
    rival = said.rival if said else None
    shown = [one for one in ranked if one.metrics is metrics[0] or one.metrics is rival]
    return SeasonSection(
        title=title,
        anchor=anchor,
        failure=entry.failure,
        current=_current(result, entry.season),
        valid=result.valid_text(entry.season),
        passage=tuple(map(text.moment_text, passage or ())),
        lead=said.lead() if said else "",
        because=said.because() if said else "",
        certainty=said.certainty() if said else "",
        verdict=said.verdict() if said else (),
        remarks=_remarks(result, ranked[0]) if ranked else (),
        rows=_rows(result, metrics),
        rejected=_rejected(result, entry),
        thumbnail=thumbnail(result, shown, label),
        picture=season_svg(result, entry.season, identity=anchor, label=f"Map of {label}"),
        profile=profile,
        padding=padding,
        **_departure(result, entry.season, anchor),
        **_how_fast(result, entry.season, anchor),
    )


def _departure(result: RunResult, season: str, anchor: str) -> dict[str, Any]:
    """Return when to leave, as text and plot; nothing if the departure was given."""
    choice = result.departure_choice(season)
    if choice is None:
        return {}
    sentences = departures_and_speeds.departure_text(choice)
    plot = departure_svg(choice, identity=f"{anchor}-departure", label=sentences[0])
    return {"departure": sentences, "departure_plot": plot}


def _how_fast(result: RunResult, season: str, anchor: str) -> dict[str, Any]:
    """Return how fast to go, as text and plot; nothing if the speed was given."""
    found = departures_and_speeds.trade_off(result, season)
    if found is None:
        return {}
    sentences = departures_and_speeds.trade_off_text(found)
    plot = trade_off_svg(found, identity=f"{anchor}-trade-off", label=" ".join(sentences))
    return {
        "how_fast": sentences,
        "trade_off_plot": plot,
        "speeds": (found.slowest, found.fastest),
    }


def _sentences(result: RunResult, metrics: list[RouteMetrics]) -> SeasonFacts | None:
    """Gather the facts for a season's sentences; None without a route."""
    if not metrics:
        return None
    season, evaluation = metrics[0].season, result.evaluation
    speeds = arrows(result, season).speed
    return SeasonFacts(
        metrics,
        float(speeds.mean()) if len(speeds) else 0.0,
        evaluation.gap_shares_of(season),
        evaluation.clock_worth_of(season),
        evaluation.side_bound_of(season),
        result.lacks_current(season),
    )


def _plots(
    result: RunResult, best: RankedRoute, title: str, anchor: str
) -> tuple[Markup, Markup | str]:
    """Plot the best route's profile, and the reach of turns at its tightest place."""
    m = best.metrics
    profile = profile_svg(
        result,
        best,
        identity=f"{anchor}-profile",
        label=f"Along the best route of {title}: fuel up to {text.fuel(m.fuel)}, speed over "
        f"ground, current along the course, and distance to {m.no_go_name}, at least "
        f"{text.clearance(m.clearance_m)}",
    )
    padding = padding_svg(
        result,
        best,
        identity=f"{anchor}-padding",
        label=f"How far hard-over turns reach at the tightest place of the best route of {title}",
    )
    return profile, padding


def _map_label(metrics: list[RouteMetrics], no_go: str) -> str:
    """Describe a map for a screen reader."""
    if not metrics:
        return f"{no_go} and currents; no route was found"
    way = f", {metrics[0].way}," if metrics[0].way else ""
    return (
        f"the best route{way} of {text.distance(metrics[0].length_m)} and "
        f"{len(metrics) - 1} other routes among {no_go} and currents"
    )


def _current(result: RunResult, season: str) -> str:
    """Return the name of the source of a season's current."""
    if (grid := result.grid_of(season)) is not None:
        return grid.credit.name
    return "given in the scenario" if season in result.scene.currents else "none found"


def _rows(result: RunResult, metrics: list[RouteMetrics]) -> tuple[Row, ...]:
    """Compare each route's fuel with the best route's, with still water and the shortest way."""
    if not metrics:
        return ()
    excesses = [row.fuel / metrics[0].fuel - 1 for row in metrics]
    largest = max(abs(e) for e in excesses)
    shortest = min(metrics, key=lambda row: row.length_m)
    return tuple(
        Row(
            row,
            excess,
            100 * abs(excess) / largest if largest > 0 else 0.0,
            row.fuel_per_distance / departures_and_speeds.still_fuel_per_metre(result, row),
            row.fuel / shortest.fuel,
        )
        for row, excess in zip(metrics, excesses, strict=True)
    )


def _rejected(result: RunResult, entry: SeasonPlan) -> tuple[RejectedGroup, ...]:
    """Group the rejected classes by reason, in order of first appearance."""
    groups: dict[str, list[Rejected]] = {}
    for rejected in entry.plan.rejected if entry.plan else ():
        groups.setdefault(result.rejection_reason(entry.season, rejected), []).append(rejected)
    return tuple(
        RejectedGroup(
            reason,
            tuple(r.homotopy for r in group),
            min(r.unpadded_fuel for r in group),
            # The middle of the places that the reason names.
            place_on_map(result, np.mean(named, axis=0)) if (named := group[0].text.places) else "",
        )
        for reason, group in groups.items()
    )


def _remarks(result: RunResult, best: RankedRoute) -> tuple[str, ...]:
    """Return warnings about the best route: its start and goal, and areas that it passes."""
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
            f"The route crosses {text.distance(best.metrics.land_m)} of "
            f"{best.metrics.no_go_name}, the most at "
            f"{position_text(best.metrics.land_lon, best.metrics.land_lat)}."
        )
    path = shapely.LineString(best.route.path)
    crossed = dict.fromkeys(
        (text.zone_text(zone), zone.kind == "shut")
        for zone, area in result.open_zones
        if area.intersects(path)
    )
    for is_shut, kinds in (
        (False, "restricted areas or traffic schemes"),
        (True, "areas at hours when they are not shut"),
    ):
        names = [name for name, is_area in crossed if is_area == is_shut]
        if names:
            remarks.append(f"The route runs through {kinds}: {'; '.join(names)}.")
    return tuple(remarks)


def thumbnail(result: RunResult, shown: Sequence[RankedRoute], label: str) -> Markup:
    """Return an `<svg>` element in the page's colours; the first route is in the season's colour.

    `label` says what the picture shows, and is escaped here.
    """
    frame = _frame(result, shown)
    xmin, ymin, xmax, ymax = frame
    scale = _SIDE / max(xmax - xmin, ymax - ymin)

    def placed(points: FloatArray) -> FloatArray:
        return np.round((points - [xmin, ymax]) * [scale, -scale], 1)

    box = shapely.intersection(result.scene.chart.extent, shapely.box(*frame))
    land = within(np.array(result.scene.land, dtype=object), box)
    land = coarser(land, _DETAIL * max(xmax - xmin, ymax - ymin), _MAX_VERTICES)
    rings = shapely.get_rings(shapely.get_parts(land))
    coast = "".join(_line(placed(shapely.get_coordinates(ring)[:-1])) + "Z" for ring in rings)
    detail = _DETAIL * max(xmax - xmin, ymax - ymin) / 2
    routes = [
        _line(
            placed(
                shapely.get_coordinates(
                    shapely.simplify(shapely.LineString(one.route.path), detail)
                )
            )
        )
        for one in shown
    ]
    water = _line(placed(shapely.get_coordinates(box)[:-1])) + "Z"
    start, goal = placed(result.scene.start), placed(result.scene.goal)
    width, height = scale * (xmax - xmin), scale * (ymax - ymin)
    classes = ("way", "rival")
    return Markup(  # noqa: S704 - numbers, and the label escaped
        f'<svg class="thumbnail" viewBox="0 0 {width:.1f} {height:.1f}" role="img" '
        f'aria-label="{escape(label)}"><path class="sea" d="{water}"/><path class="shore" '
        f'd="{coast}"/>'
        + "".join(
            f'<path class="{name}" d="{route}"/>'
            for name, route in reversed([*zip(classes, routes, strict=False)])
        )
        + f'<circle cx="{start[0]:g}" cy="{start[1]:g}" r="3"/>'
        f'<path class="goal" d="M{goal[0]:g} {goal[1] - 4:g}l4 4-4 4-4-4Z"/></svg>'
    )


def _frame(result: RunResult, shown: Sequence[RankedRoute]) -> tuple[float, float, float, float]:
    """Return the chart's bounds; a much longer side is cropped to what the routes need."""
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    paths = shapely.MultiLineString([shapely.LineString(one.route.path) for one in shown])
    low, high = np.array([xmin, ymin]), np.array([xmax, ymax])
    if shown:
        bounds = np.array(paths.bounds)
        size = high - low
        most = np.minimum(size, _MAX_RATIO * size.min())
        middle = (bounds[:2] + bounds[2:]) / 2
        half = np.maximum(most, 1.2 * (bounds[2:] - bounds[:2])) / 2
        low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _line(points: FloatArray) -> str:
    """Return points (n, 2) as the data of a path."""
    return "M" + "L".join(f"{x:g} {y:g}" for x, y in points)
