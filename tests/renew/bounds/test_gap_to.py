"""Gaps that are asked for: the bound stops once it is tight enough, and goes on where it is not."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import renew
from renew.bounds.fuel_bound import FuelBound
from renew.voyage.voyage import Voyage
from tests.strategies import PAPER_VESSEL, random_scene


def planned(gap_to: float) -> renew.Plan:
    chart, current, start, goal = random_scene(4)
    return renew.plan(chart, current, PAPER_VESSEL, start, goal, padding="none", gap_to=gap_to)


def test_a_gap_that_is_asked_for_is_reached_and_hardly_undercut() -> None:
    standard = planned(0.0).best
    loose = planned(0.05)
    assert standard.optimality_gap < loose.best.optimality_gap < 0.05
    # One bound for all routes.
    assert len({route.fuel_bound.value for route in loose.routes}) == 1
    assert loose.best.fuel == standard.fuel


def test_a_gap_below_the_standard_one_takes_a_finer_grid() -> None:
    standard, tight = planned(0.0).best, planned(1e-4).best
    assert 0 < tight.optimality_gap < standard.optimality_gap


@pytest.mark.parametrize("gap_to", [-0.1, 1.0, float("nan"), "0.1"])
def test_a_gap_out_of_range_is_refused(gap_to: float) -> None:
    with pytest.raises(renew.ParameterError, match=r"gap_to = .* 0 or more, below 1"):
        renew.PlanOptions(gap_to=gap_to)


def test_threads_that_ask_together_compute_the_bound_once(monkeypatch: pytest.MonkeyPatch) -> None:
    source, asked = planned(0.0).best.fuel_bound.source, list[Voyage]()
    assert isinstance(source, Voyage)

    def bound(voyage: Voyage, *_: object) -> float:
        asked.append(voyage)
        time.sleep(0.05)  # s; the other threads ask meanwhile
        return 7.0

    monkeypatch.setattr("renew.bounds.fuel_bound.fuel_lower_bound", bound)
    shared = FuelBound(source)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: shared.value, range(4)))
    assert found == [7.0] * 4
    assert asked == [source]
