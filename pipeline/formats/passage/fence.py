"""The fence and the rally points of a mission: where an autopilot may be, and where it may return.

An autopilot draws the edges of its fence, and its way to a rally point, straight in longitude and
latitude. So polygons are made and checked in a plane where such lines are straight.
"""

from dataclasses import dataclass

import numpy as np
import pyproj
import shapely

from pipeline._types import FloatArray
from pipeline.findings.result import RunCase
from pipeline.formats.passage.safe_corridor import kept_out
from pipeline.formats.passage.tracks import in_pieces, tracks
from pipeline.formats.passage.waypoints import Waypoints, case_waypoints
from pipeline.geo.lonlat import EARTH_RADIUS_M, METRES_PER_DEGREE
from pipeline.model import Water

STORAGE_BYTES = 672
"""What ArduPilot Rover keeps its fence in: 8 bytes a vertex, 2 a polygon and 5 more."""
MAX_VERTICES = (STORAGE_BYTES - 5 - 2) // 8
"""Largest number of vertices of a fence: of one polygon; of several it is a little less."""
MAX_RALLY_POINTS = 50
"""Number of rally points that the same storage has room for."""
KEPT_SHARE = 0.98
"""Share of the cross-track limits that the fence leaves free beside the legs."""
# Share of the least limit by which the fence may run outside what is left free where no other water
# is: the limits themselves may end at V.
_USED_SHARE = 0.01
# Steps by which the water is narrowed until few vertices do, as shares of its size.
_STEPS = 2.0 ** np.arange(-9, -3, 0.5)
# Decimals of degrees of a vertex: autopilots hold whole numbers of 1e-7 degrees.
_DECIMALS = 7
# Edges of the planner's plane are projected in pieces: in between, they are off by a centimetre.
_PIECE_M = 1_000.0
# Largest error of the legs' drawing, metres.
_ERROR_M = 0.1
# Number of points tried as the next vertex.
_TRIED = 100
# Number of pieces into which a route is cut at least to find the nearest rally point of each.
_PIECES = 1_000
# An autopilot's distances may be off by this share.
_DISTANCE_ERROR = 0.01
_GEOD = pyproj.Geod(ellps="WGS84")
_CACHE = "_autopilot"


@dataclass(frozen=True)
class Fence:
    """An inclusion polygon (n, 2) and the exclusion polygons (m, 2) in it, degrees, not closed."""

    inclusion: FloatArray
    exclusions: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Autopilot:
    """What a mission's file may tell an autopilot beside the way.

    Attributes
    ----------
    fence : all that is inside the inclusion polygon and outside the exclusion polygons is water
        outside V. None if none was found of so few vertices, if a leg lies in V, where nothing is
        promised, or on a chart across 180 degrees.
    rally : points (n, 2), degrees, n >= 0, in the fence if there is one, such that from every place
        of the legs the straight line to the nearest one of them and the start is water outside V.
        None if there are none such, the start alone included: then the vessel must not return.
    """

    fence: Fence | None
    rally: FloatArray | None


def autopilot(case: RunCase) -> Autopilot:
    """Return fence and rally points for a case's best route; worked out once."""
    cached: dict[str, Autopilot] = case.run.kept.setdefault(_CACHE, {})
    if case.name not in cached:
        cached[case.name] = _autopilot(case)
    return cached[case.name]


def _autopilot(case: RunCase) -> Autopilot:
    points, flat = case_waypoints(case)[0], _Flat(case.run.water)
    least_m = float(np.minimum(points.port_m, points.starboard_m)[:-1].min())
    if flat.crosses_180 or least_m <= 0:
        return Autopilot(None, None)
    parts = shapely.get_parts(flat.of(open_water(case)))
    kept = flat.of(_beside(points))
    used = shapely.buffer(kept, _USED_SHARE * least_m)
    water = parts[shapely.distance(parts, used).argmin()]
    shapely.prepare(water)
    found = _fence(flat, water, used, kept)
    given = case.coverage.havens if case.coverage is not None else ()
    # A rally point is open at all hours.
    places = [one.place for one in given if not np.isfinite([one.opens, one.closes]).any()]
    lonlat = case.run.water.projection.to_lonlat(np.reshape(places, (-1, 2)))
    havens = np.round(lonlat, _DECIMALS)
    if found is not None:  # An autopilot passes over rally points outside its fence.
        rings = found.inclusion, *found.exclusions
        inside, *shut = (shapely.contains_xy(shapely.Polygon(ring), havens) for ring in rings)
        havens = havens[inside & ~np.any(shut, axis=0)]
    havens = havens[:MAX_RALLY_POINTS]
    for rally in (havens, havens[:0]) if len(havens) else (havens,):
        if _is_clear(flat, water, points, rally):
            return Autopilot(found, rally)
    return Autopilot(found, None)


