"""Base of all maps: axes, lines, areas and text, with sizes in points; figures as SVG.

Maps are in the planner's plane, so that shapes and angles are true, with a lon/lat graticule. All
use matplotlib's object interface, without pyplot and global settings.
"""

import io
import math
import re
from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import shapely
from markupsafe import Markup, escape
from matplotlib import font_manager
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.ft2font import FT2Font
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath

from pipeline._types import ArrayLike, Geometries
from pipeline.findings.result import RunResult
from pipeline.formats.appearance import COLOURS
from pipeline.formats.figures.map_marks import GridLine, graticule, scale_bar_m
from pipeline.geo.projection import Projection
from pipeline.texts import clean

POINTS_PER_INCH = 72.0
# Size of labels on maps.
SMALL_PT = 8.2
# Size of a map's lower title.
PLAIN_PT = 9.5
# A scale bar shorter than this, points, has one label beside it, and a longer one labels below it.
_SHORT_BAR_PT = 45.0
# Width of a small letter or figure, points.
_LETTER_PT = 0.6 * SMALL_PT
# Names longer than this number of characters are shortened.
_MAX_LENGTH = 24

# Parts of matplotlib's SVG that a page must not have: a style rule for every element, which would
# affect the whole page, the fonts of this machine, metadata and comments.
_UNWANTED = (
    r"<metadata>.*?</metadata>",
    r"<defs>\s*<style.*?</style>\s*</defs>",
    r"<!--.*?-->",
    r"font-family: [^;\"]*; ?",
    r' transform="rotate\(-0 [^"]*"',
)


def axes_at(figure: Figure, box_pt: tuple[float, float, float, float]) -> Axes:
    """Return axes without frame, of equal scales, in a box (left, bottom, width, height), pt."""
    figure_width, figure_height = figure.get_size_inches() * POINTS_PER_INCH
    left, bottom, width, height = box_pt
    axes = figure.add_axes(
        (left / figure_width, bottom / figure_height, width / figure_width, height / figure_height)
    )
    axes.set_axis_off()
    axes.set_aspect("equal")
    return axes


def stroke(path: ArrayLike, colour: str, width_pt: float, zorder: float) -> Line2D:
    """Return a path (n, 2) as a line with round corners."""
    x, y = np.asarray(path, dtype=float).T
    return Line2D(
        x,
        y,
        color=colour,
        linewidth=width_pt,
        zorder=zorder,
        solid_joinstyle="round",
        solid_capstyle="round",
    )


def mark_point(
    axes: Axes,
    at: tuple[float, float],
    role: str,
    size_pt: tuple[float, float],
    marker: str = "o",
    zorder: float = 4,
) -> None:
    """Mark a point by an outline of a size and thickness, by default a ring."""
    (x, y), (size, width), edge = at, size_pt, COLOURS[role]
    axes.plot(
        [x], [y], marker=marker, markersize=size, color=COLOURS["halo"], markeredgecolor=edge,
        markeredgewidth=width, clip_on=False, zorder=zorder,
    )  # fmt: skip


