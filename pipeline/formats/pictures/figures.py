"""Maps of a run, drawn by matplotlib's object interface: no pyplot, no global settings.

A map lies in the planner's plane, so that shapes and angles are true, under a lon/lat graticule.
Every colour stands for a role (land, best route, …), so that `season_svg` can leave the colours
to the page it stands in, light or dark; `season_map` and `overview` write files.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.pictures.arrows import arrows, speed_scale
from pipeline.formats.pictures.graticule import graticule, scale_bar_m
from pipeline.formats.pictures.page_svg import page_svg
from pipeline.formats.pictures.palette import COLOURS

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.patches import PathPatch
    from shapely.geometry.base import BaseGeometry

    from pipeline.formats.result import RunResult

# A phone's width in CSS pixels, so that labels stay readable there; a desktop enlarges it.
_WIDTH_PT = 374.0
_LEFT_PT, _RIGHT_PT, _BOTTOM_PT, _TOP_PT = 36.0, 18.0, 40.0, 10.0
_TITLE_PT, _LEGEND_PT = 24.0, 30.0
_POINTS_PER_INCH = 72.0
# Taller or flatter waters than this are drawn with room left beside them.
_FLATTEST, _TALLEST = 0.45, 1.7
# Coast finer than this on paper can't be seen, and makes up most of a picture's bytes.
_DETAIL_PT = 0.25
_SMALL_PT, _PLAIN_PT = 8.2, 9.5
_SOFT_ALPHA = 0.38


def season_svg(result: RunResult, season: str, *, identity: str, label: str) -> str:
    """Draw a season as an `<svg>` element for a page; see `page_svg`."""
    return page_svg(_season_figure(result, season), identity=identity, label=label)


def season_map(result: RunResult, season: str, path: Path, *, dpi: float = 200) -> None:
    """Draw one season to a file; its suffix (.png, .svg, .pdf) says the form."""
    _season_figure(result, season).savefig(path, dpi=dpi, facecolor=COLOURS["halo"])


def overview(result: RunResult, path: Path, *, dpi: float = 160) -> None:
    """Draw all seasons side by side, named, with a legend, to a file; for a README."""
    from matplotlib.figure import Figure

    seasons = [entry.season for entry in result.plans]
    width, height = _figure_size_pt(result)
    height += _TITLE_PT
    whole = Figure(
        figsize=(
            width * len(seasons) / _POINTS_PER_INCH,
            (height + _LEGEND_PT) / _POINTS_PER_INCH,
        ),
        facecolor=COLOURS["halo"],
    )
    heights = [height, _LEGEND_PT]
    upper, lower = np.ravel(whole.subfigures(2, 1, squeeze=False, height_ratios=heights, hspace=0))
    panels = np.ravel(upper.subfigures(1, len(seasons), squeeze=False))
    for season, panel in zip(seasons, panels, strict=True):
        _draw_season(panel, result, season, size_pt=(width, height), top_pt=_TITLE_PT)
        panel.text(
            0.5,
            1 - 0.5 * _TITLE_PT / height,
            _drawable(_title_of(result, season)),
            ha="center",
            va="center",
            color=COLOURS["ink"],
            fontsize=10.5,
            fontweight="bold",
            parse_math=False,
        )
    _draw_legend(lower, result)
    whole.savefig(path, dpi=dpi)


def _title_of(result: RunResult, season: str) -> str:
    """Name the season and its best route's side, length and fuel."""
    from pipeline.formats.phrases import distance, number

    title = result.season_title(season)
    ranked = result.season_routes(season)
    if not ranked:
        return f"{title}: no route"
    best = ranked[0].metrics
    side = f" {best.side} about," if best.side else ""
    return f"{title}:{side} {distance(best.length_m)}, fuel {number(best.fuel)}"


def _season_figure(result: RunResult, season: str) -> Figure:
    """Draw one season on a figure of its own."""
    from matplotlib.figure import Figure

    width, height = _figure_size_pt(result)
    figure = Figure(figsize=(width / _POINTS_PER_INCH, height / _POINTS_PER_INCH))
    _draw_season(figure, result, season, size_pt=(width, height), top_pt=0.0)
    return figure


def _figure_size_pt(result: RunResult) -> tuple[float, float]:
    """Width and height of a season's map, in points."""
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    ratio = float(np.clip((ymax - ymin) / (xmax - xmin), _FLATTEST, _TALLEST))
    return _WIDTH_PT, (_WIDTH_PT - _LEFT_PT - _RIGHT_PT) * ratio + _BOTTOM_PT + _TOP_PT


