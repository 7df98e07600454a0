"""A lower bound on statistics of the fuel of any one route over the members of an ensemble.

For steady members with fields cₘ, weights qₘ and any one path, Σ qₘ Fₘ >= F in the field Σ qₘ cₘ:
the speed over ground along a course is concave in the current, and 1/g is convex and falls. So the
bound in the mean current holds for the mean fuel. CVaR is the largest mean over a set of weights:
whichever of them are taken, the bound in their mean current holds. Frank and Wolfe's rounds
(1956) look for good ones, each towards the worst members of the best known path. For members that
change the clocks differ, and the theorem fails.

For all members a second bound is the same statistic of their own bounds: a statistic never falls
when a fuel rises. The larger one counts. Proofs: `docs/explanation/lower-bound.md`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from renew._types import FloatArray
from renew.bounds.fuel_bound import FuelBound
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.inputs.members import Members
from renew.vary.statistics import TAIL, Statistic, statistic, worst_weights
from renew.voyage.voyage import Voyage, Waters

# Rounds in which weights are moved towards the worst members.
_ROUNDS = 3


@dataclass(frozen=True, repr=False, eq=False)
class EnsembleBound:
    """What any one route needs at least, as a statistic over the members; found when asked for.

    `voyage` is in the mean of the members, whose bound on fuel is `in_mean`; `paths` (n, 2), m, are
    known ones.
    """

    voyage: Voyage
    members: Members
    paths: Sequence[FloatArray]
    in_mean: FuelBound
    _known: dict[str, FloatArray] = field(default_factory=dict, init=False)

    @property
    def of_members(self) -> FloatArray:
        """The bound on the fuel of any route in each member (m,)."""
        if "members" not in self._known:
            self._known["members"] = self._each()
        return self._known["members"]

    def of(self, name: Statistic, tail: float = TAIL) -> float:
        """Return the bound on a statistic of the fuel of any one route (fuel units).

        Regret has none: a route may be the best in every member. CVaR is the mean of the worst
        members, a share `tail` of them by weight.
        """
        key = f"{name} {tail}"
        if key not in self._known:
            self._known[key] = np.array(self._found(name, tail))
        return float(self._known[key])

    def _found(self, name: Statistic, tail: float) -> float:
        """Return the larger of the two bounds."""
        if name == "regret":
            return 0.0
        own = float(statistic(name, self.of_members[None], self.members.weights, tail)[0])
        if not self.members.are_steady or name == "p90":
            return own
        return max(own, self.in_mean.value, self._dual(tail) if name == "cvar90" else 0.0)

    def _dual(self, tail: float) -> float:
        """Return the largest bound in a mean current by weights that CVaR may take."""
        weights, best = self.members.weights, 0.0
        fuels = np.array([self._fuels(path) for path in self.paths])
        for at in range(_ROUNDS):
            # Which members are the worst hardly depends on which path that is good here it is.
            here = self._in_mean(weights)
            nearest = int(np.argmin([here.fuel(path) for path in self.paths]))
            step = 2 / (at + 2)
            worst = worst_weights(fuels[nearest], self.members.weights, tail)
            weights = (1 - step) * weights + step * worst
            best = max(best, fuel_lower_bound(self._in_mean(weights)))
        return best

    def _each(self) -> FloatArray:
        """Return the bound in each member (m,); members that share a field share it."""
        return self._by_member(fuel_lower_bound)

    def _fuels(self, path: FloatArray) -> FloatArray:
        """Return the fuel (m,) along a path (n, 2), m, in each member; inf where no way is made."""
        return self._by_member(lambda voyage: voyage.fuel(path))

    def _by_member(self, figure: Callable[[Voyage], float]) -> FloatArray:
        """Return a figure (m,) of the voyage in each member, found once for each field."""
        found = {id(one.current): figure(one) for one in self.voyages}
        return np.array([found[id(one)] for one in self.members.fields])

    @cached_property
    def voyages(self) -> tuple[Voyage, ...]:
        """The voyage in each distinct member."""
        return self.voyage.in_members[1:] or (self.voyage,)

    def _in_mean(self, weights: FloatArray) -> Voyage:
        """Return the voyage in the mean of the members by weights (m,)."""
        return replace(self.voyage, waters=Waters(self.voyage.chart, self.members.mean(weights)))
