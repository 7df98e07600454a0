"""Lon/lat: the projection to the planner's plane, bounds of regions, what is known on a grid.

The projection is conformal, and centred on the region.

In a conformal plane a turning circle remains a circle, and headings differ from true ones by one
angle only, the meridian convergence. The projection depends on the region's shape (Snyder, *Map
Projections: A Working Manual*, USGS PP 1395, 1987), so that the line or point without distortion
lies in the region's middle.

| region | projection |
|---|---|
| reaches beyond 85 degrees, or wide and centred beyond 75 | polar stereographic |
| taller than wide, or no wider than 1000 km | transverse Mercator on its central meridian |
| wide, centred within 10 degrees of the equator | Mercator |
| wide, elsewhere | Lambert conformal conic, parallels at 1/6 and 5/6 of its height |

The scale factor is balanced: its largest and smallest values in the region are reciprocal. Regions
across 180 degrees have continuous longitudes (170 to 190); results are continuous too, within 180
degrees of the region's centre. Exact lengths are geodesics, by pyproj.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar, cast

import numpy as np
import pyproj
import shapely

from pipeline._types import ArrayLike, BoolArray, FloatArray, Geometries, IndexArray, IntArray
from pipeline.errors import RequestError

# A geometry or an array of geometries: functions return the type that they are given.
GeometryT = TypeVar("GeometryT", bound="shapely.Geometry | Geometries")

GEOD = pyproj.Geod(ellps="WGS84")
"""Geodesics on the earth's ellipsoid."""
_LONLAT = "OGC:CRS84"

# Latitudes (degrees) and width (metres) at which the rows of the table above begin.
_POLAR_REACH_DEG = 85.0
_POLAR_CENTRE_DEG = 75.0
_EQUATORIAL_CENTRE_DEG = 10.0
_SMALL_WIDTH_M = 1_000_000.0
# Length of a degree of the equator, m.
_EQUATOR_DEGREE_M = math.pi / 180 * GEOD.a

# Half of the step of the central difference, degrees: 11 m, at which the relative errors by
# rounding (1e-10) and curvature (1e-11) are both negligible for a heading.
_STEP_DEG = 1e-4
# Maximum length s of the geodesics whose sum is a path's length, m: a straight line of the plane is
# longer by (κs)²/24, which is 1e-7 if its curvature κ is the earth's.
_MAX_LEG_M = 10_000.0
MAX_EDGE_M = 5_000.0
"""Length above which edges that are straight in degrees are divided before they are projected, m:
they are curved in the plane. One of 5 km at 70 degrees of latitude deviates by 1.3 m."""
# Number of points per side of the region at which the scale is computed.
_SAMPLES = 9


