"""The turning radius over ground against the headings that the triangle of velocities gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import renew
from renew.steering.corners import (
    corner_radius,
    course_changes,
    effective_turning_radius,
    steerable,
)
from tests.strategies import PAPER_VESSEL, angles, seeds

STILL = renew.UniformCurrent(0.0, 0.0)


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
