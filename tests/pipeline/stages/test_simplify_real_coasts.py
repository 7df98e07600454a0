"""The simplified land of real coasts."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pipeline.geo.projection import Projection
from pipeline.model import Land
from pipeline.sources.land.osm import land as osm_land
from pipeline.stages.simplify import (
    simplify_land,
)

MINDORO_SIDE, WEST_SIDE = (120.42, 12.4), (119.77, 12.0)
BUSUANGA = shapely.box(119.75, 11.75, 120.45, 12.45)


@pytest.fixture(scope="module")
def busuanga() -> Land:
    """Return the real land around Busuanga and Culion: about 400 islands."""
    return osm_land(BUSUANGA)


def test_real_islands(busuanga: Land) -> None:
    result = simplify_land(
        busuanga.polygons,
        BUSUANGA,
        accuracy_m=busuanga.accuracy_m,
        turning_radius_m=17.0,
        endpoints=[MINDORO_SIDE, WEST_SIDE],
    )
    simplified = result
    assert simplified.tolerance_m == simplified.margin_m == 60.0
    plane = Projection.for_region(BUSUANGA)
    extent = plane.geometry_to_plane(BUSUANGA)
    land = shapely.union_all(plane.geometry_to_plane(np.array(busuanga.polygons, dtype=object)))
    polygons, inner = (
        plane.geometry_to_plane(np.array(some, dtype=object))
        for some in (simplified.polygons, simplified.inner_polygons)
    )
    no_go = shapely.union_all(polygons)
    assert land.intersection(extent).difference(no_go).area == 0
    assert len(shapely.get_parts(no_go)) == len(polygons)
    assert shapely.union_all(inner).difference(land).area < 1e-3
    endpoints = shapely.points(plane.to_plane([MINDORO_SIDE, WEST_SIDE]))
    # Water that is enclosed at this distance may have become land.
    far = shapely.get_parts(extent.difference(land.buffer(121.0)))
    (sea,) = far[shapely.intersects(far[:, None], endpoints).all(axis=1)]
    assert no_go.intersection(sea).area == 0
    assert not shapely.intersects(no_go, endpoints).any()


def test_straits_of_the_cyclades_are_water() -> None:
    """Naxos–Donousa and Amorgos–Kinaros, 16 and 17 km wide, which became land once."""
    region = shapely.box(22.5, 35.0, 29.0, 38.5)
    ends = [(23.6, 37.85), (28.3, 36.5)]
    land = osm_land(region)
    result = simplify_land(
        land.polygons, region, accuracy_m=land.accuracy_m, turning_radius_m=17.0, endpoints=ends
    )
    plane = Projection.for_region(region)
    polygons = plane.geometry_to_plane(np.array(result.polygons, dtype=object))
    water = shapely.get_parts(
        plane.geometry_to_plane(region).difference(shapely.union_all(polygons))
    )
    straits = [(25.69, 37.15), (26.18, 36.96)]
    places = shapely.points(plane.to_plane([*ends, *straits]))
    assert shapely.intersects(water[:, None], places).all(axis=1).sum() == 1
    # As wide as they are, less margin and tolerance.
    assert shapely.distance(polygons[:, None], places[2:]).min() > 4_000
    assert len(result.inner_polygons) > 100
