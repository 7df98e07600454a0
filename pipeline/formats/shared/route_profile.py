"""Profile of a route: time, fuel, speed, current and clearance at points along it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pyproj
import shapely

from pipeline._types import FloatArray, Geometries
from pipeline.formats.shared.legs import cumulative, steps
from pipeline.formats.shared.result import RankedRoute, RunResult
from pipeline.geo.projection import Projection, densified

# Maximum distance between points, true metres: between them the plane has one scale, and geodesics
# are its straight lines.
_MAX_STEP_M = 10_000.0
# Factor on the least planar distance up to which coast may still be the nearest on earth.
_NEAREST_FACTOR = 1.02
# Distance, as a share of the route's length, below which two points count as one.
_SAME_POINT = 1e-9


@dataclass(frozen=True)
class RouteProfile:
    """A route at n points from start to goal, in order: arrays (n,), `lonlat` (n, 2).

    All of the path's vertices and the point of least clearance are among them.

    Attributes
    ----------
    distance_m : true geodesic metres from the start.
    time_s : true-scale seconds since departure.
    lonlat : degrees.
    course_deg : true course towards the next point; at the goal, on arrival.
    fuel : used since departure, in the planner's units.
    speed_m_s : mean speed over ground to the next point; at the goal, on arrival.
    through_water_m_s : speed through water to the next point; at the goal, on arrival.
    current_along_m_s : component of the current along the course, positive if following.
    clearance_m : true metres to the original land; inf without any land.
    """

    distance_m: FloatArray
    time_s: FloatArray
    lonlat: FloatArray
    course_deg: FloatArray
    fuel: FloatArray
    speed_m_s: FloatArray
    through_water_m_s: FloatArray
    current_along_m_s: FloatArray
    clearance_m: FloatArray


def route_profile(ranked: RankedRoute, result: RunResult, *, points: int = 200) -> RouteProfile:
    """Sample a route every 1/points of its length and at its vertices.

    Fuel and time end at the route's own figures, and the least clearance is the route's.
    """
    scene, metrics = result.scene, ranked.metrics
    projection = scene.projection
    path = np.asarray(ranked.route.path, dtype=float)
    # Without vertices that repeat the one before them.
    path = path[np.append(True, np.diff(path, axis=0).any(axis=1))]
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    sampled = densified(path, min(length / points, _MAX_STEP_M / projection.scale))
    coast = coast_index(scene.land)
    closest = coast.closest_approach(sampled, projection)
    if closest is not None:
        sampled = _with_point(sampled, closest.point, _SAME_POINT * length)

    lonlat = projection.to_lonlat(sampled)
    azimuth, back, step_m = pyproj.Geod(ellps="WGS84").inv(
        lonlat[:-1, 0], lonlat[:-1, 1], lonlat[1:, 0], lonlat[1:, 1]
    )
    current = scene.currents[ranked.season]
    found = steps(sampled, ranked, result)
    way = np.diff(sampled, axis=0)
    tangent = _with_last_repeated(way / np.linalg.norm(way, axis=1, keepdims=True))
    step_fuel = found.planner_s * found.through_water_m_s**scene.vessel.fuel_exponent
    clearance = coast.clearance_m(sampled, projection, crosses_land=metrics.land_m > 0)
    if closest is not None:
        nearest = np.argmin(np.linalg.norm(sampled - closest.point, axis=1))
        # A route over land has no clearance, however far the coastline may be.
        least_m = 0.0 if metrics.land_m > 0 else closest.clearance_m
        clearance = np.maximum(clearance, least_m)
        clearance[nearest] = least_m
    return RouteProfile(
        distance_m=cumulative(step_m),
        time_s=cumulative(found.true_s),
        lonlat=lonlat,
        course_deg=np.append(azimuth, back[-1] + 180) % 360,
        fuel=cumulative(step_fuel * (metrics.fuel / step_fuel.sum())),
        speed_m_s=_with_last_repeated(step_m / found.true_s),
        through_water_m_s=_with_last_repeated(found.through_water_m_s),
        current_along_m_s=(current.velocity(sampled, cumulative(found.planner_s)) * tangent).sum(
            axis=1
        ),
        clearance_m=clearance,
    )


@dataclass(frozen=True)
class ClosestApproach:
    """The point (2,) of a route where land is nearest, and its distance in true metres."""

    point: FloatArray
    clearance_m: float


@dataclass(frozen=True)
class CoastIndex:
    """Land, its edges, and a tree of the edges that finds the nearest one."""

    land: Geometries
    edges: Geometries
    tree: shapely.STRtree

    def clearance_m(
        self, sampled: FloatArray, projection: Projection, *, crosses_land: bool
    ) -> FloatArray:
        """True metres (n,) from points (n, 2) to the coast; 0 on land, if the route crosses any."""
        if not len(self.edges):
            return np.full(len(sampled), math.inf)
        points = shapely.points(sampled)
        nearest = self.tree.query_nearest(points, all_matches=False)[1]
        ends = projection.to_lonlat(
            shapely.get_coordinates(shapely.shortest_line(points, self.edges[nearest]))
        )
        near, far = ends[::2], ends[1::2]
        clearance = np.asarray(
            pyproj.Geod(ellps="WGS84").inv(near[:, 0], near[:, 1], far[:, 0], far[:, 1])[2]
        )
        if crosses_land:
            clearance[shapely.STRtree(points).query(self.land, predicate="intersects")[1]] = 0.0
        return clearance

    def closest_approach(
        self, sampled: FloatArray, projection: Projection
    ) -> ClosestApproach | None:
        """Closest approach to the coast of the line through points (n, 2); None without a coast.

        The nearest coast in the plane need not be the nearest on earth, so all gaps that are nearly
        as small are measured.
        """
        if not len(self.edges):
            return None
        steps = _segments(sampled)
        apart = self.tree.query_nearest(steps, return_distance=True, all_matches=False)[1]
        middles = projection.to_lonlat((sampled[:-1] + sampled[1:]) / 2)
        true = apart / projection.point_scale(middles)
        near = true <= true.min() * _NEAREST_FACTOR
        step, edge = self.tree.query(
            steps[near], predicate="dwithin", distance=apart[near] * _NEAREST_FACTOR
        )
        gaps = shapely.get_coordinates(
            shapely.shortest_line(steps[near][step], self.edges[edge])
        ).reshape(-1, 2, 2)
        lengths = [projection.geodesic_length_m(gap) for gap in gaps]
        best = int(np.argmin(lengths))
        return ClosestApproach(gaps[best, 0], lengths[best])


def edges_of(areas: Sequence[shapely.Geometry]) -> FloatArray:
    """Endpoints (n, 2, 2) of the edges of all rings of areas."""
    rings = shapely.get_rings(shapely.get_parts(np.array(areas, dtype=object)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    return np.asarray(np.stack([points[:-1], points[1:]], axis=1)[ring[:-1] == ring[1:]])


# Polygons are hashed by their coordinates, which takes a hundredth of the time of the tree.
@lru_cache(maxsize=2)
def coast_index(land: tuple[shapely.Polygon, ...]) -> CoastIndex:
    """Index the edges of the land."""
    edges = shapely.linestrings(edges_of(land))
    return CoastIndex(np.array(land, dtype=object), edges, shapely.STRtree(edges))


def _with_point(line: FloatArray, point: FloatArray, same: float) -> FloatArray:
    """Insert a point (2,) that lies on a line (n, 2), unless a vertex is within `same` of it."""
    if np.linalg.norm(line - point, axis=1).min() <= same:
        return line
    after = int(np.argmin(shapely.distance(_segments(line), shapely.Point(point))))
    return np.insert(line, after + 1, point, axis=0)


def _segments(line: FloatArray) -> Geometries:
    """LineStrings (n - 1,) between the points (n, 2) of a line."""
    return np.asarray(shapely.linestrings(np.stack([line[:-1], line[1:]], axis=1)))


def _with_last_repeated(values: FloatArray) -> FloatArray:
    """Append the last value: at the goal, the values of the last step hold."""
    return np.concatenate([values, values[-1:]])
