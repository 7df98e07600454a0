"""How QGIS shows a run: the map's reference system, the styles of the layers, XML by templates.

`styles.toml` has the styles. Only arrows of currents and names along routes are made here, because
they depend on the run. A layer has the same style by itself and in the project.
"""

import base64
import uuid
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import pyproj
import shapely
from jinja2 import Environment

from pipeline._types import FloatArray
from pipeline.findings.names import COLUMNS
from pipeline.findings.result import RunCase, RunResult
from pipeline.findings.text import xml_environment
from pipeline.formats.appearance import COLOURS, season_colour
from pipeline.formats.figures.map_marks import speed_labels, speed_limits
from pipeline.formats.gis.layers import LAYERS
from pipeline.geo.projection import METRES_PER_DEGREE, Projection, bounds_of
from pipeline.texts import clean, table_beside

# Width, metres on paper or screen, at which a map opens.
_MAP_WIDTH_M = 0.25
# Spacing of arrows where the current has no grid, as a share of the chart's longer side.
_SPACING_SHARE = 1 / 24
# Margin around the chart, as a share of its longer side.
_MARGIN = 0.03
# Maximum length of a segment of the chart's edge, as a share of the edge.
_SEGMENT_SHARE = 1 / 64

Bounds: TypeAlias = tuple[float, float, float, float]  # xmin, ymin, xmax, ymax

LONLAT = "EPSG:4326"
"""The reference system of the file."""
_NAME = "Plane of the RENEW planner"
# Maximum error of a UTM zone's scale, as a share: 1.5 mm across an A4 page.
_MAX_SCALE_ERROR = 5e-3
# Latitudes between which there are UTM zones, degrees.
_UTM_LATITUDES_DEG = (-80.0, 84.0)
# Width of a UTM zone, degrees.
_ZONE_DEG = 6
# Maximum distance in longitude, degrees, from the central meridian for the fit of the convergence.
_MAX_LONGITUDE_OFFSET_DEG = 179.0


@dataclass(frozen=True)
class View:
    """What a map shows: some cases, and `lead`, the case that is shown in full at first.

    `speed_limits` are those of the classes of current speed; `full_scale` is the denominator of the
    scale that shows the whole chart; `convergence` is as in `MapCrs`.
    """

    cases: tuple[RunCase, ...]
    lead: RunCase
    speed_limits: tuple[float, ...]
    full_scale: float
    convergence: str = ""


def view(result: RunResult) -> View:
    """Describe how a map shows a run; the case of least fuel leads."""
    ranked = [route for route in result.routes if route.rank == 1]
    lead = min(ranked, key=lambda route: route.metrics.fuel).case if ranked else result.cases[0]
    return View(result.cases, lead, speed_limits(result), _across_m(result) / _MAP_WIDTH_M)


def _across_m(result: RunResult) -> float:
    """Return the chart's longer side, true metres."""
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    return max(xmax - xmin, ymax - ymin) * result.water.projection.scale


@dataclass(frozen=True)
class MapCrs:
    """A map's reference system, and its bounds (xmin, ymin, xmax, ymax) with a margin.

    `authority` is the system's "authority:code", empty without one. `convergence` is the angle in
    degrees of the y axis clockwise from true north, as a QGIS expression of a point's lon/lat;
    empty if north is up.
    """

    system: pyproj.CRS
    authority: str
    bounds: Bounds
    convergence: str = ""

    @property
    def is_lonlat(self) -> bool:
        """Whether the map is in longitudes and latitudes."""
        return self.authority == LONLAT


