"""Start and goal stay in water, and connected, if they are so without the margin."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings, strategies as st

from pipeline.geo.coast import covering_land, opened, parted
from tests.pipeline.archipelagos import EXTENT, PLANE, archipelagos
from tests.pipeline.geo.shapes import planar

WEST, EAST = (-20e3, 0.0), (20e3, 0.0)
WALL = shapely.box(-1e3, -40e3, 1e3, 40e3)


@settings(max_examples=30)
@given(land=archipelagos, where=st.tuples(st.floats(0.01, 0.49), st.floats(0.01, 0.49)))
def test_an_endpoint_keeps_half_of_its_distance_from_land(
    land: list[shapely.Polygon], where: tuple[float, float]
) -> None:
    polygons = planar(land)
    endpoint = PLANE.to_plane([where])
    point = shapely.points(endpoint)[0]
    distance = shapely.distance(shapely.union_all(polygons), point)
    assume(distance > 1.0)
    grown = covering_land(polygons, 0.0, 300.0, endpoint)
    free = opened(grown, polygons, EXTENT, endpoint, 300.0)
    assert shapely.distance(free.land, point).min(initial=np.inf) >= min(
        distance / 2 * 0.99, distance - 320
    )
    assert shapely.union_all(polygons).difference(shapely.union_all(free.land)).area < 1e-3


@pytest.mark.parametrize("width", [10.0, 400.0])
def test_the_widest_strait_is_opened_where_the_margin_shuts_all(width: float) -> None:
    wide = shapely.box(-2e3, 10e3, 2e3, 10e3 + width)
    narrow = shapely.box(-2e3, 0.0, 2e3, width / 2)
    wall = shapely.get_parts(WALL.difference(wide).difference(narrow))
    endpoints = np.array([WEST, EAST])
    grown = covering_land(wall, 100.0, 300.0, endpoints)
    assert parted(grown, EXTENT, endpoints[None]) == {0}
    free = opened(grown, wall, EXTENT, endpoints, 400.0)
    assert parted(free.land, EXTENT, endpoints[None]) == set()
    assert shapely.union_all(wall).difference(shapely.union_all(free.land)).area < 1e-3
    assert free.width_m == pytest.approx(width, rel=0.02)
    assert free.narrowest is not None
    x, y = free.narrowest
    # Anywhere in the strait, or in its mouth.
    assert abs(x) <= 1.3e3
    assert 9.9e3 < y < 10.1e3 + width


def test_what_land_parts_stays_apart() -> None:
    endpoints = np.array([WEST, EAST])
    wall = np.array([WALL])
    grown = covering_land(wall, 100.0, 300.0, endpoints)
    free = opened(grown, wall, EXTENT, endpoints, 400.0)
    assert free.narrowest is None
    assert parted(free.land, EXTENT, endpoints[None]) == {0}


def test_bodies_of_water_are_distinguished() -> None:
    wall = np.array([WALL])
    voyages = np.array([(WEST, EAST), (WEST, (-20e3, 100.0)), (EAST, WEST)])
    assert parted(wall, EXTENT, voyages) == {0, 2}
    gate = shapely.get_parts(WALL.difference(shapely.box(-2e3, -5, 2e3, 5)))
    assert parted(gate, EXTENT, voyages) == set()


def test_each_of_many_voyages_gets_its_strait() -> None:
    """A lagoon with a narrow mouth, the wall's strait, an end within the margin, one on land."""
    ring = shapely.box(20e3, -30e3, 30e3, -20e3).difference(shapely.box(22e3, -28e3, 28e3, -22e3))
    lagoon = ring.difference(shapely.box(24.9e3, -23e3, 25.1e3, -19e3))
    wall = WALL.difference(shapely.box(-2e3, 10e3, 2e3, 10.1e3))
    land = shapely.get_parts([wall, lagoon])
    inside, close = (25e3, -25e3), (20e3 - 50.0, -25e3)
    endpoints = np.array([EAST, inside, WEST, EAST, close, EAST, (21e3, -25e3), EAST])
    grown = covering_land(land, 100.0, 300.0, endpoints)
    voyages = endpoints.reshape(-1, 2, 2)
    assert parted(grown, EXTENT, voyages) == {0, 1, 2, 3}
    free = opened(grown, land, EXTENT, endpoints, 400.0)
    assert parted(free.land, EXTENT, voyages) == {3}
    assert shapely.union_all(land).difference(shapely.union_all(free.land)).area < 1e-3
    assert free.width_m == pytest.approx(100.0, rel=0.02)
