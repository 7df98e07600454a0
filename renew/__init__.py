"""RENEW: risk- and energy-aware navigation in dynamic waterways.

Plans vessel routes that are safe and cheap in ocean currents, after the AAAI 2026 paper of that
name. Planar metres, arrays and shapely geometries in, routes out.
"""

from renew.chart import Chart
from renew.contingency import Contingency, contingency
from renew.current import CurrentField, GriddedCurrent, GyreCurrent, UniformCurrent
from renew.errors import (
    CurrentTooStrongError,
    GeometryError,
    GoalInNoGoError,
    ParameterError,
    PlanningError,
    StartInNoGoError,
    UnreachableError,
)
from renew.fuel import fuel
from renew.planner import plan
from renew.route import Plan, Rejected, Route
from renew.tightest import Tightest, tightest
from renew.vessel import Vessel

__all__ = [
    "Chart",
    "Contingency",
    "CurrentField",
    "CurrentTooStrongError",
    "GeometryError",
    "GoalInNoGoError",
    "GriddedCurrent",
    "GyreCurrent",
    "ParameterError",
    "Plan",
    "PlanningError",
    "Rejected",
    "Route",
    "StartInNoGoError",
    "Tightest",
    "UniformCurrent",
    "UnreachableError",
    "Vessel",
    "contingency",
    "fuel",
    "plan",
    "tightest",
]