def map_crs(result: RunResult) -> MapCrs:
    """Choose the reference system of a run's map."""
    projection, extent = result.water.projection, result.water.chart.extent
    outline = shapely.get_coordinates(
        projection.geometry_to_lonlat(shapely.segmentize(extent, extent.length * _SEGMENT_SHARE))
    )
    if np.abs(outline[:, 0]).max() > 180:
        return MapCrs(pyproj.CRS(LONLAT), LONLAT, _bounds(outline))
    # PROJ takes 80 ms to search its database, which does not have the planner's own planes.
    zone = _utm_zone(outline)
    projection = zone or projection
    crs = pyproj.CRS.from_user_input(projection.crs)
    authority = ":".join(crs.to_authority() or ()) if zone else ""
    if not authority:
        crs = pyproj.CRS.from_json_dict({**crs.to_json_dict(), "name": _NAME})
    to_plane = pyproj.Transformer.from_crs("OGC:CRS84", crs, always_xy=True)
    planar = np.stack(to_plane.transform(outline[:, 0], outline[:, 1]), axis=-1)
    return MapCrs(crs, authority, _bounds(planar), _convergence(projection, outline))


def _utm_zone(outline: FloatArray) -> Projection | None:
    """Return the UTM zone of the middle of an outline (n, 2), degrees; None if not to scale."""
    west, south, east, north = bounds_of(outline)
    if south < _UTM_LATITUDES_DEG[0] or north > _UTM_LATITUDES_DEG[1]:
        return None
    zone = int(((west + east) / 2 + 180) // _ZONE_DEG) % (360 // _ZONE_DEG) + 1
    code = (32600 if south + north >= 0 else 32700) + zone
    utm = Projection(f"EPSG:{code}", central_longitude=(zone - 0.5) * _ZONE_DEG - 180)
    return utm if np.abs(utm.point_scale(outline) - 1).max() <= _MAX_SCALE_ERROR else None


def _bounds(points: FloatArray) -> Bounds:
    """Return bounds of points (n, 2) with a margin."""
    xmin, ymin, xmax, ymax = bounds_of(points)
    margin = _MARGIN * max(xmax - xmin, ymax - ymin)
    return xmin - margin, ymin - margin, xmax + margin, ymax + margin


def _convergence(projection: Projection, points: FloatArray) -> str:
    """Return the convergence of the map's plane as a QGIS expression of longitude and latitude.

    Fitted at lon/lat points (n, 2): exact for stereographic, Mercator and Lambert planes, and
    accurate enough for transverse Mercator.
    """
    middle = projection.central_longitude
    # Around a pole the angle jumps, as the longitude does, opposite the central meridian.
    points = points[np.abs(points[:, 0] - middle) < _MAX_LONGITUDE_OFFSET_DEG]
    east, sine = points[:, 0] - middle, np.sin(np.radians(points[:, 1]))
    terms = np.stack([np.ones_like(east), east, east * sine], axis=-1)
    angle = projection.convergence(points)
    constant, slope, slope_up = np.linalg.lstsq(terms, angle, rcond=None)[0].tolist()
    east_of = f"(x($geometry) - {middle:.10g})"
    slopes = f"({slope:.6g} + {slope_up:.6g} * sin(radians(y($geometry))))"
    return f"({constant:.6g} + {east_of} * {slopes})"


# Maximum number of characters of a name in the list of layers.
_MAX_TITLE_LENGTH = 60
# Unit in a column's alias -> number of decimals that QGIS shows; 2 of any other.
_DECIMALS = {"m": 1, "s": 0, "h": 0, "Wh": 0, "° true": 1, "°": 5, "share": 3, "planner's units": 1}


def rendered(template: str, **values: object) -> str:
    """Fill in a template."""
    return _environment().get_template(template).render(values).lstrip()


def inert(text: str) -> str:
    """Break up each [% of a text: QGIS would evaluate what stands between [% and %]."""
    return text.replace("[%", "[ %")


def one_line(text: str, limit: int = _MAX_TITLE_LENGTH) -> str:
    """Shorten a text for QGIS to at most `limit` characters."""
    return clean(inert(text), limit)


def literal(text: str) -> str:
    """Write text as a string of QGIS's expression language."""
    escaped = text.replace("\\", "\\\\").replace("'", "''").replace("\n", "\\n")
    return f"'{escaped}'"


@cache
def _environment() -> Environment:
    loaded = xml_environment("pipeline.formats.gis")
    loaded.filters.update(
        inert=inert,
        decimals=lambda column: _DECIMALS.get(column.alias.rpartition("(")[2].rstrip(")"), 2),
        g=lambda value: f"{value:g}",
        # Escaped, because QGIS may show the text as HTML.
        html=lambda text: inert(text).replace("<", "&lt;"),
        title_line=one_line,
        uuid=lambda name: f"{{{uuid.uuid5(uuid.NAMESPACE_URL, f'renew:{name}')}}}",
    )
    return loaded


STYLES: dict[str, dict[str, Any]] = table_beside(__file__, "styles.toml")
"""Layer -> how it is drawn, in the drawing order of layers, from the top down."""

# Geometry type of a layer -> the kind of its symbols.
_SYMBOLS = {"LineString": "line", "Point": "marker", "MultiPolygon": "fill"}
# Minimum and maximum length of the strongest arrows on paper, mm; closer points are thinned out.
_ARROW_MM = (5.5, 12.0)
# Length of an arrow of speed 0, as a share of the strongest's.
_SHORTEST = 0.4
# Maximum number of characters of a case's title along its route.
_MAX_LABEL_LENGTH = 32
# Defaults of a rule.
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
                "on": case is view.lead or "all_cases_on" in about,
            }
            for case in view.cases
        ]
    return {
        "kind": _SYMBOLS[LAYERS[layer]["geometry_type"]],
        "rules": rules,
        "symbols": [one["symbol"] for rule in rules for one in rule["children"] or [rule]],
        "labels": [
            *_case_labels(layer, view),
            *(_label(one, view) for one in about.get("labels", ())),
        ],
        "levels": "levels" in about,
        "opacity": about.get("opacity", 1.0),
        "times": about.get("times", ()),
        "display": about.get("display", ""),
    }