@dataclass(frozen=True)
class Projection:
    """Lon/lat degrees (WGS 84) to planar metres divided by `scale`, and back.

    `crs` is the plane's CRS for pyproj: a PROJ string, WKT or authority code. `scale` is in true
    metres per planar metre: 1 is the true scale, 1000 is 1:1000. Resulting longitudes are within
    180 degrees of `central_longitude`.
    """

    crs: str
    scale: float = 1.0
    central_longitude: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a scale that is not a positive number."""
        if not (math.isfinite(self.scale) and self.scale > 0):
            raise RequestError(f"scale is {self.scale:g}, must be above 0: 1 is the true scale")

    @classmethod
    def for_region(cls, region: shapely.Polygon, scale: float = 1.0) -> "Projection":
        """Choose the projection for a region in degrees; `scale` is true metres per planar metre.

        Its longitudes are continuous across 180 (170 to 190, not 170 to -170). Raises RequestError
        if it is not on the globe.
        """
        west, south, east, north = region.bounds
        if region.is_empty or not (-90 <= south <= north <= 90 and east - west <= 360):
            raise RequestError(
                f"region ({west:g} to {east:g} E, {south:g} to {north:g} N) is not on the globe: "
                "keep latitudes in -90 to 90 and longitudes within one turn of 360"
            )
        centre = (west + east) / 2
        if (polar := _polar_latitude(region)) is not None:
            chosen = cls._balanced("stere", centre, polar, 0.0, region, scale)
        elif _is_narrow(region):
            chosen = cls._balanced("tmerc", centre, (south + north) / 2, 0.0, region, scale)
        elif abs(south + north) / 2 < _EQUATORIAL_CENTRE_DEG:
            # Mercator has no latitude of origin: the centre's northing is subtracted.
            plain = cls(_proj4("merc", centre, 0.0))
            northing = float(plain.to_plane(np.array([centre, (south + north) / 2]))[1])
            chosen = cls._balanced("merc", centre, 0.0, -northing, region, scale)
        else:
            sixth = (north - south) / 6
            parallels = f" +lat_1={south + sixth!r} +lat_2={north - sixth!r}"
            proj4 = _proj4("lcc", centre, (south + north) / 2) + parallels
            chosen = cls(proj4, scale, centre)
        return chosen

    @classmethod
    def at(cls, longitude: float, latitude: float, scale: float = 1.0) -> "Projection":
        """Return a plane whose origin is the given point (degrees), true to scale there."""
        return cls(_proj4("tmerc", longitude, latitude), scale, longitude)

    @classmethod
    def _balanced(
        cls,
        name: str,
        longitude: float,
        latitude: float,
        northing: float,
        region: shapely.Polygon,
        scale: float,
    ) -> "Projection":
        """Balance the scale factor: the geometric mean of its extremes over the region is 1."""
        factors = cls(_proj4(name, longitude, latitude)).point_scale(_samples(region))
        factor = 1 / math.sqrt(float(factors.min() * factors.max()))
        proj4 = _proj4(name, longitude, latitude) + f" +k_0={factor!r} +y_0={northing * factor!r}"
        return cls(proj4, scale, longitude)

    def to_plane(self, lonlat: ArrayLike) -> FloatArray:
        """Project lon/lat (..., 2) in degrees to scaled planar metres (..., 2)."""
        points = np.asarray(lonlat, dtype=np.float64)
        x, y = _transformer(self.crs).transform(points[..., 0], points[..., 1])
        planar: FloatArray = np.stack([x, y], axis=-1) / self.scale
        if not np.isfinite(planar).all():
            bad = points[~np.isfinite(planar).all(axis=-1)].reshape(-1, 2)[0]
            raise RequestError(
                f"point {bad[0]:g} E {bad[1]:g} N can't be projected by {self.crs!r}: "
                "give coordinates in degrees, and a region that contains them"
            )
        return planar

    def to_lonlat(self, xy: ArrayLike) -> FloatArray:
        """Convert scaled planar metres (..., 2) to lon/lat degrees (..., 2)."""
        points = np.asarray(xy, dtype=np.float64) * self.scale
        lon, lat = _transformer(self.crs).transform(
            points[..., 0], points[..., 1], direction="INVERSE"
        )
        # Continuous across 180 degrees: a route must not jump across the map.
        turns = np.round((np.asarray(lon) - self.central_longitude) / 360)
        return np.stack([lon - 360 * turns, lat], axis=-1)

    def geometry_to_plane(self, geometry: GeometryT, densify_m: float = 0.0) -> GeometryT:
        """Project a geometry or an array of them, z dropped.

        With `densify_m`, edges longer than about that (true metres) are divided first: a long line
        that is straight in lon/lat is curved in the plane.
        """
        if densify_m > 0:
            longest_deg = densify_m / _EQUATOR_DEGREE_M
            geometry = cast("GeometryT", shapely.segmentize(geometry, longest_deg))
        return cast("GeometryT", shapely.transform(geometry, self.to_plane))

    def geometry_to_lonlat(self, geometry: GeometryT, densify_m: float = 0.0) -> GeometryT:
        """Convert planar geometries to lon/lat; edges over `densify_m` true metres are divided."""
        if densify_m > 0:
            geometry = cast("GeometryT", shapely.segmentize(geometry, densify_m / self.scale))
        return cast("GeometryT", shapely.transform(geometry, self.to_lonlat))

    def rotate_to_lonlat(self, lonlat: ArrayLike, xy: ArrayLike) -> FloatArray:
        """Rotate vectors (..., 2) along the plane's axes at lon/lat to (east, north)."""
        return rotated(np.asarray(xy, dtype=np.float64), -self.rotation_rad(lonlat))

    def convergence(self, lonlat: ArrayLike) -> FloatArray:
        """Return the meridian convergence (...), degrees: y axis clockwise from true north."""
        return np.degrees(self.rotation_rad(lonlat))

    def point_scale(self, lonlat: ArrayLike) -> FloatArray:
        """Return planar metres (before `scale`) per true metre at lon/lat (...)."""
        jacobian = self._jacobian(lonlat)
        return np.asarray(np.sqrt(np.abs(np.linalg.det(jacobian))))

    def scale_at(self, xy: ArrayLike) -> FloatArray:
        """Return planar metres (before `scale`) per true metre at points (..., 2) of the plane."""
        return self.point_scale(self.to_lonlat(xy))

    def geodesic_length_m(self, xy: ArrayLike) -> float:
        """Return the length of a planar path (n, 2) in true metres.

        Legs are straight in the plane; long ones are not the shortest way on earth.
        """
        path = np.asarray(xy, dtype=np.float64)
        lonlat = self.to_lonlat(densified(path, _MAX_LEG_M / self.scale))
        return float(GEOD.line_length(lonlat[:, 0], lonlat[:, 1]))

    def __dask_tokenize__(self) -> tuple[str, str, float, float]:
        """Return the values that identify a projection in the keys of the store."""
        return type(self).__name__, self.crs, self.scale, self.central_longitude

    def rotation_rad(self, lonlat: ArrayLike) -> FloatArray:
        """Return the angle (...) by which directions turn in the plane, anticlockwise, radians."""
        jacobian = self._jacobian(lonlat)
        # The mean angle of east and of north, which are equal where the plane is conformal.
        across = jacobian[..., 1, 0] - jacobian[..., 0, 1]
        along = jacobian[..., 0, 0] + jacobian[..., 1, 1]
        return np.asarray(np.arctan2(across, along))

    def _jacobian(self, lonlat: ArrayLike) -> FloatArray:
        """Return planar metres (before `scale`) per true metre: (..., 2, 2), of east and north."""
        points = np.asarray(lonlat, dtype=np.float64)
        # At a pole, where east is undefined, use a point beside it on the same meridian.
        limit = 90 - 2 * _STEP_DEG
        latitude = np.clip(points[..., 1], -limit, limit)
        points = np.stack([points[..., 0], latitude], axis=-1)
        sine = np.sin(np.radians(latitude))
        root = np.sqrt(1 - GEOD.es * sine**2)
        metres_east = np.radians(2 * _STEP_DEG) * GEOD.a / root * np.cos(np.radians(latitude))
        metres_north = np.radians(2 * _STEP_DEG) * GEOD.a * (1 - GEOD.es) / root**3
        columns = [
            (self.to_plane(points + step) - self.to_plane(points - step)) * self.scale
            for step in (np.array([_STEP_DEG, 0.0]), np.array([0.0, _STEP_DEG]))
        ]
        east = columns[0] / metres_east[..., None]
        north = columns[1] / metres_north[..., None]
        return np.stack([east, north], axis=-1)


