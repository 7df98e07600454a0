"""Legs as a plotter draws and sails them, and the safe corridor in which a route's legs stay.

The corridor is the water near the route's path, off land and off its soft no-go zone V: waypoints
are chosen so that the legs between them stay inside it.

Legs are loxodromes, or geodesics in high latitudes. A loxodrome has a constant course; it is a
straight line in Mercator's projection of the ellipsoid. It departs from a straight line of the
planner's plane by about s²/8R·tan(latitude): 12 m on 60 km at 10 degrees, 20 km on 1,000 km at 45
degrees.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, Self

import numpy as np
import pyproj
import shapely

import renew
from pipeline._types import FloatArray, Geometries, IndexArray, IntArray
from pipeline.geo.projection import Projection
from pipeline.model import Case
from renew.inputs.chart_and_vessel import edges_of

Curve = Literal["Loxodrome", "Orthodrome"]
"""A leg's geometry in RTZ's terms: constant course, or shortest distance."""

# Decimals of degrees in the files, about a millimetre. Legs are checked at these rounded positions.
DECIMALS = 8
# Latitude (degrees) above which legs are orthodromes: IEC 61174 warns that systems draw loxodromes
# differently there.
_HIGH_LATITUDE_DEG = 70.0
_GEOD = pyproj.Geod(ellps="WGS84")
# Largest curvature of straight lines of the plane, 1 / earth radius; a loxodrome's is
# tan(latitude).
_PLANE_CURVATURE = 0.2
# Minimum length of a chord, metres.
_MIN_STEP_M = 1.0


def curve_for(lonlat: FloatArray) -> Curve:
    """Choose the geometry of legs between points (n, 2), in degrees."""
    high = np.abs(lonlat[:, 1]).max() > _HIGH_LATITUDE_DEG
    return "Orthodrome" if high else "Loxodrome"


@dataclass(frozen=True)
class Tracks:
    """k legs, drawn as m points along them, in order.

    `lonlat` (m, 2) degrees, continuous across 180; `xy` (m, 2) planner's metres; `leg` (m,) index
    of each point's leg.
    """

    lonlat: FloatArray
    xy: FloatArray
    leg: IntArray

    @property
    def lines(self) -> Geometries:
        """One LineString a leg, in the plane."""
        return np.asarray(shapely.linestrings(self.xy, indices=self.leg))

    @property
    def chain(self) -> tuple[FloatArray, IntArray]:
        """Consecutive legs as one line (n, 2) of the plane; indices (k + 1,) of the legs' ends."""
        begins = np.flatnonzero(np.diff(self.leg, prepend=-1))
        doubled = begins[1:]
        ends = np.append(begins - np.arange(len(begins)), len(self.leg) - len(begins))
        return np.delete(self.xy, doubled, axis=0), ends

    @property
    def length_m(self) -> FloatArray:
        """True length of each leg (k,)."""
        steps = _GEOD.inv(
            self.lonlat[:-1, 0], self.lonlat[:-1, 1], self.lonlat[1:, 0], self.lonlat[1:, 1]
        )[2]
        inside = self.leg[:-1] == self.leg[1:]
        total = np.zeros(int(self.leg[-1]) + 1)
        np.add.at(total, self.leg[:-1][inside], np.asarray(steps)[inside])
        return total


def tracks(
    begin: FloatArray, end: FloatArray, curve: Curve, projection: Projection, error_m: float
) -> Tracks:
    """Draw legs from points (k, 2) to points (k, 2), in degrees.

    The polylines in the plane are within `error_m` true metres of the legs everywhere.
    """
    lonlat, leg = in_pieces(begin, end, curve, _step_m(begin, end, error_m))
    return Tracks(lonlat, projection.to_plane(lonlat), leg)


