"""The map's reference system, and arrows on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

import renew
from pipeline.findings.result import RunResult
from pipeline.formats.gis.qgis import map_crs, view
from pipeline.formats.gis.styles import style
from pipeline.geo.projection import Projection
from tests.pipeline.formats.gis.cases import moved_east
from tests.pipeline.results import with_water


def in_waters(result: RunResult, *box: float) -> RunResult:
    """The same run on the chart of a lon/lat box, without land."""
    region = shapely.box(*box)
    projection = Projection.for_region(region)
    chart = renew.Chart(projection.geometry_to_plane(region, densify_m=10_000), [])
    return with_water(result, projection=projection, chart=chart)


@pytest.mark.parametrize(
    ("box", "authority"),
    [
        ((116.0, 7.0, 121.0, 13.0), "EPSG:32650"),
        ((117.9, -34.0, 118.9, -33.0), "EPSG:32750"),
        ((-179.9, 50.0, -178.0, 52.0), "EPSG:32601"),
        ((115.5, 7.0, 122.0, 13.5), "EPSG:32650"),
        ((110.0, 7.0, 124.0, 23.0), ""),
        ((-10.0, 50.0, 20.0, 62.0), ""),
        ((10.0, 83.0, 12.0, 84.5), ""),
    ],
)
def test_the_map_is_in_a_utm_zone_that_is_to_scale(
    result: RunResult, box: tuple[float, float, float, float], authority: str
) -> None:
    """Where a zone is wrong by more than 0.5 % somewhere, the map is in the planner's plane."""
    chosen = map_crs(in_waters(result, *box))
    assert chosen.system.authority == authority
    plane, west_to_east = Projection(chosen.system.wkt), np.linspace(box[0], box[2], 50)
    points = [(lon, lat) for lon in west_to_east for lat in np.linspace(box[1], box[3], 50)]
    if authority:
        assert np.abs(plane.point_scale(points) - 1).max() <= 5e-3
    planar = plane.to_plane(np.array(points))
    assert (planar >= chosen.bounds[:2]).all()
    assert (planar <= chosen.bounds[2:]).all()


@pytest.mark.parametrize(
    "box",
    [
        (119.0, 9.0, 120.2, 10.0),
        (16.0, 58.0, 18.0, 60.0),
        (110.0, 7.0, 124.0, 23.0),
        (-10.0, 50.0, 20.0, 62.0),
        (100.0, -8.0, 130.0, 8.0),
    ],
    ids=["UTM", "UTM in the north", "transverse Mercator", "Lambert", "Mercator"],
)
def test_arrows_are_turned_by_the_maps_convergence(
    result: RunResult, box: tuple[float, float, float, float]
) -> None:
    """The formula, evaluated in Python, against the projection at points all over the chart."""
    chosen = map_crs(in_waters(result, *box))
    formula, projection = chosen.convergence, Projection(chosen.system.wkt)
    python = formula.replace("x($geometry)", "lon").replace("y($geometry)", "lat")
    for lon, lat in np.random.default_rng(0).uniform(box[:2], box[2:], (50, 2)):
        place = {"lon": lon, "lat": lat, "sin": np.sin, "radians": np.radians}
        found = eval(python, {"__builtins__": {}}, place)  # noqa: S307 - our own formula
        true = projection.convergence(np.array([lon, lat]))
        assert found == pytest.approx(float(true), abs=0.1)


def test_on_a_map_around_the_pole_arrows_turn_with_the_longitude(result: RunResult) -> None:
    projection = Projection.for_region(shapely.box(-180, 84, 180, 90))
    ring = shapely.Point(0, 0).buffer(600_000)
    polar = with_water(result, projection=projection, chart=renew.Chart(ring, []))
    formula = map_crs(polar).convergence
    python = formula.replace("x($geometry)", "lon").replace("y($geometry)", "lat")
    for lon in (-170.0, -90.0, 0.0, 45.0, 179.0):
        place = {"lon": lon, "lat": 87.0, "sin": np.sin, "radians": np.radians}
        found = eval(python, {"__builtins__": {}}, place)  # noqa: S307 - our own formula
        # On the map around the pole, a meridian's direction is its longitude.
        assert np.cos(np.radians(found - lon)) == pytest.approx(1.0, abs=1e-4)


def test_across_180_degrees_the_map_is_in_continuous_longitudes(result: RunResult) -> None:
    here, there = map_crs(result), map_crs(moved_east(result, 60.4))
    assert not here.is_lonlat
    assert there.system.authority == "EPSG:4326"
    assert there.bounds == pytest.approx((179.4 - 0.036, 8.964, 180.6 + 0.036, 10.036), abs=2e-3)


def test_dense_currents_are_thinned_on_a_map_of_the_whole(result: RunResult) -> None:
    """By the points' indices in the grid, so that the rest is a coarser grid."""
    coarse = view(result)
    seasons = tuple(
        replace(s, spacing_m=s.spacing_m / 20, step_deg=(0.01, 0.00875)) for s in coarse.cases
    )
    dense = replace(coarse, cases=seasons)
    plain, thinned = (
        [rule.condition for group in style("currents", one).rules for rule in group.children]
        for one in (coarse, dense)
    )
    assert len(plain) == len(thinned) > 1
    assert not any("@map_scale" in condition for condition in plain)
    assert all("@map_scale" in condition for condition in thinned)
