"""What all classes of a plan share, whatever their padding; each part is computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from shapely.geometry.base import BaseGeometry

from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.h_signature import Rays
from renew.classes.overpowered_water import overpowered_water
from renew.classes.triangulation import Triangulation, triangulate
from renew.inputs.arguments import Order
from renew.inputs.voyage import Voyage
from renew.paths.corridor import SLACK
from renew.route import FuelBound
from renew.turns.reach_bound import TurnReach


@dataclass(frozen=True, eq=False)
class Problem:
    """A voyage; classes that differ only by islands under `distinct_by` m count as one."""

    voyage: Voyage
    distinct_by: float
    order: Order

    @cached_property
    def overpowered_water(self) -> BaseGeometry:
        """Water where the current is as strong as the vessel."""
        return overpowered_water(self.voyage)

    @cached_property
    def triangulation(self) -> Triangulation:
        """Triangles of the water that is not overpowered."""
        return triangulate(self.voyage.chart, closed=self.overpowered_water)

    @cached_property
    def rays(self) -> Rays:
        """Rays by which classes are told apart."""
        return Rays.of(self.voyage.chart, self.distinct_by, self.overpowered_water)

    @cached_property
    def reach(self) -> TurnReach:
        """How far hard-over turns can get."""
        return TurnReach.of(self.voyage.table, self.voyage.vessel)

    @cached_property
    def fuel_bound(self) -> FuelBound:
        """The fuel that no route can stay below."""
        return FuelBound(self.voyage)

    def enumerator(self, clearance: float) -> ClassEnumerator:
        """Enumerate classes by paths that keep about `clearance` m off land."""
        slack = SLACK * self.voyage.vessel.turning_radius
        return ClassEnumerator(
            self.voyage, self.triangulation, self.rays, self.order, clearance=clearance + slack
        )
