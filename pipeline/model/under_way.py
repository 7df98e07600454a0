"""A voyage that is planned again under way: the plan that is sailed, and the answer."""

from dataclasses import dataclass
from typing import Literal

import renew
from pipeline._types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class VoyageBefore:
    """The plan that the vessel is sailing, on the clock of the scene that has it.

    Attributes
    ----------
    plan : its best route alone; times (s) are below 0 before the scene's departure.
    current : the current that it was planned in; None if that is the scene's own.
    start, via : where it began, planar metres (2,), and all its via points (n, 2).
    heading_rad : the vessel's heading in the plane, anticlockwise from the x axis, or None.
    switch_above : see `renew.replan`.
    """

    plan: renew.Plan
    current: renew.CurrentField | None
    start: FloatArray
    via: FloatArray
    heading_rad: float | None
    switch_above: float


@dataclass(frozen=True, slots=True)
class Replanned:
    """What `renew.replan` answered; fuel in the planner's units, distances in true metres.

    `kept_fuel` is the fuel ahead on the way that was planned, NaN if that can't be sailed, with the
    reason in `kept_reason`. The other fields are those of `renew.Replanned`.
    """

    answer: Literal["kept", "switched"]
    fuel: float
    kept_fuel: float
    kept_reason: str
    off_m: float
    moved_m: float
    late_s: float
    planned_fuel: float
    burnt: float
    by_drift: float
    by_forecast: float
    saved: float
    has_new_current: bool
