"""Voyages round Palawan in six fields of a global model, planned again every day.

The truth is linear between the fields, which lie five days apart; a forecast is the field of the
day on which it is issued, for ever. So its error grows with its lead, as that of persistence does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

import renew
from pipeline.model import Case
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.stages.measure import hat_weights, weighted
from renew._types import FloatArray
from tests.bench.palawan_figures import cases_of, fetched_data
from tests.under_way import Flow, Pace

FIELDS = (
    Path(__file__).parents[2].parent
    / "shared/data/currents/cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc"
)
"""Six days of January 2024, Copernicus GLO12; absent on a user's machine."""
VOYAGES = 10
"""Number of voyages."""

_DAY_S = 86_400.0
# The first departure, time between two of them (s), and how long a voyage may take (hours).
_FIRST, _EVERY_S, _HOURS = "2024-01-03T00:00:00Z", 1.8 * _DAY_S, 25 * 24
# A vessel slow enough for the currents to matter, m/s, and its turn rate, rad/s.
_CRAFT = renew.Vessel(1.5, turn_rate=np.radians(4.0))
_PACE = Pace(60.0, 50.0, 200.0, 1000.0, 300.0, _DAY_S, 16 * _DAY_S)


@dataclass(frozen=True)
class RealSea:
    """A voyage from a departure (s after the first) in real fields, there or back."""

    case: Case
    departure: float
    is_back: bool
    craft: renew.Vessel = _CRAFT
    pace: Pace = _PACE

    @property
    def chart(self) -> renew.Chart:
        """The chart."""
        return self.case.chart

    @cached_property
    def truth(self) -> renew.VaryingCurrent:
        """The true current, on a clock that begins at the departure."""
        current = self.case.current
        if not isinstance(current, renew.VaryingCurrent):
            raise TypeError("the fields change")
        return renew.VaryingCurrent(current.slice_times - self.departure, current.slices)

    @property
    def eddies(self) -> Flow:
        """The true current at points (..., 2) and times (...)."""

        def velocity(points: FloatArray, times: FloatArray) -> FloatArray:
            return self.truth.velocity(points, times)

        return velocity

    def forecast(self, issued: float) -> renew.CurrentField:
        """Return the field of a time (s)."""
        return weighted(self.truth, hat_weights(self.truth.slice_times, issued))

    def plan(self, current: renew.CurrentField) -> renew.Plan:
        """Plan the voyage at time 0."""
        ends = (self.case.start, self.case.goal)
        return renew.plan(
            self.chart,
            current,
            self.craft,
            *(ends[::-1] if self.is_back else ends),
            classes=2,
            clearance=1000.0,
            narrow_share=0.5,
            drift="crab",
        )


def seas() -> Iterator[RealSea]:
    """Yield the seas of the voyages; none where the fields are absent."""
    if not FIELDS.exists():
        return
    table = load_scenario("palawan-usv").model_dump(mode="json")
    table["seasons"] = [
        {
            "name": "january",
            "time_method": "changing",
            "departure": _FIRST,
            "max_hours": _HOURS,
            "currents": [[str(FIELDS)]],
        }
    ]
    scenario = Scenario.model_validate(table)
    (case,) = cases_of(scenario, fetched_data(scenario))
    for number in range(VOYAGES):
        yield RealSea(case, number * _EVERY_S / 2, bool(number % 2))