def densified(path: FloatArray, max_length: float) -> FloatArray:
    """Return a path (n, 2) with points added, so that no leg is longer than `max_length`."""
    return cut(path, max_length)[0]


def cut(path: FloatArray, max_length: float) -> tuple[FloatArray, IntArray]:
    """Cut the legs of a path (n, 2) into equal pieces no longer than `max_length`.

    Returns their ends (m, 2), and the first piece (n - 1,) of each leg.
    """
    legs = np.diff(path, axis=0)
    pieces = np.maximum(1, np.ceil(np.linalg.norm(legs, axis=1) / max_length)).astype(np.int64)
    first = np.cumsum(pieces) - pieces
    leg = np.repeat(np.arange(len(legs)), pieces)
    share = (np.arange(len(leg)) - first[leg]) / pieces[leg]
    return np.vstack([path[leg] + share[:, None] * legs[leg], path[-1:]]), first


def _proj4(name: str, longitude: float, latitude: float) -> str:
    """Return a PROJ string in metres on WGS 84."""
    origin = "" if name == "merc" else f" +lat_0={latitude!r}"
    return f"+proj={name} +lon_0={longitude!r}{origin} +datum=WGS84 +units=m +no_defs"


def _polar_latitude(region: shapely.Polygon) -> float | None:
    """Return the latitude of the pole to centre on, degrees; None for other projections."""
    _, south, _, north = region.bounds
    centre = (south + north) / 2
    reaches = max(abs(south), abs(north)) > _POLAR_REACH_DEG
    if reaches or (abs(centre) > _POLAR_CENTRE_DEG and not _is_narrow(region)):
        return math.copysign(90.0, centre)
    return None


