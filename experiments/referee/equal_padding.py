"""The padding that rivals must keep beside our plan with adaptive padding.

No rival needs to keep further off land than a route of ours would, and none may use water that all
of ours have to leave alone.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

import renew
from renew._types import FloatArray
from renew.planner.problem import Problem
from renew.turns.turn_reach import TurnSampler, TurnsAtEdges, normals_away
from renew.voyage.voyage import Voyage

Paddings: TypeAlias = dict[tuple[float, ...], float]

_RISK = renew.PlanOptions.risk
_SEED = renew.PlanOptions.seed


def equal_padding(plan: renew.Plan, voyage: Voyage, clearance: float = 0.0) -> FloatArray:
    """Edges (e, 5) x0, y0, x1, y1, padding (m) that rivals must keep, for a fair comparison.

    For each edge it is the first of these that exists: (1) the padding of the best route; (2) the
    least padding of any other route; (3) the least padding that the planner would give a route past
    it, at least `clearance`. Without (3) a rival could slip through a strait that is too narrow for
    all our routes.
    """
    paddings = smallest_paddings(voyage, clearance)
    paddings |= _least([_kept(route) for route in plan.routes])
    paddings |= _kept(plan.best)
    return np.array([(*ends, padding) for ends, padding in paddings.items()]).reshape(-1, 5)


def smallest_paddings(voyage: Voyage, clearance: float = 0.0) -> Paddings:
    """Padding (m) of constrained edges by their ends: the smaller one of both courses past each.

    By the planner's rule, in the triangle at the edge, from one of its passing edges' midpoints to
    the other's. An edge at the end of a bay, which nothing passes, has none.
    """
    triangulation = Problem(voyage, renew.PlanOptions(distinct_by="auto")).triangulation
    triangle, _ = np.nonzero(triangulation.hazardous)
    is_passed = (triangulation.neighbours[triangle] >= 0).sum(axis=1) == 2
    triangle, edges = triangle[is_passed], triangulation.constrained_edges[is_passed]
    row, corner = np.nonzero(triangulation.neighbours[triangle] >= 0)
    passing = triangulation.edge_vertices(triangle[row], corner)
    enter, leave = triangulation.vertices[passing].mean(axis=1).reshape(-1, 2, 2).swapaxes(0, 1)
    statistics = voyage.waters.quick_current.statistics(triangulation.corners[triangle])
    normals = normals_away(edges, (enter + leave) / 2)
    sampler, rows = TurnSampler.for_risk(_SEED, _RISK), np.arange(len(edges))
    needed = np.full(len(edges), np.inf)
    for travel in (leave - enter, enter - leave):
        course = np.arctan2(travel[:, 1], travel[:, 0])
        turns = TurnsAtEdges(statistics, course, rows, normals, voyage.vessel)
        reach = sampler.quantile(turns, _RISK)
        needed = np.minimum(needed, reach)
    rows_of_edges = np.column_stack([edges.reshape(-1, 4), np.maximum(needed, clearance)])
    return {_ends(row): row[4] for row in rows_of_edges.tolist()}


def _kept(route: renew.Route) -> Paddings:
    """Padding (m) that a route kept, by the edges' ends."""
    kept: Paddings = {}
    for row in route.padding_used.tolist():
        kept[_ends(row)] = max(kept.get(_ends(row), 0.0), row[4])
    return kept


def _least(paddings: list[Paddings]) -> Paddings:
    """Least padding of each edge."""
    least: Paddings = {}
    for one in paddings:
        for ends, padding in one.items():
            least[ends] = min(least.get(ends, padding), padding)
    return least


def _ends(row: list[float]) -> tuple[float, ...]:
    """Ends of an edge, whichever way it is drawn."""
    one, other = sorted([tuple(row[:2]), tuple(row[2:4])])
    return (*one, *other)
