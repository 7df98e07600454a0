"""The voyage: which current the search uses, and fuel by its drift model."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import box

import renew
from renew.inputs.current import TabulatedCurrent
from tests.strategies import PAPER_VESSEL, voyage_on

CHART = renew.Chart(box(0, 0, 100, 100))


def test_a_smooth_current_is_replaced_by_its_table_and_a_step_is_not() -> None:
    class Step(renew.CurrentField):
        def __call__(self, points: np.ndarray) -> np.ndarray:
            return np.where(points[..., :1] < 31, [0.5, 0.0], [-0.5, 0.0])

    smooth = voyage_on(CHART, current=renew.GyreCurrent(0.8, 100, 100))
    assert isinstance(smooth.waters.quick_current, TabulatedCurrent)
    rough = voyage_on(CHART, current=Step())
    assert rough.waters.quick_current is rough.current


def test_fuel_is_that_of_the_chosen_drift_model() -> None:
    current = renew.UniformCurrent(0.0, 0.6)
    path = np.array([[10.0, 50.0], [90.0, 50.0]])
    assert voyage_on(CHART, current=current).fuel(path) == pytest.approx(80)
    crab = voyage_on(CHART, current=current, drift="crab")
    assert crab.fuel(path) == pytest.approx(100)
    assert crab.polar[:2] == (PAPER_VESSEL.speed, True)