def _is_narrow(region: shapely.Polygon) -> bool:
    """Say whether the region is taller than wide, or narrower than 1000 km."""
    west, south, east, north = region.bounds
    width = (east - west) * math.cos(math.radians((south + north) / 2)) * _EQUATOR_DEGREE_M
    return bool(width <= max(_SMALL_WIDTH_M, (north - south) * _EQUATOR_DEGREE_M))


def _samples(region: shapely.Polygon) -> FloatArray:
    """Return lon/lat points (n, 2) over the region's bounds, edges included."""
    west, south, east, north = region.bounds
    grid = np.meshgrid(np.linspace(west, east, _SAMPLES), np.linspace(south, north, _SAMPLES))
    return np.stack(grid, axis=-1).reshape(-1, 2)


def rotated(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotate vectors (..., 2) anticlockwise by angle (...) in radians."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x = cosine * vectors[..., 0] - sine * vectors[..., 1]
    y = sine * vectors[..., 0] + cosine * vectors[..., 1]
    return np.stack([x, y], axis=-1)


# pyproj's Transformer has one context per thread, so that threads may share it. Making one takes
# about 10 ms, and it is not part of a Projection's value (equality, hash, pickle).
@lru_cache(maxsize=32)
def _transformer(crs: str) -> pyproj.Transformer:
    """Return the transformer from lon/lat to the plane of `crs` in its own units."""
    return pyproj.Transformer.from_crs(_LONLAT, crs, always_xy=True)


# Mean radius of the earth, m: (2a + b)/3 of the ellipsoid GRS 80, which is WGS 84's to 0.1 mm
# (Moritz, Geodetic Reference System 1980, Journal of Geodesy 74, 2000).
EARTH_RADIUS_M = 6_371_008.8
# Length of a degree of latitude, m: on a sphere of that radius, rounded. On the ellipsoid it is
# 110,574 m at the equator and 111,694 m at the poles, so this is off by at most 0.6 %.
METRES_PER_DEGREE = 111_195.0


def position_text(lon: float, lat: float) -> str:
    """Write a position in degrees, by its hemispheres: 119.8710 E 11.5244 N, 70.9815 W 42.3427 N.

    On a chart across 180 degrees, longitudes may exceed 180.
    """
    east = (lon + 180) % 360 - 180
    return f"{abs(east):.4f} {'W' if east < 0 else 'E'} {abs(lat):.4f} {'S' if lat < 0 else 'N'}"


Bounds = tuple[float, float, float, float]
"""West, south, east, north in degrees."""

# Cells that a source adds around the region, so that currents at its edge are interpolated.
MARGIN_CELLS = 2.5


def bounds_of(points: ArrayLike) -> Bounds:
    """Return the bounds of points (n, 2), or of several bounds (n, 4)."""
    places = np.reshape(np.asarray(points, dtype=float), (-1, 2))
    (west, south), (east, north) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    return west, south, east, north


def widened(bounds: Bounds, lon_deg: float, lat_deg: float) -> Bounds:
    """Return bounds with a margin on each side."""
    west, south, east, north = bounds
    return west - lon_deg, south - lat_deg, east + lon_deg, north + lat_deg


def cell_bounds(lon: FloatArray, lat: FloatArray, cell_deg: tuple[float, float]) -> Bounds:
    """Return outer edges of the cells around a grid's ascending nodes: half a cell beyond these."""
    nodes = (float(lon[0]), float(lat[0]), float(lon[-1]), float(lat[-1]))
    return widened(nodes, cell_deg[0] / 2, cell_deg[1] / 2)


def sides_beyond(region: Bounds, grid: Bounds) -> list[str]:
    """Name each side on which a region reaches beyond a grid, with the grid's limit there."""
    return [
        f"{side} of {grid[at]:g} (the region reaches {region[at]:g})"
        for at, side in enumerate(("west", "south", "east", "north"))
        if (region[at] < grid[at] if at < 2 else region[at] > grid[at])
    ]


def common_bounds(one: Bounds, other: Bounds) -> Bounds | None:
    """Return the intersection of two bounds; None if it is empty."""
    west, south = max(one[0], other[0]), max(one[1], other[1])
    east, north = min(one[2], other[2]), min(one[3], other[3])
    return (west, south, east, north) if west < east and south < north else None


# Number of evenly spaced points at which shares of a path are measured: every 200 m of 1,000 km.
# The error of a share is about 0.01 % per gap that the path enters.
_PATH_SAMPLES = 5_000


@dataclass(frozen=True, slots=True)
class KnownCells:
    """Cells of a grid, each around its node: `known` (ny, nx) says which have a figure.

    `lon` (nx,) and `lat` (ny,) are the nodes, ascending, degrees; at least two of each.
    """

    lon: FloatArray
    lat: FloatArray
    known: BoolArray

    def at(self, lonlat: FloatArray) -> BoolArray:
        """Say which points (n, 2), degrees, lie in a cell with a figure; none does off the grid."""
        (column, across), (row, along) = (
            _cell(axis, lonlat[:, i]) for i, axis in enumerate((self.lon, self.lat))
        )
        return np.asarray(across & along & self.known[row, column])


def _cell(axis: FloatArray, values: FloatArray) -> tuple[IndexArray, BoolArray]:
    """Return the node nearest to each value, and whether the value is within its cell."""
    low = axis[0] - (axis[1] - axis[0]) / 2
    high = axis[-1] + (axis[-1] - axis[-2]) / 2
    return nearest_node(axis, values), (values >= low) & (values <= high)


def nearest_node(axis: FloatArray, values: FloatArray) -> IndexArray:
    """Return the index of an ascending axis's node that is nearest to each value."""
    return np.asarray(np.searchsorted((axis[1:] + axis[:-1]) / 2, values))


@dataclass(frozen=True, slots=True)
class DepthCover:
    """Where a chart has depths (lon/lat degrees): in areas, and in the cells of a grid."""

    areas: tuple[shapely.Polygon, ...] = ()
    cells: KnownCells | None = None

    def at(self, lonlat: FloatArray) -> BoolArray:
        """Say at which points (n, 2), degrees, a depth is charted."""
        tree, areas = shapely.STRtree(shapely.points(lonlat)), np.array(self.areas, dtype=object)
        charted = np.zeros(len(lonlat), dtype=bool)
        charted[tree.query(areas, "intersects")[1]] = True
        return charted if self.cells is None else charted | self.cells.at(lonlat)


def share_without(
    path: FloatArray, projection: Projection, known: Callable[[FloatArray], BoolArray]
) -> float:
    """Return the share of the length of a planar path (n, 2) where something is not known."""
    line = shapely.LineString(path)
    along = (np.arange(_PATH_SAMPLES) + 0.5) / _PATH_SAMPLES
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, along, normalized=True))
    lonlat = projection.to_lonlat(points)
    length = 1 / projection.point_scale(lonlat)
    return float(length[~known(lonlat)].sum() / length.sum())
