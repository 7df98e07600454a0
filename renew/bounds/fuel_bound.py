"""The bound on fuel that the routes of a plan share, computed when first asked for."""

import math
from dataclasses import dataclass, field
from threading import Lock

from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.voyage.voyage import Voyage

# Number of cells of the finest grid if a gap is asked for: four times the standard number.
_FINE_CELLS = 512_000


@dataclass(frozen=True, repr=False, eq=False)
class FuelBound:
    """The fuel that every route of a voyage needs at least, whatever its class.

    It is computed from the voyage when first asked for, unless a number is given; once, also where
    two threads ask. If `enough` (fuel units) is finite, the grid may be refined further, until the
    bound is above it.
    """

    source: Voyage | float
    enough: float = math.inf
    _known: list[float] = field(default_factory=list, init=False)
    # A `cached_property` has one lock for all instances before Python 3.12: threads that plan
    # several voyages would wait for each other's bounds.
    _lock: Lock = field(default_factory=Lock, init=False)

    @property
    def value(self) -> float:
        """The bound on any route (fuel units); see :mod:`renew.bounds.fuel_lower_bound`."""
        if not isinstance(self.source, Voyage):
            return self.source
        with self._lock:
            if not self._known:
                # With chosen speeds the bound is loose on any grid.
                is_fine = self.enough < math.inf and not self.source.has_price
                cells = _FINE_CELLS if is_fine else 0
                self._known.append(fuel_lower_bound(self.source, cells, self.enough))
            return self._known[0]

    def __reduce__(self) -> "tuple[type[FuelBound], tuple[float]]":
        """Pickle the bound instead of its source: a current may be any function."""
        return FuelBound, (self.value,)

    def gap(self, fuel: float) -> float:
        """Share by which fuel exceeds the bound on any route, >= 0."""
        return max(0.0, fuel / self.value - 1) if self.value > 0 else math.inf
