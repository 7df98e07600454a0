from __future__ import annotations

import numpy as np
import pytest
import shapely

from pipeline.sources.land import osm
from pipeline.sources.land.osm import surroundings
from pipeline.sources.land.shapes import box_around

CREEK = shapely.box(119.0, 9.0, 120.2, 10.6)  # Palawan's middle, cut on two sides
FIJI = shapely.box(177.5, -18.5, 181.5, -16.0)


@pytest.mark.parametrize("region", [CREEK, FIJI])
def test_it_is_the_worlds_land_outside_the_region_in_the_regions_longitudes(
    region: shapely.Polygon,
) -> None:
    found = shapely.union_all(surroundings(region))
    side = max(np.subtract(region.bounds[2:], region.bounds[:2]))
    wide = box_around(region, 0.5 * side * 111_000.0)
    fine = shapely.union_all(osm.land_polygons(wide).polygons)
    outside = wide.difference(region)
    assert found.intersection(region).area < 1e-12
    wrong = found.intersection(outside).symmetric_difference(fine.intersection(outside))
    # All of it lies within the detail of a coast.
    assert wrong.buffer(-0.002 * side).is_empty
    assert fine.intersection(outside).area > 0.01


def test_it_is_coarse() -> None:
    beyond_m = 0.75 * 1.6 * 111_195.0
    fine = osm.land_polygons(CREEK, beyond_m).polygons
    coarse = surroundings(CREEK)
    assert all(polygon.is_valid for polygon in coarse)
    vertices = [int(shapely.get_num_coordinates(np.array(one)).sum()) for one in (coarse, fine)]
    assert vertices[0] < 0.3 * vertices[1]


def test_small_polygons_are_left_out_before_they_are_read() -> None:
    whole, some = (osm.polygons_near("Osm", CREEK, least_deg=least)[0] for least in (0.0, 0.02))
    bounds = shapely.bounds(whole.polygons)
    is_large = (bounds[:, 2:] - bounds[:, :2]).max(axis=1) >= 0.02
    assert 0 < len(some.polygons) < len(whole.polygons)
    assert shapely.equals_exact(some.polygons, whole.polygons[is_large]).all()


def test_a_region_at_the_pole_has_surroundings() -> None:
    polar = shapely.box(0.0, 78.0, 40.0, 88.0)
    assert surroundings(polar)