def _draw_season(
    figure: Figure | SubFigure,
    result: RunResult,
    season: str,
    *,
    size_pt: tuple[float, float],
    top_pt: float,
) -> None:
    """Draw sea, currents, zones, routes and frame; `top_pt` is kept free above."""
    width, height = size_pt
    left, bottom = _LEFT_PT / width, _BOTTOM_PT / height
    right, top = _RIGHT_PT / width, (_TOP_PT + top_pt) / height
    axes = figure.add_axes((left, bottom, 1 - left - right, 1 - bottom - top))
    axes.set_axis_off()
    axes.set_aspect("equal")
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    axes.set_xlim(xmin, xmax)
    axes.set_ylim(ymin, ymax)
    sea = _patch(result.scene.chart.extent, facecolor=COLOURS["water"], edgecolor="none", zorder=0)
    axes.add_patch(sea)
    _draw_sea(axes, result, season, sea)
    _draw_routes(axes, result, season, sea)
    _draw_ends(axes, result)
    _draw_frame(axes, result, sea)


def _draw_sea(axes: Axes, result: RunResult, season: str, sea: PathPatch) -> None:
    """Draw currents, the best route's soft no-go zone over them, and land on top."""
    outlines = arrows(result, season).outlines(speed_scale(result))
    layers = [
        _patch(outline, facecolor=COLOURS[f"speed{i}"], edgecolor="none", zorder=2)
        for i, outline in enumerate(outlines)
        if not outline.is_empty
    ]
    detail = _DETAIL_PT * _point(axes)
    for ranked in result.season_routes(season)[:1]:
        soft = shapely.simplify(ranked.route.soft_no_go, detail)
        layers.append(
            _patch(soft, facecolor=COLOURS["soft"], edgecolor="none", alpha=_SOFT_ALPHA, zorder=3)
        )
    land = shapely.simplify(np.array(result.scene.land, dtype=object), detail)
    layers.append(
        _patch(
            land, facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], linewidth=0.35, zorder=4
        )
    )
    shoals = result.scene.projection.geometry_to_plane(np.array(result.shoals, dtype=object))
    layers.append(
        _patch(
            shapely.simplify(shoals, detail),
            facecolor=COLOURS["shoal"],
            edgecolor="none",
            zorder=4,
        )
    )
    for layer in layers:
        # add_patch would look at each vertex for limits that are set already: a minute for a coast.
        axes.add_artist(layer)
        layer.set_clip_path(sea)


def _draw_routes(axes: Axes, result: RunResult, season: str, sea: PathPatch) -> None:
    """Draw all candidates thin and the best thick, on a halo."""
    from matplotlib.lines import Line2D

    for ranked in reversed(result.season_routes(season)):
        x, y = np.asarray(ranked.route.path, dtype=float).T
        strokes = [("halo", 4.0, 6), ("best", 2.2, 7)] if ranked.rank == 1 else [("other", 0.7, 5)]
        for role, width, zorder in strokes:
            line = Line2D(
                x,
                y,
                color=COLOURS[role],
                linewidth=width,
                zorder=zorder,
                solid_joinstyle="round",
                solid_capstyle="round",
            )
            axes.add_line(line)
            line.set_clip_path(sea)


def _draw_ends(axes: Axes, result: RunResult) -> None:
    """Mark start (circle) and goal (diamond) and name them, to the left where the right is full."""
    from matplotlib.patheffects import withStroke

    xmin, xmax = axes.get_xlim()
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
        on_left = x > xmin + 0.72 * (xmax - xmin)
        axes.annotate(
            name,
            (x, y),
            xytext=(-8 if on_left else 8, 0),
            textcoords="offset points",
            ha="right" if on_left else "left",
            va="center",
            fontsize=_PLAIN_PT,
            fontweight="bold",
            color=COLOURS["ink"],
            zorder=9,
            path_effects=[withStroke(linewidth=2.4, foreground=COLOURS["halo"])],
        )


def _draw_frame(axes: Axes, result: RunResult, sea: PathPatch) -> None:
    """Draw the grid with its labels, the neat line, and the scale bar."""
    from matplotlib.lines import Line2D

    extent = result.scene.chart.extent
    for line in graticule(result.scene.projection, extent, in_metres=result.scenario.is_planar):
        for part in line.parts:
            drawn = Line2D(part[:, 0], part[:, 1], color=COLOURS["grid"], linewidth=0.5, zorder=1)
            axes.add_line(drawn)
            drawn.set_clip_path(sea)
        _label(axes, line.label, line.foot, below=line.is_meridian)
    frame = _patch(extent, facecolor="none", edgecolor=COLOURS["frame"], linewidth=0.9, zorder=7.5)
    axes.add_patch(frame)
    frame.set_clip_on(False)
    _draw_scale_bar(axes, result)


