"""The choice of speeds while the current changes on the way."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shapely import box

import renew
from renew._types import FloatArray
from renew.inputs.current import as_field
from tests.moving_waters import MovingScene, moving_scene
from tests.speed_oracles import CostModel, improved, least_fuel_in_table
from tests.strategies import PAPER_VESSEL, SIZE, StreamFunctionCurrent, random_scene

SPEEDS = (0.75, 1.6)


def in_open_water(seed: int) -> MovingScene:
    """The current of a scene without its islands."""
    return replace(moving_scene(seed), chart=renew.Chart(box(0, 0, SIZE, SIZE)))


def plan_of(scene: MovingScene, vessel: renew.Vessel, **options: Any) -> renew.Plan:
    return replace(scene, vessel=vessel).plan(**options)


def equal_slices(current: renew.CurrentField) -> renew.VaryingCurrent:
    """A current that stays as it is, known at two times by two fields."""

    def again(points: FloatArray) -> FloatArray:
        return current(points)

    return renew.VaryingCurrent([0.0, 1000.0], [current, as_field(again)])


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "exponent"), [(2, 2.0), (4, 3.0)])
def test_neither_a_table_nor_an_optimizer_needs_less(seed: int, exponent: float) -> None:
    scene = in_open_water(seed)
    vessel = replace(PAPER_VESSEL, fuel_exponent=exponent)
    deadline = scene.departure + 190.0
    best = plan_of(scene, vessel, speed=SPEEDS, arrive_by=deadline).best
    costs = CostModel(
        scene.current,
        scene.start,
        scene.goal,
        scene.departure,
        deadline,
        SPEEDS,
        exponent,
        scene.drift,
    )
    axis = np.linspace(0, SIZE, 25)
    nodes = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    in_table, path, speeds = least_fuel_in_table(costs, nodes, reach=26.0, buckets=120, tried=6)
    least = improved(costs, path, speeds, 14)[0]
    assert best.fuel <= 1.002 * least
    # The oracle's table loses time by rounding up, and tries few speeds.
    assert least <= in_table <= 1.25 * least
    assert best.fuel_bound.value <= min(least, best.fuel)
    assert deadline - 1e-5 * 190 <= best.times[-1] <= deadline
    assert best.times[0] == scene.departure
    assert (best.speeds >= SPEEDS[0] * (1 - 1e-9)).all()
    assert (best.speeds <= SPEEDS[1] * (1 + 1e-9)).all()
    # Eq. 4 with the clock running gives the same fuel, and so does the oracle's own rule.
    sailed = renew.fuel(
        best.path,
        scene.current,
        vessel,
        drift=scene.drift,
        departure=scene.departure,
        speeds=best.speeds,
    )
    assert sailed == pytest.approx(best.fuel, rel=1e-9)
    (fuel,), (arrival,) = costs.flown(best.path[None], best.speeds[None])
    assert fuel == pytest.approx(best.fuel, rel=1e-3)
    assert arrival == pytest.approx(best.times[-1], abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 8])
def test_one_speed_by_the_same_arrival_is_never_cheaper(seed: int) -> None:
    scene = moving_scene(seed)
    constant = plan_of(scene, PAPER_VESSEL).best
    plan = plan_of(scene, PAPER_VESSEL, speed=(0.7, 1.5), arrive_by=constant.times[-1])
    best = plan.best
    assert best.fuel <= constant.fuel * (1 + 1e-4)
    assert best.times[-1] <= constant.times[-1]
    for route in plan.routes:
        flown = scene.turns(route, spacing=0.5)
        # Early, on time and late.
        assert flown.trials > 5000
        assert flown.collisions == 0
        assert len(route.speeds) == len(route.path) - 1 == len(route.times) - 1
        assert route.times[-1] <= constant.times[-1]
    trade_off = plan.trade_off
    assert trade_off is not None
    assert (np.diff(trade_off.arrivals) > 0).all()
    assert (np.diff(trade_off.fuels) <= 1e-9).all()
    expected = np.interp(constant.times[-1], trade_off.arrivals, trade_off.fuels)
    assert expected == pytest.approx(best.fuel, rel=3e-3)


@pytest.mark.slow
def test_the_trade_off_is_what_other_deadlines_come_to() -> None:
    scene = in_open_water(2)
    plan = plan_of(scene, PAPER_VESSEL, speed=SPEEDS, arrive_by=scene.departure + 230.0)
    assert plan.trade_off is not None
    for under_way in (190.0, 260.0):
        by = scene.departure + under_way
        again = plan_of(scene, PAPER_VESSEL, speed=SPEEDS, arrive_by=by).best
        expected = np.interp(by, plan.trade_off.arrivals, plan.trade_off.fuels)
        assert expected == pytest.approx(again.fuel, rel=0.01)
    # From the earliest arrival of all to where time is free.
    fastest = plan_of(scene, replace(PAPER_VESSEL, speed=SPEEDS[1])).best
    assert plan.trade_off.arrivals[0] == pytest.approx(fastest.times[-1], abs=0.5)
    # Where there is far more time another path is best: along those of this plan it needs more.
    free = plan_of(scene, PAPER_VESSEL, speed=SPEEDS).best
    assert free.fuel <= plan.trade_off.fuels[-1] <= 1.1 * free.fuel
    assert free.fuel_bound.value <= free.fuel


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [2.0, 3.0])
def test_two_equal_slices_give_the_steady_plan(
    exponent: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("renew.vary.speeds.ClockSearch", None)  # neither current changes
    still = replace(random_scene(3), vessel=replace(PAPER_VESSEL, fuel_exponent=exponent))
    options = {"speed": (0.9, 1.5), "arrive_by": 230.0, "classes": 2}
    steady = still.plan(**options)
    varying = still.in_current(equal_slices(still.current)).plan(**options)
    assert [one.homotopy for one in varying.routes] == [one.homotopy for one in steady.routes]
    for route, same in zip(varying.routes, steady.routes, strict=True):
        assert route.fuel == pytest.approx(same.fuel, rel=1e-6)
        assert route.times[-1] == pytest.approx(same.times[-1], rel=1e-6)


@pytest.mark.slow
def test_a_current_that_hardly_changes_gives_nearly_the_steady_plan() -> None:
    still, moved = (StreamFunctionCurrent(1, peak) for peak in (0.6, 0.6 * (1 + 1e-5)))
    chart, (start, goal) = renew.Chart(box(0, 0, 150, 150)), ((20.0, 30.0), (130.0, 120.0))
    slices = renew.VaryingCurrent([0.0, 1000.0], [still, moved])
    for drift in ("projected", "crab"):
        options = {"speed": (0.75, 2.0), "arrive_by": 130.0, "drift": drift}
        steady = renew.plan(chart, still, PAPER_VESSEL, start, goal, **options)  # type: ignore[arg-type]
        varying = renew.plan(chart, slices, PAPER_VESSEL, start, goal, **options)  # type: ignore[arg-type]
        # Neither is exact to the last digit: both join legs of nearly the same speed.
        assert varying.best.fuel == pytest.approx(steady.best.fuel, rel=5e-4)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("exponent", [2.0, 3.0])
def test_in_a_tide_that_is_the_same_everywhere_one_speed_is_best(exponent: float) -> None:
    # From 0.3 m/s against the vessel to 0.3 m/s with it: a straight line in the water's own frame.
    tide = renew.VaryingCurrent(
        [0.0, 380.0], [renew.UniformCurrent(-0.3, 0.0), renew.UniformCurrent(0.3, 0.0)]
    )
    vessel = replace(PAPER_VESSEL, fuel_exponent=exponent)
    best = renew.plan(
        renew.Chart(box(0, 0, 300, 100)),
        tide,
        vessel,
        (20, 50),
        (280, 50),
        drift="crab",
        speed=(0.6, 2.0),
        arrive_by=380.0,
    ).best
    speed = 260 / 380
    assert best.speeds == pytest.approx(speed, rel=0.02)
    assert best.fuel == pytest.approx(speed**exponent * 380, rel=5e-4)


def test_a_deadline_that_cannot_be_made_names_the_earliest_arrival() -> None:
    scene = in_open_water(2)
    fastest = plan_of(scene, replace(PAPER_VESSEL, speed=1.5)).best
    with pytest.raises(renew.ArrivalError) as caught:
        plan_of(scene, PAPER_VESSEL, speed=(0.7, 1.5), arrive_by=fastest.times[-1] - 10.0)
    message = str(caught.value)
    assert f"arrives at {fastest.times[-1]:.6g} s at the earliest" in message
    assert "at the earliest: arrive later" in message
    assert "let speed reach" in message
    speed = float(message.split("reach ")[1].split(maxsplit=1)[0])
    enough = plan_of(
        scene, PAPER_VESSEL, speed=(0.7, 1.02 * speed), arrive_by=fastest.times[-1] - 10.0
    )
    assert enough.best.times[-1] <= fastest.times[-1] - 10.0


@pytest.mark.slow
def test_time_is_free_until_the_current_ends() -> None:
    still = renew.UniformCurrent(0.0, 0.0)
    ends = renew.VaryingCurrent([0.0, 120.0], [still, renew.UniformCurrent(0.1, 0.0)])
    chart = renew.Chart(box(0, 0, 150, 100))
    best = renew.plan(chart, ends, PAPER_VESSEL, (20, 50), (120, 50), speed=(0.2, 2.0)).best
    assert 119.0 < best.times[-1] <= 120.0
    assert math.isfinite(best.fuel)
