"""The choice of speeds: least fuel by a deadline."""

import math
import pickle
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from shapely import box

import renew
from renew.turns.turn_reach import turn_reach
from tests.speed_oracles import least_fuel
from tests.strategies import PAPER_VESSEL, StreamFunctionCurrent, random_scene

OPEN = renew.Chart(box(0, 0, 150, 150))
START, GOAL = (20.0, 30.0), (130.0, 120.0)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("drift", ["projected", "crab"])
@pytest.mark.parametrize(("exponent", "hotel"), [(3.0, 2.0), (2.0, 0.0), (3.0, 0.0)])
@pytest.mark.parametrize("seed", range(3))
def test_no_path_and_speeds_of_an_optimizer_need_less(
    seed: int, exponent: float, hotel: float, drift: Literal["projected", "crab"]
) -> None:
    current = StreamFunctionCurrent(seed, 0.6)
    vessel = replace(PAPER_VESSEL, fuel_exponent=exponent, hotel=hotel)
    deadline, speeds = 130.0, (0.75, 2.0)
    best = renew.plan(
        OPEN, current, vessel, START, GOAL, drift=drift, speed=speeds, arrive_by=deadline
    ).best
    line = np.linspace(START, GOAL, 25)
    oracle = least_fuel(
        line,
        current,
        speeds,
        deadline,
        exponent=exponent,
        hotel=hotel,
        crab=drift == "crab",
        moving=True,
    )
    assert best.fuel <= 1.001 * oracle
    assert best.fuel_bound.value <= oracle
    assert best.optimality_gap < 0.2
    assert deadline * (1 - 1e-6) <= best.times[-1] <= deadline
    sailed = renew.fuel(best.path, current, vessel, drift=drift, speeds=best.speeds)
    assert sailed == pytest.approx(best.fuel, rel=1e-4)
    # A trajectory crabs, whatever the drift model of the fuel.
    crabbing = 1e-4 if drift == "crab" else 0.03
    assert best.trajectory[-1, 0] == pytest.approx(best.times[-1], rel=crabbing)


def test_a_longer_way_keeps_the_speeds_that_the_best_one_does_not_need() -> None:
    """The short way needs 1.0 m/s of at most 3, the long one a quarter more: both have a route."""
    chart = renew.Chart(box(0, 0, 150, 150), [box(60, 30, 90, 84)])
    current = renew.UniformCurrent(0.0, 0.0)
    given = (chart, current, PAPER_VESSEL, (20.0, 75.0), (130.0, 75.0))
    short, long = renew.plan(*given, classes=2).routes
    assert long.length > 1.2 * short.length
    plan = renew.plan(*given, classes=2, speed=(0.2, 3.0), arrive_by=short.length)
    assert [route.homotopy for route in plan.routes] == [short.homotopy, long.homotopy]
    assert plan.rejected == ()
    for route in plan.routes:
        assert route.times[-1] <= short.length
        assert route.fuel == pytest.approx(route.length**2 / short.length, rel=5e-3)
        assert route.fuel_bound is plan.best.fuel_bound


@pytest.mark.parametrize("exponent", [2.0, 3.0])
def test_against_a_current_with_time_free(exponent: float) -> None:
    current = renew.UniformCurrent(-0.4, 0.0)
    vessel = replace(PAPER_VESSEL, fuel_exponent=exponent)
    best = renew.plan(
        OPEN, current, vessel, (20.0, 75.0), (130.0, 75.0), speed=(0.1, 3.0), drift="crab"
    ).best
    assert best.speeds == pytest.approx(exponent * 0.4 / (exponent - 1), rel=1e-3)


@pytest.mark.slow
def test_a_deadline_at_constant_speed_is_met_with_less_fuel() -> None:
    scene = random_scene(3)
    constant = scene.plan(classes=4)
    by = constant.best.times[-1]
    plan = scene.plan(classes=4, speed=(0.9, 1.5), arrive_by=by)
    best = plan.best
    assert best.times[-1] <= by
    assert best.fuel < constant.best.fuel
    for route in plan.routes[:2]:
        flown = scene.turns(route, spacing=0.5)
        assert flown.trials > 1000
        assert flown.collisions == 0
        assert (route.speeds >= 0.9 - 1e-9).all()
        assert (route.speeds <= 1.5 + 1e-9).all()
        assert len(route.speeds) == len(route.path) - 1 == len(route.times) - 1
    trade_off = plan.trade_off
    assert trade_off is not None
    assert (np.diff(trade_off.arrivals) > 0).all()
    assert (np.diff(trade_off.fuels) <= 1e-9).all()
    assert np.interp(by, trade_off.arrivals, trade_off.fuels) == pytest.approx(best.fuel, rel=2e-3)
    # Less time takes more fuel, by about as much as the curve says.
    sooner = by - 20.0
    again = scene.plan(classes=1, speed=(0.9, 1.5), arrive_by=sooner)
    assert again.best.fuel > best.fuel
    told = np.interp(sooner, trade_off.arrivals, trade_off.fuels)
    assert again.best.fuel == pytest.approx(told, rel=0.02)
    copied = pickle.loads(pickle.dumps(plan))  # noqa: S301 - its own
    assert copied.best.fuel == best.fuel
    assert np.array_equal(copied.trade_off.fuels, trade_off.fuels)


