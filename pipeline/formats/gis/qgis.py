"""How QGIS shows a run: the view of the map, its reference system, and its XML by templates."""

import uuid
from dataclasses import dataclass
from functools import cache
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
from pipeline.geo.projection import METRES_PER_DEGREE, Projection, bounds_of
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
    own = projection.crs.startswith("+proj")
    if own and (zone := _utm_zone(outline)):
        projection, own = zone, False
    crs = pyproj.CRS.from_user_input(projection.crs)
    authority = "" if own else ":".join(crs.to_authority() or ())
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