def _rules(layer: str, view: View, case: RunCase | None) -> list[dict[str, Any]]:
    """Return the rules by which the features of a case are drawn, or those of the chart."""
    if layer == "currents" and case is not None:
        return _arrows(view, case)
    leads = case is view.lead
    rules = []
    for rule in STYLES[layer]["rules"]:
        symbol = rule.get("leading_symbol", rule["symbol"]) if leads else rule["symbol"]
        on = rule.get("on", True)
        rules.append(
            {
                **_RULE,
                **rule,
                "symbol": [symbol_layer(one, case) for one in symbol],
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
    """Return labels of the best routes: titles along them, and names at the leading one's ends."""
    if layer == "routes":
        return [
            {
                "expression": literal(one_line(case.title, _MAX_LABEL_LENGTH)),
                "condition": f'"rank" = 1 AND {_of(case)}',
                "colour": _colour(season_colour(case.number)),
                "size_pt": 9,
                "along_line": True,
                "finer_than": 0.0,
            }
            for case in view.cases
        ]
    ends = '"rank" = 1 AND ("sequence" = 1 OR "course_deg" IS NULL)'
    return [
        _label({"expression": '"name"', "condition": f"{ends} AND {_of(one)}", "size_pt": 10}, view)
        for one in view.cases
        if layer == "passage" and (one is view.lead or len(view.cases) == 1)
    ]


def _arrows(view: View, case: RunCase) -> list[dict[str, Any]]:
    """Return rules that draw the current as arrows: darker and longer if stronger.

    Their length is fixed on the ground, but for a least and a greatest length on paper.
    """
    rotation = '"direction"' + (f" - {view.convergence}" if view.convergence else "")
    limits, spacing_m = view.speed_limits, _across_m(case.run) * _SPACING_SHARE
    thinned = ""
    if (grid := case.grid) is not None:
        steps = [float(np.diff(axis).min()) for axis in (grid.lon, grid.lat)]
        narrow = float(np.cos(np.radians(grid.lat.mean())))
        spacing_m = min(steps[0] * narrow, steps[1]) * METRES_PER_DEGREE
        thinned = _thinned((float(grid.lon[0]), float(grid.lat[0])), steps, spacing_m, view)
    rules = []
    for index, (lower, upper) in enumerate(pairwise((0.0, *limits))):
        share = _SHORTEST + (1 - _SHORTEST) * (index + 1) / len(limits)
        upto = f' AND "speed" <= {upper:g}' if index + 1 < len(limits) else ""
        shortest_mm, longest_mm = (share * length for length in _ARROW_MM)
        options = {
            "name": "base64:" + base64.b64encode(_ARROW_SVG.encode()).decode(),
            "color": _colour(f"speed{index}"),
            "outline_width": "0",
            "size": f"{share * spacing_m:.6g}",
            "size_unit": "RenderMetersInMapUnits",
            "size_map_unit_scale": f"3x:0,0,1,{shortest_mm:g},1,{longest_mm:g}",
        }
        rules.append(
            {
                **_RULE,
                "label": f"{speed_labels(limits)[index]} m/s",
                "condition": f'"speed" > {lower:g}{upto}{thinned}',
                "symbol": [
                    {"kind": "SvgMarker", "options": options, "level": 0, "rotation": rotation}
                ],
            }
        )
    return rules


def _thinned(
    first: tuple[float, float], steps: Sequence[float], spacing_m: float, view: View
) -> str:
    """Return a condition that omits points that would be too close on a map of the whole chart.

    The points are a grid, with its first point and its steps to east and to north in degrees.
    """
    every = round(_ARROW_MM[0] / 1000 * view.full_scale / spacing_m + 0.49)
    if every < 2:
        return ""
    near = [
        f"round(({axis}($geometry) - {begin:.10g}) / {step:.10g}) % {every} = 0"
        for axis, begin, step in zip("xy", first, steps, strict=True)
    ]
    return f" AND (@map_scale < {1000 * spacing_m / _ARROW_MM[0]:.0f} OR ({' AND '.join(near)}))"


def _of(case: RunCase) -> str:
    """Return the condition that a feature belongs to a case."""
    return f'"season" = {literal(case.name)}'


def symbol_layer(about: dict[str, Any], case: RunCase | None = None) -> dict[str, Any]:
    """Return a layer of a symbol, as `styles.toml` describes it, with QGIS's class and options."""

    def colour(key: str) -> str:
        return _colour(about[key], case)

    width = f"{about.get('width', 0):g}"
    kind, options = "SimpleMarker" if "marker" in about else "SimpleFill", {"joinstyle": "round"}
    if "line" in about:
        kind = "SimpleLine"
        options |= {"line_color": colour("line"), "line_width": width, "capstyle": "round"}
    else:
        edge_style = "dot" if about.get("dotted") else "solid"
        options |= {
            "color": colour("fill"),
            "outline_color": colour("edge" if "edge" in about else "fill"),
            "outline_style": edge_style if "width" in about else "no",
            "outline_width": width,
        }
    if "marker" in about:
        options |= {"name": about["marker"], "size": f"{about['size']:g}"}
    return {"kind": kind, "options": options, "level": about.get("level", 0), "rotation": ""}


def _colour(about: str, case: RunCase | None = None) -> str:
    """Write a colour, such as "case 0.6" or "#c9a97c", as QGIS does: red,green,blue,alpha."""
    name, _, opacity = about.partition(" ")
    own = COLOURS.get(name, name)
    if case is not None and name == "case":
        own = season_colour(case.number)
    red, green, blue = bytes.fromhex(own.removeprefix("#"))
    return f"{red},{green},{blue},{round(255 * float(opacity or 1))}"
