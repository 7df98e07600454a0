"""Padding that grows until a path's own triangles, and its hard-over turns, need no more.

The padding of a class is first set for its channel. A path that bulges out of it, or a turn in a
perturbed current, may need more: the edges concerned grow, and the class is planned again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

from renew._types import FloatArray, IntArray
from renew.kernels.traversal import visits
from renew.padding.padding_model import PaddingModel
from renew.padding.passage_windows import passage_windows
from renew.padding.policy import PaddingPolicy
from renew.paths.corridor import Corridor
from renew.search.problem import Problem
from renew.turns.point_risk import risky_edges
from renew.turns.verification import colliding_edges

Shortfall: TypeAlias = tuple[IntArray, FloatArray]
"""Constrained edges, and by how much their padding is too small (m)."""


@dataclass(frozen=True)
class PaddingGrowth:
    """Finds what the padding of a corridor lacks for a path, where padding is adaptive."""

    problem: Problem
    model: PaddingModel
    policy: PaddingPolicy

    def shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfall | None:
        """What padding lacks for the triangles that a path (n, 2) crosses, else for its turns."""
        if not self.policy.is_adaptive:
            return None
        voyage = self.problem.voyage
        short = self.crossed_shortfall(corridor, path) or self.collisions(corridor, path)
        if short or self.policy.risk_at == "route":
            return short
        sampler, risk = self.model.sampler, self.policy.risk
        return risky_edges(path, voyage, corridor.padded, corridor.corners, sampler, risk)

    def collisions(
        self, corridor: Corridor, path: FloatArray, speeds: FloatArray | None = None
    ) -> Shortfall | None:
        """What padding lacks for turns along a path (n, 2), sailed at speeds (n - 1,) if given."""
        if not self.policy.is_adaptive:
            return None
        voyage, reach = self.problem.voyage, self.problem.reach
        return colliding_edges(path, voyage, corridor.padded, reach, speeds)

    def crossed_shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfall | None:
        """What padding lacks where a path bulges out of the channel for which it was set."""
        if not self.policy.is_adaptive:
            return None
        inside = visits(path, corridor.corners)
        crossed = inside._replace(triangle=corridor.triangles[inside.triangle])
        windows = passage_windows(self.problem.voyage, path, inside.enter, inside.leave)
        return self.model.shortfall(crossed, windows, corridor.channel, corridor.padded)


def grown(corridor: Corridor, shortfall: Shortfall) -> Corridor:
    """Corridor with the padding larger by what it lacks."""
    return replace(corridor, padded=corridor.padded.grown(*shortfall))