def in_pieces(
    begin: FloatArray, end: FloatArray, curve: Curve, most_m: FloatArray | float
) -> tuple[FloatArray, IntArray]:
    """Cut legs from points (k, 2) to points (k, 2), degrees, into pieces of at most `most_m` (k,).

    Return the ends of the pieces (m, 2), degrees, and the leg of each (m,).
    """
    distance = np.asarray(_GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])[2])
    pieces = np.maximum(1, np.ceil(distance / most_m)).astype(np.int64)
    leg = np.repeat(np.arange(len(begin)), pieces + 1)
    share = (np.arange(len(leg)) - (np.cumsum(pieces + 1) - pieces - 1)[leg]) / pieces[leg]
    between = _on_loxodrome if curve == "Loxodrome" else _on_geodesic
    lonlat = between(begin, end, leg, share)
    # The computed ends are rounded: the legs' exact ends take their place.
    lonlat[share <= 0], lonlat[share >= 1] = begin, end
    return lonlat, leg


@dataclass(frozen=True)
class Drawing:
    """How legs are drawn: curve, and maximum error in true metres."""

    projection: Projection
    curve: Curve
    error_m: float

    def lonlat(self, xy: FloatArray) -> FloatArray:
        """Return degrees (n, 2) of planar points, as they will be written."""
        return np.round(self.projection.to_lonlat(xy), DECIMALS)

    def lines(self, begin: FloatArray, end: FloatArray) -> Geometries:
        """Return legs from degrees (k, 2) to degrees (k, 2), as lines of the plane."""
        return tracks(begin, end, self.curve, self.projection, self.error_m).lines


def initial_course_deg(begin: FloatArray, end: FloatArray, curve: Curve) -> FloatArray:
    """Return true course (k,) in degrees at the start of each leg; constant along a loxodrome."""
    if curve == "Orthodrome":
        azimuth = np.asarray(_GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])[0])
        return azimuth % 360
    north = (_northing(end[:, 1]) - _northing(begin[:, 1])) / _GEOD.a
    course: FloatArray = np.degrees(np.arctan2(np.radians(end[:, 0] - begin[:, 0]), north)) % 360
    return course


def _step_m(begin: FloatArray, end: FloatArray, error_m: float) -> FloatArray:
    """Return the length (k,) of chords that are within `error_m` of their leg everywhere."""
    latitude = np.minimum(np.maximum(np.abs(begin[:, 1]), np.abs(end[:, 1])), 89.0)
    bend = (np.tan(np.radians(latitude)) + _PLANE_CURVATURE) / _GEOD.a
    step: FloatArray = np.maximum(np.sqrt(8 * error_m / bend), _MIN_STEP_M)
    return step


def _on_loxodrome(
    begin: FloatArray, end: FloatArray, leg: IntArray, share: FloatArray
) -> FloatArray:
    """Return points (m, 2) at shares of some of the loxodromes (k,) from `begin` to `end`."""
    low, high = _northing(begin[:, 1])[leg], _northing(end[:, 1])[leg]
    latitude = _mercator().transform(
        np.zeros(len(share)), low + share * (high - low), direction="INVERSE"
    )[1]
    longitude = begin[leg, 0] + share * (end[leg, 0] - begin[leg, 0])
    return np.stack([longitude, latitude], axis=-1)


def _on_geodesic(
    begin: FloatArray, end: FloatArray, leg: IntArray, share: FloatArray
) -> FloatArray:
    """Return points (m, 2) at shares of some of the geodesics (k,) from `begin` to `end`."""
    azimuth, _, distance = _GEOD.inv(begin[:, 0], begin[:, 1], end[:, 0], end[:, 1])
    first = begin[leg]
    longitude, latitude, _ = _GEOD.fwd(
        first[:, 0], first[:, 1], azimuth[leg], share * distance[leg]
    )
    longitude = longitude - 360 * np.round((longitude - first[:, 0]) / 360)
    return np.stack([longitude, latitude], axis=-1)


def _northing(latitude: FloatArray) -> FloatArray:
    """Return Mercator's northing in metres; latitudes are limited so that it stays finite."""
    limited = np.clip(latitude, -90 + 1e-9, 90 - 1e-9)
    return np.asarray(_mercator().transform(np.zeros(len(limited)), limited)[1])


