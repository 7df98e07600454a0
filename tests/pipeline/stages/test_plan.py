"""A season's plan keeps the planner's order, and its ranks put the route to take first."""

from __future__ import annotations

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
