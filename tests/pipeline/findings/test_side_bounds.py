"""The other side's bound: below every route there, and above the best if the detour is long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

import renew
from pipeline.findings.other_ways import side_bound
from pipeline.findings.way_names import way_names
from pipeline.model import CaseResult, Measures
from tests.pipeline.formats import small_run
from tests.pipeline.results import rows_of, with_rows


def planned_around(island: shapely.Polygon, speed: float) -> tuple[list[renew.Route], float]:
    """Routes around an island in a current along x, m/s; and the bound of the worse side."""
    like = small_run.parts(planar=True)
    chart = renew.Chart(shapely.box(0, 0, 100, 100), [island])
    water = replace(like.water, chart=chart, land=(island,))
    case = replace(like.planned["gyre"], water=water, current=renew.UniformCurrent(speed, 0.0))
    plan = renew.plan(
        chart, case.current, case.vessel, case.start, case.goal, classes=4, padding="none"
    )
    rows = tuple(
        replace(
            rows_of(like)[0],
            rank=rank,
            homotopy=route.homotopy,
            fuel=route.fuel,
            passages=(),
        )
        for rank, route in enumerate(plan.routes, start=1)
    )
    result = CaseResult("gyre", plan, "", 0.0, measures=Measures(rows))
    names = way_names(water, [result], ())
    bound = side_bound(case, names.name(result), names.islands[0], like.scenario.planner)
    assert bound is not None
    return list(plan.routes), bound


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_no_route_on_the_other_side_is_below_the_bound(speed: float) -> None:
    # Start and goal are (10, 10) and (90, 90): north-west about is much the longer way.
    island = shapely.Polygon([(20, 30), (30, 20), (70, 60), (60, 96), (20, 96)])
    (best, other, *_), bound = planned_around(island, speed)
    assert bound <= other.fuel
    assert best.fuel_bound.value < best.fuel < bound
    # The bound is taken on a grid: a few per cent below the best route there.
    assert bound > 0.9 * other.fuel


def test_nothing_is_proven_of_two_sides_that_are_alike() -> None:
    island = shapely.Polygon([(40, 50), (50, 40), (60, 50), (50, 60)])
    (best, other, *_), bound = planned_around(island, 0.0)
    assert other.fuel == pytest.approx(best.fuel, rel=1e-3)
    assert bound <= best.fuel


def test_cases_without_another_side_have_no_bound() -> None:
    result = with_rows(small_run.parts(), lambda _, row: replace(row, passages=()))
    for case in result.cases:
        options = result.scenario.planner
        assert side_bound(case.case, case.result, result.islands[0], options) is None


def test_the_bound_of_a_real_plan_is_below_its_routes_there() -> None:
    result, found = small_run.parts(), []
    for case in result.cases:
        bound = side_bound(case.case, case.result, result.islands[0], result.scenario.planner)
        if bound is not None:
            best, *others = case.routes
            there = [o for o in others if o.metrics.main_passage != best.metrics.main_passage]
            assert bound <= min(one.route.fuel for one in there)
            assert np.isfinite(bound)
            found.append(bound)
    assert found
