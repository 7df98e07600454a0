"""A quick look at the chart near start and goal only, before anything is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.sources.land.polygons import box_around
from pipeline.sources.registry import land_source
from pipeline.stages.endpoints import endpoints, not_in_water

if TYPE_CHECKING:
    from pipeline.scenario.model import Scenario
    from pipeline.sources.interfaces import LandSource

# Distance around a position within which a quick look finds water, m.
_LOOK_M = 20_000.0


def endpoints_on_land(scenario: Scenario) -> list[str]:
    """Return a fault for each of start and goal that lies on land; none in a plane."""
    if scenario.is_planar:
        return []
    source = land_source(scenario.chart, scenario.vessel.draught_m)
    return [
        fault
        for name, (lon, lat) in endpoints(scenario).items()
        if (fault := _on_land(scenario, source, name, lon, lat))
    ]


def _on_land(scenario: Scenario, source: LandSource, name: str, lon: float, lat: float) -> str:
    """Say that a position is on land, and where water is, or that its coordinates are swapped."""
    region = box_around(shapely.Point(lon, lat), _LOOK_M)
    try:
        land = np.array(source.land(region).polygons, dtype=object)
    except RequestError:
        return ""  # the chart has nothing near, which a run judges with its whole region
    if not shapely.intersects_xy(land, lon, lat).any():
        return ""
    if -90 <= lon <= 90 and abs(lat) <= 180 and not _is_land(source, lat, lon):
        return (
            f"{name} = {[lon, lat]} lies on land; did you mean [{lat:g}, {lon:g}]? A place is "
            "[longitude, latitude]"
        )
    projection = Projection.for_region(region)
    try:
        chart = renew.Chart(
            projection.geometry_to_plane(region), projection.geometry_to_plane(land)
        )
    except renew.GeometryError:
        return (
            f"{name} = {[lon, lat]} lies on land, more than {_LOOK_M / 1000:.0f} km from the "
            "nearest water; move it into water"
        )
    here = shapely.Point(projection.to_plane((lon, lat)))
    return not_in_water(scenario, name, here, chart, projection)


def _is_land(source: LandSource, lon: float, lat: float) -> bool:
    """Whether a place is on the chart's land."""
    here = shapely.Point(lon, lat)
    try:
        land = np.array(source.land(box_around(here, _LOOK_M)).polygons, dtype=object)
    except RequestError:
        return False
    return bool(shapely.intersects_xy(land, lon, lat).any())
