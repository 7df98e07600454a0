"""What is cut lies near the simplified rings; nothing else changes sides."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given, settings, strategies as st

from pipeline.geo.coast import simplified
from tests.pipeline.geo.shapes import coasts

CUTS = st.sampled_from([0.0, 10.0, 150.0, 3000.0])


@settings(max_examples=60)
@given(land=coasts, cut=CUTS)
def test_only_what_is_nearer_than_the_cut_to_a_new_ring_changes_sides(
    land: np.ndarray, cut: float
) -> None:
    result = simplified(land, cut)
    assert shapely.is_valid(result.areas).all()
    for index, (polygon, area) in enumerate(zip(land, result.areas, strict=True)):
        own = result.outlines[result.owner == index]
        # Inscribed polygons of the buffers: a little wider than the cut makes up for it.
        near = shapely.union_all(shapely.buffer([area.boundary, *own], 1.02 * cut + 1e-6))
        assert polygon.symmetric_difference(area).difference(near).area < 1e-3


def test_an_islet_becomes_a_line_and_a_dot_a_point() -> None:
    islet = shapely.box(0, 0, 90, 10)
    dot = shapely.box(500, 0, 501, 1)
    result = simplified(np.array([islet, dot, shapely.box(0, 100, 90, 190)]), 20.0)
    assert shapely.is_empty(result.areas).tolist() == [True, True, False]
    assert result.owner.tolist() == [0, 1]
    line, point = result.outlines
    assert line.length >= 90
    assert point.length < 2
    # Both can be buffered to all sides.
    assert line.buffer(20.0).covers(islet)
    assert point.buffer(20.0).covers(dot)


def test_a_lake_that_collapses_is_an_outline_of_its_land() -> None:
    lake = shapely.box(100, 100, 400, 110)
    land = shapely.box(0, 0, 1000, 1000).difference(lake)
    result = simplified(np.array([land]), 20.0)
    assert result.areas[0].equals(shapely.box(0, 0, 1000, 1000))
    assert result.owner.tolist() == [0]
    assert result.outlines[0].buffer(20.0).covers(lake)
