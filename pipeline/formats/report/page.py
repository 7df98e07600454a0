"""`report.html`: one page that works offline and loads nothing.

Its content is gathered here; its layout is in `templates/`. Jinja2 escapes everything that comes
from a scenario or a source. Without scripts, and on paper, the page shows static maps; on a screen
the scripts replace them by the interactive one.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from pipeline._types import FloatArray
from pipeline.findings import choices, text
from pipeline.findings.haven_rows import HavenRow, haven_rows
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import DEAR, MAX_STRAITS, RankedRoute, RunCase, RunResult, addressed
from pipeline.findings.sentences import case_facts
from pipeline.findings.text import environment
from pipeline.formats import appearance, tables
from pipeline.formats.figures.chart_map import page_svg
from pipeline.formats.figures.map_marks import arrows, speed_labels, speed_limits
from pipeline.formats.figures.plots import (
    departure_figure,
    fan_figure,
    profile_figure,
    trade_off_figure,
)
from pipeline.formats.figures.season_map import case_svg
from pipeline.formats.passage import waypoints
from pipeline.formats.passage.missions import MAX_VERTICES, fence_of
from pipeline.formats.passage.waypoints import KNOTS_PER_M_S, NAUTICAL_MILE_M
from pipeline.formats.records import versions
from pipeline.formats.report.map_data import coarser, map_data, numbered_sides, place_on_map
from pipeline.geo.coast import within
from pipeline.geo.projection import position_text
from pipeline.model import Credit, CurrentGrid, RouteMetrics
from renew import Rejected

Notice = tuple[str, tuple[tuple[str, str], ...]]
"""A notice beside the answer: a title, and items, each with the title of a case and a text."""
_FILTERS = ("number", "fuel", "hours", "days", "percent", "share", "plain", "capitalised")


def write_report(result: RunResult, path: Path) -> None:
    """Write the page to a new file at `path`."""
    path.write_text(render(gather(result)), encoding="utf-8")


def render(report: dict[str, Any]) -> str:
    """Fill in the template; everything but our own figures, scripts and styles is escaped."""
    result = report["result"]
    loaded = environment("pipeline.formats.report")
    loaded.filters.update({name: getattr(text, name) for name in _FILTERS})
    quantities = {kind: partial(_quantity, kind) for kind in ("distance", "clearance")}
    loaded.filters.update(quantities, note_texts=note_texts)
    return loaded.get_template("report.html.jinja").render(
        report=report,
        result=result,
        titles=lambda seasons: [result.case(name).title for name in seasons],
        scenario=result.scenario,
        land=result.fetched.land,
        straits=[one for one in result.straits if one.way][:MAX_STRAITS],
        position_text=position_text,
        # A strait's place, for a button.
        place_on_map=lambda strait: place_on_map(
            result.water, result.water.projection.to_plane(np.array([strait.lon, strait.lat]))
        ),
        versions=versions(),
        **appearance.style_colours(),
        # Files of this package, without text from elsewhere.
        script=Markup(appearance.script()),  # noqa: S704 - our own
        script_hash=appearance.content_hash(appearance.script()),
        leaflet_style=Markup(appearance.leaflet_style()),  # noqa: S704 - our own
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
    has_current = any(len(arrows(case)[0]) for case in result.cases)
    # Decisions and unknown facts have parts of their own.
    shown = {*result.decisions, *result.unknowns, *result.narrow_notes}
    crossed = [
        (case.title, f": {_crossed(case)}")
        for case in result.cases
        if any(one.rank == 1 for one in case.measures.shore_crossings)
    ]
    narrow = [("", f"{text.capitalised(line)}.") for line in note_texts(result.narrow_notes)]
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    return {
        "result": result,
        "notices": [
            (title, items)
            for title, items in (
                ("Check the official chart: land of another shoreline on the route", crossed),
                ("No room to turn hard over", narrow),
            )
            if items
        ],
        "doubts": [(title, items) for title, items in _doubts(result) if items],
        "notes": note_texts(note for note in result.fetched.notes if note not in shown),
        "lacking": [
            one
            for one in result.routes
            if not result.scenario.is_planar
            and (one.metrics.filled_share > 0 or one.metrics.uncharted_share > 0)
        ],
        "dear": DEAR,
        "has_crossings": any(case.measures.shore_crossings for case in result.cases),
        "is_narrow": any(case.measures.narrow for case in result.cases),
        "has_near_best": any(case.measures.near_best is not None for case in result.cases),
        "is_near_land": any(
            row.adrift_share > 0 for one in result.cases for row in one.measures.routes
        ),
        "seasons": [case_section(case) for case in result.cases],
        "speed_labels": speed_labels(limits) if has_current else (),
        # JSON without characters that could end its element.
        "map_json": htmlsafe_json_dumps(
            map_data(result, limits), separators=(",", ":"), allow_nan=False
        ),
        # The interactive map's width to its height, so that the chart fills it.
        "map_ratio": min(2.5, max(0.6, (xmax - xmin) / (ymax - ymin))),
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
        *(("Wind and waves", credit) for credit in result.fetched.weather_credits),
    )


def _doubts(result: RunResult) -> Iterator[Notice]:
    """Yield the notices directly below the answer: energy, currents, other routes, decisions."""
    short = [note for note in result.unknowns if note.kind == "energy-short"]
    yield (
        "Too little on board",
        tuple(("", f"{text.capitalised(one)}.") for one in note_texts(short)),
    )
    with_grid = [case for case in result.cases if case.grid is not None]
    yield (
        "Planned with stand-in currents",
        tuple((case.title, _stand_in(case)) for case in with_grid if case.is_stand_in),
    )
    yield (
        "The current is not known",
        tuple(
            (one.title, f": {_lacking(one.source_grid)}") for one in with_grid if one.lacks_current
        ),
    )
    yield (
        "Check the official chart: land of another shoreline on other routes",
        tuple((one.title, f": {said}") for one in result.cases if (said := _crossed_beside(one))),
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
    """Say how much of a case's best route crosses land of another shoreline."""
    best = [one.length_m for one in case.measures.shore_crossings if one.rank == 1]
    places = text.count(len(best), "place", "places")
    return f"{text.distance(sum(best))} at {places}."


