"""Requests at the limits of what can be asked for: they plan as fast as others, or are refused."""

import math
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from shapely import box

import renew
from renew.inputs.options import RANGES
from tests.strategies import PAPER_VESSEL, random_scene, single_gyre


def cpu_seconds(plan: Callable[[], renew.Plan]) -> float:
    """Least CPU time (s) of two runs, after a first one that loads the kernels."""
    plan()
    taken = []
    for _ in range(2):
        begun = time.process_time()
        plan()
        taken.append(time.process_time() - begun)
    return min(taken)


@cache
def far_cpu_seconds() -> float:
    """CPU time (s) of a plan across a scene."""
    return cpu_seconds(random_scene(1).plan)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("metres", [1.0, 1e-2, 1e-4, 1e-6])
def test_endpoints_close_together_plan_as_fast_as_far_ones(metres: float) -> None:
    here = np.array([100.0, 20.0])
    close = replace(random_scene(1), start=here, goal=here + np.array([metres, 0.0]))
    assert cpu_seconds(close.plan) <= 2 * far_cpu_seconds()


def test_a_strip_of_water_is_planned_as_fast_as_a_square() -> None:
    still = renew.UniformCurrent(0.0, 0.0)

    def plan_over(height: float) -> renew.Plan:
        chart = renew.Chart(box(0, 0, 5e6, height))
        ends = (1e6, height / 2), (4e6, height / 2)
        return renew.plan(chart, still, PAPER_VESSEL, *ends, padding="none")

    assert plan_over(0.1).best.length == pytest.approx(3e6)
    assert cpu_seconds(lambda: plan_over(0.1)) <= 2 * cpu_seconds(lambda: plan_over(5e6))


def test_endpoints_on_both_sides_of_a_wall_go_round_it() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(49.95, -1, 50.05, 60)])
    still = renew.UniformCurrent(0.0, 0.0)
    route = renew.plan(chart, still, PAPER_VESSEL, (45, 20), (55, 20), padding="none").best
    assert route.length == pytest.approx(2 * math.hypot(40.0, 5.0), rel=0.05)


def test_endpoints_closer_than_the_precision_of_the_chart_are_refused() -> None:
    with pytest.raises(renew.ParameterError, match="same point"):
        replace(single_gyre(), goal=np.array([10, 10 + 1e-9])).plan()


def gyre_at(risk: float) -> renew.Plan:
    """Plan the published gyre at a risk."""
    return single_gyre().plan(risk=risk)


@cache
def usual_cpu_seconds() -> float:
    """CPU time (s) of a plan at the usual risk."""
    return cpu_seconds(lambda: gyre_at(0.05))


@pytest.mark.slow
@pytest.mark.parametrize("risk", [1e-3, 1e-5, RANGES["risk"]["ge"]])
def test_small_risks_cost_bounded_time_and_memory(risk: float) -> None:
    tracemalloc.start()
    gyre_at(risk)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500e6
    # Padding that is fitted to the route's turns hardly depends on the risk.
    usual, careful = (single_gyre().plan(risk=one, risk_at="point").best for one in (0.05, risk))
    assert careful.fuel > usual.fuel
    assert careful.padding_used[:, 4].max() > usual.padding_used[:, 4].max()
    assert cpu_seconds(lambda: gyre_at(risk)) < 10 * usual_cpu_seconds()
