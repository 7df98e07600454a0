"""Plane scenarios: extent, obstacles and current are figures in metres, placed at 0 N 0 E.

They pass through the same artefacts as a chart does, so that every output works for them too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Credit, Fetched, Land, Scene, Simplified

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from pipeline.model import Current
    from pipeline.scenario.model import Scenario, Season
    from pipeline.scenario.region import Plane


def fetched(scenario: Scenario) -> Fetched:
    """Obstacles as land; the current stays with the scenario."""
    projection = _projection(scenario)
    credit = Credit(
        name="Obstacles of the scenario", kind="land", text=_plane(scenario).credit, licence=""
    )
    polygons = tuple(projection.geometry_to_lonlat(polygon) for polygon in _obstacles(scenario))
    return Fetched(Land(polygons, (credit,), accuracy_m=0.0), ())


def unsimplified(land: Land) -> Simplified:
    """Take the obstacles as they are."""
    vertices = sum(int(shapely.get_num_coordinates(polygon)) for polygon in land.polygons)
    return Simplified(
        polygons=land.polygons,
        original_vertices=vertices,
        vertices=vertices,
        tolerance_m=0.0,
        joined_gap_m=0.0,
        margin_m=0.0,
    )


def scene(scenario: Scenario) -> Scene:
    """Build the planner's world from the figures as given: a way to lon/lat and back blurs them."""
    from pipeline.stages.endpoints import check_ends

    obstacles = _obstacles(scenario)
    chart = renew.Chart(scenario.waters, obstacles)
    projection = _projection(scenario)
    check_ends(scenario, chart, projection)
    return Scene(
        chart=chart,
        land=obstacles,
        currents={season.name: _current(season, scenario.waters) for season in scenario.seasons},
        start=np.asarray(scenario.start, dtype=float),
        goal=np.asarray(scenario.goal, dtype=float),
        projection=projection,
        vessel=scenario.vessel.vessel(),
    )


def _plane(scenario: Scenario) -> Plane:
    """The scenario's plane."""
    if scenario.plane is None:
        raise RequestError(["the scenario has neither region nor plane; give one of the two"])
    return scenario.plane


def _obstacles(scenario: Scenario) -> tuple[Polygon, ...]:
    """Obstacles in metres."""
    return tuple(shapely.Polygon(corners) for corners in _plane(scenario).obstacles)


def _projection(scenario: Scenario) -> Projection:
    """Where the plane lies on the globe: its origin at 0 N 0 E."""
    return Projection.at(0.0, 0.0, scenario.scale)


def _current(season: Season, extent: Polygon) -> Current:
    """A season's current that is given as figures."""
    if season.gyre is not None:
        _, _, width, height = extent.bounds
        return renew.GyreCurrent(
            season.gyre.amplitude, width, height, season.gyre.columns, season.gyre.rows
        )
    if season.uniform is not None:
        return renew.UniformCurrent(season.uniform.u, season.uniform.v)
    raise RequestError([f"season {season.name!r} gives no current; add 'gyre' or 'uniform'"])
