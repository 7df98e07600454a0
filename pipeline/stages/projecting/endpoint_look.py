"""Check quickly, with the chart near each stop only, that no stop lies on land."""

import numpy as np
import numpy.typing as npt
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.scenario.model import Scenario
from pipeline.sources.interfaces import LandSource
from pipeline.sources.land.shapes import box_around
from pipeline.sources.registry import land_source
from pipeline.stages.projecting.endpoints import endpoints, not_in_water

# Distance around a position within which the quick check searches for water, m.
_LOOK_M = 20_000.0


def endpoints_on_land(scenario: Scenario) -> list[str]:
    """Return a message for each stop that lies on land; none for a plane scenario."""
    if scenario.is_planar:
        return []
    source = land_source(scenario.chart, scenario.vessel.draught_m)
    return [
        fault
        for name, (lon, lat) in endpoints(scenario).items()
        if (fault := _on_land(scenario, source, name, lon, lat))
    ]


def _on_land(scenario: Scenario, source: LandSource, name: str, lon: float, lat: float) -> str:
    """Return a message with a remedy if a position lies on land, otherwise ""."""
    region = box_around(shapely.Point(lon, lat), _LOOK_M)
    land = _land_near(source, lon, lat)
    if not shapely.intersects_xy(land, lon, lat).any():
        return ""
    projection = Projection.for_region(region)
    try:
        chart = renew.Chart(
            projection.geometry_to_plane(region), projection.geometry_to_plane(land)
        )
    except renew.GeometryError:
        return (
            f"{name} = {[lon, lat]} lies on land, more than {_LOOK_M / 1000:.0f} km from the "
            f"nearest water; {_remedy(source, lon, lat)}"
        )
    here = shapely.Point(projection.to_plane((lon, lat)))
    return not_in_water(scenario, name, here, chart, projection)


def _remedy(source: LandSource, lon: float, lat: float) -> str:
    """Return the remedy for a position far inland; its coordinates may be swapped."""
    can_swap = -90 <= lon <= 90
    if can_swap and not shapely.intersects_xy(_land_near(source, lat, lon), lat, lon).any():
        return f"did you mean [{lat:g}, {lon:g}]? A place is [longitude, latitude]"
    return "move it into water"


def _land_near(source: LandSource, lon: float, lat: float) -> npt.NDArray[np.object_]:
    """Return the chart's land around a position; empty if the chart has nothing near it.

    The run itself checks with its whole region whether the chart covers it.
    """
    try:
        found = source.land(box_around(shapely.Point(lon, lat), _LOOK_M)).polygons
    except RequestError:
        found = ()
    return np.array(found, dtype=object)
