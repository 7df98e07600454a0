"""A scenario's vessel and options as the planner has them."""

import math

import renew
from pipeline.scenario.model import PlannerOptions
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


def plan_options(options: PlannerOptions, *, min_lateness: float = 0.0) -> renew.PlanOptions:
    """Return the planner's options; the vessel is early or late by `min_lateness` (s) at least.

    A run has chosen the clearance for a chart before; a plane's is 0 where it is left out.
    """
    given = {**options.model_dump(), "clearance": options.clearance or 0.0}
    return renew.PlanOptions(**given, min_lateness=min_lateness)
