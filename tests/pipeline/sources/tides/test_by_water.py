"""Which station counts on which side of a spit, beside the exact way round its tip."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely

from pipeline._types import FloatArray
from pipeline.geo.projection import Projection
from pipeline.sources.tides.station import Station, distances_by_water, tide_zones

PLANE = Projection.at(42.3, -71.0, 1.0)
EXTENT = shapely.box(-4000, -3000, 4000, 3000)
# From the northern edge to 1 km from the southern one.
SPIT = shapely.box(-100, -2000, 100, 3000)
WEST, EAST = (-3000.0, 1500.0), (500.0, 1500.0)
CELL = 8000 / 120


def station(name: str, place: tuple[float, float]) -> Station:
    lon, lat = PLANE.to_lonlat(np.array(place)).tolist()
    return Station(name=name, position=(lon, lat), datum="MLLW", mean_level_m=1.0, constants={})


def way(begin: FloatArray, end: FloatArray, spit: shapely.Polygon) -> float:
    """Shortest way outside a box that touches the northern edge: round none, one or two corners."""
    xmin, ymin, xmax, _ = spit.bounds
    inside = shapely.buffer(spit, -1e-6)
    corners = [(xmin, ymin), (xmax, ymin)]
    rounds = [(), *((one,) for one in corners), tuple(corners), tuple(corners[::-1])]
    found = []
    for between in rounds:
        line = [tuple(begin), *between, tuple(end)]
        if not shapely.LineString(line).intersects(inside):
            found.append(sum(itertools.starmap(math.dist, itertools.pairwise(line))))
    return min(found)


@pytest.mark.parametrize("spit", [SPIT, shapely.box(-1530, -2410, -1410, 3000)])
def test_distances_are_those_of_the_shortest_way_round_a_spit(spit: shapely.Polygon) -> None:
    stations = np.array([WEST, EAST])
    boxes, places, apart = distances_by_water(stations, EXTENT, np.array([spit]))
    water = shapely.difference(EXTENT, spit)
    assert shapely.difference(water, shapely.union_all(boxes)).area < 1e-3
    exact = np.array([[way(one, place, spit) for place in places] for one in stations])
    assert (apart >= exact - 1e-6).all()
    assert (apart <= 1.03 * exact + 3 * CELL).all()
    # Nothing lies between: the straight line.
    straight = np.linalg.norm(stations[:, None] - places[None], axis=2)
    is_open = exact < straight + 1e-9
    assert is_open.mean() > 0.3
    np.testing.assert_allclose(apart[is_open], straight[is_open], atol=1e-6)


def test_a_spit_parts_the_waters_of_two_stations() -> None:
    given = [station("West", WEST), station("East", EAST)]
    zones, far = tide_zones(given, EXTENT, PLANE, np.array([SPIT]))
    rng = np.random.default_rng(3)
    places = rng.uniform((-4000, -3000), (4000, 3000), (800, 2))
    places = places[~shapely.contains_xy(shapely.buffer(SPIT, CELL), places)]
    exact = np.array([[way(np.array(one), at, SPIT) for at in places] for one in (WEST, EAST)])
    is_sure = np.abs(exact[0] - exact[1]) > 0.03 * exact.max(axis=0) + 4 * CELL
    nearest = exact.argmin(axis=0)
    for at, zone in enumerate(zones):
        holds = shapely.contains_xy(zone, places)
        assert (holds == (nearest == at))[is_sure].all()
    # By the straight line the water beside the spit would be the other side's.
    beside = np.array([-300.0, 1500.0])
    assert math.dist(beside, EAST) < math.dist(beside, WEST)
    assert shapely.contains_xy(zones[0], *beside)
    assert far.is_empty
    assert shapely.intersection(*zones).area == pytest.approx(0.0, abs=1e-3)


def test_without_land_between_the_zones_are_those_of_the_straight_line() -> None:
    given = [station("West", WEST), station("East", EAST)]
    islet = np.array([shapely.box(-3990, -2990, -3950, -2950)])
    free, beside = (tide_zones(given, EXTENT, PLANE, land)[0] for land in (islet[:0], islet))
    for one, other in zip(free, beside, strict=True):
        assert shapely.symmetric_difference(one, other).area < 4 * CELL**2


def test_water_beyond_ten_kilometres_by_water_has_no_station() -> None:
    """Three kilometres across a long spit, and fifteen round it."""
    extent, spit = shapely.box(-4000, -9000, 4000, 3000), shapely.box(-100, -8500, 100, 3000)
    given = [station("East", (1500.0, 2000.0))]
    (zone,), far = tide_zones(given, extent, PLANE, np.array([spit]))
    behind = shapely.Point(-1500.0, 2000.0)
    assert far.intersects(behind)
    assert not zone.intersects(behind)
    assert zone.intersects(shapely.Point(1500.0, -5000.0))


def test_a_station_on_a_pier_and_a_pond_keep_what_they_have() -> None:
    pier, dam = shapely.box(450, 1400, 550, 1600), shapely.box(2000, -3000, 4000, -1000)
    pond = shapely.box(2500, -2500, 3500, -1500)
    land = np.array([pier, shapely.difference(dam, pond)])
    _, places, apart = distances_by_water(np.array([EAST]), EXTENT, land)
    in_pond = shapely.contains_xy(shapely.buffer(pond, 1e-6), places)
    assert np.isinf(apart[0, in_pond]).all()
    assert np.isfinite(apart[0, ~in_pond]).all()
    (zone,), _ = tide_zones([station("East", EAST)], EXTENT, PLANE, land)
    assert zone.covers(shapely.box(2600, -2400, 3400, -1600))
