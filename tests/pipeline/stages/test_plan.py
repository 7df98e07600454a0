"""A season's plan keeps the planner's order, and its ranks put the route to take first."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from pipeline.geo.projection import Projection
from pipeline.loading import parse_scenario
from pipeline.model import SeasonPlan
from pipeline.stages import planar
from pipeline.stages.evaluate import evaluate_season
from pipeline.stages.plan import plan_season

SCENARIO = {
    "schema_version": 1,
    "name": "two-ways",
    "vessel": "paper-asv",
    "start": [10, 50],
    "goal": [90, 50],
    "plane": {"extent": [0, 0, 100, 100], "obstacles": [[[45, 45], [55, 45], [55, 55], [45, 55]]]},
    "seasons": [{"name": "calm", "uniform": {"u": 0.1}}],
}


def test_the_chosen_route_has_rank_1_and_the_plan_keeps_its_order_by_fuel() -> None:
    """With few random chains, the mean of a class and its best path often disagree."""
    for seed in range(40):
        options = {"classes": 2, "method": "sampled", "samples": 5, "padding": "none", "seed": seed}
        scenario = parse_scenario(SCENARIO | {"planner": options})
        scene = planar.plane_scene(scenario)
        season = plan_season(scene, "calm", scenario.planner)
        if season.plan is not None and season.plan.chosen != 0:
            break
    else:
        raise AssertionError("no seed makes the sampled method choose another route than the first")
    routes = season.plan.routes
    assert [route.fuel for route in routes] == sorted(route.fuel for route in routes)
    assert season.plan.best is routes[season.plan.chosen]
    assert season.ranked_routes == (routes[1], routes[0])
    rows = evaluate_season(scene, season, scenario.scale, seed=0).routes
    assert [(row.rank, row.homotopy) for row in rows] == [
        (1, season.plan.best.homotopy),
        (2, routes[0].homotopy),
    ]


def test_a_season_that_could_not_be_planned_has_no_routes() -> None:
    assert SeasonPlan("calm", None, "no water connects start and goal", 0.1).ranked_routes == ()


def test_places_in_reasons_are_given_as_a_scenario_gives_them() -> None:
    """A strait of 6 m, blocked by padding: in metres in a plane, in degrees on a chart."""
    walls = [[[0, 45], [47, 45], [47, 55], [0, 55]], [[53, 45], [100, 45], [100, 55], [53, 55]]]
    plane = {"extent": [0, 0, 100, 100], "obstacles": walls}
    asked = SCENARIO | {"start": [50, 10], "goal": [50, 90], "plane": plane}
    scenario = parse_scenario(asked | {"planner": {"padding": 8.0}})
    scene = planar.plane_scene(scenario)
    in_plane = plan_season(scene, "calm", scenario.planner).failure
    assert "blocked at (50, 45) m" in in_plane
    on_chart = replace(scene, is_planar=False, projection=Projection.at(118.5, 9.75))
    in_degrees = plan_season(on_chart, "calm", scenario.planner).failure
    found = re.search(r"blocked at ([\d.]+) E ([\d.]+) N", in_degrees)
    assert found is not None
    assert np.allclose(
        on_chart.projection.to_plane(list(map(float, found.groups()))), [50, 45], atol=6
    )
    assert "triangle" not in in_plane + in_degrees