def draw_scale_bar(axes: Axes, projection: Projection, *, drop_pt: float = 24.0) -> None:
    """Draw a scale bar of two fields below the map's right corner, true in the map's middle."""
    (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
    size = point(axes)
    length_m, length = scale_bar_m(projection, (xmin, ymin, xmax, ymax))
    is_short = length < _SHORT_BAR_PT * size
    left = xmax - length - (4 if is_short else 16) * size
    low = ymin - drop_pt * size
    for field, role in enumerate(("ink", "halo")):
        axes.add_artist(
            Rectangle(
                (left + field * length / 2, low),
                length / 2,
                3.2 * size,
                facecolor=COLOURS[role],
                edgecolor=COLOURS["ink"],
                linewidth=0.7,
                clip_on=False,
            )
        )
    unit, whole = ("km", length_m / 1000) if length_m >= 1000 else ("m", length_m)
    if is_short:
        position = left - 4 * size, low + 1.6 * size
        label(axes, f"{whole:g} {unit}", position, below=False, gap_pt=0)
        return
    texts = {0.0: "0", 0.5: f"{whole / 2:g}", 1.0: f"{whole:g} {unit}"}
    letters = (len(texts[0.5]) + len(texts[1.0])) / 2 + 1
    if letters * _LETTER_PT * size > length / 2:
        del texts[0.5]
    for share, text in texts.items():
        label(axes, text, (left + share * length, low), below=True, gap_pt=2)


def label(
    axes: Axes, text: str, position: tuple[float, float], *, below: bool, gap_pt: float = 4
) -> None:
    """Write small text below a position, or to its left."""
    axes.annotate(
        text,
        position,
        xytext=(0, -gap_pt) if below else (-gap_pt, 0),
        textcoords="offset points",
        ha="center" if below else "right",
        va="top" if below else "center",
        fontsize=SMALL_PT,
        color=COLOURS["ink"],
        annotation_clip=False,
    )


def point(axes: Axes) -> float:
    """Return the length in the plane of a typographic point (1/72 inch) on paper."""
    box = axes.get_position()
    width_in, height_in = axes.figure.bbox.width, axes.figure.bbox.height
    points = POINTS_PER_INCH / axes.figure.dpi
    (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
    # The tighter dimension sets the scale, since the axes keep their aspect.
    return float(
        max(
            (xmax - xmin) / (box.width * width_in * points),
            (ymax - ymin) / (box.height * height_in * points),
        )
    )


def patch(areas: shapely.Geometry | Geometries, **style: object) -> PathPatch:
    """Return one patch of all rings of all areas, so that an SVG has one element per layer."""
    rings = shapely.get_rings(shapely.get_parts(areas))
    outlines = [Outline(shapely.get_coordinates(ring), closed=True) for ring in rings]
    whole = Outline.make_compound_path(*outlines) if outlines else Outline(np.empty((0, 2)))
    return PathPatch(whole, **style)


def drawable(text: str, limit: int = 60) -> str:
    """Return a shortened text that the default font can draw."""
    known = _glyphs()
    shown = "".join(c if ord(c) in known else "\N{WHITE SQUARE}" for c in text)
    return clean(shown, limit)


def in_season_colour(drawn: Artist, colour: str) -> None:
    """Draw the best route of a figure, or of a part of one, in a case's colour."""
    for artist in drawn.findobj():
        for name in ("color", "edgecolor", "markeredgecolor", "markerfacecolor"):
            get = getattr(artist, f"get_{name}", None)
            value = get() if get is not None else None
            if isinstance(value, str) and same_color(value, COLOURS["best"]):
                getattr(artist, f"set_{name}")(colour)


@cache
def text_width(text: str, size_pt: float, *, bold: bool = False) -> float:
    """Return the width of a text in the default font, points."""
    font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    if not text.strip():
        return 0.0
    return float(TextPath((0, 0), text, size=size_pt, prop=font, usetex=False).get_extents().width)


@cache
def _glyphs() -> frozenset[int]:
    """Return the code points that the default font has, in regular and bold."""
    plain, bold = (
        FT2Font(font_manager.findfont(f"DejaVu Sans:{weight}")).get_charmap()
        for weight in ("regular", "bold")
    )
    return frozenset(plain.keys() & bold.keys())


def draw_island_labels(axes: Axes, result: RunResult) -> None:
    """Write each island's number or name on it, with a halo."""
    for island in result.islands:
        axes.text(
            island.x,
            island.y,
            drawable(island.label, _MAX_LENGTH),
            ha="center",
            va="center",
            fontsize=SMALL_PT,
            fontweight="bold",
            color=COLOURS["ink"],
            zorder=7.8,
            parse_math=False,
            path_effects=[withStroke(linewidth=2.2, foreground=COLOURS["halo"])],
        )


def page_svg(figure: Figure | None, *, identity: str, label: str) -> Markup:
    """Draw a figure as an `<svg>` element whose colours the page sets; empty without a figure.

    `identity` (letters, digits, hyphens) prefixes its ids, so that they are unique in the page;
    `label` is what a screen reader says, escaped here. Colours become
    `var(--map-<role>, <light colour>)`. Text stays text, in the page's font and scaled by
    `var(--text)`.
    """
    if figure is None:
        return Markup()
    FigureCanvasSVG(figure)
    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    for pattern in _UNWANTED:
        text = re.sub(pattern, "", text, flags=re.DOTALL)
    text = re.sub(r'\bd="([^"]*)"', _rounded_path, text)
    text = re.sub(
        r'\b([xy])="(-?[\d.]+)"', lambda at: f'{at[1]}="{float(at[2]):.1f}"'.replace(".0", ""), text
    )
    text = re.sub(r"font-size: ([\d.]+)px", r"font-size: calc(\1px * var(--text, 1))", text)
    text = _rename_ids(text.replace("xlink:href", "href"), identity)
    for role, colour in COLOURS.items():
        text = text.replace(colour, f"var(--map-{role}, {colour})")
    text = re.sub(r"\s*\n\s*", "\n", text)
    head, _, body = text.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    if box is None:
        raise ValueError("matplotlib wrote an SVG without a viewBox")
    # Only the label comes from outside, and it is escaped.
    return Markup(  # noqa: S704 - our own
        f'<svg class="map" xmlns="http://www.w3.org/2000/svg" {box[0]} role="img"'
        f' aria-label="{escape(label)}">{body.strip()}'
    )


def _rounded_path(match: re.Match[str]) -> str:
    """Round a path's coordinates to a tenth of a point, on one line."""
    path = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}", match[1])
    path = re.sub(r"\.0\b", "", path)
    path = re.sub(r" ?([MLCQzZ]) ?", r"\1", " ".join(path.split()))
    return f'd="{path}"'


def _rename_ids(text: str, identity: str) -> str:
    """Drop unused ids and number the others, since matplotlib makes some of them up at random."""
    used = re.findall(r'(?:url\(#|href="#)([^)"]+)', text)
    names = {name: f"{identity}-{number}" for number, name in enumerate(dict.fromkeys(used))}

    def renamed(match: re.Match[str]) -> str:
        return f"{match[1]}{names[match[2]]}"

    text = re.sub(r'(url\(#|href="#)([^)"]+)', renamed, text)
    return re.sub(
        r' id="([^"]+)"',
        lambda match: f' id="{names[match[1]]}"' if match[1] in names else "",
        text,
    )


# Width of a map: a phone's in CSS pixels, so that labels are readable there; a desktop enlarges it.
WIDTH_PT = 374.0
# Least room left of a map, for the labels of its parallels.
LEFT_PT = 36.0
# Least room right of a map, for half a meridian's label.
RIGHT_PT = 18.0
# Room below a map, for the labels of its meridians and its scale bar.
BOTTOM_PT = 40.0
# Room above a map.
TOP_PT = 10.0
# Least ratio of a map's height to its width; flatter charts get margins.
_MIN_RATIO = 0.45
# Greatest ratio of a map's height to its width; taller charts get margins.
_MAX_RATIO = 1.7
# Distance from a marker to its label.
_LABEL_GAP_PT = 8.0
# Height of a map's two titles.
_TITLE_PT = 30.0
# Space between the maps and the legend.
_LEGEND_PT = 8.0
# Height of a line of the legend.
_LEGEND_ROW_PT = 12.0
_LEGEND_TEXT_PT = 7.5
# Largest size of a map's upper and lower title, and whether it is bold.
_TITLES = ((11.0, True), (PLAIN_PT, False))
# Least room between the labels of meridians.
_LABEL_SPACE_PT = 4.0
# Width of handle, gaps and spacing of an entry of the legend, in sizes of its text.
_LEGEND_EXTRA = 4.2
# Room between a text and the figure's edge.
_EDGE_PT = 3.0
# Room of a parallel's label beside its text.
_LABEL_ROOM_PT = 9.0


def side_room_pt(result: RunResult) -> tuple[float, float]:
    """Return the room left and right of a map for the labels of its grid, points.

    At the left there is room for the longest label of a parallel; at the right, for half of the
    longest label of a meridian.
    """
    water = result.water
    grid = graticule(water.projection, water.chart.extent, in_metres=water.is_planar)
    parallels = [text_width(g.label, SMALL_PT) for g in grid if not g.is_meridian]
    meridians = [text_width(g.label, SMALL_PT) / 2 for g in grid if g.is_meridian]
    return (
        max(LEFT_PT, _LABEL_ROOM_PT + max(parallels, default=0.0)),
        max(RIGHT_PT, _EDGE_PT + max(meridians, default=0.0)),
    )


def map_figure(
    result: RunResult,
    handles: Sequence[Artist] = (),
    *,
    titles: Sequence[tuple[str, str]] = (),
    columns: int = 1,
    below_pt: float = 0.0,
) -> tuple[Figure, list[tuple[Axes, PathPatch]]]:
    """Make a figure with a map under each title (two lines), and one legend.

    Returns the axes of each map, `WIDTH_PT` wide, and its water as a patch to clip layers to.
    Without titles there is one; `below_pt` points are left free between maps and legend.
    """
    left_pt, right_pt = side_room_pt(result)
    whole_width = columns * WIDTH_PT
    inner = WIDTH_PT - left_pt - right_pt
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    ratio = float(np.clip((ymax - ymin) / (xmax - xmin), _MIN_RATIO, _MAX_RATIO))
    height = inner * ratio + BOTTOM_PT + TOP_PT
    row_height = height + (_TITLE_PT if titles else 0.0)
    count = max(1, len(titles))
    legend_columns = _legend_columns(handles, whole_width)
    lines = math.ceil(len(handles) / legend_columns)
    legend = _LEGEND_PT + lines * _LEGEND_ROW_PT if handles else 0.0
    whole_height = math.ceil(count / columns) * row_height + below_pt + legend
    figure = Figure(
        figsize=(whole_width / POINTS_PER_INCH, whole_height / POINTS_PER_INCH),
        facecolor=COLOURS["halo"],
    )
    room = min(left_pt, right_pt) * 2 + inner
    sizes = _title_sizes(titles, room - 2 * _EDGE_PT)
    maps = []
    for index in range(count):
        row, column = divmod(index, columns)
        left, bottom = column * WIDTH_PT, whole_height - (row + 1) * row_height
        box_pt = (left + left_pt, bottom + BOTTOM_PT, inner, height - BOTTOM_PT - TOP_PT)
        maps.append(_map_axes(figure, result, box_pt))
        if titles:
            middle = left + left_pt + inner / 2
            _draw_titles(figure, titles[index], (middle, bottom + height), sizes)
    if handles:
        figure.legend(
            handles=handles,
            loc="center",
            bbox_to_anchor=(0.5, 0.5 * legend / whole_height),
            ncols=legend_columns,
            frameon=False,
            fontsize=_LEGEND_TEXT_PT,
            labelcolor=COLOURS["ink"],
            handlelength=1.6,
            columnspacing=1.2,
            handletextpad=0.5,
        )
    return figure, maps


def _title_sizes(titles: Sequence[tuple[str, str]], room_pt: float) -> tuple[float, float]:
    """Return the sizes of the upper and the lower title, points, at which all titles fit."""
    sizes = []
    for line, (size, bold) in enumerate(_TITLES):
        wide = [text_width(drawable(title[line]), size, bold=bold) for title in titles]
        sizes.append(size * min(1.0, room_pt / max([1.0, *wide])))
    return sizes[0], sizes[1]


def _draw_titles(
    figure: Figure,
    titles: tuple[str, str],
    foot_pt: tuple[float, float],
    sizes_pt: tuple[float, float],
) -> None:
    width, height = figure.get_size_inches() * POINTS_PER_INCH
    middle, bottom = foot_pt
    for text, up_pt, size_pt, (_, bold) in zip(titles, (20.0, 6.0), sizes_pt, _TITLES, strict=True):
        figure.text(
            middle / width,
            (bottom + up_pt) / height,
            drawable(text),
            ha="center",
            va="center",
            color=COLOURS["ink"],
            fontsize=size_pt,
            fontweight="bold" if bold else "normal",
            parse_math=False,
        )


def _legend_columns(handles: Sequence[Artist], width_pt: float) -> int:
    """Return how many columns of a legend fit into a width; entries run down the columns."""
    wide = [text_width(str(Artist.get_label(h)), _LEGEND_TEXT_PT) for h in handles]
    for columns in range(len(wide), 1, -1):
        needed = sum(max(column) for column in np.array_split(wide, columns))
        if needed + columns * _LEGEND_EXTRA * _LEGEND_TEXT_PT <= width_pt - 2 * _EDGE_PT:
            return columns
    return 1


def add_layers(axes: Axes, layers: Sequence[Artist], sea: PathPatch) -> None:
    """Add layers to a map, clipped to its water."""
    for layer in layers:
        # add_patch would update the axes' limits from each vertex: a minute for a long coast.
        axes.add_artist(layer)
        layer.set_clip_path(sea)


def draw_map(
    axes: Axes,
    sea: PathPatch,
    result: RunResult,
    layers: Sequence[Artist],
    paths: Sequence[ArrayLike] = (),
) -> None:
    """Draw layers, start and goal (their labels off the paths, if possible), and the frame."""
    add_layers(axes, layers, sea)
    _draw_start_and_goal(axes, result, paths)
    _draw_frame(axes, result, sea)


def _draw_start_and_goal(axes: Axes, result: RunResult, paths: Sequence[ArrayLike]) -> None:
    """Mark start (circle) and goal (diamond), with labels that keep off the paths if possible."""
    drawn = shapely.MultiLineString([shapely.LineString(path) for path in paths])
    start, *between, goal = result.stops
    via = [(point, "s", f"Via {at}") for at, point in enumerate(between, start=1)]
    for end, marker, name in ((start, "o", "Start"), *via, (goal, "D", "Goal")):
        x, y = (float(value) for value in end)
        mark_point(axes, (x, y), "best", (6.0, 1.8), marker, zorder=8)
        across, up = _free_side(axes, (x, y), name, drawn)
        axes.annotate(
            name,
            (x, y),
            xytext=(_LABEL_GAP_PT * across, _LABEL_GAP_PT * up),
            textcoords="offset points",
            ha=("right", "center", "left")[across + 1],
            va=("top", "center", "bottom")[up + 1],
            fontsize=PLAIN_PT,
            fontweight="bold",
            color=COLOURS["ink"],
            zorder=9,
            path_effects=[withStroke(linewidth=2.4, foreground=COLOURS["halo"])],
        )


def _draw_frame(axes: Axes, result: RunResult, sea: PathPatch) -> None:
    """Draw the grid with its labels, the neatline and the scale bar."""
    extent = result.water.chart.extent
    grid = graticule(result.water.projection, extent, in_metres=result.scenario.is_planar)
    for line in grid:
        for part in line.parts:
            drawn = Line2D(part[:, 0], part[:, 1], color=COLOURS["grid"], linewidth=0.5, zorder=1)
            axes.add_line(drawn)
            drawn.set_clip_path(sea)
    for line in (*_labelled(axes, grid), *(line for line in grid if not line.is_meridian)):
        label(axes, line.label, line.foot, below=line.is_meridian)
    frame = patch(extent, facecolor="none", edgecolor=COLOURS["frame"], linewidth=0.9, zorder=7.5)
    axes.add_artist(frame)
    frame.set_clip_on(False)
    draw_scale_bar(axes, result.water.projection)


def _labelled(axes: Axes, grid: Sequence[GridLine]) -> Sequence[GridLine]:
    """Return the meridians to label, as many as have room: all, every second, every third, ..."""
    meridians = sorted((line for line in grid if line.is_meridian), key=lambda line: line.foot)
    size = point(axes)
    for every in range(1, len(meridians)):
        shown = meridians[::every]
        wide = [text_width(line.label, SMALL_PT) + _LABEL_SPACE_PT for line in shown]
        apart = [(b.foot[0] - a.foot[0]) / size for a, b in pairwise(shown)]
        if all(gap >= (a + b) / 2 for gap, a, b in zip(apart, wide, wide[1:], strict=False)):
            return shown
    return meridians[:1]


def _free_side(
    axes: Axes, position: tuple[float, float], text: str, drawn: shapely.Geometry
) -> tuple[int, int]:
    """Return a side (across, up) of a position where its text is in the map and off the paths.

    It is the first such side of right, left, above and below; else the first one in the map.
    """
    (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
    # The mean width of a bold letter of the default font is 0.7 of its size.
    size = point(axes)
    wide, high = 0.7 * PLAIN_PT * len(text) * size, PLAIN_PT * size
    inside = []
    for across, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        x = position[0] + across * (_LABEL_GAP_PT * size + wide / 2)
        y = position[1] + up * (_LABEL_GAP_PT * size + high / 2)
        box = shapely.box(x - wide / 2, y - high / 2, x + wide / 2, y + high / 2)
        if not shapely.box(xmin, ymin, xmax, ymax).contains(box):
            continue
        if not box.intersects(drawn):
            return across, up
        inside.append((across, up))
    return inside[0] if inside else (1, 0)


def _map_axes(
    figure: Figure, result: RunResult, box_pt: tuple[float, float, float, float]
) -> tuple[Axes, PathPatch]:
    """Return axes over the chart's extent, and its water as a patch to clip layers to."""
    axes = axes_at(figure, box_pt)
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    axes.set_xlim(xmin, xmax)
    axes.set_ylim(ymin, ymax)
    sea = patch(result.water.chart.extent, facecolor=COLOURS["water"], edgecolor="none", zorder=0)
    axes.add_artist(sea)
    return axes, sea
