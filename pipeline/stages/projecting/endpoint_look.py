"""A quick look at the chart near start and goal only, before anything is computed."""

import numpy as np
import numpy.typing as npt
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.scenario.model import Scenario
from pipeline.sources.interfaces import LandSource
from pipeline.sources.land.polygons import box_around
from pipeline.sources.registry import land_source
from pipeline.stages.projecting.endpoints import endpoints, not_in_water

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
    """Say what to do about a position far inland: with its coordinates swapped it may be at sea."""
    can_swap = -90 <= lon <= 90
    if can_swap and not shapely.intersects_xy(_land_near(source, lat, lon), lat, lon).any():
        return f"did you mean [{lat:g}, {lon:g}]? A place is [longitude, latitude]"
    return "move it into water"


def _land_near(source: LandSource, lon: float, lat: float) -> npt.NDArray[np.object_]:
    """Return the chart's land around a place; none where the chart has nothing near.

    A run judges that with its whole region.
    """
    try:
        found = source.land(box_around(shapely.Point(lon, lat), _LOOK_M)).polygons
    except RequestError:
        found = ()
    return np.array(found, dtype=object)
