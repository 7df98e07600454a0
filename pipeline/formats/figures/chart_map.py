"""What all maps share: titles and legend, land, start and goal, grid and frame.

A map lies in the planner's plane, so that shapes and angles are true, under a lon/lat graticule.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.figures.graticule import graticule
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.figures.sheet import (
    PLAIN_PT,
    POINTS_PER_INCH,
    axes_at,
    draw_scale_bar,
    drawable,
    label,
    patch,
    point,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch
    from shapely.geometry.base import BaseGeometry

    from pipeline.formats.shared.result import RunResult

    FloatArray = npt.NDArray[np.float64]

# A phone's width in CSS pixels, so that labels stay readable there; a desktop enlarges it.
WIDTH_PT = 374.0
LEFT_PT, RIGHT_PT, BOTTOM_PT, TOP_PT = 36.0, 18.0, 40.0, 10.0
# Taller or flatter waters than this are drawn with room left beside them.
_FLATTEST, _TALLEST = 0.45, 1.7
# Coast finer than this on paper can't be seen, and makes up most of a picture's bytes.
DETAIL_PT = 0.25
SOFT_ALPHA = 0.38
ZONE_ALPHA, ZONE_DASHES = 0.06, (0, (4, 2))
# What the planner took for land beyond what is land.
_ADDED_ALPHA = 0.4
# From a mark to its name.
_BESIDE_PT = 8.0
_TITLE_PT, _LEGEND_PT, _LEGEND_ROW_PT = 30.0, 8.0, 12.0


def map_figure(
    result: RunResult,
    handles: Sequence[Artist] = (),
    *,
    titles: Sequence[tuple[str, str]] = (),
    columns: int = 1,
    legend_columns: int = 2,
    below_pt: float = 0.0,
) -> tuple[Figure, list[tuple[Axes, PathPatch]]]:
    """Make a figure with a map under each title (a name and its figures), and one legend.

    Each map has its axes, and its water as a patch that all is clipped to. Without titles there is
    one map; `below_pt` is kept free between the maps and the legend.
    """
    from matplotlib.figure import Figure

    width, height = _figure_size_pt(result)
    tall = height + (_TITLE_PT if titles else 0.0)
    count = max(1, len(titles))
    rows = math.ceil(count / columns)
    lines = math.ceil(len(handles) / legend_columns)
    legend = _LEGEND_PT + lines * _LEGEND_ROW_PT if handles else 0.0
    whole_width, whole_height = columns * width, rows * tall + below_pt + legend
    figure = Figure(
        figsize=(whole_width / POINTS_PER_INCH, whole_height / POINTS_PER_INCH),
        facecolor=COLOURS["halo"],
    )
    maps = []
    for place in range(count):
        row, column = divmod(place, columns)
        left, bottom = column * width, whole_height - (row + 1) * tall
        box_pt = (
            left + LEFT_PT,
            bottom + BOTTOM_PT,
            width - LEFT_PT - RIGHT_PT,
            height - BOTTOM_PT - TOP_PT,
        )
        maps.append(_map_axes(figure, result, box_pt))
        for text, up_pt, size_pt, weight in (
            (
                (titles[place][0], 20.0, 11.0, "bold"),
                (titles[place][1], 6.0, PLAIN_PT, "normal"),
            )
            if titles
            else ()
        ):
            figure.text(
                (left + LEFT_PT + (width - LEFT_PT - RIGHT_PT) / 2) / whole_width,
                (bottom + height + up_pt) / whole_height,
                drawable(text),
                ha="center",
                va="center",
                color=COLOURS["ink"],
                fontsize=size_pt,
                fontweight=weight,
                parse_math=False,
            )
    if handles:
        _draw_legend(figure, handles, legend_columns, 0.5 * legend / whole_height)
    return figure, maps


def add_layers(axes: Axes, layers: Sequence[Artist], sea: PathPatch) -> None:
    """Put layers on a map, clipped to its water."""
    for layer in layers:
        # add_patch would look at each vertex for limits that are set already: a minute for a coast.
        axes.add_artist(layer)
        layer.set_clip_path(sea)


def land_layers(axes: Axes, result: RunResult, within: BaseGeometry | None = None) -> list[Artist]:
    """Land as it was before it was simplified, and what is too shallow, as fine as can be seen.

    Cut to an area if one is given.
    """
    detail = DETAIL_PT * point(axes)
    land = _drawn(_cut(result.scene.land, within), detail)
    shoals = result.scene.projection.geometry_to_plane(np.array(result.shoals, dtype=object))
    return [
        patch(
            land, facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], linewidth=0.35, zorder=4
        ),
        patch(
            _drawn(_cut(shoals, within), detail),
            facecolor=COLOURS["shoal"],
            edgecolor="none",
            zorder=4,
        ),
    ]


def no_go_layers(result: RunResult, within: BaseGeometry | None = None) -> list[Artist]:
    """What the planner took for land, cut to an area if one is given."""
    no_go = _cut(result.scene.chart.no_go, within)
    return [
        patch(no_go, facecolor=COLOURS["land"], edgecolor="none", alpha=_ADDED_ALPHA, zorder=3.5)
    ]


def soft_layer(axes: Axes, area: BaseGeometry) -> Artist:
    """A soft no-go zone, translucent."""
    seen = shapely.simplify(area, DETAIL_PT * point(axes))
    return patch(seen, facecolor=COLOURS["soft"], edgecolor="none", alpha=SOFT_ALPHA, zorder=3)


def zone_layers(result: RunResult) -> list[Artist]:
    """Areas of the chart that may be entered, under a rule: outlined, over the land."""
    return [
        patch(
            area,
            facecolor=(COLOURS[zone.kind], ZONE_ALPHA),
            edgecolor=COLOURS[zone.kind],
            linewidth=0.9,
            linestyle=ZONE_DASHES,
            zorder=4.5,
        )
        for zone, area in result.open_zones
    ]


def zone_handles(result: RunResult) -> list[Artist]:
    """Legend of the areas that `zone_layers` draws; none where there are none."""
    from matplotlib.patches import Patch

    kinds = {zone.kind for zone, _ in result.open_zones}
    return [
        Patch(
            facecolor=(COLOURS[kind], ZONE_ALPHA),
            edgecolor=COLOURS[kind],
            linestyle=ZONE_DASHES,
            label=words,
        )
        for kind, words in (("restricted", "restricted"), ("traffic", "traffic scheme"))
        if kind in kinds
    ]


def land_handles(result: RunResult) -> list[Artist]:
    """Legend of land and of what the planner took for land."""
    from matplotlib.patches import Patch

    added = [Patch(facecolor=COLOURS["land"], alpha=_ADDED_ALPHA, label="no-go as planned on")]
    return [
        Patch(facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], label="land"),
        *([] if result.scenario.is_planar else added),
    ]


def line_handle(role: str, width_pt: float, words: str) -> Artist:
    """Legend of a line."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=COLOURS[role], linewidth=width_pt, label=words)


