"""Plans with covered routes alone: what stays as it is, what is planned again, what is refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from shapely import box

import renew
from tests.strategies import PAPER_VESSEL, random_scene, single_gyre

CURRENT = renew.UniformCurrent(0.2, 0.0)
NORTH = [renew.Haven(f"north {x:.0f}", np.array([x, 150.0])) for x in (20.0, 100, 180)]


def long_island() -> tuple[renew.Chart, renew.Plan]:
    """Return a chart whose island lies between havens and the cheaper way, and a plan on it."""
    chart = renew.Chart(box(0, 0, 200, 160), [box(70, 60, 130, 100)])
    return chart, renew.plan(chart, CURRENT, PAPER_VESSEL, (20.0, 75.0), (180.0, 75.0))


@pytest.fixture(scope="module")
def island() -> tuple[renew.Chart, renew.Plan]:
    return long_island()


def random_plan(seed: int) -> tuple[renew.Plan, list[renew.Haven]]:
    """Return a plan in a seeded scene, and its ends as havens."""
    chart, current, start, goal = random_scene(seed)
    plan = renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=2)
    return plan, [renew.Haven("start", np.array(start)), renew.Haven("goal", np.array(goal))]


def test_a_covered_best_route_stays_as_it_is(island: tuple[renew.Chart, renew.Plan]) -> None:
    gyre, current = single_gyre()
    in_gyre = renew.plan(gyre, current, PAPER_VESSEL, (10.0, 10.0), (90.0, 90.0))
    corner = [renew.Haven("corner", np.array([85.0, 15.0]))]
    scenes = [(island[1], NORTH), (in_gyre, corner), random_plan(1)]
    for plan, havens in scenes:
        whole = renew.only_covered(plan, havens, within=4 * plan.best.duration)
        assert whole.best is not None
        for name in ("path", "trajectory", "times"):
            assert np.array_equal(getattr(whole.best, name), getattr(plan.best, name))
        assert whole.best.fuel == plan.best.fuel
        assert whole.best.homotopy == plan.best.homotopy
        assert whole.best.fuel_bound.value == plan.best.fuel_bound.value


def test_another_class_is_taken_where_the_cheapest_is_not_covered(
    island: tuple[renew.Chart, renew.Plan],
) -> None:
    chart, plan = island
    within = 95.0
    found = renew.only_covered(plan, NORTH, within=within)
    assert plan.best.homotopy != found.best.homotopy
    assert found.best.fuel > plan.best.fuel
    again = renew.cover(found.best, chart, CURRENT, PAPER_VESSEL, NORTH, within=within)
    assert again.is_covered
    # The bound holds for covered routes alone: it may lie above the fuel of others.
    assert found.best.fuel_bound.value <= found.best.fuel
    assert found.best.fuel_bound.value >= plan.best.fuel_bound.value * (1 - 1e-6)
    (rejected,) = [one for one in found.rejected if one.homotopy == plan.best.homotopy]
    needed = re.fullmatch(
        r"not covered: from \(.*\) m no haven is reached within 95 s; with ([\d.]+) s the route is "
        r"covered",
        rejected.reason,
    )
    assert needed is not None
    enough = renew.cover(
        plan.best, chart, CURRENT, PAPER_VESSEL, NORTH, within=float(needed.group(1)) * 1.001
    )
    assert enough.is_covered


def test_a_route_is_moved_towards_havens_in_its_own_class() -> None:
    chart = renew.Chart(box(0, 0, 160, 110))
    plan = renew.plan(chart, CURRENT, PAPER_VESSEL, (20.0, 40.0), (140.0, 40.0))
    places = ((20, 45), (80, 90), (140, 45))
    havens = [renew.Haven(f"at {x} m", np.array([x, y], dtype=float)) for x, y in places]
    within = 44.0
    before = renew.cover(plan.best, chart, CURRENT, PAPER_VESSEL, havens, within=within)
    assert not before.is_covered
    found = renew.only_covered(plan, havens, within=within)
    assert found.best.fuel > plan.best.fuel
    assert found.best.homotopy == plan.best.homotopy
    after = renew.cover(found.best, chart, CURRENT, PAPER_VESSEL, havens, within=within)
    assert after.is_covered
    assert plan.best.fuel_bound.value <= found.best.fuel_bound.value <= found.best.fuel


def test_where_no_class_is_covered_the_error_says_what_would_do(
    island: tuple[renew.Chart, renew.Plan],
) -> None:
    with pytest.raises(renew.UncoveredError, match="no route is covered: class ") as caught:
        renew.only_covered(island[1], NORTH, within=30.0)
    assert "no haven is reached within 30 s; with " in str(caught.value)
    assert caught.value.causes
    assert caught.value.places


@pytest.mark.parametrize(
    ("given", "words"),
    [({}, "no limit is given"), ({"within": 1.0}, "one full turn"), ({"within": math.inf}, "inf")],
)
def test_limits_are_refused_as_by_cover(
    island: tuple[renew.Chart, renew.Plan], given: dict[str, Any], words: str
) -> None:
    with pytest.raises(renew.ParameterError, match=words):
        renew.only_covered(island[1], NORTH, **given)


def test_plans_that_ways_to_havens_do_not_know_are_refused(
    island: tuple[renew.Chart, renew.Plan],
) -> None:
    chart, plan = island
    with pytest.raises(renew.ParameterError, match=r"plan\.voyage = None: a plan that was pickled"):
        renew.only_covered(replace(plan, voyage=None), NORTH, within=95.0)
    area = renew.ShutArea(box(190, 0, 199, 9), 0.0, 9.0, "range")
    shut = renew.plan(
        chart, CURRENT, PAPER_VESSEL, (20.0, 75.0), (180.0, 75.0), avoid=[area], classes=1
    )
    with pytest.raises(renew.ParameterError, match="plan without them"):
        renew.only_covered(shut, NORTH, within=95.0)
    with pytest.raises(renew.ParameterError, match=r"plan = .* must be a renew\.Plan"):
        renew.only_covered(cast("Any", plan.best), NORTH, within=95.0)
