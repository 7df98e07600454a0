"""Waits for water to open: as early as an oracle that waits, and never in waves over the limit."""

from __future__ import annotations

import contextlib
import itertools
import math

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew._types import FloatArray
from renew.errors import Moment
from renew.inputs.current import CurrentLike
from renew.inputs.openings import OverLimit
from renew.planner.plan import plan_request, planner_of
from renew.request import Request
from renew.vary.waits import WaitingPlan, plan_waiting
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

LONGEST = 86_400.0
CHART = renew.Chart(box(0, 0, 200, 60))
START, GOAL = (20.0, 30.0), (180.0, 30.0)


def passages_over_the_limit(scene: StormyScene, found: WaitingPlan) -> tuple[int, int]:
    """Fly all parts early, on time and late, with turns: moments over the limit, and all."""
    over = flown = 0
    for part in found.parts:
        route = part.best
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_in_moving_storms_the_arrival_is_that_of_an_oracle(seed: int) -> None:
    scene = stormy_scene(seed)
    found = plan_waiting(scene.request(), LONGEST)
    assert found.arrival <= 1.003 * scene.oracle(spacing=800.0, radius=6)
    over, flown = passages_over_the_limit(scene, found)
    assert flown > 10_000
    assert over == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_no_bound_is_above_an_oracle_that_waits(seed: int) -> None:
    """In moving scenes; shut water and waits make no vessel earlier than the bound says."""
    scene = moving_storms(seed)
    bound = planner_of(scene.request()).problem.fuel_bound.value
    earliest = scene.oracle(spacing=1_500.0, radius=4)
    assert bound <= VESSEL.fuel_rate * (earliest - scene.departure)
    with contextlib.suppress(renew.PlanningError):
        found = plan_waiting(scene.request(), LONGEST)
        # What is shut is no land to the bound: a vessel may pass it at other hours.
        first, *others = (part.best for part in found.parts)
        if not others and first.times[0] == scene.departure:
            assert first.fuel_bound.value == bound
        assert all(one.fuel_bound.value <= one.fuel for one in (first, *others))
        assert bound <= VESSEL.fuel_rate * (found.arrival - scene.departure)


def test_a_way_around_or_behind_a_storm_is_found_without_a_wait() -> None:
    scene = stormy_scene(6)
    plan = plan_request(scene.request())
    assert plan.best.times[-1] <= scene.oracle(spacing=2_000.0, radius=4, waits=False)
    assert plan.shut
    over, flown = passages_over_the_limit(scene, WaitingPlan((plan,), ()))
    assert flown > 10_000
    assert over == 0


def gate(begin: float, end: float, at: float) -> OverLimit:
    """Waves across the whole chart for a while."""
    return OverLimit(box(at, -1, at + 10, 61), begin, end, "waves", 2.0, "m")


def waiting(
    *gates: OverLimit,
    current: CurrentLike | None = None,
    longest: float = LONGEST,
    anchorage: shapely.Polygon | None = None,
) -> WaitingPlan:
    request = Request.of(
        CHART,
        renew.UniformCurrent(0.0, 0.0) if current is None else current,
        PAPER_VESSEL,
        (START, GOAL),
        avoid=gates,
        changes={"classes": 2, "lateness": 0.0},
    )
    return plan_waiting(request, longest, tick=1.0, anchorage=anchorage)


def test_a_gate_is_waited_for_at_the_start() -> None:
    """It opens at 500 s, 75 m from the start at 1 m/s, and a turn reaches out before it."""
    found = waiting(gate(0.0, 500.0, 95.0))
    assert len(found.parts) == 1
    (wait,) = found.waits
    assert wait.begin == 0.0
    assert wait.fuel == 0.0
    np.testing.assert_array_equal(wait.place, START)
    assert 500.0 + 85.0 <= found.arrival <= 500.0 + 95.0


