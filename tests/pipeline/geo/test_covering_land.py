"""Outer land covers land and margin and little more; inner land is land."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from pipeline.geo.coast import covering_land, in_small_pieces, inner_land
from tests.pipeline.geo.shapes import coasts
from tests.strategies import examples

NO_ENDPOINTS = np.empty((0, 2))
TOLERANCES = st.sampled_from([0.0, 40.0, 700.0])


@examples(20, 60)
@given(land=coasts, tolerance=TOLERANCES, margin=st.sampled_from([0.0, 5.0, 200.0]))
def test_land_and_margin_are_covered_and_nothing_far_beyond(
    land: np.ndarray, tolerance: float, margin: float
) -> None:
    outer = covering_land(land, tolerance, margin, NO_ENDPOINTS)
    assert shapely.is_valid(outer).all()
    united = shapely.union_all(outer)
    assert united.area == np.float64(shapely.area(outer).sum()).round(6) or np.isclose(
        united.area, shapely.area(outer).sum(), rtol=1e-9
    )
    original = shapely.union_all(land)
    # An inscribed polygon of the round buffer, judged by GEOS alone.
    assert original.buffer(margin * 0.999).difference(united).area < 1e-3
    reach = max(margin + tolerance, 1.05 * margin)
    assert united.difference(original.buffer(1.01 * reach + 1e-3)).area < 1e-3


@settings(max_examples=60)
@given(land=coasts, tolerance=TOLERANCES, margin=st.sampled_from([0.0, 30.0]))
def test_inner_land_is_land_and_lacks_only_its_edge(
    land: np.ndarray, tolerance: float, margin: float
) -> None:
    inner = inner_land(land, tolerance, margin)
    assert shapely.is_valid(inner).all()
    original = shapely.union_all(land)
    assert shapely.union_all(inner).difference(original.buffer(-0.99 * margin)).area < 1e-3
    core = shapely.union_all(shapely.buffer(land, -(3.2 * tolerance + 1.1 * margin + 0.01)))
    assert core.difference(shapely.union_all(inner)).area < 1e-3


def test_enclosed_water_becomes_land_but_for_that_of_an_endpoint() -> None:
    island = shapely.box(0, 0, 10e3, 10e3).difference(shapely.box(4e3, 4e3, 6e3, 6e3))
    islet = shapely.box(4.9e3, 4.9e3, 5.1e3, 5.1e3)
    land = np.array([island, islet])
    (whole,) = covering_land(land, 50.0, 10.0, np.array([[-1e3, 0.0]]))
    assert not whole.interiors
    assert len(covering_land(land, 50.0, 10.0, NO_ENDPOINTS)) == 2
    kept = covering_land(land, 50.0, 10.0, np.array([[4.2e3, 4.2e3]]))
    assert len(kept) == 2
    # Two hooks enclose a pool only once they have grown together.
    hooks = shapely.difference(island, shapely.box(4.99e3, 5e3, 5.01e3, 11e3))
    (closed,) = covering_land(np.array([hooks]), 50.0, 10.0, np.array([[-1e3, 0.0]]))
    assert not closed.interiors
    assert closed.covers(shapely.Point(5e3, 5e3))


def test_small_pieces_make_up_the_same_area() -> None:
    angle = np.linspace(0, 2 * np.pi, 5_000, endpoint=False)
    radius = 1000 + 200 * np.sin(37 * angle) + 5 * np.sin(1_900 * angle)
    star = shapely.Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    holed = star.difference(shapely.Point(0, 0).buffer(300, quad_segs=200))
    whole = np.array([holed, shapely.box(2_000, 0, 2_001, 1)], dtype=object)
    pieces = in_small_pieces(whole)
    assert shapely.get_num_coordinates(pieces).max() <= 256
    assert shapely.area(pieces).sum() == pytest.approx(shapely.area(whole).sum(), rel=1e-12)
    line = shapely.LineString([(-1_500, -700), (1_500, 433)])
    lengths = [shapely.length(shapely.intersection(line, cut)).sum() for cut in (whole, pieces)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-9)
