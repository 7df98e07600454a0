"""Fuel along a path against closed forms and quadrature, and how early or late a vessel may be."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import quad
from shapely import box

import renew
from renew.inputs.current import TabulatedCurrent
from renew.inputs.options import Drift
from renew.voyage.fuel import passage
from renew.voyage.voyage import early_and_late
from tests.strategies import PAPER_VESSEL, StreamFunctionCurrent, angles, seeds, speeds, voyage_on

CHART = renew.Chart(box(0, 0, 100, 100))


def test_a_smooth_current_is_replaced_by_its_table_and_a_step_is_not() -> None:
    class Step(renew.CurrentField):
        def __call__(self, points: np.ndarray) -> np.ndarray:
            return np.where(points[..., :1] < 31, [0.5, 0.0], [-0.5, 0.0])

    smooth = voyage_on(CHART, current=renew.GyreCurrent(0.8, 100, 100))
    assert isinstance(smooth.waters.quick_current, TabulatedCurrent)
    rough = voyage_on(CHART, current=Step())
    assert rough.waters.quick_current is rough.current


def test_a_share_of_the_time_and_at_least_some_but_not_before_departure() -> None:
    times = np.array([100.0, 150.0, 300.0, 1100.0])
    early, late = early_and_late(times, 100.0, 0.1, 60.0)
    assert early.tolist() == [100.0, 100.0, 240.0, 1000.0]
    assert late.tolist() == [160.0, 210.0, 360.0, 1200.0]
    early, late = early_and_late(times, 100.0, 0.1, 0.0)
    assert early.tolist() == [100.0, 145.0, 280.0, 1000.0]
    assert late.tolist() == [100.0, 155.0, 320.0, 1200.0]


def _southward_after_300_s(points: np.ndarray, times: np.ndarray) -> np.ndarray:
    v = np.interp(times, [300.0, 400.0], [0.0, -0.6])
    return np.asarray(np.stack([np.zeros_like(v), v], axis=-1) + 0 * points)


def test_turns_are_safe_when_the_vessel_is_late_by_the_least_lateness() -> None:
    """The set towards the shore begins when the vessel has passed it, if it is punctual."""
    chart = renew.Chart(box(0, 0, 200, 60), [box(60, 0, 140, 30)])
    current = renew.VaryingCurrent(np.arange(0.0, 1001.0, 50.0), _southward_after_300_s)
    ends = (20.0, 30.0), (180.0, 30.0)
    punctual = renew.plan(chart, current, PAPER_VESSEL, *ends).best
    late = renew.plan(chart, current, PAPER_VESSEL, *ends, min_lateness=400.0).best

    def collisions(route: renew.Route, min_lateness: float) -> int:
        flown = renew.contingency(route, chart, current, PAPER_VESSEL, min_lateness=min_lateness)
        return flown.collisions

    assert collisions(punctual, 0.0) == 0
    assert collisions(punctual, 400.0) > 0
    assert collisions(late, 400.0) == 0
    assert late.clearance > punctual.clearance + 1.0


@pytest.mark.parametrize("least", [-1.0, np.inf, np.nan])
def test_a_bad_least_lateness_is_refused(least: float) -> None:
    chart = renew.Chart(box(0, 0, 100, 100))
    still = renew.UniformCurrent(0.0, 0.0)
    with pytest.raises(renew.ParameterError, match="min_lateness = "):
        renew.plan(chart, still, PAPER_VESSEL, (10, 50), (90, 50), min_lateness=least)
    route = renew.plan(chart, still, PAPER_VESSEL, (10, 50), (90, 50)).best
    with pytest.raises(renew.ParameterError, match="min_lateness = "):
        renew.contingency(route, chart, still, PAPER_VESSEL, min_lateness=least)


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
