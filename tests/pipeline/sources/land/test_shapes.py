"""Operations on chart geometries: repair, boxes and buffers in true metres."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.sources.land.shapes import box_around, buffered, repaired

GEOD = pyproj.Geod(ellps="WGS84")


@pytest.mark.parametrize("latitude", [0.0, 60.0, 89.0])
def test_the_box_is_wider_by_metres(latitude: float) -> None:
    region = shapely.box(10, latitude, 11, latitude + 0.5)
    west, south, east, north = box_around(region, 20_000).bounds
    assert 10 - west == pytest.approx(east - 11)
    assert (10 - west) * 111.2 * np.cos(np.radians(north)) >= 19.9
    assert south == pytest.approx(latitude - 0.18, abs=0.01)
    assert north == pytest.approx(latitude + 0.68, abs=0.01)


def test_the_box_is_at_most_360_degrees_wide() -> None:
    assert box_around(shapely.box(-180, 80, 180, 90), 20_000).bounds[2] == 180
    west, _, east, north = box_around(shapely.box(0, 88, 10, 90), 20_000).bounds
    assert east - west == pytest.approx(360)
    assert north == 90


@given(
    lon=st.floats(-179, 179),
    lat=st.floats(-80, 80),
    radius=st.floats(5, 500),
)
def test_buffered_points_enclose_their_circle(lon: float, lat: float, radius: float) -> None:
    (area,) = buffered(np.array([shapely.Point(lon, lat)], dtype=object), radius)
    edge = shapely.get_coordinates(shapely.segmentize(area.exterior, radius / 2e6))
    _, _, apart = GEOD.inv(np.full(len(edge), lon), np.full(len(edge), lat), *edge.T)
    assert radius * (1 - 1e-4) <= apart.min() < apart.max() < 1.03 * radius


def test_valid_geometries_are_not_repaired() -> None:
    lake = shapely.box(0.4, 0.4, 0.6, 0.6).exterior
    island = shapely.Polygon(shapely.box(0, 0, 1, 1).exterior, [lake])
    valid = np.array([island, shapely.Point(0, 0)], dtype=object)
    same, count = repaired(valid)
    assert same is valid
    assert count == 0