def _crossed_beside(case: RunCase) -> str:
    """Say how many routes cross land of another shoreline if the best does not; "" if none."""
    ranks = {one.rank for one in case.measures.shore_crossings}
    if not ranks or 1 in ranks:
        return ""
    return f"parts of {text.count(len(ranks), 'route', 'routes')}, none of the best."


# Longer side of a card's picture, in its own units.
_SIDE = 100.0
# Size of the smallest details, as a share of that side.
_DETAIL = 0.006
# Maximum number of vertices of the picture's land.
_MAX_VERTICES = 900


def case_section(case: RunCase) -> dict[str, Any]:
    """Gather what the templates show of a case; `rows` are empty if `failure` gives a reason.

    `passage` is departure and arrival of the best route, empty if no departure is given. `said`
    tells why to take this route; `profile` is a plot of it, and `tightest` a sentence on its
    tightest place. `thumbnail` and `picture` are static maps. `choices` are when to leave and how
    fast to go, if that was to be chosen; `speeds` are then the best route's lowest and highest,
    m/s.
    """
    result, ranked = case.run, case.routes
    title, anchor = case.title, f"season-{case.number + 1}"
    metrics = [r.metrics for r in ranked]
    label = f"{title}: {_map_label(metrics, result.fetched.land.no_go_name)}"
    passage = result.scenario.passage(case.name, round(metrics[0].duration_s)) if ranked else ()
    said = case_facts(case)
    rival = said.rival if said else None
    found = choices.trade_off(case)
    tightest = tables.tightest_place(ranked[0]) if ranked else None
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
        "rows": [
            row | {"side": one["side"]}
            for row, one in zip(_rows(ranked), numbered_sides(case), strict=True)
        ],
        "gap_figure": case.gap_figure,
        "current_text": case.current_text,
        "rejected": _rejected(case),
        "thumbnail": {
            **thumbnail(result, [r for r in ranked if r.metrics in (metrics[0], rival)]),
            "label": label,
        },
        "picture": case_svg(case, identity=anchor, label=f"Map of {label}"),
        "tightest": tightest and tables.tightest_text(case.case, tightest),
        "profile": _profile(ranked[0], title, anchor) if ranked else "",
        "havens": haven_section(case),
        "plan": plan_section(case),
        "choices": list(shown_choices(case)),
        "speeds": found and (found.slowest, found.fastest),
    }


