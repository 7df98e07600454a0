"""The whole method in the paper's order: triangulate, classes, padding, best path, prove it."""

from __future__ import annotations

from typing import get_args

from renew._types import FloatArray
from renew.classes.channels import ChannelSearch, Order
from renew.classes.h_signature import shortened
from renew.errors import ParameterError, UnreachableError
from renew.inputs.arguments import as_point, check_counts, check_ends
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.fuel import Drift, check_drift
from renew.inputs.vessel import Vessel
from renew.padding.padding_model import Padder, Padding, check_padding
from renew.route import Plan, Rejected, Route
from renew.search.class_planner import ClassSearch, Method
from renew.search.diagnosis import advise
from renew.search.k_sailable_classes import Examined, examine
from renew.search.problem import Waters


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
    distinct_by: float = 0.0,
    method: Method = "optimal",
    samples: int = 500,
    drift: Drift = "projected",
    seed: int = 0,
    order: Order = "fuel",
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
        Of how many homotopy classes to give the route, k >= 1; fewer where fewer can be sailed.
    risk : float
        1 - σ in (0, 1): the share of drawn turns that may reach beyond the padding.
    padding : "adaptive", "none" or float
        Adaptive padding (paper), none, or the same width (m) on every constrained edge.
    clearance : float
        Floor on the padding (m).
    distinct_by : float
        Classes that part only around islands smaller than this (m) count as one.
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

    Returns
    -------
    Plan
        Routes, least fuel first, and rejected classes with their reasons. With adaptive padding
        every route's hard-over turns were flown and none touched the no-go zone, but around a
        start or goal that lies in the soft no-go zone itself.

    Raises
    ------
    ParameterError
        Arguments out of range.
    StartInNoGoError, GoalInNoGoError
        An end on land or outside the chart; says by how much and where water is nearest.
    CurrentTooStrongError
        The current at the start or at the goal outruns the vessel.
    UnreachableError
        No water joins start and goal, or every class fell away; says why, and what would help.
    """
    if method not in get_args(Method):
        raise ParameterError(f"method = {method!r} is not one of {', '.join(get_args(Method))}")
    check_counts(classes, samples, seed, distinct_by)
    check_drift(drift)
    check_padding(padding, clearance, risk)
    field = as_field(current)
    start, goal = as_point("start", start), as_point("goal", goal)
    check_ends(chart, field, vessel, start, goal)
    waters = Waters(chart, field, vessel, start, goal, drift, distinct_by)

    def finder(clearance: float) -> ChannelSearch:
        return ChannelSearch(
            waters.triangulation,
            waters.rays,
            start,
            goal,
            order,
            table=waters.table,
            speed=vessel.speed,
            drift=drift,
            clearance=clearance,
        )

    def examined(
        *, padding: Padding, clearance: float, risk: float, classes: int = classes
    ) -> Examined:
        floor = clearance if isinstance(padding, str) else max(clearance, float(padding))
        adaptive = padding == "adaptive"
        # Hardly any padding is less than v/ω: a turn is twice as wide.
        likely = finder(max(floor, vessel.turning_radius) if adaptive else floor)
        padder = Padder(
            waters.triangulation,
            waters.quick_current,
            vessel,
            padding=padding,
            clearance=clearance,
            risk=risk,
            seed=seed,
        )
        search = ClassSearch(waters, padder, method, samples, seed, proves=adaptive)
        return examine(likely, lambda: finder(0.0), search, classes)

    def attempt(*, padding: Padding, clearance: float, risk: float) -> Route | None:
        found = examined(padding=padding, clearance=clearance, risk=risk, classes=1)
        return found.routes[0] if found.routes else None

    found = examined(padding=padding, clearance=clearance, risk=risk)
    if not found.routes:
        advice = advise(attempt, padding, clearance, risk, finder(0.0).widest_gap())
        raise UnreachableError(_no_class(found.rejected, advice))
    chosen = min(range(len(found.routes)), key=lambda i: found.routes[i].harmonic_mean)
    return Plan(found.routes, found.rejected, chosen, waters.closed)


def _no_class(rejected: tuple[Rejected, ...], advice: list[str]) -> str:
    """Message for a plan in which every class fell away."""
    reasons = "; ".join(f"class {shortened(r.homotopy)}: {r.reason}" for r in rejected[:3])
    more = f" (and {len(rejected) - 3} more)" if len(rejected) > 3 else ""
    return (
        f"all {len(rejected)} classes fell away: {reasons}{more}. To find a route: "
        f"{'; '.join(advice)}; or allow a smaller padding or clearance, or more classes"
    )
