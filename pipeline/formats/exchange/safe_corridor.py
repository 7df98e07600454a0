"""The water in which a route's legs may be drawn: near the planned line, off land and off V."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry.base import BaseGeometry

    import renew
    from pipeline.model import Scene

    FloatArray = npt.NDArray[np.float64]

# Legs keep this share of the least room that the planned line leaves to V or land; and none needs
# drawing finer than this share of a turning radius.
_SHARE_OF_ROOM = 0.5
# The least fuel lies at V's edge, where no course can be kept without an alarm: legs are drawn so
# far from it, as a share of the lane's half width, where there is water for it.
_USEFUL_ROOM = 0.5
_FINEST_RADII = 2e-3
# A leg that leaves V ends this many turning radii outside it.
_EXIT_RADII = 0.1
_QUADRANT_SEGMENTS = 4


class Shores:
    """What all routes of a scene have to keep off, made ready once: planar metres."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._land = np.array(scene.land, dtype=object)
        self._tree = shapely.STRtree(self._land)
        self._extent = scene.chart.extent
        shapely.prepare(self._extent)

    def land_in(self, area: BaseGeometry) -> BaseGeometry:
        """Unite what of the original land lies in an area."""
        near = self._land[self._tree.query(area, predicate="intersects")]
        return shapely.union_all(shapely.intersection(near, area))

    def on_chart(self, area: BaseGeometry) -> BaseGeometry:
        """Part of an area that lies on the chart: beyond its edge nobody knows the land."""
        if shapely.covers(self._extent, area):
            return area
        return shapely.intersection(area, self._extent)

    @cached_property
    def edges(self) -> tuple[npt.NDArray[np.object_], shapely.STRtree]:
        """Edges of the hard no-go zone, which covers all land, and of the chart; their tree."""
        areas = [*self.scene.chart.no_go, self._extent]
        parts = np.asarray(shapely.linestrings(edges_of(areas)))
        return parts, shapely.STRtree(parts)


@dataclass(frozen=True)
class Lane:
    """Where the legs of one route may run, in planar metres.

    Attributes
    ----------
    path
        The planned path (n, 2), with a vertex more where it leaves or enters V.
    free
        Within `tolerance` of the path, off the original land and off V.
    blocked
        Land and V in these parts.
    useful
        Room to `blocked` (metres of the plane) that legs want.
    lawful
        The same with V in it, where the route begins or ends in V: for the legs in there.
    first, last
        Indices of the path's vertices between which it keeps out of V.
    error
        How exactly legs have to be drawn (metres of the plane): `free` keeps so far off at least.
    """

    path: FloatArray
    free: BaseGeometry
    blocked: BaseGeometry
    useful: float
    lawful: BaseGeometry
    first: int
    last: int
    error: float

    @cached_property
    def holes(self) -> FloatArray:
        """Points (h, 2), one in each hole of `free`: what a leg must pass on the path's side."""
        parts = shapely.get_parts(self.free)
        holes = [shapely.Polygon(ring) for part in parts for ring in shapely.get_rings(part)[1:]]
        inside = shapely.point_on_surface(np.array(holes, dtype=object))
        return np.asarray(shapely.get_coordinates(inside))

    @cached_property
    def _shore(self) -> shapely.STRtree:
        """Edges of what is blocked."""
        return shapely.STRtree(shapely.linestrings(edges_of([self.blocked])))

    def room(self, geometries: npt.NDArray[np.object_]) -> FloatArray:
        """Room (n,) of points or lines to V and land, in metres of the plane; `useful` at most."""
        room = np.full(len(geometries), self.useful)
        (index, _), apart = self._shore.query_nearest(
            geometries, max_distance=self.useful, all_matches=False, return_distance=True
        )
        room[index] = apart
        return room


def lane(route: renew.Route, shores: Shores, tolerance: float) -> Lane:
    """Mark out the lane of a route, `tolerance` metres of the plane to each side of its path."""
    line = shapely.LineString(route.path)
    around = shores.on_chart(shapely.buffer(line, tolerance, quad_segs=_QUADRANT_SEGMENTS))
    land = shores.land_in(around)
    soft = shapely.intersection(route.soft_no_go, around)
    radius = shores.scene.vessel.turning_radius
    path, first, last = _clear_of(soft, np.asarray(route.path, dtype=float), _EXIT_RADII * radius)
    finest = _FINEST_RADII * radius
    kept = shapely.LineString(path[first : last + 1]) if first < last else shapely.Point(path[0])
    blocked = shapely.union(soft, land)
    room = shapely.distance(kept, blocked)
    # NaN where there is nothing to keep off; 0 where the path itself touches land or V.
    kept_off = _SHARE_OF_ROOM * room if np.isfinite(room) else tolerance
    off = shapely.buffer(blocked, kept_off, quad_segs=_QUADRANT_SEGMENTS)
    free = lawful = shapely.difference(around, off)
    if first > 0 or last < len(path) - 1:
        lawful = shapely.difference(around, land)
    shapely.prepare([free, lawful])
    useful = _USEFUL_ROOM * tolerance
    error = min(finest, kept_off) or finest
    return Lane(path, free, blocked, useful, lawful, first, last, error)


def edges_of(areas: list[BaseGeometry]) -> FloatArray:
    """Ends (n, 2, 2) of the edges of areas' rings."""
    rings = shapely.get_rings(shapely.get_parts(np.array(areas, dtype=object)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    inside = ring[:-1] == ring[1:]
    return np.stack([points[:-1][inside], points[1:][inside]], axis=1)


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Cross products (n,) of planar vectors (n, 2)."""
    product: FloatArray = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return product


def _clear_of(soft: BaseGeometry, path: FloatArray, margin: float) -> tuple[FloatArray, int, int]:
    """Give a path that begins or ends in V a vertex `margin` outside V.

    Returns it with the indices of these vertices, or of its start and goal: it keeps out of V
    between them.
    """
    backwards, last = _with_exit(soft, path[::-1], margin)
    forwards, first = _with_exit(soft, backwards[::-1], margin)
    last = len(forwards) - 1 - last
    return forwards, min(first, last), last


def _with_exit(soft: BaseGeometry, path: FloatArray, margin: float) -> tuple[FloatArray, int]:
    """Give a path that begins in V a vertex where it has left V; also its index, else 0."""
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
