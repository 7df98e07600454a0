"""The other side's bound: below every route there, and above the best if the detour is long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

import renew
from pipeline.findings.other_ways import side_bounds
from pipeline.findings.way_names import with_way_names
from pipeline.model import Evaluation, SeasonPlan
from tests.pipeline.formats import small_run
from tests.pipeline.results import rows_of


def planned_around(island: shapely.Polygon, speed: float) -> tuple[list[renew.Route], float]:
    """Routes around an island in a current along x, m/s; and the bound of the worse side."""
    like = small_run.parts(planar=True)
    chart = renew.Chart(shapely.box(0, 0, 100, 100), [island])
    current = renew.UniformCurrent(speed, 0.0)
    scene = replace(like.scene, chart=chart, land=(island,), currents={"gyre": current})
    plan = renew.plan(
        chart, current, scene.vessel, scene.start, scene.goal, classes=4, padding="none"
    )
    seasons = [SeasonPlan("gyre", plan, "", 0.0)]
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
    evaluation = with_way_names(Evaluation(rows, {}), scene, seasons, ())
    [bound] = side_bounds(scene, seasons, evaluation, like.scenario.planner)
    assert bound.season == "gyre"
    return list(plan.routes), bound.fuel


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


def test_seasons_without_another_side_have_no_bound() -> None:
    result = small_run.parts()
    alone = replace(
        result.evaluation,
        routes=tuple(replace(row, passages=()) for row in rows_of(result)),
    )
    assert side_bounds(result.scene, result.results, alone, result.scenario.planner) == ()


def test_the_bound_of_a_real_plan_is_below_its_routes_there() -> None:
    result = small_run.parts()
    found = side_bounds(result.scene, result.results, result.evaluation, result.scenario.planner)
    assert {bound.season for bound in found} <= {plan.name for plan in result.results}
    for bound in found:
        best, *others = result.case(bound.season).routes
        there = [o for o in others if o.metrics.main_passage != best.metrics.main_passage]
        assert bound.fuel <= min(one.route.fuel for one in there)
        assert np.isfinite(bound.fuel)
    assert found