def open_water(case: RunCase) -> shapely.Geometry:
    """Return the water of a case's best route in the planner's plane: off no-go and V."""
    route = case.routes[0].route
    shut = shapely.union_all([route.soft_no_go, *kept_out(case.case, route)])
    return shapely.difference(case.case.chart.water, shut)


class _Flat:
    """A plane in which lines are straight as in longitude and latitude; metres, nearly true."""

    def __init__(self, water: Water) -> None:
        self._projection = water.projection
        extent = self._projection.geometry_to_lonlat(water.chart.extent, _PIECE_M)
        west, south, east, north = extent.bounds
        self._origin = np.array([(west + east) / 2, (south + north) / 2])
        self._metres = METRES_PER_DEGREE * np.array([np.cos(np.radians(self._origin[1])), 1.0])
        self.crosses_180 = west < -180 or east >= 180

    def xy(self, lonlat: FloatArray) -> FloatArray:
        """Return points (n, 2), degrees, in this plane."""
        planar: FloatArray = (lonlat - self._origin) * self._metres
        return planar

    def of(self, area: shapely.Geometry) -> shapely.Geometry:
        """Return an area of the planner's plane in this one."""
        lonlat = self._projection.geometry_to_lonlat(area, _PIECE_M)
        return shapely.make_valid(shapely.transform(lonlat, self.xy))

    def lonlat(self, ring: FloatArray) -> FloatArray:
        """Return points (n, 2) of this plane in degrees, as they will be written."""
        lonlat: FloatArray = np.round(ring / self._metres + self._origin, _DECIMALS)
        return lonlat


def _beside(points: Waypoints) -> shapely.Geometry:
    """Return the area that the fence leaves free beside the legs, planner's plane."""
    projection = points.ranked.case.run.water.projection
    legs = tracks(points.lonlat[:-1], points.lonlat[1:], points.curve, projection, _ERROR_M)
    # A limit is narrowest in the plane where the plane stretches the leg least.
    least = np.full(len(legs.lines), np.inf)
    np.minimum.at(least, legs.leg, projection.point_scale(legs.lonlat))
    planar = KEPT_SHARE * least / projection.scale
    port, starboard = points.port_m[:-1] * planar, points.starboard_m[:-1] * planar
    both = shapely.buffer(legs.lines, np.minimum(port, starboard), quad_segs=64)
    left = shapely.buffer(legs.lines, port, cap_style="flat", single_sided=True)
    right = shapely.buffer(legs.lines, -starboard, cap_style="flat", single_sided=True)
    return shapely.union_all([both, left, right])


def _fence(
    flat: _Flat, water: shapely.Polygon, used: shapely.Geometry, kept: shapely.Geometry
) -> Fence | None:
    """Return the first fence found, in water that is narrowed step by step but for what is used."""
    edges, narrowed = shapely.boundary(shapely.difference(water, kept)), water
    shapely.prepare(edges)
    # An island is inside a ring that does not meet it if its first vertex is.
    islands = np.array([ring.coords[0] for ring in water.interiors]).reshape(-1, 2)
    inside = shapely.get_coordinates(shapely.point_on_surface(kept))
    for step in np.sqrt(water.area) * _STEPS:
        if narrowed.is_empty:
            break
        wide = shapely.buffer(shapely.simplify(narrowed, step / 4), -step)
        narrowed = shapely.simplify(wide, step / 2)
        parts = shapely.get_parts(shapely.union(used, narrowed))
        joined = parts[shapely.intersects(parts, used)][0]
        # A hole that is all water needs no fence.
        holes = shapely.polygons(np.array(joined.interiors, dtype=object))
        holes = holes[~shapely.covers(water, holes)]
        if 3 * len(holes) > MAX_VERTICES:
            continue
        outside = islands[~shapely.contains_xy(shapely.Polygon(joined.exterior), islands)]
        apart = [outside, *(islands[shapely.contains_xy(hole, islands)] for hole in holes)]
        # Nor do the legs change sides.
        apart = [np.concatenate([one, inside]) for one in apart]
        outlines = [joined.exterior, *(hole.exterior for hole in holes)]
        rings = [flat.xy(flat.lonlat(shapely.get_coordinates(one)[:-1])) for one in outlines]
        if not _are_few(rings):
            rings[0] = _fewest(rings[0], apart[0], edges)
            if len(rings[0]) > MAX_VERTICES:
                continue
            rings[1:] = [_fewest(*one, edges) for one in zip(rings[1:], apart[1:], strict=True)]
        polygons = np.array([shapely.Polygon(ring) for ring in rings], dtype=object)
        if not (_are_few(rings) and shapely.is_valid(polygons).all()):
            continue
        allowed = shapely.difference(polygons[0], shapely.union_all(polygons[1:]))
        if allowed.covers(kept) and water.covers(allowed):
            inclusion, *exclusions = map(flat.lonlat, rings)
            return Fence(inclusion, tuple(exclusions))
    return None


