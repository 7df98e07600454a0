"""Artists that all figures are made of: axes in points, lines, areas, text and a scale bar.

They use matplotlib's object interface, without pyplot and global settings.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from pipeline._types import FloatArray
from pipeline.formats.figures.graticule import scale_bar_m
from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import shortened
from pipeline.geo.projection import Projection

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import PathPatch

POINTS_PER_INCH = 72.0
SMALL_PT, PLAIN_PT = 8.2, 9.5
# Length of a scale bar, points, below which it has room for one label only, beside it.
_SHORT_BAR_PT = 45.0
# Width of a small letter or figure, points.
_LETTER_PT = 0.6 * SMALL_PT
# Length of the longest name, in characters, that is drawn whole.
_MAX_LENGTH = 24


def axes_at(figure: Figure, box_pt: tuple[float, float, float, float]) -> Axes:
    """Axes without frame, of equal scales, in a box (left, bottom, width, height) in points."""
    figure_width, figure_height = figure.get_size_inches() * POINTS_PER_INCH
    left, bottom, width, height = box_pt
    axes = figure.add_axes(
        (
            left / figure_width,
            bottom / figure_height,
            width / figure_width,
            height / figure_height,
        )
    )
    axes.set_axis_off()
    axes.set_aspect("equal")
    return axes


def stroke(path: npt.ArrayLike, colour: str, width_pt: float, zorder: float) -> Line2D:
    """A path (n, 2) as a line with round corners."""
    from matplotlib.lines import Line2D

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


def lines(edges: FloatArray, colour: str, width_pt: float, zorder: float) -> LineCollection:
    """Segments (e, 2, 2) as one artist."""
    from matplotlib.collections import LineCollection

    return LineCollection(list(edges), colors=colour, linewidths=width_pt, zorder=zorder)


def draw_scale_bar(axes: Axes, projection: Projection, *, drop_pt: float = 24.0) -> None:
    """Draw a scale bar of two fields below the map's right corner, true in the map's middle."""
    from matplotlib.patches import Rectangle

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
    """Length in the plane of a typographic point (1/72 inch) on paper."""
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


def patch(areas: BaseGeometry | npt.NDArray[np.object_], **style: object) -> PathPatch:
    """One patch of all rings of all areas, so that an SVG has one element per layer."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    rings = shapely.get_rings(shapely.get_parts(areas))
    outlines = [Outline(shapely.get_coordinates(ring), closed=True) for ring in rings]
    whole = Outline.make_compound_path(*outlines) if outlines else Outline(np.empty((0, 2)))
    return PathPatch(whole, **style)


def drawable(text: str, limit: int = 60) -> str:
    """Text that the default font can draw, shortened: no missing glyphs, no control characters."""
    known = _glyphs()
    shown = "".join(c if c.isprintable() and ord(c) in known else "\N{WHITE SQUARE}" for c in text)
    return shortened(shown, limit)


def in_season_colour(drawn: Artist, colour: str) -> None:
    """Recolour what a figure or a part of it has in the best route's colour, by a season's.

    A page does so by `var(--map-best)`.
    """
    from matplotlib.colors import same_color

    for artist in drawn.findobj():
        for name in ("color", "edgecolor", "markeredgecolor", "markerfacecolor"):
            get = getattr(artist, f"get_{name}", None)
            value = get() if get is not None else None
            if isinstance(value, str) and same_color(value, COLOURS["best"]):
                getattr(artist, f"set_{name}")(colour)


@cache
def text_width(text: str, size_pt: float, *, bold: bool = False) -> float:
    """Width of a text in the default font, points."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    if not text.strip():
        return 0.0
    return float(TextPath((0, 0), text, size=size_pt, prop=font, usetex=False).get_extents().width)


@cache
def _glyphs() -> frozenset[int]:
    """Code points that the default font has, in regular and bold."""
    from matplotlib import font_manager
    from matplotlib.ft2font import FT2Font

    plain, bold = (
        FT2Font(font_manager.findfont(f"DejaVu Sans:{weight}")).get_charmap()
        for weight in ("regular", "bold")
    )
    return frozenset(plain.keys() & bold.keys())


def draw_island_labels(axes: Axes, result: RunResult) -> None:
    """Write each island's number or name on it, on a halo, below the routes' ends."""
    from matplotlib.patheffects import withStroke

    for island in result.evaluation.islands:
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
