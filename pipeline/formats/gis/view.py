"""How a map shows a run: seasons and colours, classes of speed, scale, and the map's CRS."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
import pyproj
import shapely

from pipeline._types import FloatArray
from pipeline.formats.figures.map_marks import SpeedScale, speed_scale
from pipeline.formats.shared.palette import season_colour
from pipeline.formats.shared.result import RunResult
from pipeline.geo.lonlat import METRES_PER_DEGREE
from pipeline.geo.projection import Projection

# Width, metres on paper or screen, at which a map opens.
_MAP_WIDTH_M = 0.25
# Spacing of arrows without a grid, as a share of the chart's longer side.
_SPACING_SHARE = 1 / 24

Bounds: TypeAlias = tuple[float, float, float, float]
"""Limits xmin, ymin, xmax, ymax."""

_NAME = "Plane of the RENEW planner"
# Margin around the chart on the map, as a share of its longer side.
_MARGIN = 0.03
# Maximum length of a segment of the chart's edge, as a share of the edge.
_SEGMENT_SHARE = 1 / 64
# Maximum error of a UTM zone's scale, as a share: 1.5 mm across an A4 page.
_MAX_SCALE_ERROR = 5e-3
# Latitudes between which there are UTM zones, degrees, and the width of one.
_UTM_LATITUDES_DEG = (-80.0, 84.0)
_ZONE_DEG = 6
# Maximum distance in longitude, degrees, from the central meridian for the fit of the convergence.
_MAX_LONGITUDE_OFFSET_DEG = 179.0


@dataclass(frozen=True)
class SeasonView:
    """How a season is shown.

    `number` identifies it inside a project, whatever its name. `leads` marks the season that is
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
    """A map's seasons, classes of current speed, and scale (denominator) that shows all of it.

    `convergence` is as in `MapCrs`.
    """

    seasons: tuple[SeasonView, ...]
    speeds: SpeedScale
    full_scale: float
    convergence: str = ""


def view(result: RunResult) -> View:
    """Describe how a map shows a run."""
    ranked = [route for route in result.routes if route.rank == 1]
    first = result.plans[0].season
    lead = min(ranked, key=lambda route: route.metrics.fuel).season if ranked else first
    planned = {route.season for route in ranked}
    xmin, ymin, xmax, ymax = result.scene.chart.bounds
    across_m = max(xmax - xmin, ymax - ymin) * result.scene.projection.scale
    seasons = []
    for index, entry in enumerate(result.plans):
        spacing_m, origin, step = across_m * _SPACING_SHARE, (0.0, 0.0), None
        if (grid := result.grid_of(entry.season)) is not None:
            step = float(np.diff(grid.lon).min()), float(np.diff(grid.lat).min())
            origin = float(grid.lon[0]), float(grid.lat[0])
            narrow = float(np.cos(np.radians(grid.lat.mean())))
            spacing_m = min(step[0] * narrow, step[1]) * METRES_PER_DEGREE
        seasons.append(
            SeasonView(
                number=index + 1,
                name=entry.season,
                title=result.season_title(entry.season),
                colour=season_colour(index),
                leads=entry.season == lead,
                planned=entry.season in planned,
                spacing_m=spacing_m,
                origin=origin,
                step_deg=step,
            )
        )
    return View(tuple(seasons), speed_scale(result), across_m / _MAP_WIDTH_M)


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
    projection, extent = result.scene.projection, result.scene.chart.extent
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
    """UTM zone of the middle of an outline (n, 2) in degrees; None if it is not to scale there."""
    (west, south), (east, north) = outline.min(axis=0).tolist(), outline.max(axis=0).tolist()
    if south < _UTM_LATITUDES_DEG[0] or north > _UTM_LATITUDES_DEG[1]:
        return None
    zone = int(((west + east) / 2 + 180) // _ZONE_DEG) % (360 // _ZONE_DEG) + 1
    code = (32600 if south + north >= 0 else 32700) + zone
    utm = Projection(f"EPSG:{code}", central_longitude=(zone - 0.5) * _ZONE_DEG - 180)
    return utm if np.abs(utm.point_scale(outline) - 1).max() <= _MAX_SCALE_ERROR else None


@lru_cache(maxsize=1)
def lonlat_system() -> ReferenceSystem:
    """Reference system of the file, EPSG:4326."""
    crs = pyproj.CRS("EPSG:4326")
    return ReferenceSystem(crs.to_wkt(), "EPSG:4326", crs.name)


def _bounds(points: FloatArray) -> Bounds:
    """Bounds of points (n, 2) with a margin."""
    (xmin, ymin), (xmax, ymax) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    margin = _MARGIN * max(xmax - xmin, ymax - ymin)
    return xmin - margin, ymin - margin, xmax + margin, ymax + margin


def _convergence(projection: Projection, points: FloatArray) -> str:
    """Convergence of the map's plane as a QGIS expression of longitude and latitude.

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
