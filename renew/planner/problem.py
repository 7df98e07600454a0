"""What the classes of a plan share, whatever their padding; each item is computed once."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.bounds.fuel_bound import FuelBound
from renew.classes.class_enumerator import ClassEnumerator, ViaEnumerator
from renew.classes.h_signature import VIA, Rays, Word, rays_that_matter
from renew.classes.triangulation import (
    Triangulation,
    overpowered_water,
    triangulate,
    triangulation_of,
)
from renew.errors import UnreachableError
from renew.inputs.options import PlanOptions
from renew.paths.corridor import SLACK
from renew.planner.hindrances import overpowered_error
from renew.turns.turn_reach import TurnReach
from renew.voyage.voyage import Voyage


@dataclass(frozen=True, eq=False)
class Problem:
    """A voyage, and which of its classes to search.

    Parts that depend on neither departure nor speeds are taken from the `first` problem, so that
    classes keep their names. Roadmaps are taken from `base`, a problem at another departure.
    Water `closed` is left out as overpowered water is; classes keep the names that they have in the
    `whole` problem without it.
    """

    voyage: Voyage
    options: PlanOptions
    first: "Problem | None" = None
    base: "Problem | None" = None
    closed: BaseGeometry | None = None
    whole: "Problem | None" = None

    @cached_property
    def overpowered_water(self) -> BaseGeometry:
        """Water where the current is as strong as the vessel."""
        return self.first.overpowered_water if self.first else overpowered_water(self.voyage)

    @cached_property
    def closed_water(self) -> BaseGeometry:
        """Water without triangles: overpowered, or closed."""
        if self.closed is None:
            return self.overpowered_water
        return shapely.union(
            self.overpowered_water, self.closed, grid_size=self.voyage.chart.precision
        )

    @cached_property
    def triangulation(self) -> Triangulation:
        """Triangles of the water that is neither overpowered nor closed."""
        if self.first:
            return self.first.triangulation
        chart, closed = self.voyage.chart, self.closed_water
        return triangulation_of(chart) if closed.is_empty else triangulate(chart, closed=closed)

    @cached_property
    def rays(self) -> Rays:
        """Rays that define the classes."""
        if self.first:
            return self.first.rays
        if self.whole:
            return replace(self.whole.rays, omits_islands=True)
        rays, options = self.all_rays, self.options
        if options.distinct_by != "auto":
            return rays.only(rays.size >= options.distinct_by)
        start, goal = self.voyage.start, self.voyage.goal
        # If padding shuts every channel, take the best one without padding.
        found = self.scout(self.likely_width).channels(1) or self.scout(0.0).channels(1)
        path = found[0].midline(start, goal) if found else np.stack([start, goal])
        return rays_that_matter(rays, path, options.classes)

    @cached_property
    def all_rays(self) -> Rays:
        """Rays of all islands."""
        if self.first:
            return self.first.all_rays
        return Rays.of(self.voyage.chart, self.closed_water)

    @cached_property
    def reach(self) -> TurnReach:
        """Upper bound on the reach of hard-over turns."""
        if self.first:
            return self.first.reach
        tables = [one.table for one in self.voyage.in_members]
        return TurnReach.of_all(tables, self.voyage.vessel)

    @cached_property
    def fuel_bound(self) -> FuelBound:
        """Lower bound on the fuel of any route."""
        return FuelBound(self.voyage)

    @property
    def likely_width(self) -> float:
        """Width (m) below which hardly any padding is."""
        return self.options.likely_width(self.voyage.vessel.turning_radius)

    def leaving(self, departure: float) -> "Problem":
        """Return the problem at another departure (s)."""
        return replace(self.with_voyage(self.voyage.leaving(departure)), base=self)

    def with_voyage(self, voyage: Voyage) -> "Problem":
        """Return the problem of another voyage in the same water."""
        return replace(self, voyage=voyage, first=self.first or self, base=None)

    def word(self, path: FloatArray) -> Word:
        """Return the word of a path's class."""
        word, *others = (self.rays.word(piece) for piece in self.voyage.cut(path))
        for other in others:
            word = (*word, VIA, *other)
        return word

    def enumerator(self, clearance: float) -> ClassEnumerator | ViaEnumerator:
        """Return the enumerator of classes, by paths that keep about `clearance` m off land."""
        return self.scout(clearance).by_rays(self.rays)

    def scout(self, clearance: float) -> ClassEnumerator | ViaEnumerator:
        """Return the enumerator of the classes that all islands distinguish."""
        if clearance not in self._scouts and self.base is not None:
            self._scouts[clearance] = self.base.scout(clearance).leaving(self.voyage)
        elif clearance not in self._scouts:
            voyage, via = self.voyage, len(self.voyage.via)
            parts = [voyage.part(at, voyage.departure) for at in range(via + 1)]
            scouts = tuple(self._scout(part, clearance) for part in parts)
            self._scouts[clearance] = ViaEnumerator(voyage, scouts) if via else scouts[0]
        return self._scouts[clearance]

    def _scout(self, voyage: Voyage, clearance: float) -> ClassEnumerator:
        """Return the enumerator of a voyage, or a part of it, without via points."""
        slack, rays = SLACK * voyage.vessel.turning_radius, self.all_rays
        order, water = self.options.order, self.triangulation
        try:
            return ClassEnumerator.of(voyage, water, rays, order, clearance=clearance + slack)
        except UnreachableError:
            if self.closed is None and not self.overpowered_water.is_empty:
                # Where land separates the two, this raises the same error.
                open_water = triangulation_of(voyage.chart)
                ways = ClassEnumerator.of(voyage, open_water, rays, "length").channels(1)
                for way in ways:
                    raise overpowered_error(way, voyage) from None
            raise

    @cached_property
    def _scouts(self) -> dict[float, ClassEnumerator | ViaEnumerator]:
        """Enumerators by clearance; each has its own roadmap."""
        return {}