@lru_cache(maxsize=1)
def _mercator() -> pyproj.Transformer:
    """Return the transformer from lon/lat to Mercator's projection of the ellipsoid."""
    return pyproj.Transformer.from_crs("OGC:CRS84", "+proj=merc +datum=WGS84", always_xy=True)


# Minimum clearance of a leg from V and land, as a share of the path's own least clearance.
_MIN_CLEARANCE_SHARE = 0.5
# Clearance that legs are given where there is water for it, as a share of the corridor's half
# width. The least fuel lies at V's edge, where any steering error would raise an alarm.
_WANTED_CLEARANCE_SHARE = 0.5
# Detail of land and V that clearances of legs leave out, as a share of the wanted clearance: it
# hardly changes them, and the time to find them is that for each vertex.
_DETAIL_SHARE = 0.02
# Maximum drawing error of a leg, in turning radii: finer drawing changes nothing for a vessel.
_MAX_ERROR_RADII = 2e-3
# Distance outside V, in turning radii, at which a leg that leaves V ends.
_EXIT_RADII = 0.1
_QUADRANT_SEGMENTS = 4


class Obstacles:
    """Land, no-go zone and edge of a case's chart, planar metres, indexed once for all its routes.

    `areas` are shut when a route would pass them: they count as land.
    """

    def __init__(self, case: Case, areas: Sequence[shapely.Geometry] = ()) -> None:
        self.case, self._areas = case, tuple(areas)
        self._land = np.array([*case.water.land, *areas], dtype=object)
        self._tree = shapely.STRtree(self._land)
        self._extent = case.chart.extent
        shapely.prepare(self._extent)

    def land_in(self, area: shapely.Geometry) -> shapely.Geometry:
        """Return the original land inside an area, as one geometry."""
        near = self._land[self._tree.query(area, predicate="intersects")]
        return shapely.union_all(shapely.intersection(near, area))

    def clipped_to_chart(self, area: shapely.Geometry) -> shapely.Geometry:
        """Clip an area to the chart: beyond its edge the land is unknown."""
        if shapely.covers(self._extent, area):
            return area
        return shapely.intersection(area, self._extent)

    @cached_property
    def edges(self) -> shapely.STRtree:
        """Tree of the edges of the hard no-go zone, which covers all land, and of the chart."""
        areas = [*self.case.chart.no_go, *self._areas, self._extent]
        edges = edges_of(shapely.get_parts(areas))
        return shapely.STRtree(shapely.linestrings(edges))


@dataclass(frozen=True)
class SafeCorridor:
    """Where the legs of one route may run, in planar metres.

    Attributes
    ----------
    path : the planned path (n, 2), with an extra vertex where it leaves or enters V.
    free : water within the tolerance of the path, off the original land and off V.
    blocked : land and V near the path, to about 2 % of the wanted clearance.
    wanted_clearance : clearance from `blocked` that legs are given where possible.
    off_land : `free`, with V included if the route starts or ends in V: for the legs inside V.
    first, last : indices of the path's vertices between which the path is outside V.
    max_error : maximum drawing error of a leg: `free` keeps at least this far from land and V.
    """

    path: FloatArray
    free: shapely.Geometry
    blocked: shapely.Geometry
    wanted_clearance: float
    off_land: shapely.Geometry
    first: int
    last: int
    max_error: float

    @cached_property
    def holes(self) -> FloatArray:
        """Points (h, 2), one in each hole of `free`; legs pass a hole on the path's side."""
        parts = shapely.get_parts(self.free)
        holes = [shapely.Polygon(ring) for part in parts for ring in shapely.get_rings(part)[1:]]
        inside = shapely.point_on_surface(np.array(holes, dtype=object))
        return np.asarray(shapely.get_coordinates(inside))

    def clearance(self, geometries: Geometries) -> FloatArray:
        """Return distance (n,) of points or lines from V and land, capped at `wanted_clearance`."""
        clearance = np.full(len(geometries), self.wanted_clearance)
        # Most lines are far from V and land, which is known sooner than how far.
        near = shapely.dwithin(self.blocked, geometries, self.wanted_clearance)
        clearance[near] = shapely.distance(self.blocked, geometries[near])
        return clearance


