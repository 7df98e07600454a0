"""A matplotlib figure as an `<svg>` element for an HTML page."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from pipeline.formats.figures.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Parts of matplotlib's SVG that a page must not have: a style rule for every element, which would
# affect the whole page, the fonts of this machine, metadata and comments.
_UNWANTED = (
    r"<metadata>.*?</metadata>",
    r"<defs>\s*<style.*?</style>\s*</defs>",
    r"<!--.*?-->",
    r"font-family: [^;\"]*; ?",
    r' transform="rotate\(-0 [^"]*"',
)


def page_svg(figure: Figure, *, identity: str, label: str) -> Markup:
    """Draw a figure as an `<svg>` element whose colours the page sets.

    `identity` (letters, digits, hyphens) prefixes its ids, so that they are unique in the page;
    `label` is what a screen reader says, escaped here. Colours become
    `var(--map-<role>, <light colour>)`. Text stays text, in the page's font and scaled by
    `var(--text)`.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    FigureCanvasSVG(figure)
    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    for pattern in _UNWANTED:
        text = re.sub(pattern, "", text, flags=re.DOTALL)
    text = re.sub(r'\bd="([^"]*)"', _rounded_path, text)
    text = re.sub(r'\b([xy])="(-?[\d.]+)"', _rounded_coordinate, text)
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


def _rounded_coordinate(match: re.Match[str]) -> str:
    """Round a coordinate to a tenth of a point."""
    return f'{match[1]}="{float(match[2]):.1f}"'.replace(".0", "")


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
