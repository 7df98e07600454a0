"""Which corners are rounded on their outer side, and which are in the way of that."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, strategies as st

from renew.kernels.capsules import Capsules
from renew.steering.corners import crowding, sharp_corners

NOTHING = Capsules(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))


@given(
    turn=st.floats(0.05, 2.5),
    radius=st.floats(0.5, 5),
    side=st.sampled_from([-1, 1]),
    place=st.tuples(st.floats(-8, 8), st.floats(-8, 8)),
)
def test_a_corner_is_sharp_where_its_arc_would_enter_a_capsule(
    turn: float, radius: float, side: int, place: tuple[float, float]
) -> None:
    """GEOS says whether the chords of the arc that is rounded inwards come near a post."""
    path = np.array([[-60.0, 0], [0, 0], [60 * math.cos(turn), 60 * math.sin(turn)]]) * [1, side]
    bisector = np.array([-math.sin(turn / 2), math.cos(turn / 2)]) * [1, side]
    middle = (radius / math.cos(turn / 2) - radius) * bisector
    tangent = radius * math.tan(turn / 2)
    chords = shapely.LineString([[-tangent, 0], middle, tangent / 60 * path[2]])
    near = chords.distance(shapely.Point(place))
    assume(abs(near - 0.3) > 1e-9)
    post = Capsules(np.array([place]), np.array([place]), np.array([0.3]))
    assert sharp_corners(path, np.array([radius]), post).tolist() == [near < 0.3]


@pytest.mark.parametrize(("first", "second", "sharp"), [(0.3, 0.9, 1), (0.9, 0.3, 0)])
def test_of_two_corners_on_a_short_leg_the_one_that_asks_for_more_is_sharp(
    first: float, second: float, sharp: int
) -> None:
    courses = np.cumsum([0.0, first, second])
    legs = np.array([50.0, 1.0, 50.0])[:, None] * np.column_stack(
        [np.cos(courses), np.sin(courses)]
    )
    path = np.vstack([np.zeros(2), np.cumsum(legs, axis=0)])
    found = sharp_corners(path, np.full(2, 2.0), NOTHING)
    assert np.flatnonzero(found).tolist() == [sharp]
    longer = path + np.array([[0, 0], [0, 0], [1, 1], [1, 1]]) * 20 * legs[1]
    assert not sharp_corners(longer, np.full(2, 2.0), NOTHING).any()


def test_corners_near_a_sharp_one_are_in_its_way() -> None:
    """Its disc cuts a chord of 2 r sin(δ/2) off either leg: within 1.5 of these they give way."""
    path = np.array([[0, 0], [10, 0], [17.5, 0], [20, 0], [20, 2.5], [20, 10], [20, 20.0]])
    sharp, radius = np.zeros(5, dtype=bool), np.full(5, 2.0)
    sharp[2] = True
    chord = 2 * 2.0 * math.sin(math.pi / 4)
    assert 2.5 < 1.5 * chord < 10
    assert crowding(path, sharp, radius).tolist() == [False, True, False, True, False]
    assert not crowding(path, np.zeros(5, dtype=bool), radius).any()
