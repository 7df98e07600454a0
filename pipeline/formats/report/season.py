"""A case's card and section: the best route, why, its plots, all classes, the rejected ones."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from markupsafe import Markup

from pipeline._types import FloatArray
from pipeline.findings import choices, ensembles, text
from pipeline.findings.choices import replanned_text
from pipeline.findings.haven_rows import HavenRow, haven_rows
from pipeline.findings.result import RankedRoute, RunCase, RunResult
from pipeline.formats.figures.chart_map import page_svg
from pipeline.formats.figures.choice_plots import (
    departure_figure,
    fan_figure,
    share_map,
    trade_off_figure,
)
from pipeline.formats.figures.map_marks import arrows
from pipeline.formats.figures.plots import padding_figure, profile_figure, tightest_place
from pipeline.formats.figures.season_map import case_svg
from pipeline.formats.report.map_data import coarser, place_on_map, within
from pipeline.formats.report.sentences import CaseFacts
from pipeline.formats.tables import haven_facts, haven_texts
from pipeline.geo.projection import position_text
from pipeline.model import RouteMetrics
from renew import Rejected

# Longer side of a card's picture, in its own units.
_SIDE = 100.0
# Size of the smallest details, as a share of that side.
_DETAIL = 0.006
# Maximum number of vertices of the picture's land.
_MAX_VERTICES = 900
# Ratio of the sides beyond which a chart is cropped around its routes.
_MAX_RATIO = 1.6


def case_section(case: RunCase) -> dict[str, Any]:
    """Gather what the templates show of a case; `rows` are empty if `failure` gives a reason.

    `passage` is departure and arrival of the best route, empty if no departure is given; `said`
    tells why to take this route. `thumbnail` and `picture` are static maps; `profile` and `padding`
    are plots of the best route. `choices` are when to leave and how fast to go, if that was to be
    chosen; `speeds` are then the best route's lowest and highest, m/s.
    """
    result, ranked = case.run, case.routes
    title, anchor = case.title, f"season-{case.number + 1}"
    metrics = [r.metrics for r in ranked]
    label = f"{title}: {_map_label(metrics, result.fetched.land.no_go_name)}"
    passage = result.scenario.passage(case.name, round(metrics[0].duration_s)) if ranked else ()
    said = case_facts(case)
    rival = said.rival if said else None
    found = choices.trade_off(case)
    return {
        "title": title,
        "anchor": anchor,
        "failure": case.result.failure,
        "current": _current(case),
        "valid": case.valid_text,
        "passage": [text.moment_text(moment) for moment in passage or ()],
        "said": said,
        "best": said and said.best,
        "remarks": _remarks(ranked[0]) if ranked else (),
        "rows": _rows(ranked),
        "gap_figure": case.gap_figure,
        "current_text": case.current_text,
        "rejected": _rejected(case),
        "thumbnail": {
            **thumbnail(result, [r for r in ranked if r.metrics in (metrics[0], rival)]),
            "label": label,
        },
        "picture": case_svg(case, identity=anchor, label=f"Map of {label}"),
        **(_plots(ranked[0], title, anchor) if ranked else {}),
        "havens": haven_section(case),
        "choices": [
            *_choices(case, found, anchor),
            *_members(case, anchor),
        ],
        "speeds": found and (found.slowest, found.fastest),
    }


def _choices(
    case: RunCase,
    found: choices.SpeedTradeOff | None,
    anchor: str,
) -> Iterator[tuple[str, tuple[str, ...], Markup]]:
    """Yield what is kept under way, when to leave and how fast to go: title, sentences, plot."""
    if case.result.replanned is not None:
        yield "Planned again under way", replanned_text(case.result.replanned), Markup()
    choice = case.departure_choice
    if choice is not None:
        said = choices.departure_text(choice)
        figure = departure_figure(choice)
        plot = page_svg(figure, identity=f"{anchor}-departure", label=said[0])
        yield "When to leave", said, plot
    if found is not None:
        said = choices.trade_off_text(found)
        figure = trade_off_figure(found)
        plot = page_svg(figure, identity=f"{anchor}-trade-off", label=" ".join(said))
        yield "How fast", said, plot


def _members(case: RunCase, anchor: str) -> Iterator[tuple[str, tuple[str, ...], Markup]]:
    """Yield how sure the side is: sentences with the fans of fuel, and the map of best routes."""
    found, ranked = case.result.ensemble, case.routes
    if found is None or not ranked:
        return
    said = ensembles.ensemble_text(case)
    fans, drawn = fan_figure(found, ranked), share_map(case.run, found, ranked)
    yield "How sure", said, page_svg(fans, identity=f"{anchor}-fans", label=said[0])
    label = f"Map of the routes by their shares. {said[0]}"
    yield "Best in how many members", (), page_svg(drawn, identity=f"{anchor}-shares", label=label)


def case_facts(case: RunCase) -> CaseFacts | None:
    """Gather the facts for a case's sentences; None without a route."""
    if not case.routes:
        return None
    speeds = arrows(case).speed
    return CaseFacts(
        [one.metrics for one in case.routes],
        float(speeds.mean()) if len(speeds) else 0.0,
        case.measures.gap_shares,
        case.measures.clock_worth,
        case.side_bound,
        case.lacks_current,
    )


