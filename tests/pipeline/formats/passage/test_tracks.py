"""Legs as drawn, against another formula and against the geodesic library's own points."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.formats.passage.safe_corridor import curve_for, initial_course_deg, tracks
from pipeline.geo.projection import Projection
from tests.pipeline.formats import oracles

latitudes = st.floats(-70, 70)
offsets = st.floats(-6, 6)


@given(latitudes, offsets, offsets, st.sampled_from(["Loxodrome", "Orthodrome"]))
def test_legs_are_drawn_within_their_error(
    latitude: float, east: float, north: float, curve: str
) -> None:
    begin, end = np.array([179.0, latitude]), np.array([179.0 + east, latitude + north])
    if np.abs(end - begin).max() < 1e-3:
        return
    projection = Projection.at(179.0 + east / 2, latitude + north / 2)
    drawn = tracks(begin[None], end[None], curve, projection, 2.0)  # type: ignore[arg-type]
    assert drawn.lonlat[0].tolist() == begin.tolist()
    assert drawn.lonlat[-1].tolist() == end.tolist()
    draw = oracles.loxodrome if curve == "Loxodrome" else oracles.geodesic
    points = shapely.points(projection.to_plane(draw(begin, end, 400)))
    # This close to its centre the plane is true to a thousandth; the oracle's table, to 0.1 m.
    assert shapely.distance(points, drawn.lines[0]).max() < 2.2
    length = oracles.GEOD.line_length(*draw(begin, end, 400).T)
    assert drawn.length_m[0] == pytest.approx(length, rel=1e-5)


@given(latitudes, offsets, offsets)
def test_a_loxodrome_keeps_its_course(latitude: float, east: float, north: float) -> None:
    begin, end = np.array([[10.0, latitude]]), np.array([[10.0 + east, latitude + north]])
    if np.abs(end - begin).max() < 1e-2:
        return
    course = initial_course_deg(begin, end, "Loxodrome")[0]
    line = oracles.loxodrome(begin[0], end[0], 2000)
    for at in (0, 1000, 1998):
        there = oracles.GEOD.inv(*line[at], *line[at + 1])[0]
        assert abs((course - there + 180) % 360 - 180) < 0.02


def test_a_known_loxodrome() -> None:
    # Along a parallel: due east, R cos(latitude) of the ellipsoid.
    begin, end = np.array([[0.0, 60.0]]), np.array([[10.0, 60.0]])
    assert initial_course_deg(begin, end, "Loxodrome")[0] == pytest.approx(90.0)
    drawn = tracks(begin, end, "Loxodrome", Projection.at(5.0, 60.0), 0.1)
    sine = np.sin(np.radians(60))
    parallel = oracles.GEOD.a * np.cos(np.radians(60)) / np.sqrt(1 - oracles.GEOD.es * sine**2)
    assert drawn.length_m[0] == pytest.approx(parallel * np.radians(10), rel=1e-6)
    assert np.abs(drawn.lonlat[:, 1] - 60).max() < 1e-9


def test_several_legs_at_once_equal_each_by_itself() -> None:
    begin = np.array([[0.0, 40.0], [1.0, 41.0], [5.0, -3.0]])
    end = np.array([[1.0, 41.0], [1.0, 44.0], [4.0, -3.5]])
    projection = Projection.at(2.0, 20.0)
    together = tracks(begin, end, "Loxodrome", projection, 1.0)
    for leg in range(3):
        alone = tracks(begin[leg : leg + 1], end[leg : leg + 1], "Loxodrome", projection, 1.0)
        assert np.array_equal(together.lonlat[together.leg == leg], alone.lonlat)
        assert together.length_m[leg] == pytest.approx(alone.length_m[0])
    assert len(together.lines) == 3


@pytest.mark.parametrize(
    ("latitude", "curve"),
    [(0, "Loxodrome"), (69, "Loxodrome"), (71, "Orthodrome"), (-85, "Orthodrome")],
)
def test_high_latitudes_have_orthodromes(latitude: float, curve: str) -> None:
    assert curve_for(np.array([[0.0, 0.0], [10.0, latitude]])) == curve
