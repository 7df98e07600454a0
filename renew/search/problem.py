"""What a plan is made in, whatever its padding, and what follows from that; worked out once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.classes.h_signature import Rays
from renew.classes.overpowered_water import overpowering_water
from renew.classes.triangulation import Triangulation, triangulate
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentField, TabulatedCurrent
from renew.inputs.current_table import Table
from renew.inputs.fuel import Drift
from renew.inputs.vessel import Vessel
from renew.route import LeastFuel
from renew.turns.reach_bound import TurnReach


@dataclass(frozen=True, eq=False)
class Waters:
    """Chart, current, vessel and ends of a plan; islands under `distinct_by` m make no class."""

    chart: Chart
    current: CurrentField
    vessel: Vessel
    start: FloatArray
    goal: FloatArray
    drift: Drift
    distinct_by: float

    @cached_property
    def table(self) -> Table:
        """The current as a table: paths are sought in it."""
        return self.current.table(self.chart.bounds)

    @cached_property
    def quick_current(self) -> CurrentField:
        """The current by its table, where that is as good."""
        return TabulatedCurrent(self.table) if self.table.is_fine else self.current

    @cached_property
    def closed(self) -> BaseGeometry:
        """Water that outruns the vessel."""
        ends = self.start, self.goal
        return overpowering_water(self.table, self.vessel.speed, self.chart, ends)

    @cached_property
    def triangulation(self) -> Triangulation:
        """Triangles of the water that is not closed."""
        return triangulate(self.chart, closed=self.closed)

    @cached_property
    def rays(self) -> Rays:
        """Rays by which classes are told apart."""
        return Rays.of(self.chart, self.distinct_by, self.closed)

    @cached_property
    def reach(self) -> TurnReach:
        """How far hard-over turns can get."""
        return TurnReach.of(self.table, self.vessel)

    @cached_property
    def least(self) -> LeastFuel:
        """The fuel that no route can stay below."""
        return LeastFuel(self.chart, self.current, self.vessel, self.start, self.goal, self.drift)