def shown_choices(case: RunCase) -> Iterator[tuple[str, tuple[str, ...], Markup]]:
    """Yield title, sentences and plot of each choice: way kept, departure, speed, and side."""
    anchor, ensemble = f"season-{case.number + 1}", case.result.ensemble
    found = choices.trade_off(case)
    if case.result.replanned is not None:
        yield "Planned again under way", choices.replanned_text(case.result.replanned), Markup()
    if (choice := case.departure_choice) is not None:
        said = choices.departure_text(choice)
        plot = page_svg(departure_figure(choice), identity=f"{anchor}-departure", label=said[0])
        yield "When to leave", said, plot
    if found is not None:
        said, figure = choices.trade_off_text(found), trade_off_figure(found)
        plot = page_svg(figure, identity=f"{anchor}-trade-off", label=" ".join(said))
        yield "How fast", said, plot
    if ensemble is not None and case.routes:
        said, figure = choices.ensemble_text(case), fan_figure(ensemble, case.routes)
        yield "How sure", said, page_svg(figure, identity=f"{anchor}-fans", label=said[0])


def _profile(best: RankedRoute, title: str, anchor: str) -> Markup:
    """Plot the best route's profile."""
    m = best.metrics
    return page_svg(
        profile_figure(best),
        identity=f"{anchor}-profile",
        label=f"Along the best route of {title}: fuel up to {text.fuel(m.fuel, m)}, speed over "
        f"ground, current along the course, and distance to {m.no_go_name}, at least "
        f"{text.clearance(m.clearance_m)}",
    )