def safe_corridor(route: renew.Route, obstacles: Obstacles, tolerance: float) -> SafeCorridor:
    """Build a route's corridor, up to `tolerance` metres of the plane to each side of its path."""
    line = shapely.LineString(route.path)
    around = obstacles.clipped_to_chart(
        shapely.buffer(line, tolerance, quad_segs=_QUADRANT_SEGMENTS)
    )
    land = obstacles.land_in(around)
    soft = shapely.intersection(route.soft_no_go, around)
    radius = float(route.speeds.max()) / obstacles.case.vessel.turn_rate
    path, first, last = _with_exits(soft, np.asarray(route.path, dtype=float), _EXIT_RADII * radius)
    outside = shapely.LineString(path[first : last + 1]) if first < last else shapely.Point(path[0])
    blocked = shapely.union(soft, land)
    clearance = shapely.distance(outside, blocked)
    # NaN where nothing is blocked; 0 where the path itself touches land or V.
    margin = _MIN_CLEARANCE_SHARE * clearance if np.isfinite(clearance) else tolerance
    margin_area = shapely.buffer(blocked, margin, quad_segs=_QUADRANT_SEGMENTS)
    free = off_land = shapely.difference(around, margin_area)
    if first > 0 or last < len(path) - 1:
        off_land = shapely.difference(around, land)
    wanted_clearance = _WANTED_CLEARANCE_SHARE * tolerance
    blocked = shapely.simplify(blocked, _DETAIL_SHARE * wanted_clearance, preserve_topology=False)
    shapely.prepare([free, off_land, blocked])
    cap = _MAX_ERROR_RADII * radius
    return SafeCorridor(
        path=path,
        free=free,
        blocked=blocked,
        wanted_clearance=wanted_clearance,
        off_land=off_land,
        first=first,
        last=last,
        max_error=min(cap, margin) or cap,
    )


