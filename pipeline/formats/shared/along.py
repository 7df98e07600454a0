"""What a route meets on its way: time, fuel, speed, current and clearance at places along it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.geo.projection import in_pieces

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry import Polygon

    from pipeline.formats.shared.result import RankedRoute, RunResult
    from pipeline.geo.projection import Projection

    FloatArray = npt.NDArray[np.float64]

# Places are no further apart than this (true metres): the plane's scale is one and the same
# between them, and so is the geodesic and the plane's straight line.
_LONGEST_STEP_M = 10_000.0
# Coast this much further than the nearest in the plane may still be the nearest on earth.
_NEARLY = 1.02
# Two places this share of the route apart are one.
_SAME = 1e-9


@dataclass(frozen=True)
class Along:
    """A route at n places from start to goal, in order: arrays (n,), `lonlat` (n, 2).

    Among the places are all of the path's vertices and the place of least clearance.

    Attributes
    ----------
    distance_m : true geodesic metres from the start.
    time_s : true-scale seconds since departure.
    lonlat : degrees.
    course_deg : true course towards the next place; at the goal, that of arrival.
    fuel : used since departure, in the planner's units.
    speed_m_s : over ground, the mean to the next place; at the goal, that of arrival.
    current_along_m_s : the current's part along the course, a following one positive.
    clearance_m : true metres to the original land; inf where there is none at all.
    """

    distance_m: FloatArray
    time_s: FloatArray
    lonlat: FloatArray
    course_deg: FloatArray
    fuel: FloatArray
    speed_m_s: FloatArray
    current_along_m_s: FloatArray
    clearance_m: FloatArray


def along(ranked: RankedRoute, result: RunResult, *, points: int = 200) -> Along:
    """Look at a route every 1/points of its length and at its vertices.

    Fuel and time end at the route's own figures, and the least clearance is its clearance.
    Calls for routes of one scene share what is known of its coast.
    """
    import pyproj

    from renew.inputs.fuel import passage_times

    scene, metrics = result.scene, ranked.metrics
    projection = scene.projection
    path = _without_repeats(np.asarray(ranked.route.path, dtype=float))
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    places = in_pieces(path, min(length / points, _LONGEST_STEP_M / projection.scale))
    coast = _coast(scene.land)
    least = coast.least(places, projection)
    if least is not None:
        places = _with(places, least.place, _SAME * length)

    lonlat = projection.to_lonlat(places)
    azimuth, back, step_m = pyproj.Geod(ellps="WGS84").inv(
        lonlat[:-1, 0], lonlat[:-1, 1], lonlat[1:, 0], lonlat[1:, 1]
    )
    current = scene.currents[ranked.season]
    passage = passage_times(places, current, scene.vessel, drift=result.scenario.planner.drift)
    # A metre of the plane is not one on earth, and takes as much more or less time.
    step_s = passage / projection.point_scale((lonlat[:-1] + lonlat[1:]) / 2)
    step_s *= metrics.duration_s / step_s.sum()
    legs = np.diff(places, axis=0)
    tangent = _to_each_place(legs / np.linalg.norm(legs, axis=1, keepdims=True))
    clearance = coast.clearance_m(places, projection, crosses=metrics.land_m > 0)
    if least is not None:
        nearest = np.argmin(np.linalg.norm(places - least.place, axis=1))
        # On land the coast may be far.
        floor = 0.0 if metrics.land_m > 0 else least.clearance_m
        clearance = np.maximum(clearance, floor)
        clearance[nearest] = floor
    return Along(
        distance_m=_sums(step_m),
        time_s=_sums(step_s),
        lonlat=lonlat,
        course_deg=np.append(azimuth, back[-1] + 180) % 360,
        fuel=_sums(passage * (metrics.fuel / passage.sum())),
        speed_m_s=_to_each_place(step_m / step_s),
        current_along_m_s=(np.asarray(current(places)) * tangent).sum(axis=1),
        clearance_m=clearance,
    )


@dataclass(frozen=True)
class _Least:
    """The place (2,) of a route where land is nearest, and how near (true metres)."""

    place: FloatArray
    clearance_m: float


@dataclass(frozen=True)
class _Coast:
    """Edges of the land: a tree over each of them finds the nearest at once."""

    land: npt.NDArray[np.object_]
    edges: npt.NDArray[np.object_]
    tree: shapely.STRtree

    def clearance_m(
        self, places: FloatArray, projection: Projection, *, crosses: bool
    ) -> FloatArray:
        """True metres (n,) from places (n, 2) to the coast; 0 on land, where the route crosses."""
        import pyproj

        if not len(self.edges):
            return np.full(len(places), math.inf)
        points = shapely.points(places)
        nearest = self.tree.query_nearest(points, all_matches=False)[1]
        ends = projection.to_lonlat(
            shapely.get_coordinates(shapely.shortest_line(points, self.edges[nearest]))
        )
        near, far = ends[::2], ends[1::2]
        clearance = np.asarray(
            pyproj.Geod(ellps="WGS84").inv(near[:, 0], near[:, 1], far[:, 0], far[:, 1])[2]
        )
        if crosses:
            clearance[shapely.STRtree(points).query(self.land, predicate="intersects")[1]] = 0.0
        return clearance

    def least(self, places: FloatArray, projection: Projection) -> _Least | None:
        """Where the way through places (n, 2) comes nearest to the coast; None without one.

        What is nearest in the plane need not be so on earth: all that comes nearly as near is
        measured.
        """
        if not len(self.edges):
            return None
        steps = shapely.linestrings(np.stack([places[:-1], places[1:]], axis=1))
        apart = self.tree.query_nearest(steps, return_distance=True, all_matches=False)[1]
        middles = projection.to_lonlat((places[:-1] + places[1:]) / 2)
        true = apart / projection.point_scale(middles)
        near = true <= true.min() * _NEARLY
        step, edge = self.tree.query(
            steps[near], predicate="dwithin", distance=apart[near] * _NEARLY
        )
        gaps = shapely.get_coordinates(
            shapely.shortest_line(steps[near][step], self.edges[edge])
        ).reshape(-1, 2, 2)
        lengths = [projection.geodesic_length_m(gap) for gap in gaps]
        best = int(np.argmin(lengths))
        return _Least(gaps[best, 0], lengths[best])


# Polygons are hashed by their coordinates, which takes a hundredth of what the tree takes.
@lru_cache(maxsize=2)
def _coast(land: tuple[Polygon, ...]) -> _Coast:
    """Cut all rings of the land into their edges."""
    rings = shapely.get_rings(np.array(land, dtype=object))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    joined = ring[:-1] == ring[1:]
    edges = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1)[joined])
    return _Coast(np.array(land, dtype=object), edges, shapely.STRtree(edges))


def _without_repeats(path: FloatArray) -> FloatArray:
    """Drop vertices (n, 2) that lie where the one before them does."""
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1) > 0
    return np.concatenate([path[:1], path[1:][moved]])


def _with(places: FloatArray, place: FloatArray, same: float) -> FloatArray:
    """Put a place (2,) of the way through places (n, 2) among them, unless it is one of them."""
    if np.linalg.norm(places - place, axis=1).min() <= same:
        return places
    steps = shapely.linestrings(np.stack([places[:-1], places[1:]], axis=1))
    after = int(np.argmin(shapely.distance(steps, shapely.Point(place))))
    return np.insert(places, after + 1, place, axis=0)


def _sums(steps: FloatArray) -> FloatArray:
    """Sums (n + 1,) of steps (n,), from 0."""
    return np.concatenate([[0.0], np.cumsum(steps)])


def _to_each_place(steps: FloatArray) -> FloatArray:
    """Give each place the figure of the step that leaves it; the last, of the one that arrives."""
    return np.concatenate([steps, steps[-1:]])