def _map_label(metrics: list[RouteMetrics], no_go: str) -> str:
    """Describe a map for a screen reader."""
    if not metrics:
        return f"{no_go} and currents; no route was found"
    way = f", {metrics[0].way}," if metrics[0].way else ""
    return (
        f"the best route{way} of {text.distance(metrics[0].length_m)} and "
        f"{text.count(len(metrics) - 1, 'other route', 'other routes')} among {no_go} and currents"
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
    one of the fuel of the shortest way, `turns_m` the greatest padding for turns, true metres.
    """
    excesses = [one.metrics.fuel / routes[0].metrics.fuel - 1 for one in routes]
    largest = max(map(abs, excesses), default=0.0)
    shortest = min(routes, key=lambda one: one.metrics.length_m, default=None)
    return [
        {
            "metrics": one.metrics,
            "excess": excess,
            "bar_percent": 100 * abs(excess) / largest if largest > 0 else 0.0,
            "of_still": one.metrics.fuel / one.metrics.still_fuel,
            "of_shortest": one.metrics.fuel / shortest.metrics.fuel,
            "turns_m": one.case.case.projection.scale * one.route.turn_padding.max(initial=0.0),
        }
        for one, excess in zip(routes, excesses, strict=True)
        if shortest
    ]


def _rejected(case: RunCase) -> list[dict[str, Any]]:
    """Group the rejected classes by reason, in order of first appearance.

    Each group has by how much the least fuel of any class, without padding, is above the best
    route's, and a place for the map, or "".
    """
    groups: dict[str, list[Rejected]] = {}
    best = case.routes[0].metrics.fuel if case.routes else math.nan
    for rejected in case.plan.rejected if case.plan else ():
        groups.setdefault(case.rejection_reason(rejected), []).append(rejected)
    return [
        {
            "reason": reason,
            "homotopies": [r.homotopy for r in group],
            "excess": min(r.unpadded_fuel for r in group) / best - 1,
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
            f"The route crosses {text.distance(best.metrics.land_m)} of {best.metrics.no_go_name}, "
            f"the most at {position_text(best.metrics.land_lon, best.metrics.land_lat)}."
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
    extent = result.water.chart.extent
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    side = max(xmax - xmin, ymax - ymin)
    scale = _SIDE / side

    def placed(points: FloatArray) -> FloatArray:
        return np.round((points - [xmin, ymax]) * [scale, -scale], 1)

    def outline(line: shapely.LineString) -> str:
        points = placed(shapely.get_coordinates(line))
        return f"{_line(points[:-1])}Z" if isinstance(line, shapely.LinearRing) else _line(points)

    land = within(np.array(result.water.land, dtype=object), extent)
    land = coarser(land, _DETAIL * side, _MAX_VERTICES)
    return {
        "width": scale * (xmax - xmin),
        "height": scale * (ymax - ymin),
        "sea": outline(extent.exterior),
        "shore": "".join(map(outline, shapely.get_rings(shapely.get_parts(land)))),
        "ways": [
            outline(shapely.simplify(shapely.LineString(one.route.path), _DETAIL * side / 2))
            for one in shown
        ],
        "start": placed(result.stops[0]),
        "goal": placed(result.stops[-1]),
    }


def _line(points: FloatArray) -> str:
    """Return points (n, 2) as the data of a path."""
    return "M" + "L".join(f"{x:g} {y:g}" for x, y in points)


def haven_section(case: RunCase) -> dict[str, Any] | None:
    """Return the sentences and rows of a case's havens; None without havens."""
    if case.coverage is None:
        return None
    return {
        "sentences": [one for one in tables.haven_facts(case) if one],
        "rows": [_haven_row(case, row) for row in haven_rows(case)],
    }


def _haven_row(case: RunCase, row: HavenRow) -> dict[str, Any]:
    """Return a row of the table as text; `place` is where the vessel turns off, for a button."""
    way, water = row.way, case.run.water
    place = None if way is None else water.projection.to_plane(way.place)
    return {
        **tables.haven_texts(row, case),
        "way": way,
        "place": "" if place is None else place_on_map(water, place),
    }


def plan_section(case: RunCase) -> dict[str, Any] | None:
    """Return sentences and table of a case's passage plan; None without a route, and in a plane."""
    if not case.routes or case.run.scenario.is_planar:
        return None
    points = waypoints.case_waypoints(case)[0]
    headings = {name: words for name, words in tables.leg_headings(points).items() if words}
    return {
        "sentences": [
            _vessel_text(points),
            _times_text(points),
            (
                "Within a leg's cross-track limits the vessel stays out of the soft no-go zone. "
                f"Legs are {points.curve.lower()}s; positions are WGS 84."
            ),
            *_autopilot_texts(case),
        ],
        "headings": list(headings.values()),
        "rows": [
            [row.get(name, "") for name in headings]
            for row in tables.rows(points, case.spec.departure)
        ],
    }


def _vessel_text(points: waypoints.Waypoints) -> str:
    """Say which vessel sails, its speed through the water, how it turns, and the way's length."""
    vessel = points.ranked.case.scenario.vessel
    name = waypoints.vessel_name(points.ranked.case.scenario)
    speeds = points.through_water_m_s[:-1] * KNOTS_PER_M_S
    through = f"{speeds.min():.2f} kn"
    if tables.has_speeds(points):
        through = f"{' to '.join(text.speed_range(speeds.min(), speeds.max()))} kn, leg by leg,"
    return (
        f"Vessel: {', '.join(filter(None, (name, f'{vessel.length_m:g} m long')))}; {through} "
        f"through the water, turns at {vessel.turn_rate_deg_s:.3g}° a second. "
        f"{points.metrics.length_m / NAUTICAL_MILE_M:.1f} NM by waypoints, "
        f"{text.speed_over_ground(points.metrics) * KNOTS_PER_M_S:.2f} kn over ground on average."
    )


def _times_text(points: waypoints.Waypoints) -> str:
    """Say when the vessel leaves and arrives, and how long the planned path takes."""
    planned_s, sailed_s = points.ranked.metrics.duration_s, points.metrics.duration_s
    case = points.ranked.case
    spec = case.spec
    texts = ["Times are since departure: none was given."]
    if spec.departure is not None:
        arrival = waypoints.time_after(spec.departure, sailed_s)
        leaves = text.moment_text(waypoints.time_after(spec.departure, 0))
        texts = [f"Departure {leaves}, arrival {text.moment_text(arrival)}."]
        choice = case.departure_choice
        by = spec.arrive_by if choice is None else choice.arrive_by
        if by is not None and text.to_minute(arrival) > text.to_minute(by):
            late = text.duration((text.to_minute(arrival) - text.to_minute(by)).total_seconds())
            texts += [f"That is {late} after {text.moment_text(by)}: leave {late} earlier."]
    if text.duration(planned_s) != text.duration(sailed_s):
        planned = text.duration(planned_s)
        texts += [
            "Times are for the legs, with the vessel heading into the cross-current;",
            f"the planned path takes {planned}.",
        ]
    return " ".join(texts)


def _autopilot_texts(case: RunCase) -> Iterator[str]:
    """Yield what the navigator has to set on an autopilot, because the mission's file can't."""
    if fence_of(case) is None:
        yield (
            f"The mission has no fence: no fence with {MAX_VERTICES} vertices or fewer was found "
            "that holds the legs and stays out of the soft no-go zone; draw one by hand."
        )
    yield (
        "On an autopilot, set Loiter or Hold, not return, for a lost link and a fence breach: a "
        "return is a straight line, whatever lies on it; Hold lets the vessel drift."
    )
