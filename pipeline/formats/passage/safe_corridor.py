"""The safe corridor of a route: the water near its path, off land and off its soft no-go zone V.

Waypoints are chosen so that the legs between them stay inside this corridor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray, Geometries, IntArray
from pipeline.formats.shared.route_profile import edges_of
from pipeline.model import Scene

# Minimum clearance of a leg from V and land, as a share of the path's own least clearance.
_MIN_CLEARANCE_SHARE = 0.5
# Clearance that legs are given where there is water for it, as a share of the corridor's half
# width. The least fuel lies at V's edge, where any steering error would raise an alarm.
_WANTED_CLEARANCE_SHARE = 0.5
# Maximum drawing error of a leg, in turning radii: finer drawing changes nothing for a vessel.
_MAX_ERROR_RADII = 2e-3
# Distance outside V, in turning radii, at which a leg that leaves V ends.
_EXIT_RADII = 0.1
_QUADRANT_SEGMENTS = 4


class IndexedEdges:
    """Edges with their endpoints `ends` (n, 2, 2), as `lines` (n,), and a `tree` of these."""

    def __init__(self, ends: FloatArray) -> None:
        self.ends = ends
        self.lines: Geometries = np.asarray(shapely.linestrings(ends))
        self.tree = shapely.STRtree(self.lines)


class Obstacles:
    """Land, no-go zone and edge of a scene's chart, planar metres, indexed once for all its routes.

    `areas` are shut when a route passes them, and count as land then.
    """

    def __init__(self, scene: Scene, areas: Sequence[shapely.Geometry] = ()) -> None:
        self.scene, self._areas = scene, tuple(areas)
        self._land = np.array([*scene.land, *areas], dtype=object)
        self._tree = shapely.STRtree(self._land)
        self._extent = scene.chart.extent
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
    def edges(self) -> IndexedEdges:
        """Edges of the hard no-go zone, which covers all land, and of the chart."""
        return IndexedEdges(edges_of([*self.scene.chart.no_go, *self._areas, self._extent]))


@dataclass(frozen=True)
class SafeCorridor:
    """Where the legs of one route may run, in planar metres.

    Attributes
    ----------
    path : the planned path (n, 2), with an extra vertex where it leaves or enters V.
    free : water within the tolerance of the path, off the original land and off V.
    blocked : land and V near the path.
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

    @cached_property
    def _blocked_edges(self) -> shapely.STRtree:
        """Tree of the edges of `blocked`."""
        return shapely.STRtree(shapely.linestrings(edges_of([self.blocked])))

    def clearance(self, geometries: Geometries) -> FloatArray:
        """Distance (n,) of points or lines from V and land, capped at `wanted_clearance`."""
        clearance = np.full(len(geometries), self.wanted_clearance)
        # Most lines are far from all. The box of a long one holds thousands of edges, so its pieces
        # are looked at one by one.
        near = np.flatnonzero(shapely.dwithin(self.blocked, geometries, self.wanted_clearance))
        pieces, owner = _pieces(geometries[near])
        (index, _), apart = self._blocked_edges.query_nearest(
            pieces, max_distance=self.wanted_clearance, all_matches=False, return_distance=True
        )
        np.minimum.at(clearance, near[owner[index]], apart)
        return clearance


def _pieces(
    geometries: Geometries,
) -> tuple[Geometries, IntArray]:
    """Segments of lines (n,), or the points themselves, and the index of the one each is of."""
    points, owner = shapely.get_coordinates(geometries, return_index=True)
    inside = owner[:-1] == owner[1:]
    if not inside.any():
        return geometries, owner
    ends = np.stack([points[:-1][inside], points[1:][inside]], axis=1)
    return np.asarray(shapely.linestrings(ends)), owner[:-1][inside]


def safe_corridor(route: renew.Route, obstacles: Obstacles, tolerance: float) -> SafeCorridor:
    """Build a route's corridor, up to `tolerance` metres of the plane to each side of its path."""
    line = shapely.LineString(route.path)
    around = obstacles.clipped_to_chart(
        shapely.buffer(line, tolerance, quad_segs=_QUADRANT_SEGMENTS)
    )
    land = obstacles.land_in(around)
    soft = shapely.intersection(route.soft_no_go, around)
    radius = float(route.speeds.max()) / obstacles.scene.vessel.turn_rate
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
    shapely.prepare([free, off_land, blocked])
    cap = _MAX_ERROR_RADII * radius
    return SafeCorridor(
        path=path,
        free=free,
        blocked=blocked,
        wanted_clearance=_WANTED_CLEARANCE_SHARE * tolerance,
        off_land=off_land,
        first=first,
        last=last,
        max_error=min(cap, margin) or cap,
    )


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Cross products (n,) of planar vectors (n, 2)."""
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
    """Add a vertex where a path that starts in V has left it; returns its index too, else 0."""
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
