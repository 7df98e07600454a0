"""How QGIS shows a run: the view of the map, its symbols and labels, and its XML by templates."""

import base64
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TypeAlias

import numpy as np
import pyproj
import shapely
from jinja2 import Environment

from pipeline._types import FloatArray
from pipeline.findings.result import RunResult
from pipeline.findings.text import xml_environment
from pipeline.formats.figures.map_marks import speed_limits
from pipeline.formats.palette import season_colour
from pipeline.geo.lonlat import METRES_PER_DEGREE, bounds_of
from pipeline.geo.projection import Projection
from pipeline.texts import clean

# Width, metres on paper or screen, at which a map opens.
_MAP_WIDTH_M = 0.25
# Spacing of arrows where the current has no grid, as a share of the chart's longer side.
_SPACING_SHARE = 1 / 24
# Margin around the chart, as a share of its longer side.
_MARGIN = 0.03
# Maximum length of a segment of the chart's edge, as a share of the edge.
_SEGMENT_SHARE = 1 / 64

Bounds: TypeAlias = tuple[float, float, float, float]  # xmin, ymin, xmax, ymax

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
class CaseView:
    """How a case is shown.

    `number` identifies it inside a project, whatever its name. `leads` marks the case that is
    shown in full at first. `spacing_m` is the distance between the current's points in true metres;
    if they are a grid, `origin` and `step_deg` give its first point and steps to east and north.
    """

    number: int
    name: str
    title: str
    colour: str
    leads: bool
    planned: bool
    spacing_m: float
    origin: tuple[float, float] = (0.0, 0.0)
    step_deg: tuple[float, float] | None = None


@dataclass(frozen=True)
class View:
    """A map's cases, limits of its classes of speed, and scale (denominator) that shows all of it.

    `convergence` is as in `MapCrs`.
    """

    cases: tuple[CaseView, ...]
    speed_limits: tuple[float, ...]
    full_scale: float
    convergence: str = ""


def view(result: RunResult) -> View:
    """Describe how a map shows a run."""
    ranked = [route for route in result.routes if route.rank == 1]
    lead = min(ranked, key=lambda route: route.metrics.fuel).case if ranked else result.cases[0]
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    across_m = max(xmax - xmin, ymax - ymin) * result.water.projection.scale
    cases = []
    for case in result.cases:
        spacing_m, origin, step = across_m * _SPACING_SHARE, (0.0, 0.0), None
        if (grid := case.grid) is not None:
            step = float(np.diff(grid.lon).min()), float(np.diff(grid.lat).min())
            origin = float(grid.lon[0]), float(grid.lat[0])
            narrow = float(np.cos(np.radians(grid.lat.mean())))
            spacing_m = min(step[0] * narrow, step[1]) * METRES_PER_DEGREE
        cases.append(
            CaseView(
                number=case.number + 1,
                name=case.name,
                title=case.title,
                colour=season_colour(case.number),
                leads=case is lead,
                planned=bool(case.routes),
                spacing_m=spacing_m,
                origin=origin,
                step_deg=step,
            )
        )
    return View(tuple(cases), speed_limits(result), across_m / _MAP_WIDTH_M)


@dataclass(frozen=True)
class ReferenceSystem:
    """A coordinate reference system: WKT, "authority:code" (empty without one), and name."""

    wkt: str
    authority: str
    name: str


@dataclass(frozen=True)
class MapCrs:
    """A map's reference system, and its bounds (xmin, ymin, xmax, ymax) with a margin.

    `convergence` is the angle in degrees of the y axis clockwise from true north, as a QGIS
    expression of a point's lon/lat; empty if north is up.
    """

    system: ReferenceSystem
    is_lonlat: bool
    bounds: Bounds
    convergence: str


def map_crs(result: RunResult) -> MapCrs:
    """Choose the reference system of a run's map."""
    projection, extent = result.water.projection, result.water.chart.extent
    outline = shapely.get_coordinates(
        projection.geometry_to_lonlat(shapely.segmentize(extent, extent.length * _SEGMENT_SHARE))
    )
    if np.abs(outline[:, 0]).max() > 180:
        return MapCrs(lonlat_system(), is_lonlat=True, bounds=_bounds(outline), convergence="")
    # PROJ takes 80 ms to search its database, which does not have the planner's own planes.
    own = projection.crs.startswith("+proj")
    if own and (zone := _utm_zone(outline)):
        projection, own = zone, False
    crs = pyproj.CRS.from_user_input(projection.crs)
    authority = "" if own else ":".join(crs.to_authority() or ())
    if not authority:
        crs = pyproj.CRS.from_json_dict({**crs.to_json_dict(), "name": _NAME})
    to_plane = pyproj.Transformer.from_crs("OGC:CRS84", crs, always_xy=True)
    planar = np.stack(to_plane.transform(outline[:, 0], outline[:, 1]), axis=-1)
    return MapCrs(
        ReferenceSystem(crs.to_wkt(), authority, crs.name),
        is_lonlat=False,
        bounds=_bounds(planar),
        convergence=_convergence(projection, outline),
    )


def _utm_zone(outline: FloatArray) -> Projection | None:
    """Return the UTM zone of the middle of an outline (n, 2), degrees; None if not to scale."""
    west, south, east, north = bounds_of(outline)
    if south < _UTM_LATITUDES_DEG[0] or north > _UTM_LATITUDES_DEG[1]:
        return None
    zone = int(((west + east) / 2 + 180) // _ZONE_DEG) % (360 // _ZONE_DEG) + 1
    code = (32600 if south + north >= 0 else 32700) + zone
    utm = Projection(f"EPSG:{code}", central_longitude=(zone - 0.5) * _ZONE_DEG - 180)
    return utm if np.abs(utm.point_scale(outline) - 1).max() <= _MAX_SCALE_ERROR else None


@lru_cache(maxsize=1)
def lonlat_system() -> ReferenceSystem:
    """Return the reference system of the file, EPSG:4326."""
    crs = pyproj.CRS("EPSG:4326")
    return ReferenceSystem(crs.to_wkt(), "EPSG:4326", crs.name)


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
    """Return the line in a colour that `colour` gives."""
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
    """Return filled area, with an outline if its colour is given."""
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
    """Return the marker of a shape that QGIS knows, such as circle, diamond or cross2."""
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
    """Return the arrow of a true length (m) within limits on paper, rotated by an expression.

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


def inert(text: str) -> str:
    """Return a text in which QGIS finds nothing to evaluate, as it does between [% and %]."""
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
    """Load the templates."""
    loaded = xml_environment("pipeline.formats.gis")
    loaded.filters.update(
        inert=inert,
        g=lambda value: f"{value:g}",
        # Escaped, because QGIS may show the text as HTML.
        html=lambda text: inert(text).replace("<", "&lt;"),
        title_line=one_line,
        uuid=lambda name: f"{{{uuid.uuid5(uuid.NAMESPACE_URL, f'renew:{name}')}}}",
    )
    return loaded
