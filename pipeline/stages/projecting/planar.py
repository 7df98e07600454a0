"""Plane scenarios: extent, obstacles and current are given in metres, and placed at 0 N 0 E.

Their data become instances of the same classes as in a chart scenario, so that every output format
works.
"""

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Credit, Current, Fetched, Land, Scene, Simplified, planner_vessel
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import Plane
from pipeline.scenario.season import Season
from pipeline.stages.projecting.avoided_areas import known_clocks
from pipeline.stages.projecting.endpoints import check_endpoints
from pipeline.stages.projecting.speed_choices import speed_choices


def fetched_plane(scenario: Scenario) -> Fetched:
    """Return the obstacles as land, and no currents: `plane_scene` reads the currents later."""
    projection = _projection(scenario)
    credit = Credit(
        name="Obstacles of the scenario", kind="land", text=_plane(scenario).credit, licence=""
    )
    polygons = tuple(projection.geometry_to_lonlat(polygon) for polygon in _obstacles(scenario))
    return Fetched(Land(polygons, (credit,), accuracy_m=0.0), ())


def unsimplified(land: Land) -> Simplified:
    """Return the obstacles unchanged: in a plane scenario nothing is simplified."""
    vertices = sum(int(shapely.get_num_coordinates(polygon)) for polygon in land.polygons)
    return Simplified(
        polygons=land.polygons,
        inner_polygons=land.polygons,
        original_vertices=vertices,
        vertices=vertices,
        tolerance_m=0.0,
        margin_m=0.0,
    )


def plane_scene(scenario: Scenario) -> Scene:
    """Build the planner's input from the given metres; a detour over lon/lat would round them."""
    obstacles = _obstacles(scenario)
    chart = renew.Chart(scenario.area, obstacles)
    projection = _projection(scenario)
    check_endpoints(scenario, chart, projection)
    return Scene(
        chart=chart,
        land=obstacles,
        currents={season.name: _current(season, scenario.area) for season in scenario.seasons},
        start=np.asarray(scenario.start, dtype=float),
        goal=np.asarray(scenario.goal, dtype=float),
        projection=projection,
        vessel=planner_vessel(scenario.vessel),
        is_planar=True,
        via=np.array(scenario.via, dtype=float).reshape(-1, 2),
        departures=known_clocks(scenario),
        speeds=speed_choices(scenario),
    )


def _plane(scenario: Scenario) -> Plane:
    """Return the scenario's plane, or raise RequestError."""
    if scenario.plane is None:
        raise RequestError("the scenario has neither region nor plane; give one of the two")
    return scenario.plane


def _obstacles(scenario: Scenario) -> tuple[shapely.Polygon, ...]:
    """Return the obstacles as polygons in metres."""
    return tuple(shapely.Polygon(corners) for corners in _plane(scenario).obstacles)


def _projection(scenario: Scenario) -> Projection:
    """Return the projection whose origin, 0 N 0 E, is that of the plane."""
    return Projection.at(0.0, 0.0, scenario.scale)


def _current(season: Season, extent: shapely.Polygon) -> Current:
    """Return the gyre or uniform current of a season."""
    if season.gyre is not None:
        _, _, width, height = extent.bounds
        return renew.GyreCurrent(
            season.gyre.amplitude, width, height, season.gyre.columns, season.gyre.rows
        )
    if season.uniform is not None:
        return renew.UniformCurrent(season.uniform.u, season.uniform.v)
    raise RequestError(f"season {season.name!r} gives no current; add 'gyre' or 'uniform'")
