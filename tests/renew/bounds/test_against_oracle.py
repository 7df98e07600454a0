"""The bound beside an oracle that shares no code with it, and proofs that are broken on purpose.

The whole suite is `python -m tests.bench bounds`. Here are the scenes in which the bound comes
nearest to the fuel, and those in which narrow water decides.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import renew
from renew._types import BoolArray, FloatArray
from renew.bounds import fuel_lower_bound as bound, grids
from renew.bounds.fuel_lower_bound import Front, drop, fuel_lower_bound
from renew.bounds.grids import wet_cells
from renew.bounds.march import march
from renew.bounds.travel_time import TravelGrid
from tests.bounded_scenes import SEEDS, bounded_scene, stored_fuels

NEAREST = (2, 267, 300, 220, 283, 365, 22, 342, 43, 326, 144, 146, 260, 341, 65, 102, 143, 245, 205)
"""Scenes in which the bound comes nearest to the oracle, within half a percent."""

NARROW = (232, 275, 307)
"""Scenes in which the best way leads through a gap that is narrower than a cell."""

SOONER = 0.97
"""Share of U from which on cells are dropped in a proof that is broken on purpose."""

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
    def lowered(
        time: FloatArray, grid: TravelGrid, counts: BoolArray, low: float, top: float
    ) -> tuple[FloatArray, FloatArray]:
        rates, reached = march(time, grid, counts, low, top)
        return 0.99 * rates, reached / 0.99

    monkeypatch.setattr(bound, "march", lowered)
    assert sum(is_above(one) for one in NEAREST[:8]) > 4


def test_land_that_a_route_may_cross_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def dropped(
        chart: renew.Chart, x: FloatArray, y: FloatArray, among: BoolArray | None = None
    ) -> BoolArray:
        west, south = np.meshgrid(x[:-1], y[:-1])
        east, north = np.meshgrid(x[1:], y[1:])
        shore = shapely.intersects(chart.open_water.boundary, shapely.box(west, south, east, north))
        return np.asarray(wet_cells(chart, x, y, among) & ~shore)

    monkeypatch.setattr(grids, "wet_cells", dropped)
    assert all(is_above(one) for one in NARROW)


def test_cells_dropped_that_a_better_route_may_cross_are_caught(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def dropped(counts: BoolArray, there: Front, back: Front, most: float) -> None:
        drop(counts, there, back, SOONER * most)

    monkeypatch.setattr(bound, "drop", dropped)
    assert sum(is_above(one) for one in NEAREST[:8]) > 4


def is_above(seed: int) -> bool:
    """Whether a scene's bound is above the oracle's fuel, and so false."""
    return fuel_lower_bound(bounded_scene(seed).voyage) > FUELS[seed]
