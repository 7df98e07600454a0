"""Requests at the edge of what can be asked for: they plan as fast as others, or are refused."""

from __future__ import annotations

import math
import time
import tracemalloc
from typing import TYPE_CHECKING

import numpy as np
import pytest
from shapely import box

import renew
from renew.inputs.arguments import MIN_RISK
from renew.inputs.current import CurrentStatistics
from renew.padding.reach_quantile import HEADING_SPREAD, TurnSampler
from renew.padding.turn_reach import TurnStarts, reach_along
from tests.strategies import PAPER_VESSEL, random_scene, single_gyre

if TYPE_CHECKING:
    from collections.abc import Callable


def cpu_seconds(plan: Callable[[], renew.Plan]) -> float:
    """Least CPU time of two runs, after one in which kernels are loaded."""
    plan()
    taken = []
    for _ in range(2):
        begun = time.process_time()
        plan()
        taken.append(time.process_time() - begun)
    return min(taken)


@pytest.mark.parametrize("metres", [1.0, 1e-2, 1e-4, 1e-6])
def test_endpoints_close_together_plan_as_fast_as_far_ones(metres: float) -> None:
    chart, current, start, goal = random_scene(1)
    here = np.array([100.0, 20.0])
    far = cpu_seconds(lambda: renew.plan(chart, current, PAPER_VESSEL, start, goal))
    close = cpu_seconds(
        lambda: renew.plan(chart, current, PAPER_VESSEL, here, here + np.array([metres, 0.0]))
    )
    assert close <= 2 * far


def test_endpoints_on_both_sides_of_a_wall_go_round_it() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(49.95, -1, 50.05, 60)])
    still = renew.UniformCurrent(0.0, 0.0)
    route = renew.plan(chart, still, PAPER_VESSEL, (45, 20), (55, 20), padding="none").best
    assert route.length == pytest.approx(2 * math.hypot(40.0, 5.0), rel=0.05)


def test_endpoints_closer_than_the_chart_can_tell_are_refused() -> None:
    chart, gyre = single_gyre()
    with pytest.raises(renew.ParameterError, match="same point"):
        renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (10, 10 + 1e-9))


@pytest.mark.parametrize("risk", [1e-3, 1e-5, MIN_RISK])
def test_small_risks_cost_bounded_time_and_memory(risk: float) -> None:
    chart, gyre = single_gyre()

    def plan(risk: float = risk) -> renew.Plan:
        return renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90), risk=risk)

    usual = plan(0.05).best
    tracemalloc.start()
    careful = plan().best
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500e6
    assert careful.fuel > usual.fuel
    assert careful.padding_used[:, 4].max() > usual.padding_used[:, 4].max()
    assert cpu_seconds(plan) < 10 * cpu_seconds(lambda: plan(0.05))


@pytest.mark.parametrize("risk", [5e-4, 1e-4])
def test_quantiles_far_in_the_tail_hold_in_millions_of_draws(risk: float) -> None:
    rng = np.random.default_rng(1)
    places, draws = 4, 2_000_000
    spread = CurrentStatistics(
        np.zeros((places, 2)),
        rng.uniform(0.1, 0.5, places),
        rng.uniform(-3, 3, places),
        rng.uniform(0.02, 0.2, places),
        rng.uniform(0.1, 0.6, places),
    )
    course, bearing = rng.uniform(-3, 3, (2, places))
    normals = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    quantile = TurnSampler.for_risk(0, risk).quantile(
        spread, course, np.arange(places), normals, PAPER_VESSEL, risk
    )
    for at in range(places):
        speed = rng.normal(spread.speed[at], spread.speed_std[at], draws).clip(min=0)
        towards = rng.normal(spread.direction[at], spread.direction_std[at], draws)
        heading = course[at] + rng.uniform(-HEADING_SPREAD, HEADING_SPREAD, draws)
        turns = TurnStarts(
            heading,
            np.cos(heading),
            np.sin(heading),
            speed * np.cos(towards),
            speed * np.sin(towards),
        )
        reach = np.empty(draws)
        reach_along(normals[at], turns, PAPER_VESSEL.speed, PAPER_VESSEL.turn_rate, reach)
        share = float((reach > quantile[at]).mean())
        assert 0.4 * risk <= share <= risk + 3 * math.sqrt(risk / draws)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"classes": 10**25}, "classes = 10000000000000000000000000 must be a whole number from 1"),
        ({"samples": 10**9}, "samples = 1000000000"),
        ({"seed": 2**80}, "seed = "),
        ({"risk": 1e-10}, "risk = 1e-10 must lie between 1e-09 and 1"),
    ],
)
def test_what_cannot_be_computed_is_refused(options: dict[str, object], message: str) -> None:
    chart, gyre = single_gyre()
    with pytest.raises(renew.ParameterError, match=message):
        renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90), **options)  # type: ignore[arg-type]


def test_figures_whose_powers_overflow_are_refused() -> None:
    with pytest.raises(renew.ParameterError, match=r"fuel_exponent = 1000\.0 must be"):
        renew.Vessel(1.0, 0.6, fuel_exponent=1000.0)
    with pytest.raises(renew.ParameterError, match=r"amplitude = 1e\+300 must be"):
        renew.GyreCurrent(1e300, 100, 100)
    huge = np.full((2, 2), 1e200)
    with pytest.raises(renew.ParameterError, match="4 nodes not finite, or beyond"):
        renew.GriddedCurrent([0.0, 1.0], [0.0, 1.0], huge, huge)  # type: ignore[arg-type]
