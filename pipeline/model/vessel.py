"""The vessel of a scenario as the planner has it."""

from __future__ import annotations

import math

import renew
from pipeline.scenario.vessel import VesselSpec


def planner_vessel(spec: VesselSpec) -> renew.Vessel:
    """Return the planner's vessel, in m, m/s and radians/s."""
    return renew.Vessel(
        speed=spec.speed_m_s,
        turn_rate=math.radians(spec.turn_rate_deg_s),
        length=spec.length_m,
        fuel_coefficient=spec.fuel_coefficient,
        fuel_exponent=spec.fuel_exponent,
    )
