"""Corners: which are rounded on their outer side, around which discs, and by which radius."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings, strategies as st

import renew
from renew.errors import InfeasibleError
from renew.kernels.capsules import Capsules
from renew.steering.trajectory import (
    corner_radius,
    course_changes,
    crowding,
    effective_turning_radius,
    round_corners,
    sharp_corners,
    steerable,
)
from tests.strategies import PAPER_VESSEL, STILL, angles, seeds


@settings(max_examples=40)
@given(
    turns=st.lists(st.floats(0.3, 1.5), min_size=1, max_size=3),
    to_port=st.booleans(),
    course=angles,
    radius=st.floats(0.5, 3),
)
def test_turns_to_one_side_are_drawn_around_discs_that_touch_their_corners_from_within(
    turns: list[float], to_port: bool, course: float, radius: float
) -> None:
    side = 1 if to_port else -1
    bearings = course + side * np.cumsum([0.0, *turns])
    path = np.vstack(
        [[0.0, 0.0], np.cumsum(30 * np.column_stack([np.cos(bearings), np.sin(bearings)]), axis=0)]
    )
    _, inwards = course_changes(path)
    every = np.ones(len(turns), dtype=bool)
    found, _ = round_corners(path, every, np.full(len(turns), radius))
    assert found[[0, -1]] == pytest.approx(path[[0, -1]])
    line = shapely.LineString(found)
    for centre, corner in zip(path[1:-1] + radius * inwards, path[1:-1], strict=True):
        # The disc touches the corner; the path goes round it on the outer side, and close by.
        assert math.dist(centre, corner) == pytest.approx(radius)
        assert line.distance(shapely.Point(centre)) == pytest.approx(radius, rel=1e-6)
        assert line.distance(shapely.Point(corner)) < 0.01 * radius
    # Never tighter than the radius: each leg has room for the arcs at both of its ends.
    legs = np.linalg.norm(np.diff(found, axis=0), axis=1)
    changes, _ = course_changes(found)
    needed = radius * np.tan(np.abs(changes) / 2)
    assert (legs >= np.append(0, needed) + np.append(needed, 0) - 1e-9).all()
    assert (side * changes > 0).all()


@settings(max_examples=30)
@given(turn=st.floats(0.3, 2.5), radius=st.floats(0.5, 5))
def test_land_inside_the_corner_is_not_touched(turn: float, radius: float) -> None:
    path = np.array([[-40, 0], [0, 0], [40 * math.cos(turn), 40 * math.sin(turn)]])
    found, _ = round_corners(path, np.array([True]), np.array([radius]))
    # A headland in the corner that touches both legs.
    land = shapely.Polygon(path * 0.7)
    assert shapely.LineString(found).intersection(land.buffer(-1e-9)).is_empty


def test_corners_that_are_not_sharp_stay_as_they_are() -> None:
    path = np.array([[0, 0], [30, 0], [60, 10], [90, 90]], dtype=float)
    found, _ = round_corners(path, np.array([False, False]), np.array([2.0, 2.0]))
    assert found == pytest.approx(path)
    found, _ = round_corners(path, np.array([False, True]), np.array([2.0, 2.0]))
    assert found[:2] == pytest.approx(path[:2])
    assert len(found) > 5
    # An arc turns by 4 degrees at each vertex, at most.
    turns, _ = course_changes(found)
    assert np.abs(turns[1:]).max() <= math.radians(4) + 1e-9


@settings(max_examples=30)
@given(share=st.floats(0.1, 1.35), radius=st.floats(2, 5), course=angles)
def test_the_end_of_a_wall_is_rounded_on_the_shortest_way(
    share: float, radius: float, course: float
) -> None:
    # From √2 radii on a disc at each corner is shorter.
    width, length = share * radius, 40.0
    along = np.array([[0, length], [0, 0], [width, 0], [width, length]]) - [width / 2, 0]
    turned = np.array([[math.cos(course), math.sin(course)], [-math.sin(course), math.cos(course)]])
    sharp, radii = np.array([True, True]), np.array([radius, radius])
    found, alone = (
        round_corners(along @ turned, sharp, radii, together=together)[0]
        for together in (True, False)
    )
    # No curve of this radius passes closer around both corners than the circle through them.
    centre = math.sqrt(radius**2 - width**2 / 4)
    reach = math.hypot(width / 2, length - centre)
    straight = math.sqrt(reach**2 - radius**2)
    across = math.atan2(width / 2, length - centre)
    around = 2 * math.pi - 2 * (across + math.acos(radius / reach))
    shortest = 2 * straight + radius * around
    assert shapely.LineString(found).length == pytest.approx(shortest, rel=1e-3)
    assert shapely.LineString(found).length < shapely.LineString(alone).length
    wall = shapely.Polygon(along @ turned)
    assert shapely.LineString(found).intersection(wall.buffer(-1e-6)).is_empty


def test_a_disc_that_the_string_does_not_lean_on_is_dropped() -> None:
    # A slight bend between two large turns: the string around their discs passes outside of it.
    bearings = np.radians([0, 60, 61, 121])
    legs = np.array([30, 10, 10, 30])[:, None]
    steps = legs * np.column_stack([np.cos(bearings), np.sin(bearings)])
    path = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    found, _ = round_corners(path, np.ones(3, dtype=bool), np.full(3, 5.0))
    turns, _ = course_changes(found)
    assert (turns > 0).all()
    _, inwards = course_changes(path)
    line = shapely.LineString(found)
    distance = [line.distance(shapely.Point(c)) for c in path[1:-1] + 5 * inwards]
    assert distance[0] == pytest.approx(5)
    assert distance[1] > 5.1
    assert distance[2] == pytest.approx(5)


def test_a_disc_within_the_next_one_is_passed_by_going_round_that() -> None:
    # Round the end of a wall 3 m thick, in a current that lets the vessel turn sooner at one side.
    path = np.array([[-15, 30], [0, 0], [3, 0], [18, 30]], dtype=float)
    found, drawn_for = round_corners(path, np.ones(2, dtype=bool), np.array([1.0, 6.0]))
    assert set(drawn_for.tolist()) == {0, 2, 3}
    turns, _ = course_changes(found)
    assert (turns > 0).all()
    wall = shapely.Polygon([(0, 0), (3, 0), (3, 30), (0, 30)])
    assert shapely.LineString(found).intersection(wall.buffer(-1e-9)).is_empty
    # The arc passes through the corner for which it is drawn, and no further off than its disc.
    assert shapely.LineString(found).distance(shapely.Point(3, 0)) < 0.01


def test_opposite_turns_too_close_together_are_refused_with_their_place() -> None:
    path = np.array([[0, 0], [30, 0], [30, 2], [60, 2]], dtype=float)
    with pytest.raises(InfeasibleError, match=r"two opposite turns near \(\d+"):
        round_corners(path, np.ones(2, dtype=bool), np.full(2, 8.0))
    roomy = np.array([[0, 0], [30, 0], [30, 40], [60, 40]], dtype=float)
    found, _ = round_corners(roomy, np.ones(2, dtype=bool), np.full(2, 8.0))
    assert all((one != other).any() for one, other in itertools.pairwise(found))


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


def test_a_corner_needs_room_for_its_arc() -> None:
    zigzag = np.array([[0, 0], [10, 0], [10.2, 0.5], [20, 0.5]], dtype=float)
    assert not steerable(zigzag, STILL, PAPER_VESSEL)
    gentle = np.array([[0, 0], [20, 0], [40, 5]], dtype=float)
    assert steerable(gentle, STILL, PAPER_VESSEL)
    # A right angle needs half of a leg for each radius.
    for room, expected in ((0.99, False), (1.01, True)):
        leg = 2 * room * PAPER_VESSEL.turning_radius
        assert steerable(np.array([[0, 0], [leg, 0], [leg, leg]]), STILL, PAPER_VESSEL) == expected
    assert steerable(np.array([zigzag, zigzag[::-1]]), STILL, PAPER_VESSEL).tolist() == [False] * 2


@given(heading=angles, strength=st.floats(0, 0.9), towards=angles)
def test_the_effective_radius_is_the_speed_over_ground_by_the_turn_rate(
    heading: float, strength: float, towards: float
) -> None:
    current = renew.UniformCurrent(strength * math.cos(towards), strength * math.sin(towards))
    radius = effective_turning_radius(current(np.zeros(2)), np.asarray(heading), PAPER_VESSEL)
    # By the law of cosines.
    square = 1 + strength**2 + 2 * strength * math.cos(towards - heading)
    expected = math.sqrt(max(square, 0)) / PAPER_VESSEL.turn_rate
    assert radius == pytest.approx(expected, abs=1e-9)


@settings(max_examples=30)
@given(course=angles, turn=st.floats(-2.5, 2.5), strength=st.floats(0, 0.8), towards=angles)
def test_an_arc_of_the_corner_radius_takes_just_the_turn_rate_on_its_faster_leg(
    course: float, turn: float, strength: float, towards: float
) -> None:
    c = strength * np.array([math.cos(towards), math.sin(towards)])
    bearings = np.array([course, course + turn])
    legs = np.column_stack([np.cos(bearings), np.sin(bearings)])
    path = np.vstack([-50 * legs[0], [0.0, 0.0], 50 * legs[1]])
    [radius] = corner_radius(path, renew.UniformCurrent(*c), PAPER_VESSEL)

    def heading_and_speed(bearing: float) -> tuple[float, float]:
        """Heading that holds a course, and the speed over ground on it."""
        crab = math.asin(strength * math.sin(bearing - towards) / PAPER_VESSEL.speed)
        ground = PAPER_VESSEL.speed * math.cos(crab) + strength * math.cos(bearing - towards)
        return bearing + crab, ground

    rates = []
    for bearing in bearings:
        step = 1e-6
        (before, _), (after, speed) = (heading_and_speed(bearing + s) for s in (-step, step))
        rates.append(abs(after - before) / (2 * step) * speed / radius)
    assert max(rates) == pytest.approx(PAPER_VESSEL.turn_rate, rel=1e-4)


@given(seed=seeds)
def test_course_changes_point_into_the_turn_and_halve_the_corner(seed: int) -> None:
    path = np.random.default_rng(seed).normal(0, 10, (6, 2))
    turns, inwards = course_changes(path)
    legs = np.diff(path, axis=0)
    units = legs / np.linalg.norm(legs, axis=1, keepdims=True)
    one, other = units[:-1], units[1:]
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    assert np.cos(turns) == pytest.approx((one * other).sum(axis=1))
    assert np.sin(turns) == pytest.approx(cross)
    halfway = (other - one) / np.linalg.norm(other - one, axis=1, keepdims=True)
    assert inwards == pytest.approx(halfway)
