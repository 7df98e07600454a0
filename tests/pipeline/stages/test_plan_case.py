"""A season's plan keeps the planner's order, and its ranks put the route to take first."""

import itertools
import os
import re
import signal
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import shapely

import renew
from pipeline.errors import StageError
from pipeline.findings.other_ways import side_bound
from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import legs
from pipeline.geo.projection import Projection
from pipeline.model import Case, CaseResult
from pipeline.run import run
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.scenario.season import Season
from pipeline.stages.plan_case import plan_case, planned as planned_case, reason_text
from pipeline.stages.project import project
from renew.errors import InfeasibleError, Strait, Text
from tests.pipeline import chosen_speeds
from tests.pipeline.planar_cases import case_of
from tests.pipeline.processes import (
    QUICK,
    SLOW,
    descendants,
    renew as renew_command,
    started,
    wait_until,
)
from tests.pipeline.results import rows_of
from tests.pipeline.tidal_run import DEPARTURE, planned

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
        case = case_of(scenario)
        if (plan := planned_case(case, scenario.planner).plan) is not None and plan.chosen != 0:
            break
    else:
        raise AssertionError("no seed makes the sampled method choose another route than the first")
    season = plan_case(case, scenario.planner)
    assert season.plan is not None
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
    assert "the gap at (50, 45) m is 6.00 m wide" in in_plane
    projection = Projection.at(118.5, 9.75)
    water = replace(case.water, is_planar=False, projection=projection)
    in_degrees = plan_case(replace(case, water=water), scenario.planner).failure
    found = re.search(r"the gap at ([\d.]+) E ([\d.]+) N", in_degrees)
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


def test_where_no_water_joins_the_ends_the_remedy_is_one_of_the_command() -> None:
    case, wall = harbour((18, 40)), shapely.box(0, 45, 100, 55)
    chart = renew.Chart(case.chart.extent, [wall])
    with pytest.raises(renew.UnreachableError) as refused:
        renew.plan(chart, case.current, case.vessel, (50, 10), (50, 90))
    failure = reason_text(refused.value, case)
    assert "Move one of the two, or give a chart of more water between them (--charts)" in failure


@pytest.mark.parametrize("mouths", [[(27, 33)], [(18, 23), (34, 40)]])
def test_a_wider_region_cannot_help_out_of_a_harbour_whose_mouths_padding_shuts(
    mouths: list[tuple[float, float]],
) -> None:
    case, options = harbour(*mouths), PlannerOptions(padding=4.0)
    out = plan_case(case, options)
    assert "the gap at" in out.failure
    assert not out.is_shut
    back = plan_case(replace(case, start=case.goal, goal=case.start), options)
    assert "the gap at" in back.failure
    assert not back.is_shut
    assert plan_case(case, PlannerOptions(padding=1.0)).plan is not None


def test_a_refusal_has_one_reason_and_a_remedy_that_helps() -> None:
    case, options = harbour((18, 23), (34, 40)), PlannerOptions(padding=4.0)
    failure = plan_case(case, options).failure
    assert len(failure) <= 300
    assert failure.count("the gap at") == 1
    assert not re.search(r"class|\b[ps]\d+\b", failure)
    # The wider of the two mouths is named, and the padding that is told leaves a route through it.
    found = re.search(
        r"at \((.*), .*\) m is 6.00 m wide.*padding = ([\d.]+).*\(--padding, ", failure
    )
    assert found is not None
    assert 34 <= float(found[1]) <= 40
    assert plan_case(case, PlannerOptions(padding=float(found[2]), clearance=0.0)).plan is not None


def test_a_gap_along_a_strait_is_not_told_to_be_too_narrow() -> None:
    """Its width, along the strait, is more than is needed: another is named, if there is one."""
    along = Strait(np.array([[10.0, 10.0], [10.0, 60.0]]), -1, 0, 1, 8.0, 8.0)
    across = Strait(np.array([[40.0, 10.0], [40.0, 20.0]]), -1, 0, 1, 8.0, 8.0)
    for straits, said in (
        ((along, across), "the gap at (40, 15) m is 10.0 m wide, and 16.0 m are needed"),
        ((along,), "the strait at (10, 35) m is shut by the padding along its banks"),
    ):
        error = renew.UnreachableError("{0}. To find a route: {1}", Text("all"), Text("none"))
        error.causes, error.straits = tuple(map(InfeasibleError.at_strait, straits)), straits
        assert reason_text(error, harbour((18, 40))).startswith(f"no way has room: {said};")
        # Another class, which something else shuts, is not named in its place.
        error.causes, error.straits = (InfeasibleError("no turn"), *error.causes), ()
        assert reason_text(error, harbour((18, 40))).startswith(f"no way has room: {said};")


