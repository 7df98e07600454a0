"""The bound beside an oracle that shares no code with it, and proofs that are broken on purpose.

The whole suite is `python -m tests.bench bounds`; here are the scenes in which the bound comes
nearest, and those in which narrow water decides.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import renew
from renew._types import BoolArray, FloatArray
from renew.bounds import fuel_lower_bound as bounds
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.bounds.travel_time import TravelGrid, wet_cells
from tests.bounded_scenes import SEEDS, bounded_scene, stored_fuels

NEAREST = (2, 267, 300, 220, 283, 365, 22, 342, 43, 326, 144, 146, 260, 341, 65, 102, 143, 245, 205)
"""Scenes in which the bound comes nearest to the oracle, within half a percent."""

NARROW = (232, 275, 307)
"""Scenes in which the best way leads through a gap that is narrower than a cell."""

FUELS = stored_fuels()


def test_every_scene_has_an_oracle() -> None:
    assert set(FUELS) == set(SEEDS)
    assert np.isfinite(list(FUELS.values())).all()


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [3, 22])
def test_the_stored_fuels_are_those_of_the_oracle(seed: int) -> None:
    assert bounded_scene(seed).oracle() == pytest.approx(FUELS[seed], rel=1e-6)


@pytest.mark.gate_share(8)
@pytest.mark.parametrize("seed", [*NEAREST, *NARROW])
def test_no_bound_is_above_the_oracle(seed: int) -> None:
    assert fuel_lower_bound(bounded_scene(seed).voyage) <= FUELS[seed]


def test_rates_that_are_a_percent_too_low_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    real = bounds._march

    def lowered(
        time: FloatArray, grid: TravelGrid, low: float, high: float
    ) -> tuple[FloatArray, float]:
        rates, proven = real(time, grid, low, high)
        return 0.99 * rates, proven / 0.99

    monkeypatch.setattr(bounds, "_march", lowered)
    caught = [fuel_lower_bound(bounded_scene(one).voyage) > FUELS[one] for one in NEAREST[:8]]
    assert sum(caught) > 4


def test_cells_dropped_that_a_route_may_cross_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def dropped(chart: renew.Chart, x: FloatArray, y: FloatArray) -> BoolArray:
        west, south = np.meshgrid(x[:-1], y[:-1])
        east, north = np.meshgrid(x[1:], y[1:])
        shore = shapely.intersects(chart.open_water.boundary, shapely.box(west, south, east, north))
        return np.asarray(wet_cells(chart, x, y) & ~shore)

    monkeypatch.setattr(bounds, "wet_cells", dropped)
    caught = [fuel_lower_bound(bounded_scene(one).voyage) > FUELS[one] for one in NARROW]
    assert all(caught)
