"""Check that all stops lie in the same body of water; if not, name the nearest suitable water."""

from collections.abc import Sequence

import numpy as np
import shapely

import renew
from pipeline.errors import NoWayError, RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Scene
from pipeline.scenario.catalogue import has_world_land
from pipeline.scenario.model import Scenario
from renew.errors import Strait

# Distances beyond the nearest shore, true metres: the first whose position is still in water after
# rounding is suggested.
_BEYOND_SHORE_M = (50.0, 200.0, 1000.0, 5000.0)
# Decimals of a degree to which a suggested position is rounded: 11 m.
_DECIMALS = 4
# Segments per quarter circle of a buffer: its round corners are slightly too narrow.
_QUADRANT_SEGMENTS = 2


def check_endpoints(scenario: Scenario, chart: renew.Chart, projection: Projection) -> None:
    """Raise RequestError if a stop is not in water, or no water connects it with the start.

    NoWayError is raised if a wider region might connect them.
    """
    water = shapely.get_parts(chart.water)
    faults: list[str] = []
    bodies: list[set[int]] = []
    for name, given in scenario.stops.items():
        xy = np.asarray(given, dtype=float) if scenario.is_planar else projection.to_plane(given)
        here = shapely.Point(xy)
        inside = set(np.flatnonzero(shapely.covers(water, here)).tolist())
        if inside:
            bodies.append(inside)
        else:
            faults.append(not_in_water(scenario, name, here, chart, projection))
    if faults:
        raise RequestError(faults)
    for name, body in zip(scenario.stops, bodies, strict=True):
        if not body & bodies[0]:
            apart = water[[min(bodies[0]), min(body)]]
            # A wider region does not connect water that land encloses.
            open_ended = not scenario.is_planar and all(_reaches_edge(one, chart) for one in apart)
            text = _not_connected(scenario, name, apart[0], projection, is_open_ended=open_ended)
            raise (NoWayError if open_ended else RequestError)([text])


def not_in_water(
    scenario: Scenario, name: str, here: shapely.Point, chart: renew.Chart, projection: Projection
) -> str:
    """Return a message with the distance from a stop to the nearest water, and its position."""
    distance, place = _nearest_water(scenario, here, chart.water, projection)
    obstacle = "land" if scenario.is_planar else "land, or within the margin around it"
    if scenario.chart.depths:
        obstacle = "land or water too shallow for the vessel, or within the margin around them"
    return (
        f"{name} = {list(scenario.stops[name])} lies on {obstacle}, {distance} from the "
        f"nearest water at {place}; move it there, or further out if the vessel needs room to turn"
        f"{lakes_text(scenario)}"
    )


def lakes_text(scenario: Scenario) -> str:
    """Say that a scenario's chart has the sea alone, if it is the world's; empty otherwise."""
    is_sea_alone = not scenario.is_planar and has_world_land(scenario.chart)
    return " (lakes and rivers are no part of this chart: it has the sea alone)" * is_sea_alone


def is_shut_in(scene: Scene, straits: Sequence[Strait], width: float) -> bool:
    """Whether a stop can't reach the chart's edge, so that no wider region can help.

    The way to the edge keeps `width` planar metres off land, and passes none of the straits.
    """
    chart = scene.chart
    # Buffered, so that the cuts reach the banks and separate the water.
    gaps = shapely.linestrings(np.array([strait.gap for strait in straits]).reshape(-1, 2, 2))
    shut = [
        *shapely.buffer(gaps, chart.precision),
        *shapely.buffer(np.array(chart.no_go, dtype=object), width, quad_segs=_QUADRANT_SEGMENTS),
    ]
    parts = shapely.get_parts(shapely.difference(chart.water, shapely.union_all(shut)))
    open_parts = [part for part in parts if _reaches_edge(part, chart)]
    # A stop may lie in the padding.
    reached = shapely.dwithin(
        np.array(open_parts, dtype=object)[:, None], shapely.points(scene.stops), 2 * width
    )
    return not reached.any(axis=0).all()


def _reaches_edge(body: shapely.Geometry, chart: renew.Chart) -> bool:
    """Whether a body of water reaches the chart's edge, so that it may continue beyond."""
    return bool(shapely.dwithin(body, chart.extent.exterior, 2 * chart.precision))


def _not_connected(
    scenario: Scenario,
    name: str,
    body: shapely.Geometry,
    projection: Projection,
    *,
    is_open_ended: bool,
) -> str:
    """Return a message with the position in the start's body of water nearest to another stop."""
    place_given = scenario.stops[name]
    xy = np.asarray(place_given, dtype=float)
    here = shapely.Point(xy if scenario.is_planar else projection.to_plane(xy))
    distance, place = _nearest_water(scenario, here, body, projection)
    return (
        f"{name} = {list(place_given)} lies in another body of water than "
        f"start = {list(scenario.start)}: no water connects them in this chart. The start's body "
        f"of water comes within {distance} of the {name}, at {place}; move the {name} there"
        + (", or widen the region" if is_open_ended else "")
    )


def _nearest_water(
    scenario: Scenario, here: shapely.Point, water: shapely.Geometry, projection: Projection
) -> tuple[str, str]:
    """Return the distance to the nearest water and its position, as a scenario would write it."""
    line = shapely.get_coordinates(shapely.shortest_line(here, water))
    shore, here_xy = line[-1], line[0]
    if scenario.is_planar:
        return f"{np.linalg.norm(shore - here_xy):.4g} m", f"[{shore[0]:.6g}, {shore[1]:.6g}]"
    ahead = (shore - here_xy) / max(float(np.linalg.norm(shore - here_xy)), 1e-12)
    # Beyond the shore, so that rounding does not move it back onto land.
    tries = [shore + ahead * beyond / projection.scale for beyond in _BEYOND_SHORE_M]
    rounded = [np.round(projection.to_lonlat(xy), _DECIMALS) for xy in [*tries, shore]]
    in_water = [at for at in rounded if water.covers(shapely.Point(projection.to_plane(at)))]
    lon, lat = (in_water or rounded[-1:])[0]
    metres = projection.geodesic_length_m([here_xy, projection.to_plane((lon, lat))])
    distance = f"{metres / 1000:.1f} km" if metres >= 1000 else f"{metres:.0f} m"
    return distance, f"[{lon:.{_DECIMALS}f}, {lat:.{_DECIMALS}f}]"
