"""Move start, via points and goal that lie on land into the nearest water that joins them.

People give the quay, or the town. A stop is moved before the coast is simplified, so that the water
around it stays open as around any stop in water, and every file has the place where the voyage
begins or ends.
"""

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries
from pipeline.geo.projection import MAX_EDGE_M, Projection
from pipeline.model import Land, Note, Place
from pipeline.scenario.model import Anchorage, Scenario
from pipeline.scenario.strict import Point
from pipeline.sources.land.shapes import in_plane

# Decimals of a degree to which a moved stop is rounded: 1 m.
_DECIMALS = 5
# Least distance, m, that a moved stop keeps from charted land where the chart's accuracy finds no
# room: rounding does not bring it back onto land.
_LEAST_ROOM_M = 5.0


def in_water(scenario: Scenario, land: Land) -> tuple[Scenario, tuple[Note, ...]]:
    """Return the scenario with stops at most `planner.snap` off land in water, and a note on each.

    The water joins all stops on the chart. Where no water does within that distance, the scenario
    is returned as it is, and refused later. The vessel's own place under way is never moved.
    """
    region, snap_m = scenario.region, scenario.planner.snap
    if region is None or not snap_m or scenario.under_way is not None:
        return scenario, ()
    given = np.array([*scenario.stops.values()], dtype=float)
    dry = np.zeros(len(given), dtype=bool)
    polygons = np.array(land.polygons, dtype=object)
    dry[shapely.STRtree(polygons).query(shapely.points(given), predicate="intersects")[0]] = True
    if not dry.any():
        return scenario, ()
    plane = Projection.for_region(region.shape)
    here = shapely.points(plane.to_plane(given))
    extent = plane.geometry_to_plane(region.shape, MAX_EDGE_M)
    body = _joining_water(extent, in_plane(polygons, plane), here, dry * snap_m)
    if body is None:
        return scenario, ()
    moved, notes = dict(scenario.stops), list[Note]()
    for at in np.flatnonzero(dry):
        name = list(moved)[at]
        place = _nearest(here[at], body, snap_m, land.accuracy_m)
        lon, lat = np.round(plane.to_lonlat(place), _DECIMALS).tolist()
        lon += 360.0 * round((given[at, 0] - lon) / 360)
        moved[name] = (lon, lat)
        metres = plane.geodesic_length_m([plane.to_plane(given[at]), plane.to_plane((lon, lat))])
        notes.append(Note.of("stop-moved", stop=name, moved_m=metres, place=Place(lon, lat)))
    return _with_stops(scenario, list(moved.values())), tuple(notes)


def _joining_water(
    extent: shapely.Polygon, land: Geometries, stops: Geometries, reach_m: FloatArray
) -> shapely.Geometry | None:
    """Return the body of water that all stops (n,) reach within `reach_m` (n,); None if none is."""
    bodies = shapely.get_parts(shapely.difference(extent, shapely.disjoint_subset_union_all(land)))
    apart_m = shapely.distance(bodies[:, None], stops)
    joined = np.flatnonzero((apart_m <= reach_m).all(axis=1))
    if not len(joined):
        return None
    nearest: shapely.Geometry = bodies[joined[apart_m[joined].sum(axis=1).argmin()]]
    return nearest


def _nearest(
    here: shapely.Point, body: shapely.Geometry, snap_m: float, room_m: float
) -> FloatArray:
    """Return the nearest place in water, with room off land if there is such a place in reach."""
    around = shapely.intersection(body, here.buffer(snap_m + 2 * room_m))
    for room in (max(room_m, _LEAST_ROOM_M), _LEAST_ROOM_M):
        line = shapely.shortest_line(here, shapely.buffer(around, -room))
        if line is not None and line.length <= snap_m:
            return np.asarray(shapely.get_coordinates(line)[-1])
    return np.asarray(shapely.get_coordinates(shapely.shortest_line(here, body))[-1])


def _with_stops(scenario: Scenario, stops: list[Point]) -> Scenario:
    """Return the scenario with other places for its stops, in their order."""
    start, *between, goal = stops
    via = tuple(
        one.model_copy(update={"at": at}) if isinstance(one, Anchorage) else at
        for one, at in zip(scenario.via, between, strict=True)
    )
    return scenario.model_copy(update={"start": start, "via": via, "goal": goal})
