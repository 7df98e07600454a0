"""QGIS's symbols, rules and labels as XML elements; sizes in millimetres on paper."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lxml import etree

from pipeline.formats.gis.layers.fields import FIELDS
from pipeline.formats.shared.text import shortened
from pipeline.formats.shared.xml_text import XML_FORBIDDEN, xml_text

Element = Any  # lxml has no types

MAX_TITLE_LENGTH = 60
"""Maximum number of characters of a name in the list of layers."""

# An arrow that points up, as slim as those of the report's maps, in a square.
_ARROW_SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100"><path '
    'fill="param(fill)" fill-opacity="param(fill-opacity)" stroke="none" '
    'd="M50 0 L67 42 L54.5 38 L54.5 100 L45.5 100 L45.5 38 L33 42 Z"/></svg>'
)
_ARROW = "base64:" + base64.b64encode(_ARROW_SVG.encode()).decode()


@dataclass(frozen=True)
class Rule:
    """A rule of a renderer: label, condition on features, and symbol.

    `symbol` has layers, bottom first. `finer_than` is the denominator of the smallest scale at
    which it is drawn; 0 means every scale. `on` says whether it is ticked.
    """

    label: str
    condition: str = ""
    symbol: Sequence[Element] = ()
    children: Sequence[Rule] = ()
    on: bool = True
    finer_than: float = 0.0


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
    """How a layer's features are drawn and labelled, and the layer's opacity."""

    renderer: Element
    labels: Element | None = None
    opacity: float = 1.0

    def put(self, layer: Element, columns: Iterable[str]) -> None:
        """Write the style into a layer's element, with aliases for its columns."""
        layer.set("labelsEnabled", "0" if self.labels is None else "1")
        layer.set("simplifyDrawingHints", "1")
        layer.append(self.renderer)
        if self.labels is not None:
            layer.append(self.labels)
        etree.SubElement(layer, "layerOpacity").text = f"{self.opacity:g}"
        aliases = etree.SubElement(layer, "aliases")
        for index, column in enumerate(columns):
            etree.SubElement(
                aliases, "alias", field=column, index=str(index), name=FIELDS[column].alias
            )


def clean(text: str) -> str:
    """Text that is plain text to XML, and to QGIS, which evaluates what is between [% and %]."""
    return xml_text(text).replace("[%", "[\N{WORD JOINER}%")


def one_line(text: str, limit: int) -> str:
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


def colour(hexadecimal: str, opacity: float = 1.0) -> str:
    """Write a colour such as "#c9a97c" as QGIS does: red,green,blue,alpha."""
    red, green, blue = bytes.fromhex(hexadecimal.removeprefix("#"))
    return f"{red},{green},{blue},{round(255 * opacity)}"


def line(drawn: str, width: float, *, dash: str = "", level: int = 0) -> Element:
    """Line in a colour from `colour`."""
    return _layer(
        "SimpleLine",
        {
            "line_color": drawn,
            "line_width": f"{width:g}",
            "line_width_unit": "MM",
            "capstyle": "flat" if dash else "round",
            "joinstyle": "round",
            "customdash": dash or "5;2",
            "customdash_unit": "MM",
            "use_custom_dash": "1" if dash else "0",
        },
        level,
    )


def fill(filled: str, outline: str = "", width: float = 0.0, *, dotted: bool = False) -> Element:
    """Filled area, with an outline if its colour is given."""
    style = "dot" if dotted else "solid"
    return _layer(
        "SimpleFill",
        {
            "color": filled,
            "style": "solid",
            "outline_color": outline or filled,
            "outline_style": style if outline else "no",
            "outline_width": f"{width:g}",
            "outline_width_unit": "MM",
            "joinstyle": "round",
        },
    )


def marker(
    shape: str, filled: str, outline: str, size: float, width: float = 0.0, *, level: int = 0
) -> Element:
    """Marker of a shape that QGIS knows, such as circle, diamond or cross2."""
    return _layer(
        "SimpleMarker",
        {
            "name": shape,
            "color": filled,
            "outline_color": outline,
            "outline_style": "solid" if width else "no",
            "outline_width": f"{width:g}",
            "outline_width_unit": "MM",
            "size": f"{size:g}",
            "size_unit": "MM",
        },
        level,
    )


