"""The whole method in the paper's order: triangulate, classes, padding, best path, verify."""

from __future__ import annotations

from renew._types import FloatArray
from renew.inputs.arguments import (
    DistinctBy,
    Method,
    Order,
    Padding,
    RiskAt,
    as_point,
    check_endpoints,
    check_options,
)
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.fuel import Drift
from renew.inputs.vessel import Vessel
from renew.inputs.voyage import Voyage
from renew.padding.policy import PaddingPolicy
from renew.route import Plan
from renew.search.class_planner import PathMethod
from renew.search.diagnosis import no_class_error
from renew.search.harmonic_mean import chosen_class
from renew.search.k_sailable_classes import plan_classes
from renew.search.problem import Problem


def plan(
    chart: Chart,
    current: CurrentLike,
    vessel: Vessel,
    start: FloatArray | tuple[float, float],
    goal: FloatArray | tuple[float, float],
    *,
    classes: int = 16,
    risk: float = 0.05,
    padding: Padding = "adaptive",
    clearance: float = 0.0,
    distinct_by: DistinctBy = 0.0,
    method: Method = "optimal",
    samples: int = 500,
    drift: Drift = "projected",
    seed: int = 0,
    order: Order = "fuel",
    risk_at: RiskAt = "route",
    departure: float = 0.0,
    lateness: float = 0.05,
) -> Plan:
    """Plan the least-fuel safe route in each of the first k homotopy classes.

    Parameters
    ----------
    chart : Chart
        Extent and hard no-go zone (m).
    current : CurrentField or callable
        Velocity (..., 2) m/s at points (..., 2) m.
    vessel : Vessel
        Speed, turn rate and fuel law.
    start, goal : array_like
        Points (2,) in metres, in the chart's water.
    classes : int
        Number of homotopy classes to give a route for, k >= 1; fewer where fewer can be sailed.
    risk : float
        1 - σ in (0, 1): the share of drawn turns that may reach beyond the padding.
    padding : "adaptive", "none" or float
        Adaptive padding (paper), none, or the same width (m) on every constrained edge.
    clearance : float
        Floor on the padding (m).
    distinct_by : float or "auto"
        Classes that differ only by islands smaller than this (m) count as one, with its best path.
        Automatic: those count that differ by none of the few largest islands on the way.
    method : {"optimal", "sampled"}
        Dynamic programming inside each class, or the paper's random chains.
    samples : int
        Chains a class, for ``"sampled"``.
    drift : {"projected", "crab"}
        Drift model of Eq. 4; see :mod:`renew.inputs.fuel`.
    seed : int
        Seed of all draws; the same seed gives the same plan.
    order : {"fuel", "length", "depth-first"}
        Which k classes: the cheapest or the shortest along their midlines, or the first of a
        depth-first search (paper).
    risk_at : {"route", "point"}
        Where adaptive padding meets the risk: on the way through each triangle (paper), or from
        every point of the final route as well, on its own heading.
    departure : float
        When the voyage begins (s), on the clock of a current that changes.
    lateness : float
        Share of the time since departure by which the vessel may be early or late anywhere: with
        adaptive padding it can turn away at all these times. Of no effect in a steady current.

    Returns
    -------
    Plan
        Routes, least fuel first, and rejected classes with their reasons. With adaptive padding
        every route's hard-over turns were flown and none touched the no-go zone, except around a
        start or goal that lies in the soft no-go zone itself.

    Raises
    ------
    ParameterError
        Arguments out of range.
    StartInNoGoError, GoalInNoGoError
        A start or goal on land or outside the chart; says by how much and where water is nearest.
    CurrentTooStrongError
        The current at the start or at the goal is as strong as the vessel.
    UnreachableError
        No water joins start and goal, or every class was rejected; says why, and what would help.
    """
    check_options(
        classes=classes,
        risk=risk,
        padding=padding,
        clearance=clearance,
        distinct_by=distinct_by,
        method=method,
        samples=samples,
        drift=drift,
        seed=seed,
        order=order,
        risk_at=risk_at,
        departure=departure,
        lateness=lateness,
    )
    voyage = Voyage(
        chart,
        as_field(current),
        vessel,
        as_point("start", start),
        as_point("goal", goal),
        drift,
        float(departure),
        float(lateness),
    )
    check_endpoints(voyage)
    policy = PaddingPolicy(padding, clearance, risk, seed, risk_at)
    width = policy.likely_width(vessel.turning_radius)
    problem = Problem(voyage, distinct_by, order, classes, width)
    path_method = PathMethod(method, samples, seed)
    found = plan_classes(problem, policy, path_method, classes)
    if not found.routes:
        raise no_class_error(found.rejected, problem, policy, path_method)
    chosen = chosen_class(found.routes)
    return Plan(found.routes, found.rejected, chosen, problem.overpowered_water)
