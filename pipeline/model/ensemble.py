"""Members of a season's current, and how its routes do in each of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

import renew
from pipeline._types import FloatArray
from renew.errors import Text
from renew.planner.ensemble.statistics import FEWEST, Statistic, statistic


@dataclass(frozen=True, slots=True, eq=False)
class MemberGrid:
    """A member of a current on its source's grid: `u`, `v` (nt, ny, nx), m/s to east and north.

    `weight` is how likely it is; the sum over all members is 1.
    """

    name: str
    u: FloatArray
    v: FloatArray
    weight: float


@dataclass(frozen=True, slots=True, eq=False)
class MemberCurrents:
    """The members of a season's current in the plane; `weights` (m,) is None if all are alike."""

    names: tuple[str, ...]
    currents: tuple[renew.CurrentField, ...]
    weights: FloatArray | None
    choose: Statistic


@dataclass(frozen=True, slots=True, eq=False)
class EnsembleFigures:
    """How a season's routes, by rank, do in the members of its current.

    Attributes
    ----------
    names, weights : (m,) the members, and how likely each is; the weights' sum is 1.
    fuels : (k, m) planner's units, of each route in each member; inf where it can't be sailed.
    best_in : (m,) rank of the route that is best in each member; 0 where none can be sailed.
    choose : the statistic by which the side was chosen.
    close : ranks of the routes that are not surely dearer, the first one's among them.
    shut : rank, member and reason of routes that can't be sailed in a member.
    bounds : of each statistic, the least that it can be for any one route.
    waiting_saves : mean fuel that is saved if the member is known before the side is chosen.
    """

    names: tuple[str, ...]
    weights: FloatArray
    fuels: FloatArray
    best_in: tuple[int, ...]
    choose: Statistic
    close: tuple[int, ...]
    shut: tuple[tuple[int, str, str], ...]
    bounds: Mapping[Statistic, float]
    waiting_saves: float

    @classmethod
    def of(cls, found: renew.EnsemblePlan, spelled: Callable[[Text], str]) -> "EnsembleFigures":
        """Return the figures of a plan, its reasons `spelled`; bounds take 0.5 s a member."""
        order = [found.plan.chosen]
        order += [at for at in range(len(found.routes)) if at != found.plan.chosen]
        rank = {at: number for number, at in enumerate(order, start=1)}
        by_name = {found.routes[at].homotopy: number for at, number in rank.items()}
        return cls(
            names=found.members.names,
            weights=found.members.weights,
            fuels=found.fuels[order],
            best_in=tuple(rank.get(at, 0) for at in found.best_in),
            choose=found.choose,
            close=tuple(sorted(rank[at] for at in found.close)),
            shut=tuple(
                (by_name[one.homotopy], one.member, spelled(one.cause.text)) for one in found.shut
            ),
            bounds={name: found.bound.of(name) for name in ("mean", "p90", "cvar90")},
            waiting_saves=found.waiting_saves,
        )

    @property
    def is_sure(self) -> bool:
        """Whether all other routes are surely dearer."""
        return self.close == (1,)

    @property
    def has_quantiles(self) -> bool:
        """Whether there are members enough for P90 and CVaR."""
        return len(self.names) >= FEWEST

    def share(self, rank: int) -> float:
        """Share of the members, by weight, in which a route is the best."""
        return float(self.weights[np.array(self.best_in) == rank].sum())

    def statistic(self, name: Statistic, rank: int) -> float:
        """Return a statistic of a route's fuel over the members, planner's units."""
        return float(statistic(name, self.fuels, self.weights)[rank - 1])

    def gap(self, name: Statistic) -> float:
        """Share by which the first route's statistic is above that of any one route, at most."""
        return max(0.0, self.statistic(name, 1) / self.bounds[name] - 1)
