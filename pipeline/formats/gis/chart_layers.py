"""Layers of the chart: its own areas, and the planner's no-go zone."""

from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from pipeline._types import Geometries
from pipeline.formats.gis.frames import ZONE_STEP_M, GeoDataFrame, columns_of, frame, multi
from pipeline.formats.shared.result import RunResult, continued
from pipeline.model import Zone


def coast(result: RunResult) -> GeoDataFrame:
    """Land before simplification: the no-go areas without shallow, uncharted or hazardous water.

    Beyond the region it goes on in less detail, so that the map does not show water there.
    """
    land = result.fetched.land
    water = [zone.area for zone in land.zones if zone.kind in {"shoal", "uncharted", "hazard"}]
    polygons = np.array(land.polygons, dtype=object)
    if water:
        # One overlay of everything: a shoal has thousands of vertices, a chart hundreds of islets.
        left = shapely.difference(shapely.union_all(polygons), shapely.union_all(water))
        polygons = shapely.get_parts(left)
        polygons = polygons[shapely.area(polygons) > 0]
    return _counted(continued(polygons, np.array(result.fetched.surroundings, dtype=object)))


def region_edge(result: RunResult) -> GeoDataFrame:
    """Edge of the region, or of a plane's extent."""
    edge = shapely.boundary(np.array([result.scene.chart.extent], dtype=object))
    return frame([result.scene.projection.geometry_to_lonlat(edge, ZONE_STEP_M)], {})


def hazards(result: RunResult) -> GeoDataFrame:
    """Rocks, wrecks and the like, with the room around them."""
    return _zones(zone for zone in result.fetched.land.zones if zone.kind == "hazard")


def chart_areas(result: RunResult) -> GeoDataFrame:
    """Shallow, uncharted and restricted areas, and traffic schemes."""
    return _zones(zone for zone in result.fetched.land.zones if zone.kind != "hazard")


def depth_areas(result: RunResult) -> GeoDataFrame:
    """Areas of equal depth."""
    found = result.fetched.land.depth_areas
    columns = columns_of(found, "kind", depth_min_m="least_m", depth_max_m="greatest_m")
    return frame(multi([one.area for one in found]), columns)


def islands(result: RunResult) -> GeoDataFrame:
    """Points on the islands by which ways are told apart."""
    islands = result.evaluation.islands
    places = np.array([[island.x, island.y] for island in islands]).reshape(-1, 2)
    points = shapely.points(result.scene.projection.to_lonlat(places))
    return frame(points, columns_of(islands, "number", "name"))


def no_go(result: RunResult) -> GeoDataFrame:
    """Hard no-go zone, the same in every season."""
    return _counted(result.simplified.polygons)


def _zones(zones: Iterable[Zone]) -> GeoDataFrame:
    """Areas of the chart, with their kinds, names and rules."""
    found = list(zones)
    return frame(multi([zone.area for zone in found]), columns_of(found, "kind", "name", "rule"))


def _counted(polygons: Sequence[shapely.Polygon] | Geometries) -> GeoDataFrame:
    """Areas with their numbers of vertices."""
    vertices = shapely.get_num_coordinates(np.array(polygons, dtype=object))
    return frame(multi(polygons), {"vertices": vertices})
