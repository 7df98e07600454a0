"""Every way in which a plan can be refused.

A message names the value, the limit it broke and what to change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from renew._types import FloatArray

Spelling: TypeAlias = Callable[[FloatArray], str]
"""Spells a place (2,), m, for a message: in metres, or as whoever knows more would give it."""


def in_metres(place: FloatArray) -> str:
    """Spell a place in planar metres, to the millimetre."""
    x, y = (round(float(metres), 3) for metres in place)
    return f"({x:.10g}, {y:.10g}) m"


class PlanningError(Exception):
    """A plan that cannot be made; the base of all errors that `renew` raises on purpose.

    Parameters
    ----------
    message
        The text. Where places are given it is a template for `str.format`: {0} is the first.
    places
        Points (2,), m, that the message names. `str(error)` gives them in planar metres.
    """

    def __init__(self, message: str, *places: FloatArray) -> None:
        self.message, self.places = message, places
        super().__init__(self.located(in_metres))

    def located(self, spell: Spelling) -> str:
        """Text of the message with its places spelled in another way, such as in lon/lat."""
        return self.message.format(*map(spell, self.places)) if self.places else self.message

    def __reduce__(self) -> tuple[type[PlanningError], tuple[str | FloatArray, ...]]:
        """Survive the way back from a worker process."""
        return type(self), (self.message, *self.places)


class ParameterError(PlanningError, ValueError):
    """An argument outside its range: unknown method, risk not in (0, 1), k < 1."""


class GeometryError(PlanningError, ValueError):
    """A chart whose polygons are not valid, not finite, or leave no water."""


class StartInNoGoError(PlanningError):
    """The start lies on land or outside the chart."""


class GoalInNoGoError(PlanningError):
    """The goal lies on land or outside the chart."""


class ViaInNoGoError(PlanningError):
    """A via point lies on land or outside the chart."""


class ArrivalError(PlanningError):
    """No voyage begun when asked arrives in time."""


class CurrentTooStrongError(PlanningError):
    """The current is as strong as the vessel where it has to be."""


@dataclass(frozen=True, eq=False)
class Strait:
    """Where a class is blocked: its padding takes a whole gap.

    Attributes
    ----------
    gap : (2, 2) metres, from the left to the right bank.
    triangle : the triangle that holds it, by its number in the triangulation; `before` and `after`
        are the ones that the channel comes from and leads to, -1 at its ends.
    padding_left, padding_right : what the two banks need, m.
    """

    gap: FloatArray
    before: int
    triangle: int
    after: int
    padding_left: float
    padding_right: float

    @property
    def transition(self) -> tuple[int, int, int]:
        """The triangle, with the ones before and after it."""
        return self.before, self.triangle, self.after

    @property
    def width(self) -> float:
        """Metres from bank to bank."""
        return math.dist(*self.gap)


class UnreachableError(PlanningError):
    """No water joins start and goal, or no class between them can be sailed.

    `straits` are the gaps that block the classes; none where anything else blocks one of them.
    """

    straits: tuple[Strait, ...] = ()


class InfeasibleError(PlanningError):
    """One class can't be sailed; only inside the planner: a plan lists the class as rejected.

    `strait` is the narrowest gap that blocks its channel, if any does; `blocked` are the triangles
    of all such gaps, each with the ones before and after it.
    """

    strait: Strait | None = None
    blocked: frozenset[tuple[int, int, int]] = frozenset()

    @classmethod
    def at_strait(
        cls, strait: Strait, blocked: Iterable[tuple[int, int, int]] = ()
    ) -> InfeasibleError:
        """Blame one gap, with what it lacks, of all that are blocked."""
        error = cls(
            f"blocked at {{0}}, between {{1}} and {{2}}: the gap is {strait.width:.2f} m wide, and "
            f"the padding takes {strait.padding_left:.2f} m on the left and "
            f"{strait.padding_right:.2f} m on the right bank",
            strait.gap.mean(axis=0),
            *strait.gap,
        )
        error.strait, error.blocked = strait, frozenset((strait.transition, *blocked))
        return error


class TooSharpError(InfeasibleError):
    """Corners of the class's path leave the vessel too little room to turn in.

    `excess` (n,) says for each point of the path by what factor the arc there, or beside it, asks
    for more of a leg than there is; at most 1 where there is enough.
    """

    excess: FloatArray

    @classmethod
    def at_points(cls, path: FloatArray, asked: FloatArray, length: FloatArray) -> TooSharpError:
        """Blame the leg of a path (n, 2) that lacks most: lengths (n - 1,), m, asked and had."""
        worst = int((asked - length).argmax())
        error = cls(
            f"the corners beside the leg at {{0}} need {asked[worst]:.2f} m to turn in; it has "
            f"{length[worst]:.2f} m",
            path[worst],
        )
        by_leg = asked / np.maximum(length, 1e-300)
        error.excess = np.maximum(np.append(by_leg, 0.0), np.append(0.0, by_leg))
        return error


class TooLateError(InfeasibleError):
    """The class's path would arrive after the last time of the current."""
