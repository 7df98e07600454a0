"""A region grows where a route comes near its edge."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest

from pipeline.stages.region import SIDES, grown, opened, sides_near

BOUNDS = (10.0, 50.0, 12.0, 51.0)
WORLD = (-180.0, -89.0, 360.0, 89.0)
MARGIN_M = 20_000.0
GEOD = pyproj.Geod(ellps="WGS84")


def near(*places: tuple[float, float]) -> list[str]:
    return [SIDES[side] for side in sides_near(BOUNDS, [np.array(places)], MARGIN_M)]


def test_only_the_sides_that_a_path_comes_near_are_found() -> None:
    assert near((11, 50.5)) == []
    assert near((10.05, 50.5)) == ["west"]
    assert near((11, 50.5), (11.95, 50.97)) == ["east", "north"]
    assert near((11, 50.02)) == ["south"]
    assert sides_near(BOUNDS, [], MARGIN_M) == []


def test_near_is_a_share_of_the_margin_on_the_ground() -> None:
    for share, is_near in ((0.25, True), (0.35, False)):
        lon = GEOD.fwd(10, 50.5, 90, share * MARGIN_M)[0]
        assert (near((lon, 50.5)) == ["west"]) is is_near


def test_a_shut_region_opens_on_all_sides_as_far_as_the_limits_allow() -> None:
    west, south, east, north = opened(BOUNDS, 100_000.0, WORLD)
    assert GEOD.inv(west, 51, 10, 51)[2] == pytest.approx(50_000.0, rel=0.02)
    assert GEOD.inv(east, 51, 12, 51)[2] == pytest.approx(50_000.0, rel=0.02)
    assert GEOD.inv(11, south, 11, 50)[2] == pytest.approx(50_000.0, rel=0.02)
    assert GEOD.inv(11, north, 11, 51)[2] == pytest.approx(50_000.0, rel=0.02)
    assert opened(BOUNDS, 100_000.0, BOUNDS) == BOUNDS


def test_sides_move_outward_as_far_as_the_limits_allow() -> None:
    west, south, east, north = grown(BOUNDS, [0, 3], MARGIN_M, WORLD)
    assert (south, east) == BOUNDS[1:3]
    assert GEOD.inv(west, 51, 10, 51)[2] == pytest.approx(2 * MARGIN_M, rel=0.02)
    assert GEOD.inv(11, 51, 11, north)[2] == pytest.approx(2 * MARGIN_M, rel=0.02)
    assert grown(BOUNDS, [0, 3], MARGIN_M, (9.9, 40, 20, 51.0)) == (9.9, 50.0, 12.0, 51.0)
    assert grown(BOUNDS, [0], MARGIN_M, (9.99, 40, 20, 51.0)) == BOUNDS
    assert grown(BOUNDS, [], MARGIN_M, WORLD) == BOUNDS
