"""The vessel: all faults are named at once; and what follows from its figures."""

from __future__ import annotations

import math

import pytest

import renew


def test_all_faults_of_a_vessel_are_named() -> None:
    with pytest.raises(renew.ParameterError) as caught:
        renew.Vessel(speed=-1.0, turn_rate=math.nan, length=0.0)
    for name in ("speed = -1.0", "turn_rate = nan", "length = 0.0"):
        assert name in str(caught.value)


def test_an_exponent_whose_power_overflows_is_refused() -> None:
    with pytest.raises(renew.ParameterError, match=r"fuel_exponent = 1000\.0 must be"):
        renew.Vessel(1.0, 0.6, fuel_exponent=1000.0)


def test_one_turn_sails_the_circumference_of_the_turning_circle() -> None:
    vessel = renew.Vessel(speed=3.0, turn_rate=0.2, fuel_coefficient=0.5, fuel_exponent=3.0)
    circumference = 2 * math.pi * vessel.turning_radius
    assert vessel.speed * vessel.turn_period == pytest.approx(circumference)
    assert vessel.turning_radius == pytest.approx(15)
    assert vessel.fuel_rate == pytest.approx(13.5)
