"""QGIS styles of the layers, the same for a layer by itself and inside the project.

`styles.toml` has them, but for arrows of currents and names along routes, which depend on the run.
"""

import base64
import tomllib
from collections.abc import Iterable
from importlib.resources import files
from itertools import pairwise
from typing import Any

from pipeline.findings.columns import COLUMNS
from pipeline.formats.figures.map_marks import speed_labels
from pipeline.formats.gis.frames import LAYERS
from pipeline.formats.gis.qgis import CaseView, View, literal, one_line, rendered
from pipeline.formats.palette import COLOURS

STYLES: dict[str, dict[str, Any]] = tomllib.loads(
    files("pipeline.formats.gis").joinpath("styles.toml").read_text(encoding="utf-8")
)
"""Layer -> how it is drawn, in the drawing order of layers, from the top down."""

# Geometry type of a layer -> the kind of its symbols.
_SYMBOLS = {"LineString": "line", "Point": "marker", "MultiPolygon": "fill"}
# Minimum and maximum length of the strongest arrows on paper, mm; closer points are thinned out.
_ARROW_MM = (5.5, 12.0)
# Length of an arrow of speed 0, as a share of the strongest's.
_SHORTEST = 0.4
# Maximum number of characters of a case's title along its route.
_MAX_LABEL_LENGTH = 32
# What a rule has unless it says otherwise.
_RULE: dict[str, Any] = {"condition": "", "symbol": (), "children": (), "on": True, "finer_than": 0}
# An arrow that points up, as slim as those of the report's maps, in a square.
_ARROW_SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100"><path '
    'fill="param(fill)" fill-opacity="param(fill-opacity)" stroke="none" '
    'd="M50 0 L67 42 L54.5 38 L54.5 100 L45.5 100 L45.5 38 L33 42 Z"/></svg>'
)


def qml(layer: str, view: View, columns: Iterable[str]) -> str:
    """Write a layer's style as a QML document."""
    return rendered("layer.qml.jinja", style=style(layer, view), columns=columns, fields=COLUMNS)


def style(layer: str, view: View) -> dict[str, Any]:
    """Return how a layer's features are drawn and labelled, for the templates."""
    about = STYLES[layer]
    if not about.get("by_case"):
        rules = _rules(layer, view, None)
    elif len(view.cases) == 1:
        rules = _rules(layer, view, view.cases[0])
    else:
        rules = [
            {
                **_RULE,
                "label": case.title,
                "condition": _of(case),
                "children": _rules(layer, view, case),
                "on": case.leads or "all_cases_on" in about,
            }
            for case in view.cases
        ]
    return {
        "kind": _SYMBOLS[LAYERS[layer].geometry_type],
        "rules": rules,
        "symbols": [one["symbol"] for rule in rules for one in rule["children"] or [rule]],
        "labels": [
            *_case_labels(layer, view),
            *(_label(one, view) for one in about.get("labels", ())),
        ],
        "levels": "levels" in about,
        "opacity": about.get("opacity", 1.0),
    }


def _rules(layer: str, view: View, case: CaseView | None) -> list[dict[str, Any]]:
    """Return the rules by which the features of a case are drawn, or those of the chart."""
    if layer == "currents" and case is not None:
        return _arrows(view, case)
    leads = case is not None and case.leads
    rules = []
    for rule in STYLES[layer]["rules"]:
        symbol = rule.get("leading_symbol", rule["symbol"]) if leads else rule["symbol"]
        on = rule.get("on", True)
        rules.append(
            {
                **_RULE,
                **rule,
                "symbol": [_symbol_layer(one, case) for one in symbol],
                "on": leads if on == "if leading" else on,
                "finer_than": _finer_than(rule, view),
            }
        )
    return rules


def _label(about: dict[str, Any], view: View) -> dict[str, Any]:
    """Return a label of ink for the templates."""
    defaults = {"condition": "", "colour": _colour("ink"), "along_line": False}
    return {**defaults, **about, "finer_than": _finer_than(about, view)}


def _finer_than(about: dict[str, Any], view: View) -> float:
    """Return the denominator of the smallest scale of a rule or label; 0 for every scale."""
    return view.full_scale / 4 if about.get("close") else 0.0


def _case_labels(layer: str, view: View) -> list[dict[str, Any]]:
    """Return labels of the best routes: titles of cases along them, names of the leading's ends."""
    if layer == "routes":
        return [
            {
                "expression": literal(one_line(case.title, _MAX_LABEL_LENGTH)),
                "condition": f'"rank" = 1 AND {_of(case)}',
                "colour": _colour(case.colour),
                "size_pt": 9,
                "along_line": True,
                "finer_than": 0.0,
            }
            for case in view.cases
        ]
    ends = '"rank" = 1 AND ("sequence" = 1 OR "course_deg" IS NULL)'
    return [
        _label(
            {"expression": '"name"', "condition": f"{ends} AND {_of(case)}", "size_pt": 10}, view
        )
        for case in view.cases
        if layer == "passage" and (case.leads or len(view.cases) == 1)
    ]