def kept_out(case: Case, route: renew.Route) -> list[shapely.Geometry]:
    """Return the shut areas, and water of too little tide, that a route's legs must keep out of."""
    areas = [area.polygon for area in case.areas]
    if case.tidal_depth is not None:
        areas += case.tidal_depth.areas
    # An area that the path itself crosses is open when the vessel passes.
    line = shapely.LineString(route.path)
    return [area for area in areas if not line.intersects(area)]


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the cross products (n,) of planar vectors (n, 2)."""
    product: FloatArray = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return product


def _with_exits(
    soft: shapely.Geometry, path: FloatArray, margin: float
) -> tuple[FloatArray, int, int]:
    """Add a vertex `margin` outside V at each end of a path that lies in V.

    Returns the path and the indices of these vertices (else of start and goal), between which the
    path is outside V.
    """
    backwards, last = _with_exit(soft, path[::-1], margin)
    forwards, first = _with_exit(soft, backwards[::-1], margin)
    last = len(forwards) - 1 - last
    return forwards, min(first, last), last


def _with_exit(soft: shapely.Geometry, path: FloatArray, margin: float) -> tuple[FloatArray, int]:
    """Add a vertex where a path that starts in V has left it; also return its index, or else 0."""
    legs = shapely.linestrings(np.stack([path[:-1], path[1:]], axis=1))
    outside = np.flatnonzero(~shapely.intersects(soft, legs))
    leg = int(outside[0]) - 1 if outside.size else len(legs) - 1
    if leg < 0:
        return path, 0
    inside = shapely.get_coordinates(shapely.intersection(soft, legs[leg]))
    left = float(np.linalg.norm(inside - path[leg], axis=1).max()) + margin
    length = float(shapely.length(legs[leg]))
    if left >= length:
        return path, leg + 1
    exit_ = path[leg] + left / length * (path[leg + 1] - path[leg])
    return np.insert(path, leg + 1, exit_, axis=0), leg + 1


# Maximum length of a turn's tangent, as a share of the leg, whose other end needs the other half.
_MAX_LEG_SHARE = 0.5
# Number of edges of each area that are clipped to the area in one call.
_AT_ONCE = 4
# Maximum number of times that a turning radius is halved before the turn is given up.
_MAX_HALVINGS = 12


def cross_track_limits(
    legs: Tracks, soft_no_go: shapely.Geometry, obstacles: Obstacles, cap: float
) -> tuple[FloatArray, FloatArray]:
    """Return cross-track limits of each leg to port and to starboard (k,), metres of the plane.

    A limit is the distance from the leg, its ends included, to the nearest point on that side that
    belongs to V, to the hard no-go zone (which covers all land) or to the chart's edge; at most
    `cap`. V is the water from which a hard-over turn in the case's current could touch land, so
    within the limits the vessel stays out of V. A leg that lies in V, as it may at start or goal,
    has the limit 0: nothing is promised there.
    """
    count = len(legs.lines)
    sides = _Sides.of(legs, cap)
    limits = np.full(2 * count, cap)
    # Most of V is far from the legs, and to index all of its edges takes long.
    way, parts = shapely.multilinestrings(legs.lines), shapely.get_parts(soft_no_go)
    shapely.prepare(way)
    near = edges_of(parts[shapely.dwithin(way, parts, cap)])
    soft = shapely.STRtree(shapely.linestrings(sides.edges_within(cap, near)))
    for edges in (obstacles.edges, soft):
        _lower_to(limits, sides, edges)
    limits[np.tile(shapely.intersects(soft_no_go, legs.lines), 2)] = 0.0
    return limits[:count], limits[count:]


def turning_radii(legs: Tracks, corridor: SafeCorridor, radius: float) -> FloatArray:
    """Return radius of the turn at each waypoint between two legs (k - 1,), metres of the plane.

    `radius` is halved until the turn stays inside the corridor and takes up at most half of each
    leg; 0 if no such turn is found.
    """
    lines = legs.lines
    before, after = lines[:-1], lines[1:]
    corner = shapely.get_coordinates(shapely.get_point(after, 0))
    inwards = shapely.get_coordinates(shapely.get_point(before, -2)) - corner
    outwards = shapely.get_coordinates(shapely.get_point(after, 1)) - corner
    angle = np.abs(np.arctan2(cross(inwards, outwards), (inwards * outwards).sum(axis=1)))
    # Tangent of half the change of course; 0 where the course does not change.
    slope = np.tan((np.pi - angle) / 2)
    max_tangent = _MAX_LEG_SHARE * np.minimum(shapely.length(before), shapely.length(after))
    radii = np.zeros(len(corner))
    for halving in range(_MAX_HALVINGS):
        size = radius / 2**halving
        tangent = size * slope
        candidates = (radii == 0) & (tangent <= max_tangent)
        corners = [
            shapely.get_coordinates(
                shapely.line_interpolate_point(before[candidates], -tangent[candidates])
            ),
            corner[candidates],
            shapely.get_coordinates(
                shapely.line_interpolate_point(after[candidates], tangent[candidates])
            ),
        ]
        triangles = shapely.convex_hull(shapely.linestrings(np.stack(corners, axis=1)))
        radii[np.flatnonzero(candidates)[shapely.covers(corridor.free, triangles)]] = size
    return radii


@dataclass(frozen=True)
class _Sides:
    """Both sides of k legs: all port sides, then all starboard sides.

    `areas` (2k,) lie beside the legs `lines` (2k,); `chords` (2k, 2, 2) run from a leg's start to
    its end; `offsets` (2k,) are the legs' greatest distances from their chords.
    """

    areas: Geometries
    lines: Geometries
    chords: FloatArray
    offsets: FloatArray

    @classmethod
    def of(cls, legs: Tracks, width: float) -> Self:
        """Return sides of legs, reaching at least a width away from them."""
        starts = np.flatnonzero(np.diff(legs.leg, prepend=-1))
        ends = np.append(starts[1:], len(legs.leg)) - 1
        chords = np.stack([legs.xy[starts], legs.xy[ends]], axis=1)
        aside = _aside(chords)
        apart = np.abs(((legs.xy - legs.xy[starts][legs.leg]) * aside[legs.leg]).sum(axis=1))
        offsets = np.maximum.reduceat(apart, starts)
        areas = [_side_areas(legs, starts, ends, side * (width + offsets)) for side in (1, -1)]
        return cls(
            np.concatenate(areas),
            np.tile(legs.lines, 2),
            np.tile(chords, (2, 1, 1)),
            np.tile(offsets, 2),
        )

    def edges_within(self, distance: float, edges: FloatArray) -> FloatArray:
        """Select the edges, of (n, 2, 2), that may be within a distance of a leg."""
        middle = edges.mean(axis=1)
        reach = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) / 2 + distance
        near = np.zeros(len(edges), dtype=bool)
        legs = len(self.chords) // 2
        for (begin, end), offset in zip(self.chords[:legs], self.offsets[:legs], strict=True):
            way, chord = middle - begin, end - begin
            share = np.clip(way @ chord / (chord @ chord), 0.0, 1.0)
            apart = way - share[:, None] * chord
            near |= np.einsum("ij,ij->i", apart, apart) < (reach + offset) ** 2
        return edges[near]

    def least_distance(self, side: IndexArray, ends: FloatArray) -> FloatArray:
        """Return a lower bound (n,) on the distance of edges (n, 2, 2) from their sides' legs."""
        half = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
        begin, chord = self.chords[side, 0], self.chords[side, 1] - self.chords[side, 0]
        way = ends.mean(axis=1) - begin
        share = np.clip((way * chord).sum(axis=1) / (chord * chord).sum(axis=1), 0.0, 1.0)
        middle = np.linalg.norm(way - share[:, None] * chord, axis=1)
        return np.asarray(middle - half - self.offsets[side])


