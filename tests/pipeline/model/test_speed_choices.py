"""Speeds chosen by a whole run: in time at true scale, and all figures by the speeds sailed."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

import renew
from pipeline.findings.other_ways import side_bounds
from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import legs
from pipeline.model.case import speed_choices, true_duration_s
from pipeline.scenario.model import PlannerOptions
from pipeline.scenario.season import Season
from pipeline.stages.project import project
from pipeline.stages.seasons.one_season import combine_seasons, evaluate_season, plan_season
from pipeline.stages.seasons.task import clock_worth, gap_shares, speeds_in_time
from tests.pipeline import chosen_speeds
from tests.pipeline.results import rows_of
from tests.pipeline.tidal_run import DEPARTURE, planned


@pytest.fixture(scope="module")
def result() -> RunResult:
    return chosen_speeds.planned()


def test_every_route_is_in_time_at_true_scale_and_the_best_one_just_so(result: RunResult) -> None:
    routes = [row for row in rows_of(result) if row.season == "chosen"]
    assert len(routes) > 1
    within_s = chosen_speeds.WITHIN.total_seconds()
    assert max(row.duration_s for row in routes) <= within_s
    assert routes[0].duration_s >= (1 - 2e-3) * within_s
    assert result.scene.vessel_in("chosen").speed == chosen_speeds.SPEEDS[1]
    assert result.scene.vessel_in("own") is result.cases[0].case.vessel


def test_the_routes_are_those_of_renew(result: RunResult) -> None:
    entry = result.results[0]
    assert entry.plan is not None
    assert entry.arrive_by_s is not None
    plan = chosen_speeds.plan_by_renew(result, entry.arrive_by_s)
    assert entry.plan.best.fuel == plan.best.fuel
    assert np.ptp(plan.best.speeds) > 0
    for row, route in zip(rows_of(result), entry.plan.routes, strict=False):
        dt = np.diff(route.times)
        assert row.speed_m_s == pytest.approx((route.speeds * dt).sum() / dt.sum())
        # The figure at the chosen speeds, not that at the vessel's own speed.
        assert row.fuel == pytest.approx((route.speeds**2 * dt).sum(), rel=1e-6)
        assert row.collisions == 0
        assert row.trials > 0


def test_a_choice_of_speeds_saves_fuel_beside_one_speed_in_the_same_time(result: RunResult) -> None:
    """The least constant speed that arrives in time along the same path takes more fuel."""
    scene, plan = result.scene, result.results[0].plan
    assert plan is not None
    best = plan.best
    low, high = chosen_speeds.SPEEDS
    for _ in range(40):
        speed = (low + high) / 2
        vessel = replace(scene.vessel, speed=speed)
        duration = renew.fuel(best.path, scene.currents["chosen"], vessel, drift="crab") / speed**2
        low, high = (low, speed) if duration <= best.duration else (speed, high)
    constant = renew.fuel(
        best.path, scene.currents["chosen"], replace(scene.vessel, speed=high), drift="crab"
    )
    assert best.fuel < constant


def test_the_parts_of_the_gap_add_up_with_speeds(result: RunResult) -> None:
    plan = result.results[0].plan
    assert plan is not None
    found = gap_shares(result.scene, result.results[0], result.scenario.planner)
    assert found is not None
    assert min(found.chart, found.padding, found.bound) >= 0
    whole = found.chart + found.padding + found.bound
    assert whole == pytest.approx(plan.best.optimality_gap)


def test_a_bound_of_the_other_side_is_below_its_routes(result: RunResult) -> None:
    bounds = side_bounds(result.scene, result.results, result.evaluation, result.scenario.planner)
    by_season = {bound.season: bound.fuel for bound in bounds}
    rows = [row for row in rows_of(result) if row.season == "chosen"]
    others = [row.fuel for row in rows if row.main_passage != rows[0].main_passage]
    assert others
    assert 0.5 * min(others) < by_season["chosen"] <= min(others)


def test_where_the_planes_scale_varies_it_is_planned_closer(result: RunResult) -> None:
    """On a plane whose scale grows by 2 % along the way the vessel does not come 2 % early."""
    asked = result.scenario
    scene = chosen_speeds.stretched(result.scene)
    plan = plan_season(scene, "chosen", asked.planner)
    assert plan.plan is not None
    durations = [true_duration_s(route, scene, "chosen") for route in plan.plan.routes]
    within_s = scene.speeds["chosen"].within_s
    assert max(durations) <= within_s
    assert durations[0] >= (1 - 1e-3) * within_s
    assert plan.arrive_by_s > 1.005 * within_s * 0.98


def test_an_arrival_that_cannot_be_made_is_refused_with_dates(result: RunResult) -> None:
    speeds = {"chosen": replace(result.scene.speeds["chosen"], within_s=1800.0)}
    plan = plan_season(replace(result.scene, speeds=speeds), "chosen", result.scenario.planner)
    assert plan.plan is None
    assert plan.failure.startswith("arrive_by = 2026-11-22 06:50 UTC can't be made")
    assert "a departure at 2026-11-22 06:20 UTC arrives at 2026-11-22 0" in plan.failure
    assert "let speed reach" in plan.failure


def test_a_plan_without_a_clock_is_sailed_in_time() -> None:
    """In a turning tide its speeds get the least factor at which it arrives in time."""
    result = planned()
    route, current = result.routes[0].route, result.case("tide").case.current
    choice = chosen_speeds.choice()
    by = 1.2 * route.duration
    speeds = speeds_in_time(route, current, choice, by, "crab")
    assert speeds is not None
    vessel = replace(result.cases[0].case.vessel, speed=choice.most)
    unit = replace(vessel, fuel_coefficient=1.0, fuel_exponent=1e-9)
    taken = renew.fuel(route.path, current, unit, drift="crab", speeds=speeds)
    assert taken == pytest.approx(by, rel=1e-5)
    assert speeds_in_time(route, current, choice, 0.3 * route.duration, "crab") is None


def test_a_refusal_of_the_planner_is_reported_for_the_season() -> None:
    """Whether or not renew plans speeds where currents change, a reason or a route is given."""
    result = planned()
    season = {
        **result.scenario.seasons[0].model_dump(exclude_none=True),
        "arrive_by": (DEPARTURE + timedelta(hours=6)).isoformat(),
        "speed": {"least": 1.0, "most": 3.0},
    }
    scenario = result.scenario.model_copy(update={"seasons": (Season.model_validate(season),)})
    scene = project(scenario, result.fetched, result.simplified)
    assert scene.speeds == speed_choices(scenario)
    plan = plan_season(scene, "tide", scenario.planner)
    if plan.plan is None:
        assert "speed" in plan.failure
        return
    # On the current's own clock: in time, and every leg as the planner has it.
    evaluated = evaluate_season(scene, plan, PlannerOptions(drift="crab"))
    assert max(row.duration_s for row in evaluated.routes) <= scene.speeds["tide"].within_s
    worth = clock_worth(scene, plan, scenario.planner)
    assert worth is not None
    assert worth.in_time
    assert min(worth.frozen, worth.mean, worth.shortest) >= worth.best * (1 - 1e-3)
    by_speeds = replace(
        result,
        scenario=scenario,
        scene=scene,
        plans=(plan,),
        evaluation=combine_seasons([evaluated]),
    )
    best = by_speeds.case("tide").routes[0]
    assert legs(best).time_s == pytest.approx(best.route.times, abs=1.0)
