"""What every step of a plan is given: chart, current, vessel, start and goal, in one object."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from renew._types import FloatArray
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentField, TabulatedCurrent
from renew.inputs.current_table import Table
from renew.inputs.fuel import Drift, passage_times
from renew.inputs.vessel import Vessel
from renew.kernels.ground_speed import Polar


@dataclass(frozen=True, eq=False)
class Voyage:
    """A passage from `start` to `goal` (2,), m, by a drift model of Eq. 4."""

    chart: Chart
    current: CurrentField
    vessel: Vessel
    start: FloatArray
    goal: FloatArray
    drift: Drift

    @cached_property
    def table(self) -> Table:
        """The current as a table: the search for paths looks it up there."""
        return self.current.table(self.chart.bounds)

    @cached_property
    def quick_current(self) -> CurrentField:
        """The current by its table, where that reproduces it, else the current itself."""
        return TabulatedCurrent(self.table) if self.table.is_fine else self.current

    @property
    def polar(self) -> Polar:
        """Speed and drift model, for kernels."""
        return Polar(self.vessel.speed, self.drift == "crab")

    def fuel(self, path: FloatArray) -> float:
        """Fuel by Eq. 4 along a path (n, 2); inf where no way can be made."""
        times = passage_times(path, self.current, self.vessel, drift=self.drift)
        return float(self.vessel.fuel_rate * times.sum())
