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
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import (
    CurrentField,
    GriddedCurrent,
    GyreCurrent,
    SwingingGyre,
    UniformCurrent,
    VaryingCurrent,
)
from renew.inputs.openings import Haven, LeastWater, OverLimit, ShutArea, TidalArea, TidalDepth
from renew.inputs.options import PlanOptions
from renew.inputs.tide import Constant, HighAndLow, Tide
from renew.planner.near_best import near_best
from renew.results import Departures, OverpoweredHours, Plan, Rejected, Route, Shortfall, TradeOff
from renew.turns.contingency import Contingency, Tightest, contingency, tightest
from renew.underway.adrift import Adrift, adrift
from renew.underway.assess import AssessedPath, assess
from renew.underway.cover import cover
from renew.underway.replan import Replanned, TurnOff, replan
from renew.underway.survey import ClassTurn, Coverage, Diversion, EqualPoint, LastTurn, Stretch
from renew.vary.ensemble import EnsemblePlan, ShutInMember, plan_ensemble
from renew.vary.plan import plan, plan_departures
from renew.voyage.fuel import fuel

__version__ = "0.1.0"
"""Also in pyproject.toml, CITATION.cff and the tag; tests/test_architecture.py compares them."""

__all__ = [
    "Adrift",
    "ArrivalError",
    "AssessedPath",
    "Chart",
    "ClassTurn",
    "Constant",
    "Contingency",
    "Coverage",
    "CurrentField",
    "CurrentTooStrongError",
    "Departures",
    "Diversion",
    "EnsemblePlan",
    "EqualPoint",
    "GeometryError",
    "GoalInNoGoError",
    "GriddedCurrent",
    "GyreCurrent",
    "Haven",
    "HighAndLow",
    "LastTurn",
    "LeastWater",
    "OverLimit",
    "OverpoweredHours",
    "ParameterError",
    "Plan",
    "PlanOptions",
    "PlanningError",
    "Rejected",
    "Replanned",
    "Route",
    "Shortfall",
    "ShutArea",
    "ShutInMember",
    "StartInNoGoError",
    "Stretch",
    "SwingingGyre",
    "TidalArea",
    "TidalDepth",
    "Tide",
    "Tightest",
    "TradeOff",
    "TurnOff",
    "UniformCurrent",
    "UnreachableError",
    "VaryingCurrent",
    "Vessel",
    "ViaInNoGoError",
    "adrift",
    "assess",
    "contingency",
    "cover",
    "fuel",
    "near_best",
    "plan",
    "plan_departures",
    "plan_ensemble",
    "replan",
    "tightest",
]
