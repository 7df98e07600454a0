"""`passage-plan.pdf`: the best route of each case for a navigator's files, to print on A4."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunCase, RunResult, has_all_depths, narrow_notes, sea_notes
from pipeline.findings.text import (
    capitalised,
    duration,
    moment_text,
    speed_over_ground,
    speed_range,
    to_minute,
    turns_text,
)
from pipeline.formats import tables
from pipeline.formats.appearance import COLOURS, season_colour
from pipeline.formats.figures.chart_map import axes_at, drawable, patch, stroke
from pipeline.formats.figures.season_map import DETAIL_PT, visible
from pipeline.formats.passage import waypoints
from pipeline.formats.passage.missions import MAX_VERTICES, autopilot

# Width of a page, A4 landscape, points.
_WIDTH = 841.9
# Height of a page, points.
_HEIGHT = 595.3
# Margin of a page, points.
_MARGIN = 36.0
# Upper edge of the page's foot, points from the paper's lower edge.
_FOOT = 20.0
# Height of a line of text.
_LINE_PT = 11.0
# Height of a row of the table.
_ROW_PT = 15.0
# Space between paragraphs, in lines.
_BETWEEN = 0.3
# Size of headings, notes and the page's foot, points.
_SMALL = 7.0
# Size of facts and cells, points.
_PLAIN = 8.0
# Size of the title, points.
_LARGE = 15.0
# Widths of the table's columns, points; columns without a heading are left out. Height of headings.
_COLUMNS = (50, 62, 68, 34, 32, 30, 54, 80, 42, 56, 64, 46, 56, 138)
_HEADINGS_PT = 28.0
_HAVEN_COLUMNS = (80, 76, 80, 100, 76, 62, 68, 40, 40, 52, 52, 44)
# Size of the map on a case's first page, points.
_MAP_PT = (250.0, 160.0)
# Margin of the map, as a share of the route's extent.
_MAP_MARGIN = 0.06
# Characters of a line across the page.
_WIDE = 190
# Characters of a line beside the map.
_BESIDE_MAP = 123
# Space above the notes, points.
_NOTES_GAP_PT = 14.0


def write_passage_plan(result: RunResult, path: Path) -> None:
    """Write the passage plan of every case that has a route."""
    about = {
        "Title": drawable(f"Passage plan: {result.scenario.title or result.scenario.name}", 120),
        "Author": "RENEW",
        "CreationDate": result.created,
    }
    with path.open("wb") as file, PdfPages(file, metadata=about) as pages:
        for case in result.cases:
            if case.routes:
                for page in _case_pages(case):
                    pages.savefig(page)
            if case.coverage is not None:
                for page in _haven_pages(case):
                    pages.savefig(page)


def _case_pages(case: RunCase) -> Iterator[Figure]:
    """Yield the pages of a case: facts, map and table first, then the rest of the table."""
    result, points = case.run, waypoints.case_waypoints(case)[0]
    table = tables.rows(points, case.spec.departure)
    caveats = waypoints.limits_text(points.ranked)
    relied_on = note_texts([note for note in result.fetched.notes if note.kind == "tide-relied-on"])
    facts = _wrapped(_facts(points), _BESIDE_MAP)
    texts = [
        f"Mind: {caveats}" if caveats else "",
        f"Tide: {'; '.join(relied_on)}." if relied_on else "",
        " ".join(_autopilot_texts(case)),
        f"Sources: {waypoints.attribution(result)}.",
        "Not for navigation without the official charts and the navigator's own judgement.",
    ]
    notes = _wrapped(texts, _WIDE)
    top = _HEIGHT - _MARGIN - 30
    below = top - max(_height(facts), _MAP_PT[1]) - 4
    pages = list(_paged(table, below, top, _NOTES_GAP_PT + _height(notes)))
    for number, part in enumerate(pages, start=1):
        page = _page(points, f"page {number} of {len(pages)}")
        if number == 1:
            _paragraphs(page, facts, top)
            _put_map(page, points, top + 6)
        end = _put_table(
            page, tables.leg_headings(points), _COLUMNS, part, below if number == 1 else top
        )
        if number == len(pages):
            _paragraphs(page, notes, end - _NOTES_GAP_PT, size=_SMALL)
        yield page


def _haven_pages(case: RunCase) -> Iterator[Figure]:
    """Yield the pages of a case's ways to havens: what is covered, where and when to turn off."""
    points = waypoints.case_waypoints(case)[0]
    facts = _wrapped(tables.haven_facts(case), _WIDE)
    top = _HEIGHT - _MARGIN - 30
    below = top - _height(facts) - _NOTES_GAP_PT
    pages = list(_paged(tables.printed_rows(case), below, top, 0.0))
    headings = tables.PRINTED | ({} if points.ranked.metrics.energy else {"fuel": ""})
    for number, part in enumerate(pages, start=1):
        page = _page(points, f"ways to havens, page {number} of {len(pages)}")
        if number == 1:
            _paragraphs(page, facts, top)
        level = below if number == 1 else top
        _put_table(page, headings, _HAVEN_COLUMNS, part, level)
        yield page


