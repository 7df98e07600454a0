"""How early and late a vessel may be: turns are safe then, too."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import box

import renew
from renew.voyage.voyage import early_and_late
from tests.strategies import PAPER_VESSEL


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
