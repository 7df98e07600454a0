"""Speeds chosen by a whole run: in time at true scale, and all figures by the speeds sailed."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

import renew
from pipeline.findings.other_ways import side_bound
from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import legs
from pipeline.model.case import true_duration_s
from pipeline.scenario.season import Season
from pipeline.stages.measure import clock_worth, gap_shares, speeds_in_time
from pipeline.stages.plan_case import plan_case, planned as planned_case
from pipeline.stages.project import project
from tests.pipeline import chosen_speeds
from tests.pipeline.tidal_run import DEPARTURE, planned


@pytest.fixture(scope="module")
def result() -> RunResult:
    return chosen_speeds.planned()


def test_every_route_is_in_time_at_true_scale_and_the_best_one_just_so(result: RunResult) -> None:
    routes = result.case("chosen").measures.routes
    assert len(routes) > 1
    within_s = chosen_speeds.WITHIN.total_seconds()
    assert max(row.duration_s for row in routes) <= within_s
    assert routes[0].duration_s >= (1 - 2e-3) * within_s
    assert result.planned["chosen"].vessel.speed == chosen_speeds.SPEEDS[1]
    assert result.planned["own"].vessel.speed == result.scenario.vessel.speed_m_s


def test_the_routes_are_those_of_renew(result: RunResult) -> None:
    entry = result.results[0]
    assert entry.plan is not None
    assert entry.arrive_by_s is not None
    plan = chosen_speeds.plan_by_renew(result, entry.arrive_by_s)
    assert entry.plan.best.fuel == plan.best.fuel
    assert np.ptp(plan.best.speeds) > 0
    for row, route in zip(entry.measures.routes, entry.plan.routes, strict=True):
        dt = np.diff(route.times)
        assert row.speed_m_s == pytest.approx((route.speeds * dt).sum() / dt.sum())
        # The figure at the chosen speeds, not that at the vessel's own speed.
        assert row.fuel == pytest.approx((route.speeds**2 * dt).sum(), rel=1e-6)
        assert row.collisions == 0
        assert row.trials > 0


def test_a_choice_of_speeds_saves_fuel_beside_one_speed_in_the_same_time(result: RunResult) -> None:
    """The least constant speed that arrives in time along the same path takes more fuel."""
    case, plan = result.planned["chosen"], result.results[0].plan
    assert plan is not None
    best = plan.best
    low, high = chosen_speeds.SPEEDS
    for _ in range(40):
        speed = (low + high) / 2
        vessel = replace(case.vessel, speed=speed)
        duration = renew.fuel(best.path, case.current, vessel, drift="crab") / speed**2
        low, high = (low, speed) if duration <= best.duration else (speed, high)
    vessel = replace(case.vessel, speed=high)
    constant = renew.fuel(best.path, case.current, vessel, drift="crab")
    assert best.fuel < constant


def test_the_parts_of_the_gap_add_up_with_speeds(result: RunResult) -> None:
    plan = result.results[0].plan
    assert plan is not None
    found = gap_shares(result.planned["chosen"], result.results[0], result.scenario.planner)
    assert found is not None
    assert min(found.chart, found.padding, found.bound) >= 0
    whole = found.chart + found.padding + found.bound
    assert whole == pytest.approx(plan.best.optimality_gap)


def test_a_bound_of_the_other_side_is_below_its_routes(result: RunResult) -> None:
    case = result.case("chosen")
    bound = side_bound(case.case, case.result, result.islands[0], result.scenario.planner)
    assert bound is not None
    rows = case.measures.routes
    others = [row.fuel for row in rows if row.main_passage != rows[0].main_passage]
    assert others
    assert 0.5 * min(others) < bound <= min(others)


def test_where_the_planes_scale_varies_it_is_planned_closer(result: RunResult) -> None:
    """On a plane whose scale grows by 2 % along the way the vessel does not come 2 % early."""
    asked = result.scenario
    case = chosen_speeds.stretched(result.planned["chosen"])
    plan = planned_case(case, asked.planner)
    assert plan.plan is not None
    durations = [true_duration_s(route, case) for route in plan.plan.routes]
    within_s = chosen_speeds.choice().within_s
    assert max(durations) <= within_s
    assert durations[0] >= (1 - 1e-3) * within_s
    assert plan.arrive_by_s > 1.005 * within_s * 0.98


def test_an_arrival_that_cannot_be_made_is_refused_with_dates(result: RunResult) -> None:
    speeds = replace(chosen_speeds.choice(), within_s=1800.0)
    hurried = replace(result.planned["chosen"], speeds=speeds)
    plan = planned_case(hurried, result.scenario.planner)
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
    (case,) = project(scenario, result.fetched, result.simplified)
    speeds = case.speeds
    assert speeds is not None
    found = plan_case(case, scenario.planner)
    if found.plan is None:
        assert "speed" in found.failure
        return
    # On the current's own clock: in time, and every leg as the planner has it.
    assert max(row.duration_s for row in found.measures.routes) <= speeds.within_s
    worth = clock_worth(case, found, scenario.planner)
    assert worth is not None
    assert worth.in_time
    assert min(worth.frozen, worth.mean, worth.shortest) >= worth.best * (1 - 1e-3)
    by_speeds = replace(result, scenario=scenario, planned={"tide": case}, results=(found,))
    best = by_speeds.case("tide").routes[0]
    assert legs(best).time_s == pytest.approx(best.route.times, abs=1.0)