def _paged(
    table: list[dict[str, str]], first_top: float, top: float, notes_pt: float
) -> Iterator[list[dict[str, str]]]:
    """Yield the rows of each page, whose tables begin at `first_top` and then at `top`, points.

    The last page keeps room for the notes.
    """
    while table:
        room = first_top - _HEADINGS_PT - _FOOT
        fits = len(table) * _ROW_PT + notes_pt <= room
        count = len(table) if fits else min(int(room / _ROW_PT), len(table) - 1)
        yield table[:count]
        table, first_top = table[count:], top


def _page(points: waypoints.Waypoints, number: str) -> Figure:
    """Start a page with its title and foot."""
    page = Figure(figsize=(_WIDTH / 72, _HEIGHT / 72))
    title = f"Passage plan: {waypoints.document_title(points.ranked.case)}"
    _write(page, drawable(title, 90), (_MARGIN, _HEIGHT - _MARGIN - 6), _LARGE, bold=True)
    created = points.ranked.case.run.created
    foot = f"{waypoints.route_name(points.ranked)} · made {created:%Y-%m-%d %H:%M} UTC"
    _write(page, drawable(foot, 120), (_MARGIN, _FOOT), _SMALL)
    _write(page, number, (_WIDTH - _MARGIN, _FOOT), _SMALL, right=True)
    return page


def _facts(points: waypoints.Waypoints) -> list[str]:
    """Return facts of the route, a paragraph each."""
    case = points.ranked.case
    planned, sailed, vessel = points.ranked.metrics, points.metrics, case.scenario.vessel
    knots = speed_over_ground(sailed) * waypoints.KNOTS_PER_M_S
    speeds = points.through_water_m_s[:-1] * waypoints.KNOTS_PER_M_S
    through = f"{speeds.min():.2f} kn"
    if tables.has_speeds(points):
        through = f"{' to '.join(speed_range(speeds.min(), speeds.max()))} kn, leg by leg,"
    turn_rate = f"{vessel.turn_rate_deg_s:.3g}°"
    length, no_go = sailed.length_m / waypoints.NAUTICAL_MILE_M, planned.no_go_name
    ship = ", ".join(
        filter(None, (waypoints.vessel_name(case.scenario), f"{vessel.length_m:g} m long"))
    )
    way = f"{planned.way or 'the only one'}; {length:.1f} NM by waypoints"
    least = tables.distance_text(planned.clearance_m)
    gap = f"Optimality gap: {case.gap_figure(planned)}."
    passage = f"{duration(sailed.duration_s)}, {knots:.2f} kn over ground on average"
    tightest = tables.tightest_place(points.ranked)
    return [
        f"Vessel: {ship}; {through} through the water, turns at {turn_rate} a second.",
        f"Way: {way}, {passage}.",
        _times_text(points),
        f"Least clearance of the planned path from {no_go}: {least}; {turns_text(planned)}. {gap}",
        *(
            f"{capitalised(line)}."
            for notes in (narrow_notes, sea_notes)
            for line in note_texts(notes(points.ranked))
        ),
        tables.tightest_text(case.case, tightest) if tightest else "",
        _current_text(case),
        "Depths are charted all along the planned path." if has_all_depths(planned) else "",
        _scale_text(case.scenario.scale),
        (
            "Within a leg's cross-track limits the vessel stays out of the soft no-go zone. "
            f"Legs are {points.curve.lower()}s; positions are WGS 84."
        ),
    ]


