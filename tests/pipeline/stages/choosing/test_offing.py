"""The offing: its formula, and that it leaves a way."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import renew
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.stages.choosing.offing import passable_offing, wanted_offing_m

FAR_M, MILE_M = 1e6, 1852.0
START, GOAL = np.array([100.0, 1000.0]), np.array([1900.0, 1000.0])


def ship(length_m: float, speed_kn: float, circle_m: float) -> VesselSpec:
    speed = speed_kn * MILE_M / 3600
    turn_rate = math.degrees(speed / (circle_m / 2))
    return VesselSpec(length_m=length_m, speed_m_s=speed, turn_rate_deg_s=turn_rate)


def test_it_is_what_a_mariner_would_keep() -> None:
    small = wanted_offing_m(catalogue.vessel("usv-7m"), 60.0, FAR_M)
    assert small / MILE_M == pytest.approx(0.4, abs=0.05)
    assert wanted_offing_m(ship(200, 15, 700), 60.0, FAR_M) / MILE_M == pytest.approx(0.9, abs=0.05)


@given(
    st.floats(2, 400), st.floats(2, 40), st.floats(10, 3000), st.floats(0, 500), st.floats(1e3, 1e7)
)
def test_it_is_wider_than_the_turn_and_the_charts_error_but_for_short_voyages(
    length_m: float, speed_kn: float, circle_m: float, accuracy_m: float, distance_m: float
) -> None:
    vessel = ship(length_m, speed_kn, circle_m)
    offing_m = wanted_offing_m(vessel, accuracy_m, distance_m)
    limit_m = distance_m / 200
    assert 0 < offing_m <= limit_m * (1 + 1e-9)
    if offing_m < limit_m * (1 - 1e-9):
        assert offing_m > accuracy_m + max(circle_m, length_m) * 0.999
        further = wanted_offing_m(vessel, accuracy_m, 2 * distance_m)
        assert offing_m == pytest.approx(further)


def strait(width: float) -> renew.Chart:
    """Return a wall from edge to edge with a gap of some width between start and goal."""
    middle = 1000.0
    walls = [
        shapely.box(990, -10, 1010, middle - width / 2),
        shapely.box(990, middle + width / 2, 1010, 2010),
    ]
    return renew.Chart(shapely.box(0, 0, 2000, 2000), walls)


@pytest.mark.parametrize(
    ("width", "kept"), [(500, 100), (150, 50), (70, 25), (30, 12.5), (2, 0), (0.5, 0)]
)
def test_it_is_halved_until_the_only_strait_is_open(width: float, kept: float) -> None:
    assert passable_offing(strait(width), START, GOAL, 100.0) == kept


def test_start_and_goal_may_lie_in_a_harbour_but_not_behind_a_strait() -> None:
    harbour = [shapely.box(60, 900, 80, 1100), shapely.box(80, 1050, 300, 1100)]
    chart = renew.Chart(shapely.box(0, 0, 2000, 2000), harbour)
    assert passable_offing(chart, START, GOAL, 100.0) == 100.0