def _are_few(rings: list[FloatArray]) -> bool:
    """Whether an autopilot has room for all polygons together."""
    return 5 + sum(2 + 8 * len(ring) for ring in rings) <= STORAGE_BYTES


def _fewest(ring: FloatArray, islands: FloatArray, edges: shapely.Geometry) -> FloatArray:
    """Return few of a ring's points (n, 2), three or more, with no line between them over an edge.

    From each point, the line goes on to the last point that is found in reach, at most a third of
    the way round, without an island (k, 2) between the line and the ring. The search ends when
    there are too many points.
    """
    count = len(ring)
    steps = np.unique(np.geomspace(1, max(count // 3, 1), _TRIED).astype(int))[::-1]
    chosen = [0]
    while (at := chosen[-1]) < count - 1 and len(chosen) <= MAX_VERTICES:
        ahead = at + steps[at + steps <= count]
        lines = np.stack([np.broadcast_to(ring[at], (len(ahead), 2)), ring[ahead % count]], axis=1)
        free = ahead[~shapely.intersects(edges, shapely.linestrings(lines))]
        passed = (to for to in free[free > at + 1] if not _parts(ring, at, to, islands))
        chosen.append(next(passed, at + 1))
    return ring[[one for one in chosen if one < count]]


def _parts(ring: FloatArray, at: int, to: int, islands: FloatArray) -> bool:
    """Whether an island lies between a ring's points from `at` to `to` and the line past them."""
    between = shapely.Polygon(ring[np.arange(at, to + 1) % len(ring)])
    return bool(shapely.contains_xy(between, islands).any())


def _is_clear(flat: _Flat, water: shapely.Polygon, points: Waypoints, rally: FloatArray) -> bool:
    """Whether from every place of the legs a straight line to the nearest point keeps to the water.

    The points are the start and those (n, 2) for rallying. Lines that are straight in other
    planes, or on the ellipsoid, keep to the water as well.
    """
    sites = np.concatenate([points.lonlat[:1], rally])
    length = float(np.nansum(points.length_m)) / _PIECES
    places, leg = in_pieces(points.lonlat[:-1], points.lonlat[1:], points.curve, length)
    lonlat = np.stack([places[:-1], places[1:]], axis=1)[np.diff(leg) == 0]
    apart = np.stack([_distances(lonlat[:, end], sites) for end in (0, 1)])
    step = np.asarray(_GEOD.inv(*lonlat[:, 0].T, *lonlat[:, 1].T)[2])[:, None]
    # From some place of a piece the distance is at least, and from every place at most:
    least, most = (apart.sum(axis=0) - step) / 2, (apart.sum(axis=0) + step) / 2
    piece, site = np.nonzero(least <= (1 + _DISTANCE_ERROR) * most.min(axis=1, keepdims=True))
    ends = flat.xy(lonlat.reshape(-1, 2)).reshape(-1, 2, 2)[piece]
    # All lines from a piece fill a triangle.
    corners = np.concatenate([ends, flat.xy(sites)[site][:, None]], axis=1)
    steepest = np.abs(np.concatenate([points.lonlat, rally])[:, 1]).max()
    bend = most[piece, site] ** 2 * np.tan(np.radians(steepest)) / (4 * EARTH_RADIUS_M)
    triangles = shapely.buffer(shapely.convex_hull(shapely.multipoints(corners)), bend)
    # Where one is not clear, a few of them soon tell.
    return bool(
        shapely.covers(water, triangles[:: max(len(triangles) // 50, 1)]).all()
        and shapely.covers(water, triangles).all()
    )


def _distances(one: FloatArray, sites: FloatArray) -> FloatArray:
    """Return the distances (n, s) of points (n, 2) from sites (s, 2), true metres."""
    lon, lat = (np.broadcast_to(one[:, None, axis], (len(one), len(sites))) for axis in (0, 1))
    to = np.broadcast_to(sites, (len(one), *sites.shape))
    return np.asarray(_GEOD.inv(lon, lat, to[..., 0], to[..., 1])[2])
