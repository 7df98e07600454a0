"""Parts of all figures: axes in points, lines, areas, text, a scale bar; figures as SVG.

They use matplotlib's object interface, without pyplot and global settings.
"""

import io
import re
from functools import cache

import matplotlib as mpl
import numpy as np
import shapely
from markupsafe import Markup, escape
from matplotlib import font_manager
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.ft2font import FT2Font
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath

from pipeline._types import ArrayLike, FloatArray, Geometries
from pipeline.findings.result import RunResult
from pipeline.formats.figures.map_marks import scale_bar_m
from pipeline.formats.palette import COLOURS
from pipeline.geo.projection import Projection
from pipeline.texts import clean

POINTS_PER_INCH = 72.0
SMALL_PT, PLAIN_PT = 8.2, 9.5
# Length of a scale bar, points, below which it has room for one label only, beside it.
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


def lines(edges: FloatArray, colour: str, width_pt: float, zorder: float) -> LineCollection:
    """Return segments (e, 2, 2) as one artist."""
    return LineCollection(list(edges), colors=colour, linewidths=width_pt, zorder=zorder)


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
    """Replace the best route's colour in a figure, or a part of it, by a season's."""
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
    """Write each island's number or name on it, on a halo, below the routes' ends."""
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
    # The only text from elsewhere is the label.
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