def _arrows(view: View, case: CaseView) -> list[dict[str, Any]]:
    """Draw arrows towards which the current sets: darker and longer if stronger.

    An arrow has a true length within limits on paper.
    """
    rotation = '"direction"' + (f" - {view.convergence}" if view.convergence else "")
    limits = view.speed_limits
    rules = []
    for index, (lower, upper) in enumerate(pairwise((0.0, *limits))):
        share = _SHORTEST + (1 - _SHORTEST) * (index + 1) / len(limits)
        upto = f' AND "speed" <= {upper:g}' if index + 1 < len(limits) else ""
        shortest_mm, longest_mm = (share * length for length in _ARROW_MM)
        options = {
            "name": "base64:" + base64.b64encode(_ARROW_SVG.encode()).decode(),
            "color": _colour(f"speed{index}"),
            "outline_width": "0",
            "size": f"{share * case.spacing_m:.6g}",
            "size_unit": "RenderMetersInMapUnits",
            "size_map_unit_scale": f"3x:0,0,1,{shortest_mm:g},1,{longest_mm:g}",
        }
        rules.append(
            {
                **_RULE,
                "label": f"{speed_labels(limits)[index]} m/s",
                "condition": f'"speed" > {lower:g}{upto}{_thinned(case, view.full_scale)}',
                "symbol": [
                    {"kind": "SvgMarker", "options": options, "level": 0, "rotation": rotation}
                ],
            }
        )
    return rules


def _thinned(case: CaseView, full_scale: float) -> str:
    """Return a condition that omits points that would be too close on a map of the whole chart."""
    min_spacing_m = _ARROW_MM[0] / 1000 * full_scale
    every = round(min_spacing_m / case.spacing_m + 0.49)
    if case.step_deg is None or every < 2:
        return ""
    (west, south), (east, north) = case.origin, case.step_deg
    roomy_scale = 1000 * case.spacing_m / _ARROW_MM[0]
    return (
        f" AND (@map_scale < {roomy_scale:.0f}"
        f" OR (round((x($geometry) - {west:.10g}) / {east:.10g}) % {every} = 0"
        f" AND round((y($geometry) - {south:.10g}) / {north:.10g}) % {every} = 0))"
    )


def _of(case: CaseView) -> str:
    """Return the condition that a feature belongs to a case."""
    return f'"season" = {literal(case.name)}'


def _symbol_layer(about: dict[str, Any], case: CaseView | None) -> dict[str, Any]:
    """Return a layer of a symbol, as `styles.toml` describes it, with QGIS's class and options."""

    def colour(key: str) -> str:
        return _colour(about[key], case)

    width = f"{about.get('width', 0):g}"
    if "line" in about:
        kind, options = (
            "SimpleLine",
            {
                "line_color": colour("line"),
                "line_width": width,
                "line_width_unit": "MM",
                "capstyle": "round",
                "joinstyle": "round",
                "customdash": "5;2",
                "customdash_unit": "MM",
                "use_custom_dash": "0",
            },
        )
    elif "marker" in about:
        kind, options = (
            "SimpleMarker",
            {
                "name": about["marker"],
                "color": colour("fill"),
                "outline_color": colour("edge"),
                "outline_style": "solid" if "width" in about else "no",
                "outline_width": width,
                "outline_width_unit": "MM",
                "size": f"{about['size']:g}",
                "size_unit": "MM",
            },
        )
    else:
        edge_style = "dot" if about.get("dotted") else "solid"
        kind, options = (
            "SimpleFill",
            {
                "color": colour("fill"),
                "style": "solid",
                "outline_color": colour("edge" if "edge" in about else "fill"),
                "outline_style": edge_style if "edge" in about else "no",
                "outline_width": width,
                "outline_width_unit": "MM",
                "joinstyle": "round",
            },
        )
    return {"kind": kind, "options": options, "level": about.get("level", 0), "rotation": ""}


def _colour(about: str, case: CaseView | None = None) -> str:
    """Write a colour, such as "case 0.6" or "#c9a97c", as QGIS does: red,green,blue,alpha."""
    name, _, opacity = about.partition(" ")
    own = case.colour if case is not None and name == "case" else COLOURS.get(name, name)
    red, green, blue = bytes.fromhex(own.removeprefix("#"))
    return f"{red},{green},{blue},{round(255 * float(opacity or 1))}"