def among_islets() -> Case:
    """A case that begins at the middle of eight islets in open water, 14 m apart."""
    middles = [(x, y) for x in (30, 50, 70) for y in (50, 70, 90) if (x, y) != (50, 70)]
    boxes = [shapely.box(x - 3, y - 3, x + 3, y + 3) for x, y in middles]
    plane = {"extent": [0, 0, 200, 140], "obstacles": [[*one.exterior.coords] for one in boxes]}
    return case_of(
        parse_scenario(SCENARIO | {"start": [50, 70], "goal": [190, 70], "plane": plane})
    )


def test_a_clearance_that_shuts_a_start_in_is_refused_at_once_with_the_largest() -> None:
    """No wider region helps, and none is tried; the clearance that is named leaves a way."""
    # Open water is 46.8 m off, less than twice the clearance; islets shut all straight legs there.
    case, asked = among_islets(), PlannerOptions(clearance=23.8)
    out = plan_case(case, asked)
    assert not out.is_shut
    found = re.search(r"clearance = ([\d.]+) .* \(--clearance ([\d.]+)m\)", out.failure)
    assert found is not None
    assert float(found[1]) == float(found[2])
    assert "padding = " not in out.failure
    assert plan_case(case, PlannerOptions(clearance=float(found[1]))).plan is not None
    assert plan_case(case, PlannerOptions(clearance=1.03 * float(found[1]))).plan is None


def test_a_wider_region_can_help_round_walls_that_end_at_the_edge() -> None:
    walls = [[[0, 45], [47, 45], [47, 55], [0, 55]], [[53, 45], [100, 45], [100, 55], [53, 55]]]
    plane = {"extent": [0, 0, 100, 100], "obstacles": walls}
    scenario = parse_scenario(SCENARIO | {"start": [50, 10], "goal": [50, 90], "plane": plane})
    season = plan_case(case_of(scenario), PlannerOptions(padding=8.0))
    assert "the gap at" in season.failure
    assert season.is_shut


# --- Seasons with a time limit run in processes that end at the limit, or with the program ---


def scenario_of_text(text: str) -> Scenario:
    """Return the scenario of a text."""
    import tomllib

    return parse_scenario(tomllib.loads(text))


@pytest.mark.slow
@pytest.mark.usefixtures("plain_report")
def test_a_limit_that_is_not_reached_changes_nothing(tmp_path: Path) -> None:
    outcomes = [
        run(scenario_of_text(QUICK), tmp_path / "a", limit_s=300),
        run(scenario_of_text(QUICK), tmp_path / "b"),
    ]
    assert [outcome.exit_code for outcome in outcomes] == [0, 0]
    # Compared as texts, since NaN (not known) differs from itself.
    assert repr(rows_of(outcomes[0].result)) == repr(rows_of(outcomes[1].result))


@pytest.mark.usefixtures("plain_report")
def test_a_season_past_its_limit_fails_and_the_others_are_written(tmp_path: Path) -> None:
    """The first season's plan lies in the store already."""
    both = scenario_of_text(SLOW.replace("classes = 9000", "classes = 1"))
    only_first = both.model_copy(update={"seasons": both.seasons[:1]})
    assert run(only_first, tmp_path).exit_code == 0
    before = descendants(os.getpid())  # other tests' clusters
    outcome = run(both, tmp_path, limit_s=0.5)
    assert outcome.exit_code == 1
    assert outcome.failures == ("season 'second': took longer than the limit of 0.5 s",)
    assert "first" in (tmp_path / "slow" / "metrics.csv").read_text()
    assert descendants(os.getpid()) <= before


def test_no_season_within_its_limit_is_a_failure(tmp_path: Path) -> None:
    with pytest.raises(StageError, match=r"took longer than the limit of 0\.5 s"):
        run(scenario_of_text(QUICK), tmp_path, limit_s=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_season_processes_end_with_the_program(tmp_path: Path, number: int) -> None:
    (tmp_path / "slow.toml").write_text(SLOW)
    command = renew_command(
        "run", str(tmp_path / "slow.toml"), "--limit", "600", "--output", str(tmp_path)
    )
    with started(*command) as process:
        wait_until(lambda: len(descendants(process.pid)) >= 1)
        children = descendants(process.pid)
        process.send_signal(number)
        process.wait(5)
        wait_until(lambda: not any(os.path.exists(f"/proc/{child}/exe") for child in children), 5)  # noqa: PTH110


# --- Speeds chosen by a whole run: in time at true scale, and all figures by the speeds sailed ---


@pytest.fixture(scope="module")
def result() -> RunResult:
    return chosen_speeds.planned()


@pytest.mark.slow
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
    durations = [route.duration * case.projection.scale for route in plan.plan.routes]
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


@pytest.mark.slow
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
    by_speeds = replace(result, scenario=scenario, planned={"tide": case}, results=(found,))
    best = by_speeds.case("tide").routes[0]
    assert legs(best).time_s == pytest.approx(best.route.times, abs=1.0)
