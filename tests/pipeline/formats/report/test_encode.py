from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.formats.report.map_data import (
    Lattice,
    coarser,
    json_for_script,
    series,
    within,
)

PLACES = hnp.arrays(
    float, st.tuples(st.integers(1, 30), st.just(2)), elements=st.floats(-3000.0, 9000.0)
)


def read_line(moves: list[int], lattice: Lattice) -> np.ndarray:
    """Decode a line as the page's script does."""
    return lattice.origin + lattice.step * np.cumsum(np.reshape(moves, (-1, 2)), axis=0)


@given(PLACES, st.sampled_from([1.0, 5.0, 1000.0]))
def test_a_line_is_decoded_to_half_a_step(places: np.ndarray, scale: float) -> None:
    lattice = Lattice.of((-3000.0, -3000.0, 9000.0, 5000.0), scale)
    assert 12_000 * scale / lattice.step_m >= 2e5
    assert lattice.step * scale == pytest.approx(lattice.step_m)
    back = read_line(lattice.line(places), lattice)
    steps = lattice.to_steps(places)
    different = [group[0] for group in (list(g) for _, g in itertools.groupby(steps.tolist()))]
    assert len(back) == len(different)
    expected = lattice.origin + lattice.step * np.array(different)
    assert np.abs(back - expected).max() < 1e-6 * 12_000
    assert np.abs(lattice.origin + lattice.step * steps - places).max() <= 0.5001 * lattice.step


def test_outer_rings_are_anticlockwise_and_holes_clockwise() -> None:
    outer = shapely.Point(50, 50).buffer(30)
    holed = shapely.Polygon(outer.reverse().exterior, [shapely.Point(50, 50).buffer(10).exterior])
    lattice = Lattice.of((0.0, 0.0, 100.0, 100.0), 1.0)
    speck = shapely.box(1, 1, 1 + lattice.step / 10, 1 + lattice.step / 10)
    areas = np.array([shapely.MultiPolygon([holed]), speck, shapely.Polygon()], dtype=object)
    shell, hole = (read_line(ring, lattice) for ring in lattice.rings(areas))
    assert shapely.LinearRing(shell).is_ccw
    assert not shapely.LinearRing(hole).is_ccw
    back = shapely.Polygon(shell, [hole])
    assert back.symmetric_difference(holed).area < 1e-3 * holed.area


@given(hnp.arrays(float, st.integers(1, 50), elements=st.floats(-1e6, 1e6)))
def test_a_series_is_decoded_and_its_last_value_is_exact(values: np.ndarray) -> None:
    encoded = series(values)
    step, moves = encoded["step"], encoded["moves"]
    assert isinstance(step, float)
    assert isinstance(moves, list)
    back = step * np.cumsum(moves)
    assert np.abs(back - values).max() <= 0.5001 * step
    assert step <= max(np.abs(values).max() / 50_000, 0) or step == 1.0
    if abs(values[-1]) > 0.1 * np.abs(values).max():
        assert back[-1] == pytest.approx(values[-1], rel=1e-12)


def test_a_series_with_infinite_values_has_no_moves() -> None:
    assert series(np.array([1.0, np.inf]))["moves"] is None


def test_areas_are_clipped_to_the_chart() -> None:
    chart = shapely.box(0, 0, 10, 10)
    areas = np.array(
        [shapely.box(1, 1, 2, 2), shapely.box(8, 8, 12, 12), shapely.box(20, 20, 21, 21)],
        dtype=object,
    )
    assert sorted(shapely.area(within(areas, chart))) == pytest.approx([1.0, 4.0])


def test_a_coast_is_simplified_only_if_it_has_too_many_vertices() -> None:
    coast = np.array([shapely.Point(0, 0).buffer(10, quad_segs=500)], dtype=object)
    assert shapely.get_num_coordinates(coarser(coast, 0.01, 5000)).sum() == 2001
    shorter = coarser(coast, 1e-4, 200)
    assert 20 < shapely.get_num_coordinates(shorter).sum() <= 200
    assert shapely.area(shorter)[0] == pytest.approx(shapely.area(coast)[0], rel=0.01)
    triangle = np.array([shapely.box(0, 0, 1, 1)], dtype=object)
    assert shapely.get_num_coordinates(coarser(triangle, 1e-9, 1)).sum() == 5


def test_islets_are_dropped_before_islands() -> None:
    corners = np.random.default_rng(3).uniform(0, 1000, (3000, 2))
    islets = shapely.box(*corners.T, *(corners + 0.4).T)
    island = shapely.Point(500, 500).buffer(100, quad_segs=20)
    simple = coarser(np.append(islets, island), 0.1, 200)
    assert shapely.is_empty(simple[:-1]).all()
    assert shapely.area(simple[-1]) == pytest.approx(shapely.area(island), rel=0.01)


@given(st.text())
def test_json_stays_data_in_a_script(text: str) -> None:
    hostile = f"</script><!--{text}<script>]]>"
    written = json_for_script({"name": hostile})
    assert json.loads(written) == {"name": hostile}
    assert not set("<>&") & set(written)
