"""Every way in which a plan can be refused.

A message names the value, the limit it broke and what to change.
"""

from __future__ import annotations


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


class InfeasibleError(PlanningError):
    """A class falls away, and why; inside the planner only: a plan lists it as rejected.

    `move` is the triangle, with the ones before and after it, that shuts the channel, if it is
    just one.
    """

    def __init__(self, reason: str, move: tuple[int, int, int] | None = None) -> None:
        super().__init__(reason)
        self.move = move


class CurrentTooStrongError(PlanningError):
    """The current outruns the vessel where it has to be."""
