"""Ways past wind and waves over a limit: never in them, and as early as an oracle's."""

import contextlib
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew.errors import Moment
from renew.inputs.openings import OverLimit
from renew.planner.plan import plan_request, planner_of
from renew.request import Request
from tests.stormy_waters import (
    LATENESS,
    LIMIT,
    VESSEL,
    StormyScene,
    moving_storms,
    stormy_scene,
)
from tests.strategies import PAPER_VESSEL, Scene
from tests.tidal_waters import positions

CHART = renew.Chart(box(0, 0, 200, 60))
START, GOAL = (20.0, 30.0), (180.0, 30.0)


def passages_over_the_limit(scene: StormyScene, route: renew.Route) -> tuple[int, int]:
    """Fly a route early, on time and late, with turns: moments over the limit, and all."""
    over = flown = 0
    start, goal = route.path[[0, -1]]
    sailed = Scene(scene.chart, scene.current, start, goal, vessel=VESSEL)
    begin, end = route.trajectory[[0, -1], 0].tolist()
    along = np.arange(begin, end, 60.0)
    late = LATENESS * (along - route.times[0])
    for share, side in itertools.product((-1.0, -0.5, 0.0, 0.5, 1.0), (1.0, -1.0)):
        for place, now in positions(route, sailed, along, share * late, side, 2.0):
            inside = shapely.contains_xy(scene.chart.extent, place)
            over += int((scene.height(place, now) > LIMIT + 1e-9)[inside].sum())
            flown += int(inside.sum())
    return over, flown


@pytest.mark.parametrize(
    "seed", [6, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 3, 8, 11))]
)
def test_a_way_around_or_behind_a_storm_is_found(seed: int) -> None:
    scene = stormy_scene(seed)
    earliest = scene.oracle(spacing=2_000.0, radius=4, waits=False)
    try:
        plan = plan_request(scene.request())
    except renew.PlanningError:
        assert math.isinf(earliest)
        return
    assert plan.best.times[-1] <= earliest
    over, flown = passages_over_the_limit(scene, plan.best)
    assert flown > 10_000
    assert over == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_no_bound_is_above_an_oracle_that_waits(seed: int) -> None:
    """In moving scenes; shut water and waits make no vessel earlier than the bound says."""
    scene = moving_storms(seed)
    bound = planner_of(scene.request()).problem.fuel_bound.value
    earliest = scene.oracle(spacing=1_500.0, radius=4)
    assert bound <= VESSEL.fuel_rate * (earliest - scene.departure)
    with contextlib.suppress(renew.PlanningError):
        # What is shut is no land to the bound: a vessel may pass it at other hours.
        assert plan_request(scene.request()).best.fuel_bound.value == bound


def gate(begin: float, end: float, at: float) -> OverLimit:
    """Waves across the whole chart for a while."""
    return OverLimit(box(at, -1, at + 10, 61), begin, end, "waves", 2.0, "m")


def planned(*gates: OverLimit) -> renew.Plan:
    request = Request.of(
        CHART,
        renew.UniformCurrent(0.0, 0.0),
        PAPER_VESSEL,
        (START, GOAL),
        avoid=gates,
        changes={"classes": 2, "lateness": 0.0},
    )
    return plan_request(request)


def test_a_gate_that_stays_shut_is_named_with_its_hours() -> None:
    with pytest.raises(renew.UnreachableError, match=r"waves of up to 2\.0 m from 0 s until 5000"):
        planned(gate(0.0, 5_000.0, 95.0))
    unknown = replace(gate(0.0, 5_000.0, 95.0), name="wind", most=math.inf)
    assert str(unknown.text(0.0)).startswith("water with unknown wind from 0 s")


def test_a_start_that_is_shut_is_refused_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hours of two spells that follow each other count together."""
    monkeypatch.setattr("renew.planner.plan.plan_classes", None)
    first, then = gate(-100.0, 1_100.0, 15.0), gate(1_100.0, 1_800.0, 15.0)
    told = r"the start \(20, 30\) m lies in water with waves of up to 2\.0 m from .* until 1100 s; "
    with pytest.raises(renew.UnreachableError, match=told + r".*Depart after 1800 s"):
        planned(first, then)
    for_ever = r"start .* It does not open again: move it"
    with pytest.raises(renew.UnreachableError, match=for_ever) as refused:
        planned(gate(-100.0, math.inf, 15.0))
    unknown = replace(gate(1_800.0, math.inf, 15.0), most=math.inf)
    with pytest.raises(renew.UnreachableError, match=r"\. No more is known: give a forecast that"):
        planned(first, then, unknown)
    # No date can be told of what never comes.
    assert all(math.isfinite(one.seconds) for one in refused.value.text.values_of(Moment))


def test_an_unreached_limit_leaves_the_plan_as_it_is() -> None:
    scene = stormy_scene(5)
    options = scene.request().options
    far = OverLimit(box(0, 0, 1, 1), -math.inf, -1e6, "waves", 2.0, "m")
    given = scene.chart, scene.current, VESSEL, scene.start, scene.goal
    plain = renew.plan(*given, options=options)
    found = renew.plan(*given, avoid=[far], options=options)
    for one, other in zip(found.routes, plain.routes, strict=True):
        np.testing.assert_array_equal(one.trajectory, other.trajectory)
        assert one.fuel_bound.value == other.fuel_bound.value
