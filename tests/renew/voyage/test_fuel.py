"""Fuel along a path against closed forms and adaptive quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import quad

import renew
from renew.inputs.options import Drift
from renew.voyage.fuel import passage
from tests.strategies import PAPER_VESSEL, StreamFunctionCurrent, angles, seeds, speeds


@given(strength=speeds, towards=angles, course=angles, length=st.floats(0.1, 1e6))
def test_uniform_current_has_a_closed_form(
    strength: float, towards: float, course: float, length: float
) -> None:
    path = np.array([[3.0, 4.0], [3.0 + length * math.cos(course), 4 + length * math.sin(course)]])
    current = renew.UniformCurrent(strength * math.cos(towards), strength * math.sin(towards))
    along = strength * math.cos(towards - course)
    across = strength * math.sin(towards - course)
    projected = renew.fuel(path, current, PAPER_VESSEL)
    crab = renew.fuel(path, current, PAPER_VESSEL, drift="crab")
    assert projected == pytest.approx(length / (1 + along), rel=1e-9)
    assert crab == pytest.approx(length / (along + math.sqrt(1 - across**2)), rel=1e-9)
    assert crab >= projected * (1 - 1e-12)


@pytest.mark.parametrize("drift", ["projected", "crab"])
@given(seed=seeds)
def test_varying_current_agrees_with_adaptive_quadrature(drift: Drift, seed: int) -> None:
    current = StreamFunctionCurrent(seed, 0.7)
    a, b = np.random.default_rng(seed).uniform(0, 200, (2, 2))
    tangent = (b - a) / np.linalg.norm(b - a)
    left = np.array([-tangent[1], tangent[0]])

    def slowness(s: float) -> float:
        velocity = current(a + s * tangent)
        across = float(velocity @ left)
        own = math.sqrt(1 - across**2) if drift == "crab" else 1.0
        return 1 / (own + float(velocity @ tangent))

    expected, _ = quad(slowness, 0, float(np.linalg.norm(b - a)), limit=200, epsrel=1e-10)
    assert renew.fuel(np.array([a, b]), current, PAPER_VESSEL, drift=drift) == pytest.approx(
        expected, rel=1e-7
    )


def test_fuel_law_scales_with_thrust() -> None:
    path = np.array([[0.0, 0.0], [100.0, 0.0]])
    vessel = renew.Vessel(2.0, 1.0, fuel_coefficient=3.0, fuel_exponent=2.5)
    assert renew.fuel(path, renew.UniformCurrent(0.5, 0.0), vessel) == pytest.approx(
        3 * 2**2.5 * 100 / 2.5
    )


def test_a_current_that_the_vessel_cannot_overcome_costs_infinite_fuel() -> None:
    path = np.array([[0.0, 0.0], [100.0, 0.0]])
    assert math.isinf(renew.fuel(path, renew.UniformCurrent(-1.2, 0.0), PAPER_VESSEL))
    assert math.isinf(renew.fuel(path, renew.UniformCurrent(0, 1.2), PAPER_VESSEL, drift="crab"))


def test_times_are_given_leg_by_leg_and_a_leg_of_no_length_takes_none() -> None:
    path = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 0.0], [30.0, 40.0]])
    times = passage(path, renew.UniformCurrent(0.5, 0.0), PAPER_VESSEL).durations
    assert times == pytest.approx([20, 0, 40])


@pytest.mark.parametrize("shape", [(1, 2), (4,), (3, 3)])
def test_a_path_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(renew.ParameterError, match=r"it must be \(n, 2\)"):
        renew.fuel(np.zeros(shape), renew.UniformCurrent(0, 0), PAPER_VESSEL)