def _scale_text(scale: float) -> str:
    """Say at which scale the route was planned; empty at true scale."""
    if scale == 1:
        return ""
    return (
        f"Planned at a scale of 1:{scale:g}: lengths and times are true, but the room for turns is "
        f"{scale:g} times as wide as the vessel's own."
    )


def _current_text(case: RunCase) -> str:
    """Say which current a case was planned on; empty if it was a formula."""
    grid = case.grid
    if grid is None:
        return ""
    # Still water has no time for which it is valid.
    moves = np.nan_to_num(grid.u).any() or np.nan_to_num(grid.v).any()
    parts = (grid.credit.name, case.valid_text if moves else "")
    return f"Current: {', '.join(part for part in parts if part)}."


def _autopilot_texts(case: RunCase) -> Iterator[str]:
    """Yield what the navigator has to set on an autopilot, because the mission's file can't."""
    told = autopilot(case)
    if told.fence is None:
        yield (
            f"The mission has no fence: no fence with {MAX_VERTICES} vertices or fewer was found "
            "that holds the legs and stays out of the soft no-go zone; draw one by hand."
        )
    if told.rally is None:
        yield (
            "On an autopilot, set Loiter or Hold, not return, for a lost link and a fence breach; "
            "Hold lets the vessel drift. A return is a straight line to the start or the nearest "
            "rally point, and from some places of this route it is not clear of hard and soft "
            "no-go areas."
        )


def _times_text(points: waypoints.Waypoints) -> str:
    """Say when the vessel leaves and arrives, and how long the planned path takes."""
    planned_s, sailed_s = points.ranked.metrics.duration_s, points.metrics.duration_s
    case = points.ranked.case
    spec = case.spec
    texts = ["Times are since departure: none was given."]
    if spec.departure is not None:
        arrival = waypoints.time_after(spec.departure, sailed_s)
        leaves = moment_text(waypoints.time_after(spec.departure, 0))
        texts = [f"Departure {leaves}, arrival {moment_text(arrival)}."]
        choice = case.departure_choice
        by = spec.arrive_by if choice is None else choice.arrive_by
        if by is not None and to_minute(arrival) > to_minute(by):
            late = duration((to_minute(arrival) - to_minute(by)).total_seconds())
            texts += [f"That is {late} after {moment_text(by)}: leave {late} earlier."]
    if duration(planned_s) != duration(sailed_s):
        planned = duration(planned_s)
        texts += [
            "Times are for the legs, with the vessel heading into the cross-current;",
            f"the planned path takes {planned}.",
        ]
    return " ".join(texts)


def _put_table(
    page: Figure,
    headings: Mapping[str, str],
    columns: Sequence[int],
    part: list[dict[str, str]],
    top: float,
) -> float:
    """Write rows below `top`, points, under headings, in columns' widths; return the lower end.

    A column without a heading is left out.
    """
    used = {name: width for name, width in zip(headings, columns, strict=True) if headings[name]}
    widths = np.array([*used.values()])
    widths += (int(_WIDTH - 2 * _MARGIN) - widths.sum()) // len(used)
    lefts = _MARGIN + np.cumsum(widths) - widths
    for left, name in zip(lefts, used, strict=True):
        _write(page, headings[name], (left, top), _SMALL, bold=True)
    level = top - _HEADINGS_PT
    for row in part:
        rule = [(level + 11) / _HEIGHT] * 2
        span = [_MARGIN / _WIDTH, 1 - _MARGIN / _WIDTH]
        page.add_artist(Line2D(span, rule, color=COLOURS["grid"], linewidth=0.5))
        for left, name in zip(lefts, used, strict=True):
            _write(page, row.get(name, ""), (left, level + 7), _PLAIN)
        level -= _ROW_PT
    return level


