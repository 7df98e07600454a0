"""A matplotlib figure as an `<svg>` element that lives inside a page."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

from pipeline.formats.pictures.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# What matplotlib writes and a page has no use for. Its one style rule names every element, which
# here would be the whole page's.
_UNWANTED = (r"<metadata>.*?</metadata>", r"<defs>\s*<style.*?</style>\s*</defs>", r"<!--.*?-->")


def page_svg(figure: Figure, *, identity: str, label: str) -> str:
    """Draw a figure as an `<svg>` element whose colours the page decides.

    `identity` (letters, digits, hyphens) keeps its ids apart from those of other pictures; `label`
    is what a screen reader says, escaped here. Colours become `var(--map-<role>, <light colour>)`.
    """
    from markupsafe import escape
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    FigureCanvasSVG(figure)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    for pattern in _UNWANTED:
        text = re.sub(pattern, "", text, flags=re.DOTALL)
    text = re.sub(r'\bd="([^"]*)"', _shorter_path, text)
    text = _rename_ids(text.replace("xlink:href", "href"), identity)
    for role, colour in COLOURS.items():
        text = text.replace(colour, f"var(--map-{role}, {colour})")
    text = re.sub(r"\s*\n\s*", "\n", text)
    head, _, body = text.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    if box is None:
        raise ValueError("matplotlib wrote an SVG without a viewBox")
    return (
        f'<svg class="map" xmlns="http://www.w3.org/2000/svg" {box[0]} role="img"'
        f' aria-label="{escape(label)}">{body.strip()}'
    )


def _shorter_path(match: re.Match[str]) -> str:
    """Write a path's coordinates to a tenth of a point, on one line."""
    path = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}", match[1])
    path = re.sub(r"\.0\b", "", path)
    path = re.sub(r" ?([MLCQzZ]) ?", r"\1", " ".join(path.split()))
    return f'd="{path}"'


def _rename_ids(text: str, identity: str) -> str:
    """Number ids in order of appearance, since matplotlib draws some of them at random."""
    names = {
        name: f"{identity}-{number}"
        for number, name in enumerate(dict.fromkeys(re.findall(r'\bid="([^"]+)"', text)))
    }

    def renamed(match: re.Match[str]) -> str:
        return f"{match[1]}{names.get(match[2], match[2])}{match[3]}"

    text = re.sub(r'(\bid=")([^"]+)(")', renamed, text)
    text = re.sub(r"(url\(#)([^)]+)(\))", renamed, text)
    return re.sub(r'(href="#)([^"]+)(")', renamed, text)
