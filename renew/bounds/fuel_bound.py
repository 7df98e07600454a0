"""The bounds on fuel that the routes of a plan share, computed when first asked for."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock

from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.voyage.voyage import Voyage

# Number of cells of the finest grid if a gap is asked for: four times the standard number.
_FINE_CELLS = 512_000
_NAMES = ("value", "at_clearance")


@dataclass(frozen=True, repr=False, eq=False)
class FuelBound:
    """The fuel that every route of a voyage needs at least, whatever its class.

    It is computed from the voyage when first asked for, unless a number is given; each bound is
    computed once, also where two threads ask. `kept` is the bound on routes that keep the plan's
    clearance, or a function that gives their voyage. If `enough` (fuel units) is finite, the grid
    may be refined further, until the bound is above it.
    """

    source: Voyage | float
    kept: Callable[[], Voyage] | float
    enough: float = math.inf
    _known: dict[str, float] = field(default_factory=dict, init=False)
    _locks: dict[str, Lock] = field(default_factory=lambda: {n: Lock() for n in _NAMES}, init=False)

    @property
    def value(self) -> float:
        """The bound on any route (fuel units); see :mod:`renew.bounds.fuel_lower_bound`."""
        return self._once("value", self._value)

    @property
    def at_clearance(self) -> float:
        """The bound (fuel units) on any route that keeps the plan's clearance and least padding.

        See :mod:`renew.turns.least_padding`.
        """
        return self._once("at_clearance", self._at_clearance)

    def _once(self, name: str, bound: Callable[[], float]) -> float:
        """Return a bound, computed at the first call.

        A `cached_property` has one lock for all instances before Python 3.12: threads that plan
        several voyages would wait for each other's bounds.
        """
        with self._locks[name]:
            if name not in self._known:
                self._known[name] = bound()
        return self._known[name]

    def _value(self) -> float:
        return self._bound(self.source) if isinstance(self.source, Voyage) else self.source

    def _at_clearance(self) -> float:
        if not callable(self.kept):
            return self.kept
        if self.enough < math.inf and self.value > self.enough:
            return self.value
        voyage = self.kept()
        return self.value if voyage is self.source else self._bound(voyage)

    def _bound(self, voyage: Voyage) -> float:
        """Return the bound of a voyage, on the standard grid or until it is enough."""
        # With chosen speeds the bound is loose on any grid.
        is_fine = self.enough < math.inf and not voyage.has_price
        return fuel_lower_bound(voyage, _FINE_CELLS if is_fine else 0, self.enough)

    def __reduce__(self) -> "tuple[type[FuelBound], tuple[float, float]]":
        """Pickle the bounds instead of their sources: a current may be any function."""
        return FuelBound, (self.value, self.at_clearance)

    def gap(self, fuel: float) -> float:
        """Share by which fuel exceeds the bound on any route, >= 0."""
        return _gap(fuel, self.value)

    def gap_at_clearance(self, fuel: float) -> float:
        """Share by which fuel exceeds the bound on routes that keep the plan's clearance, >= 0."""
        # The bound on any route holds here too, and may be the tighter one.
        return _gap(fuel, max(self.value, self.at_clearance))


def _gap(fuel: float, bound: float) -> float:
    """Share by which fuel exceeds a bound on it, >= 0."""
    return max(0.0, fuel / bound - 1) if bound > 0 else math.inf
