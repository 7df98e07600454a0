"""The water that the rule leaves to every route, beside the rule's own figures and its routes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

import renew
from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.classes.triangulation import Triangulation
from renew.inputs.options import PlanOptions, Request
from renew.planner.problem import Problem
from renew.turns import least_padding
from renew.turns.turn_reach import TurnSampler, TurnsAtEdges, normals_away
from renew.voyage.voyage import Voyage
from tests.bounded_scenes import bounded_scene
from tests.strategies import PAPER_VESSEL, random_scene, voyage_on

PLACES = np.array([[0.34, 0.33, 0.33], [0.48, 0.48, 0.04], [0.48, 0.04, 0.48], [0.04, 0.48, 0.48]])
"""Middles of crossings of a triangle, as means of its corners."""

HEADINGS = np.linspace(0, 2 * np.pi, 24, endpoint=False)


def by_the_rule(problem: Problem, *, worst: bool = False) -> FloatArray:
    """Padding (e,) of edges by the rule itself: the least over triangles and headings, or worst."""
    voyage, options = problem.voyage, problem.options
    edges, corners = problem.triangulation.constrained_edges, problem.triangulation.corners
    sampler = TurnSampler.for_risk(options.seed, options.risk)
    statistics = voyage.waters.quick_current.statistics(corners)
    lines = shapely.linestrings(edges)
    most = least_padding._MOST * voyage.vessel.turning_radius
    found = np.full(len(edges), 0.0 if worst else most)
    for triangle, own in enumerate(corners):
        apart = shapely.distance(lines, shapely.Polygon(own))
        near = np.flatnonzero(apart < most)
        here = type(statistics)(*(of[[triangle]] for of in statistics))
        row = np.zeros(len(near), dtype=np.int64)
        for place in PLACES @ own:
            normals = normals_away(edges[near], place)
            for one in HEADINGS:
                turns = TurnsAtEdges(here, np.array([one]), row, normals, voyage.vessel)
                needed = sampler.quantile(turns, options.risk)
                if worst:
                    found[near] = np.maximum(found[near], needed)
                else:
                    found[near] = np.minimum(found[near], np.maximum(apart[near], needed))
    return found


def problem_of(seed: int, risk: float = 0.05) -> Problem:
    """The problem of a random scene."""
    chart, current, start, goal = random_scene(seed)
    return Problem(voyage_on(chart, start, goal, current), Request(risk=risk))


@pytest.mark.parametrize(("seed", "risk"), [(0, 0.05), (1, 0.2), (2, 0.005)])
def test_no_padding_of_the_rule_is_below_the_least(seed: int, risk: float) -> None:
    problem = problem_of(seed, risk)
    edges = problem.triangulation.constrained_edges
    least = least_padding._paddings(problem.voyage, problem.triangulation, problem.options, edges)
    by_rule = by_the_rule(problem)
    assert (least <= by_rule + 1e-9).all()
    assert least.sum() > 0.4 * by_rule.sum(), "it is of no use"


OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"padding": 4.0},
    {"padding": "none", "clearance": 6.0},
    {"clearance": 8.0, "narrow_share": 0.5},
    {"risk_at": "point"},
    {"drift": "crab"},
)


def inside(plan: renew.Plan) -> list[float]:
    """Length (m) of each route of a plan outside the water that the bound leaves all of them."""
    kept = plan.best.fuel_bound.kept
    assert callable(kept)
    assert all(route.fuel_bound.kept == kept for route in plan.routes)
    water = kept().chart.open_water
    lines = [shapely.LineString(route.path) for route in plan.routes]
    return [float(one.length) for one in shapely.difference(lines, water)]


@pytest.mark.gate_share(11)
@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_planned_routes_keep_to_the_water_and_need_no_less_than_its_bound(
    seed: int, options: dict[str, Any]
) -> None:
    chart, current, start, goal = random_scene(seed)
    plan = renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=4, **options)
    assert max(inside(plan)) < 1e-3
    for route in plan.routes:
        assert route.fuel >= route.fuel_bound.at_clearance
        assert 0 <= route.gap_at_clearance <= route.optimality_gap


def test_padding_of_the_worst_heading_would_be_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    chart, current, start, goal = random_scene(0)
    plan = renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=4)
    problem = problem_of(0)
    worst = by_the_rule(problem, worst=True)

    def broken(
        voyage: Voyage, triangulation: Triangulation, options: PlanOptions, edges: FloatArray
    ) -> FloatArray:
        del voyage, options
        is_edge = (edges[:, None] == triangulation.constrained_edges).all(axis=(2, 3))
        return np.asarray(worst[is_edge.argmax(axis=1)])

    monkeypatch.setattr(least_padding, "_paddings", broken)
    assert max(inside(plan)) > 1.0


@pytest.mark.parametrize("seed", [2, 22, 300])
def test_no_bound_at_the_clearance_is_above_the_oracle_in_that_water(seed: int) -> None:
    scene = bounded_scene(seed)
    problem = Problem(scene.voyage, Request(clearance=3.0, narrow_share=0.5))
    kept = problem.fuel_bound.kept
    assert callable(kept)
    voyage = kept()
    land = shapely.difference(scene.chart.extent, voyage.chart.open_water)
    assert land.area > shapely.union_all(scene.chart.no_go).area
    own = replace(scene, chart=renew.Chart(scene.chart.extent, [land]))
    assert fuel_lower_bound(voyage) <= own.oracle()
