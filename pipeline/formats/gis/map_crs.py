"""The plane that the project's map lies in, as QGIS is told of it.

It is the planner's own: a route planned straight is straight on it, and true to scale. Where the
waters reach across 180 degrees it is longitude and latitude as they are in the file, for QGIS
looks for features of a file in lon/lat between -180 and 180 only, whatever plane it shows them in.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.formats.shared.result import RunResult

    FloatArray = npt.NDArray[np.float64]

_NAME = "Plane of the RENEW planner"
_MARGIN = 0.03
# Longest piece of the waters' edge that is taken for straight, as a share of its length.
_PIECE = 1 / 64
_NEARLY_ROUND = 179.0


@dataclass(frozen=True)
class System:
    """A reference system: WKT, authority and code where it has one, and a name."""

    wkt: str
    authority: str
    name: str


@dataclass(frozen=True)
class Ground:
    """Where the map lies: reference system, bounds (xmin, ymin, xmax, ymax) with a margin.

    `convergence` is the angle in degrees of the y axis clockwise of true north, as an expression on
    a point's lon/lat; empty where north is up.
    """

    system: System
    is_lonlat: bool
    bounds: tuple[float, float, float, float]
    convergence: str


def ground(result: RunResult) -> Ground:
    """Choose the map's plane."""
    import pyproj

    projection, extent = result.scene.projection, result.scene.chart.extent
    outline = shapely.get_coordinates(
        projection.geometry_to_lonlat(shapely.segmentize(extent, extent.length * _PIECE))
    )
    if np.abs(outline[:, 0]).max() > 180:
        return Ground(lonlat(), is_lonlat=True, bounds=_around(outline), convergence="")
    crs = pyproj.CRS.from_user_input(projection.crs)
    # PROJ looks through all that it knows, for 80 ms; the planner's own planes have no name there.
    own = projection.crs.startswith("+proj")
    authority = "" if own else ":".join(crs.to_authority() or ())
    if not authority:
        crs = pyproj.CRS.from_json_dict({**crs.to_json_dict(), "name": _NAME})
    to_plane = pyproj.Transformer.from_crs("OGC:CRS84", crs, always_xy=True)
    planar = np.stack(to_plane.transform(outline[:, 0], outline[:, 1]), axis=-1)
    return Ground(
        System(crs.to_wkt(), authority, crs.name),
        is_lonlat=False,
        bounds=_around(planar),
        convergence=_convergence(result, outline),
    )


@lru_cache(maxsize=1)
def lonlat() -> System:
    """Describe the file's own reference system."""
    import pyproj

    crs = pyproj.CRS("EPSG:4326")
    return System(crs.to_wkt(), "EPSG:4326", crs.name)


def _around(points: FloatArray) -> tuple[float, float, float, float]:
    """Bounds of points (n, 2), a little wider."""
    (xmin, ymin), (xmax, ymax) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    margin = _MARGIN * max(xmax - xmin, ymax - ymin)
    return xmin - margin, ymin - margin, xmax + margin, ymax + margin


def _convergence(result: RunResult, points: FloatArray) -> str:
    """Give the convergence of the planner's plane as a formula in longitude and latitude.

    Fitted at lon/lat points (n, 2): exact for stereographic, Mercator and Lambert's planes, and
    near enough for the transverse Mercator.
    """
    projection = result.scene.projection
    middle = projection.central_longitude
    # Round a pole the angle jumps where the longitude does, opposite the middle: not right there.
    points = points[np.abs(points[:, 0] - middle) < _NEARLY_ROUND]
    east, sine = points[:, 0] - middle, np.sin(np.radians(points[:, 1]))
    terms = np.stack([np.ones_like(east), east, east * sine], axis=-1)
    angle = projection.convergence(points)
    constant, slope, slope_up = np.linalg.lstsq(terms, angle, rcond=None)[0].tolist()
    east_of = f"(x($geometry) - {middle:.10g})"
    slopes = f"({slope:.6g} + {slope_up:.6g} * sin(radians(y($geometry))))"
    return f"({constant:.6g} + {east_of} * {slopes})"