def arrow(filled: str, length_m: float, rotation: str, limits_mm: tuple[float, float]) -> Element:
    """Arrow of a true length (m) within limits on paper, rotated by an expression.

    The expression gives degrees clockwise from up.
    """
    shortest, longest = limits_mm
    layer = _layer(
        "SvgMarker",
        {
            "name": _ARROW,
            "color": filled,
            "outline_width": "0",
            "size": f"{length_m:.6g}",
            "size_unit": "RenderMetersInMapUnits",
            "size_map_unit_scale": f"3x:0,0,1,{shortest:g},1,{longest:g}",
        },
    )
    properties = etree.SubElement(layer, "data_defined_properties")
    collection = etree.SubElement(properties, "Option", type="Map")
    _option(collection, "name", "")
    angle = etree.SubElement(
        etree.SubElement(collection, "Option", type="Map", name="properties"),
        "Option",
        type="Map",
        name="angle",
    )
    _option(angle, "active", "true", "bool")
    _option(angle, "expression", rotation)
    _option(angle, "type", "3", "int")
    _option(collection, "type", "collection")
    return layer


def rule_renderer(kind: str, rules: Iterable[Rule], *, levels: bool = False) -> Element:
    """Renderer by rules; `kind` is line, fill or marker, to suit the layer's geometry.

    With `levels` the layers of symbols are drawn in the order of their levels, across all features.
    """
    renderer = etree.Element(
        "renderer-v2", type="RuleRenderer", symbollevels="1" if levels else "0", forceraster="0"
    )
    root = etree.SubElement(renderer, "rules", key="renderer")
    symbols = etree.SubElement(renderer, "symbols")
    for index, rule in enumerate(rules):
        _put_rule(root, symbols, rule, kind, f"rule-{index}")
    return renderer


def labeling(labels: Iterable[Label]) -> Element:
    """Labelling by rules."""
    element = etree.Element("labeling", type="rule-based")
    root = etree.SubElement(element, "rules", key="labels")
    for index, label in enumerate(labels):
        rule = etree.SubElement(
            root, "rule", key=f"label-{index}", filter=label.condition, active="1"
        )
        _limit_scale(rule, label.finer_than)
        settings = etree.SubElement(rule, "settings", calloutType="simple")
        style = etree.SubElement(
            settings,
            "text-style",
            fieldName=label.expression,
            isExpression="1",
            fontSize=f"{label.size_pt:g}",
            fontSizeUnit="Point",
            fontWeight="75",
            namedStyle="Bold",
            textColor=label.colour,
            textOpacity="1",
        )
        etree.SubElement(
            style,
            "text-buffer",
            bufferDraw="1",
            bufferColor="253,254,254,255",
            bufferSize="0.8",
            bufferSizeUnits="MM",
            bufferOpacity="0.9",
            bufferNoFill="0",
            bufferJoinStyle="128",
        )
        # 3: curved along a line, above or below it; 6: around a point, off its symbol.
        etree.SubElement(
            settings,
            "placement",
            placement="3" if label.along_line else "6",
            placementFlags="10",
            predefinedPositionOrder="R,L,TR,BR,TL,BL,TSR,BSR",
            offsetType="1",
            dist="1",
            distUnits="MM",
            priority="8",
        )
        etree.SubElement(
            settings, "rendering", drawLabels="1", obstacle="1", obstacleFactor="1", mergeLines="0"
        )
    return element


def _put_rule(parent: Element, symbols: Element, rule: Rule, kind: str, key: str) -> None:
    """Add a rule with its children and its symbol."""
    element = etree.SubElement(
        parent, "rule", key=key, label=one_line(rule.label, MAX_TITLE_LENGTH)
    )
    if rule.condition:
        element.set("filter", rule.condition)
    if not rule.on:
        element.set("checkstate", "0")
    _limit_scale(element, rule.finer_than)
    if len(rule.symbol):
        number = str(len(symbols))
        element.set("symbol", number)
        symbol = etree.SubElement(
            symbols, "symbol", type=kind, name=number, alpha="1", clip_to_extent="1"
        )
        symbol.extend(rule.symbol)
    for index, child in enumerate(rule.children):
        _put_rule(element, symbols, child, kind, f"{key}-{index}")


def _limit_scale(rule: Element, finer_than: float) -> None:
    """Limit a rule to scales larger than 1:`finer_than`."""
    if finer_than:
        rule.set("scalemindenom", "1")
        rule.set("scalemaxdenom", f"{finer_than:.0f}")


def _layer(kind: str, options: Mapping[str, str], level: int = 0) -> Element:
    """Create a layer of a symbol."""
    layer = etree.Element("layer", {"class": kind, "enabled": "1", "locked": "0"})
    layer.set("pass", str(level))
    values = etree.SubElement(layer, "Option", type="Map")
    for name, value in options.items():
        _option(values, name, value)
    return layer


def _option(parent: Element, name: str, value: str, kind: str = "QString") -> None:
    """Add a named value."""
    etree.SubElement(parent, "Option", type=kind, name=name, value=value)
