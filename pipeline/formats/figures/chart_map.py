"""Base of all maps: titles and legend, land, start and goal, grid and frame.

Maps are in the planner's plane, so that shapes and angles are true, with a lon/lat graticule.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.patheffects import withStroke

from pipeline._types import ArrayLike
from pipeline.findings.result import RunResult
from pipeline.formats.figures.artists import (
    PLAIN_PT,
    POINTS_PER_INCH,
    SMALL_PT,
    axes_at,
    draw_scale_bar,
    drawable,
    label,
    patch,
    point,
    text_width,
)
from pipeline.formats.figures.map_marks import GridLine, graticule
from pipeline.formats.palette import COLOURS

# Width of a map: a phone's in CSS pixels, so that labels are readable there; a desktop enlarges it.
WIDTH_PT = 374.0
LEFT_PT, RIGHT_PT, BOTTOM_PT, TOP_PT = 36.0, 18.0, 40.0, 10.0
# Minimum and maximum ratio of a map's height to its width; other charts get margins.
_MIN_RATIO, _MAX_RATIO = 0.45, 1.7
# Distance from a marker to its label.
_LABEL_GAP_PT = 8.0
_TITLE_PT, _LEGEND_PT, _LEGEND_ROW_PT = 30.0, 8.0, 12.0
_LEGEND_TEXT_PT = 7.5
# Largest size of a map's upper and lower title, and whether it is bold.
_TITLES = ((11.0, True), (PLAIN_PT, False))
# Least room between the labels of meridians.
_LABEL_SPACE_PT = 4.0
# Room of an entry of a legend beside its text, in sizes of the text: handle, gaps, spacing.
_LEGEND_EXTRA = 4.2
# Least width of a map in a figure of a given width, and room between a text and the figure's edge.
_MIN_WIDTH_PT, _EDGE_PT = 160.0, 3.0
# Room of a parallel's label beside its text.
_LABEL_ROOM_PT = 9.0


@dataclass(frozen=True)
class Margins:
    """Room around a map for the labels of its grid, points."""

    left: float
    right: float

    @classmethod
    def of(cls, result: RunResult) -> Self:
        """Return room for the longest labels: a whole one at the left, half of one at the right."""
        water = result.water
        grid = graticule(water.projection, water.chart.extent, in_metres=water.is_planar)
        parallels = [text_width(g.label, SMALL_PT) for g in grid if not g.is_meridian]
        meridians = [text_width(g.label, SMALL_PT) / 2 for g in grid if g.is_meridian]
        return cls(
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
    width_pt: float | None = None,
) -> tuple[Figure, list[tuple[Axes, PathPatch]]]:
    """Make a figure with a map under each title (two lines), and one legend.

    Returns the axes of each map, and its water as a patch to clip layers to. Without titles there
    is one map; `below_pt` points are left free between the maps and the legend. A figure of a given
    width has as many columns as fit, at most `columns`; otherwise each map is `WIDTH_PT` wide.
    """
    margins = Margins.of(result)
    whole_width = width_pt or columns * WIDTH_PT
    columns = max(1, min(columns, int(whole_width / _MIN_WIDTH_PT)))
    width = whole_width / columns
    height = _map_height_pt(result, width, margins)
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
    room = min(margins.left, margins.right) * 2 + width - margins.left - margins.right
    sizes = _title_sizes(titles, room - 2 * _EDGE_PT)
    maps = []
    for index in range(count):
        row, column = divmod(index, columns)
        left, bottom = column * width, whole_height - (row + 1) * row_height
        inner = width - margins.left - margins.right
        box_pt = (left + margins.left, bottom + BOTTOM_PT, inner, height - BOTTOM_PT - TOP_PT)
        maps.append(_map_axes(figure, result, box_pt))
        if titles:
            middle = left + margins.left + inner / 2
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
    """Write a map's two titles above its upper edge."""
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
        axes.plot(
            [x],
            [y],
            marker=marker,
            markersize=6.0,
            color=COLOURS["halo"],
            markeredgecolor=COLOURS["best"],
            markeredgewidth=1.8,
            zorder=8,
            clip_on=False,
        )
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


def _map_height_pt(result: RunResult, width_pt: float, margins: Margins) -> float:
    """Return the height of one map with its margins, points, for a width with its margins."""
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    ratio = float(np.clip((ymax - ymin) / (xmax - xmin), _MIN_RATIO, _MAX_RATIO))
    return (width_pt - margins.left - margins.right) * ratio + BOTTOM_PT + TOP_PT


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