def _plots(best: RankedRoute, title: str, anchor: str) -> dict[str, Markup]:
    """Plot the best route's profile, and the reach of turns at its tightest place."""
    m = best.metrics
    profile = page_svg(
        profile_figure(best),
        identity=f"{anchor}-profile",
        label=f"Along the best route of {title}: fuel up to {text.fuel(m.fuel)}, speed over "
        f"ground, current along the course, and distance to {m.no_go_name}, at least "
        f"{text.clearance(m.clearance_m)}",
    )
    found = tightest_place(best)
    padding = page_svg(
        padding_figure(found, best.case.case.projection.scale) if found else None,
        identity=f"{anchor}-padding",
        label=f"How far hard-over turns reach at the tightest place of the best route of {title}",
    )
    return {"profile": profile, "padding": padding}


def _map_label(metrics: list[RouteMetrics], no_go: str) -> str:
    """Describe a map for a screen reader."""
    if not metrics:
        return f"{no_go} and currents; no route was found"
    way = f", {metrics[0].way}," if metrics[0].way else ""
    return (
        f"the best route{way} of {text.distance(metrics[0].length_m)} and "
        f"{len(metrics) - 1} other routes among {no_go} and currents"
    )


def _current(case: RunCase) -> str:
    """Return the name of the source of a case's current."""
    if case.grid is not None:
        return case.grid.credit.name
    return "none found" if case.planned is None else "given in the scenario"


def _rows(routes: Sequence[RankedRoute]) -> list[dict[str, Any]]:
    """Return the rows of a case's table: each route's fuel as shares of other fuels.

    `excess` is above the best route's fuel; `bar_percent` is the length of its bar, 100 for the
    greatest. `of_still` is a share of the fuel that this way takes in still water, `of_shortest`
    one of the fuel of the shortest way.
    """
    excesses = [one.metrics.fuel / routes[0].metrics.fuel - 1 for one in routes]
    largest = max(map(abs, excesses), default=0.0)
    shortest = min(routes, key=lambda one: one.metrics.length_m, default=None)
    return [
        {
            "metrics": one.metrics,
            "excess": excess,
            "bar_percent": 100 * abs(excess) / largest if largest > 0 else 0.0,
            "of_still": one.metrics.fuel_per_distance / choices.still_fuel_per_metre(one),
            "of_shortest": one.metrics.fuel / shortest.metrics.fuel,
        }
        for one, excess in zip(routes, excesses, strict=True)
        if shortest
    ]


def _rejected(case: RunCase) -> list[dict[str, Any]]:
    """Group the rejected classes by reason, in order of first appearance.

    Each group has the least fuel of any class without padding, and a place for the map, or "".
    """
    groups: dict[str, list[Rejected]] = {}
    for rejected in case.plan.rejected if case.plan else ():
        groups.setdefault(case.rejection_reason(rejected), []).append(rejected)
    return [
        {
            "reason": reason,
            "homotopies": [r.homotopy for r in group],
            "unpadded_fuel": min(r.unpadded_fuel for r in group),
            # The middle of the places that the reason names.
            "place": place_on_map(case.run.water, np.mean(named, axis=0))
            if (named := group[0].text.places)
            else "",
        }
        for reason, group in groups.items()
    ]


def _remarks(best: RankedRoute) -> tuple[str, ...]:
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
            "zone, as harbours do; planning simulates no hard-over turn around there."
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
        for zone, area in best.case.run.open_zones
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


def thumbnail(result: RunResult, shown: Sequence[RankedRoute]) -> dict[str, Any]:
    """Return the sizes, outlines and places of a small map: the best route, and its rival."""
    frame = _frame(result, shown)
    xmin, ymin, xmax, ymax = frame
    side = max(xmax - xmin, ymax - ymin)
    scale = _SIDE / side

    def placed(points: FloatArray) -> FloatArray:
        return np.round((points - [xmin, ymax]) * [scale, -scale], 1)

    def outline(line: shapely.LineString) -> str:
        points = placed(shapely.get_coordinates(line))
        return f"{_line(points[:-1])}Z" if isinstance(line, shapely.LinearRing) else _line(points)

    box = shapely.intersection(result.water.chart.extent, shapely.box(*frame))
    land = within(np.array(result.water.land, dtype=object), box)
    land = coarser(land, _DETAIL * side, _MAX_VERTICES)
    return {
        "width": scale * (xmax - xmin),
        "height": scale * (ymax - ymin),
        "sea": outline(box.exterior),
        "shore": "".join(map(outline, shapely.get_rings(shapely.get_parts(land)))),
        "ways": [
            outline(shapely.simplify(shapely.LineString(one.route.path), _DETAIL * side / 2))
            for one in shown
        ],
        "start": placed(result.stops[0]),
        "goal": placed(result.stops[-1]),
    }


def _frame(result: RunResult, shown: Sequence[RankedRoute]) -> tuple[float, float, float, float]:
    """Return the chart's bounds; a much longer side is cropped to what the routes need."""
    xmin, ymin, xmax, ymax = result.water.chart.bounds
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


def haven_section(case: RunCase) -> dict[str, Any] | None:
    """Return the sentences and rows of a case's havens; None without havens."""
    if case.coverage is None:
        return None
    return {
        "sentences": [one for one in haven_facts(case) if one],
        "rows": [_haven_row(case, row) for row in haven_rows(case)],
    }


def _haven_row(case: RunCase, row: HavenRow) -> dict[str, Any]:
    """Return a row of the table as text; `place` is where the vessel turns off, for a button."""
    way, water = row.way, case.run.water
    place = None if way is None else water.projection.to_plane(way.place)
    return {
        **haven_texts(row, case.spec.departure),
        "way": way,
        "place": "" if place is None else place_on_map(water, place),
    }
