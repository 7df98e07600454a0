"""Plans without a clock, sailed in the changing current; the test repeats each by itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

import renew
from pipeline.findings.text import percent
from pipeline.formats.report.sentences import clock_text
from pipeline.model import CaseResult, ClockWorth
from pipeline.stages.measure import clock_worth, hat_weights, mean_weights
from tests.pipeline.tidal_run import planned


@given(
    st.lists(st.floats(0.1, 5), min_size=1, max_size=8), st.floats(0, 1), st.integers(0, 2**32 - 1)
)
def test_the_mean_is_the_integral_of_what_is_linear_between_slices(
    gaps: list[float], share: float, seed: int
) -> None:
    times = np.cumsum([-0.3 * gaps[0], *gaps])
    values = np.random.default_rng(seed).uniform(-1, 1, len(times))
    end = max(share * times[-1], 0.01)
    fine = np.linspace(0, end, 20_001)
    expected = np.trapezoid(np.interp(fine, times, values), fine) / end
    assert mean_weights(times, end) @ values == pytest.approx(expected, abs=1e-4)
    assert mean_weights(times, end).sum() == pytest.approx(1)
    assert hat_weights(times, end) @ values == pytest.approx(np.interp(end, times, values))


def test_other_plans_are_sailed_in_the_changing_current() -> None:
    """The plan at departure is made again here, from the field asked at that time."""
    result = planned()
    case, worth = result.planned["tide"], result.case("tide").measures.clock_worth
    assert worth is not None
    current, best = case.current, result.routes[0].route
    assert worth.best == best.fuel
    assert worth.bound <= worth.best * (1 + 1e-9)
    assert worth.bound == pytest.approx(best.fuel_bound.value)

    def at_departure(points: np.ndarray) -> np.ndarray:
        return current.velocity(points, 0.0)

    frozen = renew.plan(
        case.chart, at_departure, case.vessel, case.start, case.goal,
        classes=4, clearance=100.0, drift="crab", distinct_by="auto",
    )  # fmt: skip
    sailed = renew.fuel(frozen.best.path, current, case.vessel, drift="crab")
    assert worth.frozen == pytest.approx(sailed, rel=2e-3)
    shortest = renew.fuel(np.array([case.start, case.goal]), current, case.vessel, drift="crab")
    assert worth.shortest > 0.99 * shortest, "straight through the island is no way"
    # No plan that knows less is better, within the accuracy of the search grid.
    assert min(worth.frozen, worth.mean, worth.shortest) > 0.999 * worth.best


def test_the_sentence_compares_the_plans() -> None:
    worth = ClockWorth(best=100.0, frozen=107.0, mean=100.01, shortest=math.inf, bound=98.5)
    assert clock_text(worth) == (
        "Sailed in the changing current from the same departure on, the plan on the current at "
        f"departure needs {percent(0.07)} more fuel than this route, the plan on its mean over the "
        "voyage needs as much fuel as this route, the shortest safe path can't be sailed. No route "
        f"within the chart saves more than {percent(0.015)}."
    )


def test_a_steady_current_has_no_clock() -> None:
    case, options = planned().planned["tide"], planned().scenario.planner
    unplanned = CaseResult("tide", None, "no way", 0.0)
    assert clock_worth(case, unplanned, options) is None
    steady = replace(case, current=renew.UniformCurrent(0.1, 0.0))
    assert clock_worth(steady, planned().results[0], options) is None
