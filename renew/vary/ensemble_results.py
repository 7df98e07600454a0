"""What a plan in an ensemble consists of: a route a class, and its fuel in every member."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from renew._types import FloatArray
from renew.errors import InfeasibleError
from renew.inputs.members import Members
from renew.results import Plan, Route
from renew.vary.ensemble_bound import EnsembleBound
from renew.vary.statistics import STATISTICS, Statistic, statistic


class ShutInMember(NamedTuple):
    """A class that can't be sailed in a member: its name, the member's, and the reason."""

    homotopy: str
    member: str
    cause: InfeasibleError


@dataclass(frozen=True, repr=False, eq=False)
class EnsemblePlan:
    """A route a class, planned in the mean current, and how it does in every member.

    Attributes
    ----------
    plan : the plan in the mean current; its best route is the one to take in the ensemble.
    members : names, weights (m,) whose sum is 1, and fields.
    fuels : (k, m) fuel units, of each route in each member; inf where it can't be sailed.
    choose : the statistic by which the class was chosen.
    close : indices of the routes that are not surely dearer, with the best one.
    shut : classes that can't be sailed in a member, with the member's name and the reason.
    bound : lower bounds on the statistics of any one route, found when first asked for.
    """

    plan: Plan
    members: Members
    fuels: FloatArray
    choose: Statistic
    close: tuple[int, ...]
    shut: tuple[ShutInMember, ...]
    bound: EnsembleBound

    @property
    def routes(self) -> tuple[Route, ...]:
        """One route a class, least fuel in the mean current first."""
        return self.plan.routes

    @property
    def best(self) -> Route:
        """The route to take: of least mean, unless another is surely better by `choose`."""
        return self.plan.best

    @property
    def is_sure(self) -> bool:
        """Whether all other classes are surely dearer; if not, it is too close to call."""
        return self.close == (self.plan.chosen,)

    @cached_property
    def best_in(self) -> tuple[int, ...]:
        """Index of the route that is best in each member (m,); -1 where none can be sailed."""
        least = self.fuels.argmin(axis=0)
        return tuple(np.where(np.isfinite(self.fuels.min(axis=0)), least, -1).tolist())

    @property
    def shares(self) -> FloatArray:
        """Share (k,) of the members, by weight, in which each route is the best one."""
        found = np.zeros(len(self.routes))
        for at, weight in zip(self.best_in, self.members.weights.tolist(), strict=True):
            if at >= 0:
                found[at] += weight
        return found

    @cached_property
    def statistics(self) -> dict[Statistic, FloatArray]:
        """Mean, P90, CVaR and largest regret (k,) of each route's fuel, fuel units."""
        weights = self.members.weights
        return {name: statistic(name, self.fuels, weights) for name in STATISTICS}

    @property
    def waiting_saves(self) -> float:
        """Mean fuel that is saved if the member is known before the class is chosen."""
        chosen = float(self.statistics["mean"][self.plan.chosen])
        return chosen - float(self.fuels.min(axis=0) @ self.members.weights)

    def gap(self, name: Statistic) -> float:
        """Share by which a statistic of the best route is above its bound; inf without a bound."""
        bound, found = self.bound.of(name), float(self.statistics[name][self.plan.chosen])
        return max(0.0, found / bound - 1) if bound > 0 else float("inf")
