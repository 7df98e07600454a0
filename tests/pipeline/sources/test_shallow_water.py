"""Shallow cells as polygons, which cover each cell and one cell around it, and no more."""

from __future__ import annotations

import time

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from pipeline.sources.combined_charts import Heights, shallow_polygons

CELL = 0.01


def grid(shallow: np.ndarray) -> Heights:
    """Return 2 m of depth where it is shallow, 50 m elsewhere."""
    ny, nx = shallow.shape
    height = np.where(shallow, -2.0, -50.0)
    lon, lat = (CELL * np.arange(size, dtype=np.float64) for size in (nx, ny))
    return Heights(10 + lon, 55 + lat, height)


@given(hnp.arrays(bool, st.tuples(st.integers(2, 12), st.integers(2, 12))))
def test_every_shallow_cell_is_covered_with_a_cell_around_and_no_deep_one_far_off(
    shallow: np.ndarray,
) -> None:
    heights = grid(shallow)
    polygons = shallow_polygons(heights, 5.0)
    assert shapely.is_valid(polygons).all()
    if not shallow.any():
        assert not len(polygons)
        return
    area = shapely.union_all(polygons)
    rows, columns = np.nonzero(shallow)
    x, y, half = heights.lon[columns], heights.lat[rows], CELL / 2
    cells = shapely.union_all(shapely.box(x - half, y - half, x + half, y + half))
    around = cells.buffer(0.999 * CELL, quad_segs=32)
    assert shapely.difference(around, area).area < 1e-12
    # The polygons cover nothing beyond the 3 x 3 cells around shallow ones.
    taken = ndimage.binary_dilation(shallow, np.ones((3, 3)))
    rows, columns = np.nonzero(~taken)
    if len(rows):
        centres = shapely.points(heights.lon[columns], heights.lat[rows])
        assert not shapely.intersects(area, centres).any()


def test_land_is_shallow_and_what_has_no_figure_is_not() -> None:
    heights = grid(np.zeros((5, 30), dtype=bool))
    heights.height_m[2, 4], heights.height_m[2, 14], heights.height_m[2, 24] = 100.0, np.nan, -5.0
    (land,) = shallow_polygons(heights, 5.0)
    assert land.contains(shapely.Point(heights.lon[4], heights.lat[2]))


def test_a_million_cells_take_less_than_two_seconds() -> None:
    rng = np.random.default_rng(1)
    noise = ndimage.gaussian_filter(rng.normal(size=(1000, 1000)), 4)
    begun = time.process_time()
    polygons = shallow_polygons(grid(noise > 0.02), 5.0)
    assert time.process_time() - begun < 2.0
    assert len(polygons) > 100


@pytest.mark.parametrize("safety_depth_m", [1.9, 2.0, 2.1])
def test_water_as_deep_as_is_needed_is_deep_enough(safety_depth_m: float) -> None:
    shallow = np.zeros((5, 5), dtype=bool)
    shallow[2, 2] = True
    assert len(shallow_polygons(grid(shallow), safety_depth_m)) == (safety_depth_m > 2.0)