def draw_ends(axes: Axes, result: RunResult, ways: Sequence[npt.ArrayLike] = ()) -> None:
    """Mark start (circle) and goal (diamond), and name each beside the ways (n, 2) if it can be."""
    from matplotlib.patheffects import withStroke

    drawn = shapely.MultiLineString([shapely.LineString(way) for way in ways])
    for end, marker, name in ((result.scene.start, "o", "Start"), (result.scene.goal, "D", "Goal")):
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
            xytext=(_BESIDE_PT * across, _BESIDE_PT * up),
            textcoords="offset points",
            ha=("right", "center", "left")[across + 1],
            va=("top", "center", "bottom")[up + 1],
            fontsize=PLAIN_PT,
            fontweight="bold",
            color=COLOURS["ink"],
            zorder=9,
            path_effects=[withStroke(linewidth=2.4, foreground=COLOURS["halo"])],
        )


def draw_frame(axes: Axes, result: RunResult, sea: PathPatch) -> None:
    """Draw the grid with its labels, the neat line, and the scale bar."""
    from matplotlib.lines import Line2D

    extent = result.scene.chart.extent
    for line in graticule(result.scene.projection, extent, in_metres=result.scenario.is_planar):
        for part in line.parts:
            drawn = Line2D(part[:, 0], part[:, 1], color=COLOURS["grid"], linewidth=0.5, zorder=1)
            axes.add_line(drawn)
            drawn.set_clip_path(sea)
        label(axes, line.label, line.foot, below=line.is_meridian)
    frame = patch(extent, facecolor="none", edgecolor=COLOURS["frame"], linewidth=0.9, zorder=7.5)
    axes.add_patch(frame)
    frame.set_clip_on(False)
    draw_scale_bar(axes, result.scene.projection)


def _figure_size_pt(result: RunResult) -> tuple[float, float]:
    """Width and height of one map, in points."""
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    ratio = float(np.clip((ymax - ymin) / (xmax - xmin), _FLATTEST, _TALLEST))
    return WIDTH_PT, (WIDTH_PT - LEFT_PT - RIGHT_PT) * ratio + BOTTOM_PT + TOP_PT


def _drawn(areas: npt.NDArray[np.object_], detail: float) -> npt.NDArray[np.object_]:
    """Simplify areas (n,) by a detail, and leave out those smaller than it: none shows on paper."""
    west, south, east, north = shapely.bounds(areas).T
    return np.asarray(
        shapely.simplify(areas[np.maximum(east - west, north - south) >= detail], detail)
    )


def _cut(
    areas: Sequence[BaseGeometry] | npt.NDArray[np.object_], within: BaseGeometry | None
) -> npt.NDArray[np.object_]:
    """Take the parts of areas that lie within another; all, if none is given."""
    areas = np.array(areas, dtype=object)
    if within is None:
        return areas
    near = areas[shapely.intersects(areas, within)]
    return np.asarray(shapely.intersection(near, within))


def _free_side(
    axes: Axes, place: tuple[float, float], text: str, drawn: BaseGeometry
) -> tuple[int, int]:
    """Side of a place where a text stays inside the map and off what is drawn: across, up.

    To the right if that will do, else to the left, above, below; where none does, the first of
    them that stays inside.
    """
    (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
    # A bold letter of the default font is some 0.7 of its size wide.
    size = point(axes)
    wide, high = 0.7 * PLAIN_PT * len(text) * size, PLAIN_PT * size
    inside = []
    for across, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        x = place[0] + across * (_BESIDE_PT * size + wide / 2)
        y = place[1] + up * (_BESIDE_PT * size + high / 2)
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
    """Axes over the chart's extent, and the water that all is clipped to."""
    axes = axes_at(figure, box_pt)
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    axes.set_xlim(xmin, xmax)
    axes.set_ylim(ymin, ymax)
    sea = patch(result.scene.chart.extent, facecolor=COLOURS["water"], edgecolor="none", zorder=0)
    axes.add_patch(sea)
    return axes, sea


def _draw_legend(figure: Figure, handles: Sequence[Artist], columns: int, centre: float) -> None:
    """Name what is drawn, centred at a share of the figure's height."""
    figure.legend(
        handles=handles,
        loc="center",
        bbox_to_anchor=(0.5, centre),
        ncols=columns,
        frameon=False,
        fontsize=7.5,
        labelcolor=COLOURS["ink"],
        handlelength=1.6,
        columnspacing=1.2,
        handletextpad=0.5,
    )
