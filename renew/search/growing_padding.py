"""Padding that grows until a path's own triangles, and its hard-over turns, need no more.

The padding of a class is first set for its channel. A path that bulges out of it, or a turn in a
perturbed current, may need more: the edges concerned grow, and the class is planned again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
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

_Shortfall: TypeAlias = tuple[IntArray, FloatArray]
"""Constrained edges, and by how much their padding is too small (m)."""

Shortfalls: TypeAlias = tuple[_Shortfall | None, ...]
"""What padding lacks on the way to each via point, and to the goal; None where it is enough."""


@dataclass(frozen=True)
class PaddingGrowth:
    """Finds what the padding of a corridor lacks for a path, where padding is adaptive."""

    problem: Problem
    model: PaddingModel
    policy: PaddingPolicy

    def shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfalls | None:
        """What padding lacks for the triangles that a path (n, 2) crosses, else for its turns."""
        if not self.policy.is_adaptive:
            return None
        return self.crossed_shortfall(corridor, path) or _any(
            self._turns_shortfall(*stage) for stage in corridor.stages(path)
        )

    def collisions(
        self, corridor: Corridor, path: FloatArray, speeds: FloatArray
    ) -> Shortfalls | None:
        """What padding lacks for turns along a path (n, 2) sailed at speeds (n - 1,), m/s."""
        if not self.policy.is_adaptive:
            return None
        own_speeds = corridor.voyage.cut_speeds(path, speeds)
        return _any(
            colliding_edges(piece, stage.voyage, stage.padded, self.problem.reach, own)
            for (stage, piece), own in zip(corridor.stages(path), own_speeds, strict=True)
        )

    def crossed_shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfalls | None:
        """What padding lacks where a path bulges out of the channel for which it was set."""
        if not self.policy.is_adaptive:
            return None
        return _any(self._bulge_shortfall(*stage) for stage in corridor.stages(path))

    def _bulge_shortfall(self, corridor: Corridor, path: FloatArray) -> _Shortfall | None:
        """The same between two via points."""
        inside = visits(path, corridor.corners)
        crossed = inside._replace(triangle=corridor.triangles[inside.triangle])
        windows = passage_windows(corridor.voyage, path, inside.enter, inside.leave)
        return self.model.shortfall(crossed, windows, corridor.channel, corridor.padded)

    def _turns_shortfall(self, corridor: Corridor, path: FloatArray) -> _Shortfall | None:
        """What padding lacks for turns along a path (n, 2) between two via points."""
        voyage, padded = corridor.voyage, corridor.padded
        short = colliding_edges(path, voyage, padded, self.problem.reach)
        if short or self.policy.risk_at == "route":
            return short
        sampler, risk = self.model.sampler, self.policy.risk
        return risky_edges(path, voyage, padded, corridor.corners, sampler, risk)


def _any(short: Iterable[_Shortfall | None]) -> Shortfalls | None:
    """The shortfalls of all stages; None where none has any."""
    found = tuple(short)
    return found if any(one is not None for one in found) else None


def grown(corridor: Corridor, shortfall: Shortfalls) -> Corridor:
    """Corridor with the padding larger by what it lacks."""
    both = zip(corridor.paddings, shortfall, strict=True)
    return corridor.with_padding(
        [padded.grown(*short) if short else padded for padded, short in both]
    )
