"""A season's plan keeps the planner's order, and its ranks put the route to take first."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely

from pipeline.geo.projection import Projection
from pipeline.model import Case, CaseResult
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.plan_case import plan_case
from tests.pipeline.planar_cases import case_of

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
        season = plan_case(case_of(scenario), scenario.planner)
        if season.plan is not None and season.plan.chosen != 0:
            break
    else:
        raise AssertionError("no seed makes the sampled method choose another route than the first")
    routes = season.plan.routes
    assert [route.fuel for route in routes] == sorted(route.fuel for route in routes)
    assert season.plan.best is routes[season.plan.chosen]
    assert season.routes == (routes[1], routes[0])
    rows = season.measures.routes
    assert [(row.rank, row.homotopy) for row in rows] == [
        (1, season.plan.best.homotopy),
        (2, routes[0].homotopy),
    ]


def test_a_season_that_could_not_be_planned_has_no_routes() -> None:
    assert CaseResult("calm", None, "no water connects start and goal", 0.1).routes == ()


def test_places_in_reasons_are_given_as_a_scenario_gives_them() -> None:
    """A strait of 6 m, blocked by padding: in metres in a plane, in degrees on a chart."""
    walls = [[[0, 45], [47, 45], [47, 55], [0, 55]], [[53, 45], [100, 45], [100, 55], [53, 55]]]
    plane = {"extent": [0, 0, 100, 100], "obstacles": walls}
    asked = SCENARIO | {"start": [50, 10], "goal": [50, 90], "plane": plane}
    scenario = parse_scenario(asked | {"planner": {"padding": 8.0}})
    case = case_of(scenario)
    in_plane = plan_case(case, scenario.planner).failure
    assert "blocked at (50, 45) m" in in_plane
    projection = Projection.at(118.5, 9.75)
    water = replace(case.water, is_planar=False, projection=projection)
    in_degrees = plan_case(replace(case, water=water), scenario.planner).failure
    found = re.search(r"blocked at ([\d.]+) E ([\d.]+) N", in_degrees)
    assert found is not None
    assert np.allclose(projection.to_plane(list(map(float, found.groups()))), [50, 45], atol=6)
    assert "triangle" not in in_plane + in_degrees


def harbour(*mouths: tuple[float, float]) -> Case:
    """A basin of 30 m by 30 m round the start, with mouths between these x in its northern wall."""
    ends = [10.0, *itertools.chain(*mouths), 50.0]
    walls = [(10.0, 10, 50.0, 15), (10, 10, 15, 50), (45, 10, 50, 50)]
    walls += [(x, 45, end, 50) for x, end in zip(ends[::2], ends[1::2], strict=True)]
    obstacles = [list(shapely.box(*wall).exterior.coords) for wall in walls]
    plane = {"extent": [0, 0, 100, 100], "obstacles": obstacles}
    scenario = parse_scenario(SCENARIO | {"start": [30, 30], "goal": [90, 90], "plane": plane})
    return case_of(scenario)


@pytest.mark.parametrize("mouths", [[(27, 33)], [(18, 23), (34, 40)]])
def test_a_wider_region_cannot_help_out_of_a_harbour_whose_mouths_padding_shuts(
    mouths: list[tuple[float, float]],
) -> None:
    case, options = harbour(*mouths), PlannerOptions(padding=4.0)
    out = plan_case(case, options)
    assert "gap is" in out.failure
    assert not out.is_shut
    back = plan_case(replace(case, start=case.goal, goal=case.start), options)
    assert "gap is" in back.failure
    assert not back.is_shut
    assert plan_case(case, PlannerOptions(padding=1.0)).plan is not None


def test_a_wider_region_can_help_round_walls_that_end_at_the_edge() -> None:
    walls = [[[0, 45], [47, 45], [47, 55], [0, 55]], [[53, 45], [100, 45], [100, 55], [53, 55]]]
    plane = {"extent": [0, 0, 100, 100], "obstacles": walls}
    scenario = parse_scenario(SCENARIO | {"start": [50, 10], "goal": [50, 90], "plane": plane})
    season = plan_case(case_of(scenario), PlannerOptions(padding=8.0))
    assert "gap is" in season.failure
    assert season.is_shut
