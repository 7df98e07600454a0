"""Removing vertices only adds land, within the tolerance, and needs few vertices."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geo.coast.covering_simplify import (
    ProtectedWater,
    count_vertices,
    covering_simplify,
)
from tests.pipeline.archipelagos import EXAMPLES, PLANE, archipelagos, blob

if TYPE_CHECKING:
    import numpy.typing as npt

    Geometries = npt.NDArray[np.object_]


@EXAMPLES
def test_moves_only_add_land_within_the_tolerance(examples: int) -> None:
    @settings(max_examples=examples)
    @given(land=archipelagos, tolerance=st.sampled_from([50.0, 500.0, 5_000.0]))
    def tried(land: list[shapely.Polygon], tolerance: float) -> None:
        merged = shapely.union_all(PLANE.geometry_to_plane(shapely.make_valid(land)))
        given_land = shapely.get_parts(merged.buffer(5))
        result = covering_simplify(given_land, given_land, tolerance, 1.0, ProtectedWater())
        assert len(result) == len(given_land)
        assert count_vertices(result) <= count_vertices(given_land)
        assert shapely.is_valid(result).all()
        assert shapely.difference(given_land, result).shape == given_land.shape
        assert shapely.area(shapely.difference(given_land, result)).max() < 1e-3
        # The new coast, sampled ten times more densely than by the moves, is hardly further off.
        coast = shapely.get_coordinates(shapely.segmentize(result, 30.0))
        distance = shapely.distance(shapely.points(coast), shapely.union_all(given_land))
        assert distance.max() <= 1.5 * tolerance

    tried()


def test_stops_at_the_given_number_of_vertices() -> None:
    circle = np.array([shapely.Point(0, 0).buffer(1_000, quad_segs=32)], dtype=object)
    result = covering_simplify(circle, circle, 1e6, 1.0, ProtectedWater(), min_vertices=10)
    assert count_vertices(result) == 10
    # The ten-sided polygon around a circle has the area 10 tan(pi / 10) r²: little more is added.
    assert result[0].area < 1.05 * 10 * math.tan(math.pi / 10) * 1_000**2


def test_beats_douglas_peucker_with_a_covering_buffer() -> None:
    rng = np.random.default_rng(7)
    angle = np.linspace(0, 2 * math.pi, 2_000, endpoint=False)
    orders = np.arange(2, 40)[:, None]
    waves = (rng.normal(0, 2_000 / orders) * np.sin(orders * angle + orders)).sum(axis=0)
    coast: Geometries = np.array([blob((0, 0), (20_000 + waves).tolist(), 1, 0)], dtype=np.object_)
    ours = covering_simplify(coast, coast, 1_000.0, 1.0, ProtectedWater())
    for tolerance in (250.0, 500.0, 1_000.0):
        thin = shapely.simplify(coast, tolerance)
        cut = shapely.hausdorff_distance(thin, coast)[0]
        theirs = shapely.buffer(thin, cut, join_style="mitre")
        fewer = count_vertices(ours) < count_vertices(theirs)
        assert fewer or shapely.area(ours)[0] < shapely.area(theirs)[0], tolerance
    assert count_vertices(ours) < 80
