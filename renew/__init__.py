"""RENEW: risk- and energy-aware navigation in dynamic waterways.

Plans vessel routes that are safe and cheap in ocean currents, after the AAAI 2026 paper of that
name. Planar metres, arrays and shapely geometries in, routes out.
"""

from renew.errors import (
    ArrivalError,
    CurrentTooStrongError,
    GeometryError,
    GoalInNoGoError,
    ParameterError,
    PlanningError,
    StartInNoGoError,
    UnreachableError,
    ViaInNoGoError,
)
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentField, GriddedCurrent, GyreCurrent, UniformCurrent
from renew.inputs.fuel import fuel
from renew.inputs.shut_area import ShutArea
from renew.inputs.varying_current import SwingingGyre, VaryingCurrent
from renew.inputs.vessel import Vessel
from renew.planner import plan, plan_departures
from renew.route import Departures, OverpoweredHours, Plan, Rejected, Route, TradeOff
from renew.turns.closest_approach import Tightest, tightest
from renew.turns.contingency import Contingency, contingency

__version__ = "0.1.0"
"""Also in pyproject.toml, CITATION.cff and the tag; tests/test_versions.py compares them."""

__all__ = [
    "ArrivalError",
    "Chart",
    "Contingency",
    "CurrentField",
    "CurrentTooStrongError",
    "Departures",
    "GeometryError",
    "GoalInNoGoError",
    "GriddedCurrent",
    "GyreCurrent",
    "OverpoweredHours",
    "ParameterError",
    "Plan",
    "PlanningError",
    "Rejected",
    "Route",
    "ShutArea",
    "StartInNoGoError",
    "SwingingGyre",
    "Tightest",
    "TradeOff",
    "UniformCurrent",
    "UnreachableError",
    "VaryingCurrent",
    "Vessel",
    "ViaInNoGoError",
    "contingency",
    "fuel",
    "plan",
    "plan_departures",
    "tightest",
]
