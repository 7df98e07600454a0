"""Land with a margin covers all that is nearer to land, but no endpoint."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pipeline.geo.coast.grow_margin import are_connected, grow_margin
from tests.pipeline.archipelagos import EXTENT, PLANE, archipelagos

NO_ENDPOINTS = np.empty((0, 2))


def planar(land: list[shapely.Polygon]) -> np.ndarray:
    """Return valid polygons in the plane."""
    valid = shapely.get_parts(shapely.make_valid(np.array(land, dtype=object)))
    polygons = valid[shapely.get_type_id(valid) == shapely.GeometryType.POLYGON]
    return np.asarray(PLANE.geometry_to_plane(polygons))


@settings(max_examples=30)
@given(
    land=archipelagos, margin=st.sampled_from([5.0, 200.0]), thinning=st.sampled_from([0.0, 50.0])
)
def test_all_within_the_margin_is_covered_and_nothing_far_beyond(
    land: list[shapely.Polygon], margin: float, thinning: float
) -> None:
    polygons = planar(land)
    grown = grow_margin(polygons, margin, thinning, NO_ENDPOINTS)
    original = shapely.union_all(polygons)
    # An inscribed polygon of the round buffer, judged by GEOS alone.
    assert original.buffer(margin * 0.999).difference(grown).area < 1.0
    # A mitre is cut off at 1.3 times the margin, its corners are at √(1.3² + 1²) times at most.
    assert grown.within(original.buffer(1.7 * (margin + thinning) + 2 * thinning))


@settings(max_examples=30)
@given(land=archipelagos, where=st.tuples(st.floats(0.01, 0.49), st.floats(0.01, 0.49)))
def test_an_endpoint_keeps_half_of_its_distance_from_land(
    land: list[shapely.Polygon], where: tuple[float, float]
) -> None:
    polygons = planar(land)
    endpoint = PLANE.to_plane([where])
    distance = shapely.distance(shapely.union_all(polygons), shapely.points(endpoint)[0])
    assume(distance > 1.0)
    grown = grow_margin(polygons, 300.0, 0.0, endpoint)
    assert grown.distance(shapely.points(endpoint)[0]) >= min(distance / 2, distance - 450) * 0.999


def test_bodies_of_water_are_distinguished() -> None:
    xmin, ymin, xmax, ymax = EXTENT.bounds
    wall = shapely.box(-10.0, ymin - 10, 10.0, ymax + 10)
    west, east = (xmin / 2, 0.0), (xmax / 2, 0.0)
    assert not are_connected(wall, EXTENT, np.array([west, east]))
    assert are_connected(wall, EXTENT, np.array([west, (xmin / 2, 100.0)]))
    assert are_connected(wall, EXTENT, np.array([west]))
    gate = wall.difference(shapely.box(-20, -5, 20, 5))
    assert are_connected(gate, EXTENT, np.array([west, east]))
