"""Which triangles a path crosses, against shapely's intersections."""

from __future__ import annotations

import itertools

import numpy as np
import shapely
from hypothesis import example, given, strategies as st

from renew.classes.dual_graph import visits
from renew.classes.triangulation import triangulate
from tests.strategies import random_scene


@given(scene=st.integers(0, 4), seed=st.integers(0, 10_000), legs=st.integers(1, 12))
@example(scene=0, seed=49, legs=1)  # a path on land, through no triangle
def test_visits_are_the_pieces_into_which_triangles_cut_a_path(
    scene: int, seed: int, legs: int
) -> None:
    chart = random_scene(scene)[0]
    corners = triangulate(chart).corners
    xmin, ymin, xmax, ymax = chart.bounds
    path = np.random.default_rng(seed).uniform((xmin, ymin), (xmax, ymax), (legs + 1, 2))

    found = visits(path, corners)

    inside = shapely.intersection(shapely.polygons(corners), shapely.LineString(path))
    assert set(found.triangle.tolist()) == set(np.flatnonzero(shapely.length(inside) > 0).tolist())
    # Each visit begins and ends in its triangle, and no triangle follows itself.
    for places in (found.enter, found.leave):
        triangles = shapely.polygons(corners[found.triangle])
        outside = shapely.distance(triangles, shapely.points(places))
        assert outside.max(initial=0.0) < 1e-9 * (xmax - xmin)
    assert all(one != other for one, other in itertools.pairwise(found.triangle.tolist()))


def test_a_triangle_entered_again_is_visited_twice_and_one_only_touched_is_not_visited() -> None:
    below = [(0, 0), (4, 0), (2, 2)]
    above = [(4, 0), (6, 2), (2, 2)]
    touched = [(6, 2), (8, 0), (8, 4)]
    path = np.array([(1.0, 0.5), (4.0, 1.0), (1.5, 1.0), (3.0, 2.0), (6.0, 2.0)])

    found = visits(path, np.array([below, above, touched], dtype=float))

    assert found.triangle.tolist() == [0, 1, 0, 1]
    np.testing.assert_allclose(found.enter[0], path[0])
    np.testing.assert_allclose(found.leave[0], found.enter[1])
    np.testing.assert_allclose(found.leave[-1], path[-1])