@pytest.mark.slow
def test_the_vessels_own_speed_alone_gives_the_same_routes() -> None:
    scene = random_scene(5)
    own = PAPER_VESSEL.speed
    given = scene.plan()
    chosen = scene.plan(speed=(own, own), arrive_by=1e4)
    assert [route.homotopy for route in chosen.routes] == [one.homotopy for one in given.routes]
    for route, same in zip(chosen.routes, given.routes, strict=True):
        assert np.array_equal(route.path, same.path)
        assert np.array_equal(route.trajectory, same.trajectory)
        assert np.array_equal(route.speeds, np.full(len(same.path) - 1, own))
        assert route.fuel == same.fuel
        assert np.array_equal(route.times, same.times)
    assert chosen.best.fuel_bound.value == given.best.fuel_bound.value


@settings(deadline=None, max_examples=200)
@given(
    st.floats(-math.pi, math.pi),
    st.floats(-math.pi, math.pi),
    st.floats(0, 2),
    st.floats(-math.pi, math.pi),
)
def test_a_turn_at_a_higher_speed_reaches_no_less(
    heading: float, bearing: float, strength: float, towards: float
) -> None:
    current = strength * np.array([math.cos(towards), math.sin(towards)])
    normal = np.array([math.cos(bearing), math.sin(bearing)])
    reach = [
        float(turn_reach(replace(PAPER_VESSEL, speed=speed), np.array(heading), current, normal))
        for speed in (0.05, 0.3, 0.9, 1.0, 1.7, 3.0)
    ]
    assert (np.diff(reach) >= -1e-9).all()


def test_a_deadline_that_cannot_be_made_says_what_would_do() -> None:
    current = renew.UniformCurrent(0.1, 0.0)
    distance = math.dist(START, GOAL)
    with pytest.raises(renew.ArrivalError) as caught:
        renew.plan(OPEN, current, PAPER_VESSEL, START, GOAL, speed=(0.5, 1.5), arrive_by=60.0)
    message = str(caught.value)
    along = (GOAL[0] - START[0]) / distance
    earliest = distance / (1.5 + 0.1 * along)
    assert f"arrives at {earliest:.4g}"[:14] in message
    speed = float(message.split("reach ")[1].split(maxsplit=1)[0])
    assert speed == pytest.approx(distance / 60 - 0.1 * along, rel=0.01)
    departure = float(message.split("leave before ")[1].split(maxsplit=1)[0])
    assert departure == pytest.approx(60 - earliest, abs=0.5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": (2.0, 1.0)}, r"speed\.least = 2\.0 m/s is above speed\.most = 1\.0"),
        (
            {"speed": (math.nan, -1.0), "risk": 2.0, "arrive_by": -5.0},
            r"risk = 2\.0 .*; arrive_by = -5\.0 .*; speed\.least = nan .*; speed\.most = -1\.0",
        ),
        ({"speed": (0.0, 1.0)}, r"speed\.least = 0\.0 m/s must be a number above 0"),
        ({"speed": (1.0, math.inf)}, r"speed\.most = inf"),
        ({"speed": 2.0}, "must be two speeds"),
        ({"speed": (1.0, 2.0, 3.0)}, "must be two speeds"),
        ({"speed": ("1", "2")}, r"speed\.least = '1' .*; speed\.most = '2'"),
        ({"speed": (1.0, 2.0), "method": "sampled"}, "speed needs method = 'optimal'"),
    ],
)
def test_bad_speeds_are_refused_all_at_once(options: dict[str, object], message: str) -> None:
    with pytest.raises(renew.ParameterError, match=message):
        renew.plan(OPEN, renew.UniformCurrent(0.1, 0.0), PAPER_VESSEL, START, GOAL, **options)  # type: ignore[arg-type]


def test_a_fuel_law_for_which_haste_is_free_is_refused() -> None:
    vessel = replace(PAPER_VESSEL, fuel_exponent=0.5)
    with pytest.raises(renew.ParameterError, match=r"fuel_exponent of at least 1, not 0\.5"):
        renew.plan(OPEN, renew.UniformCurrent(0.1, 0.0), vessel, START, GOAL, speed=(1.0, 2.0))


def test_turns_are_flown_at_the_speeds_sailed() -> None:
    chart = renew.Chart(OPEN.extent, [box(60, 54, 90, 60)])
    still, path = renew.UniformCurrent(0.0, 0.0), np.array([[20.0, 50.0], [130.0, 50.0]])

    class Straight:
        """A path, 4 m off the island: turns of up to 2 m radius stay off it."""

        def __init__(self, *speeds: float) -> None:
            self.path = np.array([path[0], [75.0, 50.0], path[1]])
            self.speeds = np.array(speeds)

    def collided(*speeds: float) -> np.ndarray:
        flown = renew.contingency(Straight(*speeds), chart, still, PAPER_VESSEL)
        return flown.points[flown.collided][:, 0]

    slow, fast = 1.9 * PAPER_VESSEL.turn_rate, 2.6 * PAPER_VESSEL.turn_rate
    assert len(collided(slow, slow)) == 0
    half = collided(slow, fast)
    assert len(half) > 5
    assert (half >= 75.0).all()
    assert (collided(fast, fast) < 75.0).any()
