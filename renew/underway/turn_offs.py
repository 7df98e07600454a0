"""Where a vessel under way turns off to if no way leads on: the havens of a list, by fuel."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from renew.errors import InfeasibleError, PlanningError
from renew.inputs.haven import Haven
from renew.planner.plan import planner_of
from renew.planner.problem import check_endpoints
from renew.request import Request
from renew.results import Plan
from renew.underway.choice import choose
from renew.underway.diversions import entered


@dataclass(frozen=True, eq=False)
class TurnOff:
    """A way from where the vessel is to a haven.

    Attributes
    ----------
    haven : where it leads.
    plan : the plan of it, to be given to the next :func:`renew.replan`.
    arrival : when the vessel enters the haven, s, after the wait until it opens.
    fuel : fuel for the way and the wait (fuel units).
    """

    haven: Haven
    plan: Plan
    arrival: float
    fuel: float


def turn_offs(
    havens: Sequence[Haven], request: Request, heading: float | None
) -> tuple[tuple[TurnOff, ...], tuple[tuple[Haven, PlanningError], ...]]:
    """Return ways from a request's start to havens, least fuel first, and havens without a way.

    The vessel has a `heading` (rad) if one is given.
    """
    found, left_out = list[TurnOff](), list[tuple[Haven, PlanningError]]()
    for haven in havens:
        try:
            found.append(_turn_off(haven, request, heading))
        except PlanningError as error:
            left_out.append((haven, error))
    return tuple(sorted(found, key=lambda one: one.fuel)), tuple(left_out)


def _turn_off(haven: Haven, request: Request, heading: float | None) -> TurnOff:
    """Plan the way to a haven; raise PlanningError if there is none."""
    stops = np.vstack([request.stops[0], haven.place])
    there = replace(request, stops=stops, like=request)
    check_endpoints(planner_of(there).problem.voyage)
    choice = choose(there, None, heading, 1.0, is_proven=False, track=None)
    plan = cast("Plan", choice.plan)  # without a way, an error was raised
    if plan.best.ends_in_soft_no_go:
        raise InfeasibleError(
            f"haven {haven.name} {{0}} lies in the soft no-go zone, where no turn is verified; "
            "move it off",
            haven.place,
        )
    reached = float(plan.best.times[-1])
    arrival = entered(haven, reached)
    fuel = plan.best.fuel + request.vessel.fuel_rate * (arrival - reached)
    return TurnOff(haven, replace(plan, voyage=there), arrival, fuel)
