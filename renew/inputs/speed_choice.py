"""Speeds through water that a vessel chooses from leg to leg, and what a second is worth to her."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SpeedChoice:
    """Speeds from `least` (m/s) to the vessel's own, to be at the goal by a deadline (s).

    `price` is the Lagrange multiplier λ of the deadline (fuel units a second): what is least is
    fuel + λ time. With an infinite one time is all that counts. Without `least` there is no choice.
    """

    least: float = math.inf
    price: float = math.inf
    deadline: float = math.inf


NO_CHOICE = SpeedChoice()
"""The vessel's own speed all the way."""