def _draw_scale_bar(axes: Axes, result: RunResult) -> None:
    """Draw a bar of two fields under the map's right corner, true in the middle of the map."""
    from matplotlib.patches import Rectangle

    bounds = result.scene.chart.bounds
    point = _point(axes)
    length_m, length = scale_bar_m(result.scene.projection, bounds)
    left, low = bounds[2] - 16 * point - length, bounds[1] - 24 * point
    for field, role in enumerate(("ink", "halo")):
        axes.add_patch(
            Rectangle(
                (left + field * length / 2, low),
                length / 2,
                3.2 * point,
                facecolor=COLOURS[role],
                edgecolor=COLOURS["ink"],
                linewidth=0.7,
                clip_on=False,
            )
        )
    unit, size = ("km", length_m / 1000) if length_m >= 1000 else ("m", length_m)
    for share, text in ((0.0, "0"), (0.5, f"{size / 2:g}"), (1.0, f"{size:g} {unit}")):
        _label(axes, text, (left + share * length, low), below=True, gap_pt=2)


def _label(
    axes: Axes, text: str, place: tuple[float, float], *, below: bool, gap_pt: float = 4
) -> None:
    """Write small text below a place, or to its left."""
    axes.annotate(
        text,
        place,
        xytext=(0, -gap_pt) if below else (-gap_pt, 0),
        textcoords="offset points",
        ha="center" if below else "right",
        va="top" if below else "center",
        fontsize=_SMALL_PT,
        color=COLOURS["ink"],
        annotation_clip=False,
    )


def _draw_legend(panel: SubFigure, result: RunResult) -> None:
    """Name lines, zones and speeds in one row."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=COLOURS["best"], linewidth=2.2, label="best route"),
        Line2D([], [], color=COLOURS["other"], linewidth=0.8, label="other classes"),
        Patch(facecolor=COLOURS["land"], edgecolor=COLOURS["coast"], label="land"),
        *([Patch(facecolor=COLOURS["shoal"], label="too shallow")] if result.shoals else []),
        Patch(facecolor=COLOURS["soft"], alpha=_SOFT_ALPHA, label="soft no-go"),
    ]
    labels = speed_scale(result).labels
    handles += [
        Line2D(
            [],
            [],
            color=COLOURS[f"speed{i}"],
            marker=">",
            markersize=5,
            label=text if i + 1 < len(labels) else f"{text} m/s",
        )
        for i, text in enumerate(labels)
    ]
    panel.legend(
        handles=handles,
        loc="center",
        # A narrow picture, of one season, has room for two rows of them.
        ncols=len(handles) if len(result.plans) > 1 else 5,
        frameon=False,
        fontsize=7.5,
        labelcolor=COLOURS["ink"],
        handlelength=1.6,
        columnspacing=1.2,
        handletextpad=0.5,
    )


def _point(axes: Axes) -> float:
    """Length in the plane of a point (1/72 inch) on paper."""
    box = axes.get_position()
    width_in, height_in = axes.figure.bbox.width, axes.figure.bbox.height
    points = _POINTS_PER_INCH / axes.figure.dpi
    (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
    # The narrower of the two decides, since the axes keep their aspect.
    return float(
        max(
            (xmax - xmin) / (box.width * width_in * points),
            (ymax - ymin) / (box.height * height_in * points),
        )
    )


def _patch(areas: BaseGeometry | npt.NDArray[np.object_], **style: object) -> PathPatch:
    """Make one path of all rings of all areas, so that a picture holds one element a layer."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    rings = shapely.get_rings(shapely.get_parts(areas))
    outlines = [Outline(shapely.get_coordinates(ring), closed=True) for ring in rings]
    whole = Outline.make_compound_path(*outlines) if outlines else Outline(np.empty((0, 2)))
    return PathPatch(whole, **style)


def _drawable(text: str, limit: int = 60) -> str:
    """Text that the default font can draw, shortened: no missing glyphs, no controls."""
    from matplotlib import font_manager
    from matplotlib.ft2font import FT2Font

    known = FT2Font(font_manager.findfont("DejaVu Sans")).get_charmap()
    shown = "".join(c if c.isprintable() and ord(c) in known else "\N{WHITE SQUARE}" for c in text)
    return shown if len(shown) <= limit else shown[: limit - 1] + "…"