def _put_map(page: Figure, points: waypoints.Waypoints, top: float) -> None:
    """Draw the route with its waypoints' numbers over the land, in the upper right corner."""
    case, (width, height) = points.ranked.case, _MAP_PT
    result, colour = case.run, season_colour(case.number)
    axes = axes_at(page, (_WIDTH - _MARGIN - width, top - height, width, height))
    way = result.water.projection.to_plane(points.lonlat)
    low, high = way.min(axis=0), way.max(axis=0)
    reach = max((high - low) * np.array([height / width, 1.0])) * (0.5 + _MAP_MARGIN)
    middle, size = (low + high) / 2, reach * np.array([width / height, 1.0])
    frame = shapely.box(*(middle - size), *(middle + size))
    land = result.drawn_land
    detail = DETAIL_PT * 2 * size[0] / width
    near = visible(
        shapely.clip_by_rect(land[shapely.intersects(land, frame)], *frame.bounds), detail
    )
    axes.set_xlim(middle[0] - size[0], middle[0] + size[0])
    axes.set_ylim(middle[1] - size[1], middle[1] + size[1])
    water, coast = COLOURS["water"], COLOURS["coast"]
    axes.add_artist(patch(np.array([frame]), facecolor=water, edgecolor=COLOURS["frame"]))
    axes.add_artist(patch(near, facecolor=COLOURS["land"], edgecolor=coast, linewidth=0.3))
    _put_region_edge(axes, result, frame)
    axes.add_line(stroke(way, colour, 1.2, 3))
    axes.plot(*way.T, "o", color=colour, markersize=2.5, zorder=4)
    for role, lines in case.marked(1).items():
        for line in lines:
            axes.add_line(stroke(line, COLOURS[role], 1.6, 3.5))
    shores = result.water.projection.to_plane(case.crossings(1))
    axes.plot(*shores.T, "o", mfc="none", mec=COLOURS["shut"], markersize=6, zorder=4)
    for number, (x, y) in enumerate(way, start=1):
        axes.annotate(str(number), (x, y), (3, 2), textcoords="offset points", fontsize=6, zorder=5)


def _put_region_edge(axes: Axes, result: RunResult, frame: shapely.Polygon) -> None:
    """Draw the region's edge where the map shows it, and name it below the map."""
    edge = shapely.intersection(result.water.chart.extent.exterior, frame)
    parts = [part for part in shapely.get_parts(edge) if part.length > 0]
    for part in parts:
        axes.add_line(stroke(shapely.get_coordinates(part), COLOURS["frame"], 0.6, 2.5))
    if parts:
        axes.annotate(
            "thin line: edge of the region that was planned in",
            (1, 0),
            (0, -3),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right",
            va="top",
            fontsize=6,
            color=COLOURS["frame"],
        )


def _wrapped(texts: Sequence[str], width: int) -> list[list[str]]:
    """Return the lines of each text that is not empty, of at most `width` characters."""
    return [
        [drawable(line, width) for line in textwrap.wrap(text, width)] for text in texts if text
    ]


def _height(paragraphs: Sequence[Sequence[str]]) -> float:
    """Return the height of paragraphs, points."""
    return (sum(map(len, paragraphs)) + _BETWEEN * (len(paragraphs) - 1)) * _LINE_PT


def _paragraphs(
    page: Figure, paragraphs: Sequence[Sequence[str]], top: float, size: float = _PLAIN
) -> None:
    """Write paragraphs, each a list of lines, below `top`, points."""
    level = top
    for lines in paragraphs:
        for line in lines:
            _write(page, line, (_MARGIN, level), size)
            level -= _LINE_PT
        level -= _LINE_PT * _BETWEEN


def _write(
    page: Figure,
    text: str,
    place: tuple[float, float],
    size: float,
    *,
    bold: bool = False,
    right: bool = False,
) -> None:
    """Write text below a place of the page, points from its lower left corner."""
    page.text(
        place[0] / _WIDTH,
        place[1] / _HEIGHT,
        text,
        fontsize=size,
        weight="bold" if bold else "normal",
        color=COLOURS["ink"],
        ha="right" if right else "left",
        va="top",
        parse_math=False,
        linespacing=1.15,
    )