def test_between_two_gates_the_vessel_holds_its_place() -> None:
    """The first shuts before the second opens: it has to wait in between, against the current."""
    flow = renew.UniformCurrent(0.3, 0.0)
    found = waiting(gate(60.0, 2_000.0, 50.0), gate(0.0, 1_000.0, 150.0), current=flow)
    assert len(found.parts) == 2
    (wait,) = found.waits
    assert 60.0 < wait.place[0] < 150.0
    assert wait.fuel == pytest.approx(0.3**2 * (wait.end - wait.begin))
    assert found.arrival <= 1_000.0 + 40.0
    assert found.fuel == pytest.approx(wait.fuel + sum(one.best.fuel for one in found.parts))


def test_no_wait_is_longer_than_allowed() -> None:
    request = Request.of(
        CHART,
        renew.UniformCurrent(0.0, 0.0),
        PAPER_VESSEL,
        (START, GOAL),
        avoid=[gate(0.0, 5_000.0, 95.0)],
        changes={"classes": 2},
    )
    with pytest.raises(renew.UnreachableError, match=r"waves of up to 2\.0 m from 0 s until 5000"):
        plan_waiting(request, 1_000.0)


def test_an_unreached_limit_leaves_the_plan_as_it_is() -> None:
    scene = stormy_scene(5)
    request = scene.request()
    far = OverLimit(box(0, 0, 1, 1), -math.inf, -1e6, "waves", 2.0, "m")
    asked = Request.of(
        scene.chart,
        scene.current,
        VESSEL,
        (scene.start, scene.goal),
        avoid=[far],
        changes={"classes": 4, "lateness": LATENESS},
    )
    plain = renew.plan(
        scene.chart, scene.current, VESSEL, scene.start, scene.goal, options=request.options
    )
    found = plan_waiting(asked, LONGEST)
    assert found.waits == ()
    for one, other in zip(found.parts[0].routes, plain.routes, strict=True):
        np.testing.assert_array_equal(one.trajectory, other.trajectory)
        assert one.fuel_bound.value == other.fuel_bound.value


@pytest.mark.parametrize("longest", [0.0, 1_000.0])
def test_a_start_that_stays_shut_is_refused_without_a_search(
    longest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hours of two spells that follow each other count together."""
    monkeypatch.setattr("renew.planner.plan.plan_classes", None)
    monkeypatch.setattr("renew.vary.waits.clock_way", None)
    first, then = gate(-100.0, 1_100.0, 15.0), gate(1_100.0, 1_800.0, 15.0)
    told = r"the start \(20, 30\) m lies in water with waves of up to 2\.0 m from .* until 1100 s; "
    with pytest.raises(renew.UnreachableError, match=told + r".*Depart after 1800 s, or let the"):
        waiting(first, then, longest=longest)
    for_ever = r"start .* It does not open again: move it"
    with pytest.raises(renew.UnreachableError, match=for_ever) as refused:
        waiting(gate(-100.0, math.inf, 15.0), longest=longest)
    # No date can be told of what never comes.
    assert all(math.isfinite(one.seconds) for one in refused.value.text.values_of(Moment))


def test_a_start_that_opens_within_the_wait_is_left_then() -> None:
    found = waiting(gate(-100.0, 900.0, 15.0))
    assert found.parts[0].best.times[0] == pytest.approx(900.0, abs=20.0)


def test_it_waits_where_that_takes_least_fuel_at_anchor_at_best() -> None:
    """Between two gates the current falls to the east; an anchorage is cheaper still."""
    gates = gate(60.0, 2_000.0, 50.0), gate(0.0, 1_000.0, 150.0)

    def flow(points: FloatArray) -> FloatArray:
        return np.stack([0.5 - points[..., 0] / 400.0, np.zeros(points.shape[:-1])], axis=-1)

    (held,) = waiting(*gates, current=flow).waits
    assert 95.0 < held.place[0] < 150.0
    assert not held.at_anchor
    anchorage = box(85.0, 0.0, 100.0, 60.0)
    (anchored,) = waiting(*gates, current=flow, anchorage=anchorage).waits
    assert shapely.intersects_xy(anchorage, *anchored.place)
    assert anchored.at_anchor
    assert anchored.fuel == 0.0 < held.fuel
