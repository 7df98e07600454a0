"""QGIS's symbols, rules and labels, sizes in millimetres on paper; and its XML, by templates."""

import base64
import re
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from jinja2 import Environment

from pipeline.formats.shared.text import XML_FORBIDDEN, shortened, xml_environment, xml_text

# Maximum number of characters of a name in the list of layers.
_MAX_TITLE_LENGTH = 60
# An arrow that points up, as slim as those of the report's maps, in a square.
_ARROW_SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100"><path '
    'fill="param(fill)" fill-opacity="param(fill-opacity)" stroke="none" '
    'd="M50 0 L67 42 L54.5 38 L54.5 100 L45.5 100 L45.5 38 L33 42 Z"/></svg>'
)
_ARROW = "base64:" + base64.b64encode(_ARROW_SVG.encode()).decode()


@dataclass(frozen=True)
class SymbolLayer:
    """A layer of a symbol: QGIS's kind and options; `rotation` is an expression, in degrees.

    Where a renderer has levels, layers are drawn in their order, across all features.
    """

    kind: str
    options: Mapping[str, str]
    level: int = 0
    rotation: str = ""


@dataclass(frozen=True)
class Rule:
    """A rule of a renderer: label, condition on features, and symbol.

    `symbol` has layers, bottom first. `finer_than` is the denominator of the smallest scale at
    which it is drawn; 0 means every scale. `on` says whether it is ticked.
    """

    label: str
    condition: str = ""
    symbol: Sequence[SymbolLayer] = ()
    children: "Sequence[Rule]" = ()
    on: bool = True
    finer_than: float = 0.0

    def symbols(self) -> Iterator[Sequence[SymbolLayer]]:
        """Yield its own symbol and its children's symbols, if there are any."""
        if self.symbol:
            yield self.symbol
        for child in self.children:
            yield from child.symbols()


@dataclass(frozen=True)
class Label:
    """Text on a map: an expression, drawn for features that fulfil `condition`."""

    expression: str
    condition: str
    colour: str
    size_pt: float
    along_line: bool = False
    finer_than: float = 0.0


@dataclass(frozen=True)
class Style:
    """How a layer's features are drawn and labelled, and the layer's opacity.

    `kind` is line, fill or marker, to suit the layer's geometry.
    """

    kind: str
    rules: Sequence[Rule]
    labels: Sequence[Label] = ()
    levels: bool = False
    opacity: float = 1.0

    @property
    def symbols(self) -> list[Sequence[SymbolLayer]]:
        """Symbols of all rules, in their order."""
        return [symbol for rule in self.rules for symbol in rule.symbols()]


def colour(hexadecimal: str, opacity: float = 1.0) -> str:
    """Write a colour such as "#c9a97c" as QGIS does: red,green,blue,alpha."""
    red, green, blue = bytes.fromhex(hexadecimal.removeprefix("#"))
    return f"{red},{green},{blue},{round(255 * opacity)}"


def line(line_colour: str, width: float, *, level: int = 0) -> SymbolLayer:
    """Line in a colour that `colour` gives."""
    return SymbolLayer(
        "SimpleLine",
        {
            "line_color": line_colour,
            "line_width": f"{width:g}",
            "line_width_unit": "MM",
            "capstyle": "round",
            "joinstyle": "round",
            "customdash": "5;2",
            "customdash_unit": "MM",
            "use_custom_dash": "0",
        },
        level,
    )


def fill(
    fill_colour: str, outline: str = "", width: float = 0.0, *, dotted: bool = False
) -> SymbolLayer:
    """Filled area, with an outline if its colour is given."""
    style = "dot" if dotted else "solid"
    return SymbolLayer(
        "SimpleFill",
        {
            "color": fill_colour,
            "style": "solid",
            "outline_color": outline or fill_colour,
            "outline_style": style if outline else "no",
            "outline_width": f"{width:g}",
            "outline_width_unit": "MM",
            "joinstyle": "round",
        },
    )


def marker(
    shape: str, fill_colour: str, outline: str, size: float, width: float = 0.0, *, level: int = 0
) -> SymbolLayer:
    """Marker of a shape that QGIS knows, such as circle, diamond or cross2."""
    return SymbolLayer(
        "SimpleMarker",
        {
            "name": shape,
            "color": fill_colour,
            "outline_color": outline,
            "outline_style": "solid" if width else "no",
            "outline_width": f"{width:g}",
            "outline_width_unit": "MM",
            "size": f"{size:g}",
            "size_unit": "MM",
        },
        level,
    )


def arrow(
    fill_colour: str, length_m: float, rotation: str, limits_mm: tuple[float, float]
) -> SymbolLayer:
    """Arrow of a true length (m) within limits on paper, rotated by an expression.

    The expression gives degrees clockwise from up.
    """
    shortest, longest = limits_mm
    return SymbolLayer(
        "SvgMarker",
        {
            "name": _ARROW,
            "color": fill_colour,
            "outline_width": "0",
            "size": f"{length_m:.6g}",
            "size_unit": "RenderMetersInMapUnits",
            "size_map_unit_scale": f"3x:0,0,1,{shortest:g},1,{longest:g}",
        },
        rotation=rotation,
    )


def rendered(template: str, **values: object) -> str:
    """Fill in a template."""
    return _environment().get_template(template).render(values).lstrip()


def clean(text: str) -> str:
    """Text that is plain text to XML, and to QGIS, which evaluates what is between [% and %]."""
    return xml_text(text).replace("[%", "[\N{WORD JOINER}%")


def one_line(text: str, limit: int = _MAX_TITLE_LENGTH) -> str:
    """Clean text on one line, of at most `limit` characters."""
    return shortened(" ".join(clean(text).split()), limit)


def literal(text: str) -> str:
    """Write text as a string of QGIS's expression language."""
    parts = re.split(f"({XML_FORBIDDEN.pattern})", text)
    terms = [
        f"char({ord(part)})"
        if index % 2
        else "'" + part.replace("\\", "\\\\").replace("'", "''").replace("\n", "\\n") + "'"
        for index, part in enumerate(parts)
    ]
    return " || ".join(term for term in terms if term != "''") or "''"


@cache
def _environment() -> Environment:
    """Load the templates."""
    loaded = xml_environment("pipeline.formats.gis")
    loaded.filters.update(
        clean=clean,
        g=lambda value: f"{value:g}",
        # Where QGIS shows HTML: no markup takes effect.
        html=lambda text: clean(text).replace("<", "&lt;"),
        title_line=one_line,
        uuid=lambda name: f"{{{uuid.uuid5(uuid.NAMESPACE_URL, f'renew:{name}')}}}",
    )
    return loaded
