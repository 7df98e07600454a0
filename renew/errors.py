"""Every way in which a plan can be refused.

A message names the value, the limit it broke and what to change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from renew._types import FloatArray


class PlanningError(Exception):
    """A plan that cannot be made; the base of all errors that `renew` raises on purpose."""


class ParameterError(PlanningError, ValueError):
    """An argument outside its range: unknown method, risk not in (0, 1), k < 1."""


class GeometryError(PlanningError, ValueError):
    """A chart whose polygons are not valid, not finite, or leave no water."""


class StartInNoGoError(PlanningError):
    """The start lies on land or outside the chart."""


class GoalInNoGoError(PlanningError):
    """The goal lies on land or outside the chart."""


class UnreachableError(PlanningError):
    """No water joins start and goal, or no class between them can be sailed."""


@dataclass(frozen=True, eq=False)
class Strait:
    """Where a class is shut: its padding takes a whole gap.

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
    def move(self) -> tuple[int, int, int]:
        """The triangle, with the ones before and after it."""
        return self.before, self.triangle, self.after

    @property
    def width(self) -> float:
        """Metres from bank to bank."""
        return math.dist(*self.gap)

    def __str__(self) -> str:
        """Say where it is and what it lacks."""
        middle, left, right = (f"({x:.1f}, {y:.1f})" for x, y in (self.gap.mean(axis=0), *self.gap))
        return (
            f"shut at {middle} m, in triangle {self.triangle} between {left} and {right} m: the "
            f"soft no-go zone takes the whole gap of {self.width:.2f} m, with a padding of "
            f"{self.padding_left:.2f} m on the left and {self.padding_right:.2f} m on the right "
            "bank"
        )


class InfeasibleError(PlanningError):
    """A class falls away, and why; inside the planner only: a plan lists it as rejected.

    `strait` is what shuts its channel, if it is just one.
    """

    def __init__(self, reason: str | Strait) -> None:
        super().__init__(str(reason))
        self.strait = reason if isinstance(reason, Strait) else None


class CurrentTooStrongError(PlanningError):
    """The current outruns the vessel where it has to be."""