def _aside(chords: FloatArray) -> FloatArray:
    """Return the unit vectors (k, 2) to port of chords (k, 2, 2)."""
    along = chords[:, 1] - chords[:, 0]
    ahead = along / np.linalg.norm(along, axis=1)[:, None]
    return np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)


def _side_areas(
    legs: Tracks, starts: IndexArray, ends: IndexArray, reach: FloatArray
) -> Geometries:
    """Return the area beside each leg (k,), to port, or to starboard with a negative reach (k,).

    It lies between the leg, extended at both ends, and a parallel of its chord at that reach.
    """
    aside = _aside(np.stack([legs.xy[starts], legs.xy[ends]], axis=1))
    ahead = np.stack([aside[:, 1], -aside[:, 0]], axis=-1)
    far = aside * reach[:, None]
    width = np.abs(reach)[:, None]
    back = legs.xy[starts] - width * ahead
    front = legs.xy[ends] + width * ahead
    rings = [
        np.vstack(
            [
                back[i],
                legs.xy[starts[i] : ends[i] + 1],
                front[i],
                front[i] + far[i],
                back[i] + far[i],
            ]
        )
        for i in range(len(starts))
    ]
    of_leg = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    return np.asarray(shapely.polygons(shapely.linearrings(np.concatenate(rings), indices=of_leg)))


def _lower_to(limits: FloatArray, sides: _Sides, edges: shapely.STRtree) -> None:
    """Lower each side's limit to the distance of the leg from the edges inside the side's area.

    Clipping an edge to an area takes long, so the edges that may be nearest come first, a few of
    each area at once, until no other edge can be nearer.
    """
    area, edge = edges.query(sides.areas, predicate="intersects")
    lines = edges.geometries[edge]
    least = sides.least_distance(area, shapely.get_coordinates(lines).reshape(-1, 2, 2))
    order = np.lexsort((least, area))
    while len(order := order[least[order] < limits[area[order]]]):
        of = area[order]
        first = np.arange(len(of)) - np.searchsorted(of, of) < _AT_ONCE
        of = of[first]
        parts = shapely.intersection(sides.areas[of], lines[order[first]])
        # An edge that only touches an area has no part inside, by rounding, and no distance.
        np.fmin.at(limits, of, shapely.distance(parts, sides.lines[of]))
        order = order[~first]
