"""Grow padding until it is enough for a path's own triangles and for its hard-over turns.

The padding of a class is first set for its channel. A path that bulges out of the channel, or a
turn in a perturbed current, may need more. The edges concerned then get more, and the class is
planned again.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, TypeVar

from renew._types import FloatArray, IntArray
from renew.errors import InfeasibleError
from renew.inputs.options import PlanOptions
from renew.kernels.traversal import visits
from renew.paths.corridor import Corridor
from renew.planner.problem import Problem
from renew.turns.padding_model import PaddingModel
from renew.turns.passage_windows import passage_windows
from renew.turns.verification import colliding_edges, risky_edges

_Shortfall: TypeAlias = tuple[IntArray, FloatArray]
"""Constrained edges, and the amount by which the padding of each is too small (m)."""

Shortfalls: TypeAlias = tuple[_Shortfall | None, ...]
"""Shortfall of padding on each part of the voyage, between stops; None if there is none."""


class _HasCorridor(Protocol):
    """A path with its corridor."""

    @property
    def corridor(self) -> Corridor:
        """Its corridor."""
        ...


_Path = TypeVar("_Path", bound=_HasCorridor)


def grown_until_clear(
    found: _Path,
    shortfall: Callable[[_Path], Shortfalls | None],
    plan_again: Callable[[Corridor, _Path], _Path],
    most: int,
    turns: str = "hard-over turns",
) -> _Path:
    """Grow a path's padding until it is enough; `plan_again` plans near the last path.

    Raises InfeasibleError if padding is still too small after `most` rounds.
    """
    for rounds_left in reversed(range(most)):
        short = shortfall(found)
        if short is None:
            return found
        if rounds_left:
            found = plan_again(grown(found.corridor, short), found)
    raise InfeasibleError(
        f"its path is still not clear of {turns} in the last of {most} rounds of growing padding"
    )


def grown(corridor: Corridor, shortfall: Shortfalls) -> Corridor:
    """Return the corridor with its padding increased by the shortfall."""
    both = zip(corridor.paddings, shortfall, strict=True)
    return corridor.with_padding(
        [padded.grown(*short) if short else padded for padded, short in both]
    )


@dataclass(frozen=True)
class PaddingGrowth:
    """Finds how much adaptive padding a path lacks in its corridor."""

    problem: Problem
    model: PaddingModel
    options: PlanOptions

    def shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfalls | None:
        """Return a path's shortfall of padding in the triangles that it crosses, else for turns."""
        if not self.options.is_adaptive:
            return None
        return self.crossed_shortfall(corridor, path) or _any(
            self._turns_shortfall(*part) for part in corridor.parts(path)
        )

    def collisions(
        self, corridor: Corridor, path: FloatArray, speeds: FloatArray
    ) -> Shortfalls | None:
        """Return the shortfall for turns along a path (n, 2) sailed at speeds (n - 1,), m/s."""
        if not self.options.is_adaptive:
            return None
        own_speeds = corridor.voyage.cut_speeds(path, speeds)
        return _any(
            colliding_edges(piece, part.voyage, part.padded, self.problem.reach, own)
            for (part, piece), own in zip(corridor.parts(path), own_speeds, strict=True)
        )

    def fitted(self, corridor: Corridor, path: FloatArray) -> Corridor:
        """Return the corridor with more padding where a path (n, 2) bulges out of its channel."""
        short = self.crossed_shortfall(corridor, path)
        return corridor if short is None else grown(corridor, short)

    def crossed_shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfalls | None:
        """Return the shortfall where a path bulges out of the channel for which padding was set."""
        if not self.options.is_adaptive:
            return None
        return _any(self._bulge_shortfall(*part) for part in corridor.parts(path))

    def _bulge_shortfall(self, corridor: Corridor, path: FloatArray) -> _Shortfall | None:
        """Return the shortfall where a path (n, 2) between two stops bulges out."""
        inside = visits(path, corridor.corners)
        crossed = inside._replace(triangle=corridor.triangles[inside.triangle])
        windows = passage_windows(corridor.voyage, path, inside.enter, inside.leave)
        return self.model.shortfall(crossed, windows, corridor.channel, corridor.padded)

    def _turns_shortfall(self, corridor: Corridor, path: FloatArray) -> _Shortfall | None:
        """Return the shortfall for turns along a path (n, 2) between two stops."""
        voyage, padded = corridor.voyage, corridor.padded
        short = colliding_edges(path, voyage, padded, self.problem.reach)
        if short or self.options.risk_at == "route":
            return short
        return risky_edges(
            path, voyage, padded, corridor.corners, self.model.sampler, self.options.risk
        )


def _any(short: Iterable[_Shortfall | None]) -> Shortfalls | None:
    """Return the shortfalls of all parts, or None if no part has one."""
    found = tuple(short)
    return found if any(one is not None for one in found) else None
