"""Speeds along a given path, also as the current changes: optimizers, deadline, trade-off."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from shapely import box

import renew
from renew._types import FloatArray
from renew.inputs.current import CurrentLike, as_field
from renew.inputs.options import Drift
from renew.paths.speed_profile import (
    constant_speed,
    speed_profile,
    speeds_by_clock,
    trade_off,
    trade_off_by_clock,
)
from renew.voyage.voyage import Voyage, Waters
from tests.moving_waters import moving_scene
from tests.speed_oracles import CostModel, least_fuel, with_and_against
from tests.strategies import PAPER_VESSEL, StreamFunctionCurrent

DRIFTS = ("projected", "crab")
CHART = renew.Chart(box(-1, -1, 101, 101))


def _voyage(
    path: FloatArray,
    current: CurrentLike,
    deadline: float = math.inf,
    *,
    exponent: float = 2.0,
    drift: Drift = "projected",
    speeds: tuple[float, float] = (0.1, 3.0),
) -> Voyage:
    vessel = renew.Vessel(speed=speeds[1], turn_rate=1.0, fuel_exponent=exponent)
    voyage = Voyage(Waters(CHART, as_field(current)), vessel, path[0], path[-1], drift)
    return replace(voyage, least_speed=speeds[0], deadline=deadline)


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize(
    ("exponent", "fuel", "speeds"),
    [(2.0, 2.155556, (0.5, 1.3)), (3.0, 2.366361, (0.733587, 1.146232))],
)
def test_two_metreswith_and_against(
    exponent: float, fuel: float, speeds: tuple[float, float], drift: Drift
) -> None:
    path = np.array([[0.0, 0.0], [2.0, 0.0]])
    voyage = _voyage(path, with_and_against, 2 / 0.9, exponent=exponent, drift=drift)
    found = speed_profile(path, voyage)
    assert found.fuel == pytest.approx(fuel, rel=1e-5)
    assert found.speeds == pytest.approx(speeds, rel=1e-4)
    assert found.path == pytest.approx(np.array([[0, 0], [1, 0], [2, 0]]))
    assert found.arrival == pytest.approx(2 / 0.9, rel=1e-6)


@pytest.mark.parametrize(
    ("k", "n", "hotel"), [(19.13, 3.33, 30.0), (1.0, 2.0, 0.5), (7.0, 4.0, 90.0)]
)
def test_in_still_water_the_hotel_load_sets_the_speed(k: float, n: float, hotel: float) -> None:
    """A metre costs (K vⁿ + H) / v, least at v = (H / (K (n - 1)))^(1/n)."""
    path = np.array([[0.0, 0.0], [50.0, 0.0]])
    best = (hotel / (k * (n - 1))) ** (1 / n)
    v = np.linspace(0.05, 3.0, 60)
    points = tuple(zip(v.tolist(), (k * v**n).tolist(), strict=True))
    voyage, still = _voyage(path, renew.UniformCurrent(0.0, 0.0)), replace(PAPER_VESSEL, speed=3.0)
    for vessel, within in (
        (replace(still, fuel_coefficient=k, fuel_exponent=n, hotel=hotel), 1e-6),
        (replace(still, power=points, hotel=hotel), 2e-2),
    ):
        found = speed_profile(path, replace(voyage, vessel=vessel))
        assert found.speeds == pytest.approx(best, rel=within)
        assert found.fuel == pytest.approx(50 * (k * best**n + hotel) / best, rel=1e-4)
        arrivals, fuels = trade_off(path, replace(voyage, vessel=vessel))
        assert arrivals[-1] == pytest.approx(50 / best, rel=within)
        assert fuels[-1] == pytest.approx(found.fuel, rel=1e-6)


@pytest.mark.parametrize("exponent", [1.5, 2.0, 3.0, 4.0])
def test_where_time_is_free_the_current_sets_the_speed(exponent: float) -> None:
    path = np.array([[0.0, 0.0], [50.0, 0.0]])
    voyage = _voyage(path, renew.UniformCurrent(-0.5, 0.0), exponent=exponent)
    found = speed_profile(path, voyage)
    assert found.speeds == pytest.approx(exponent * 0.5 / (exponent - 1), rel=1e-6)
    assert found.price == 0
    # Going faster with the current gains nothing.
    with_it = speed_profile(path, _voyage(path, renew.UniformCurrent(0.5, 0.0), exponent=exponent))
    assert with_it.speeds == pytest.approx(0.1)


@pytest.mark.gate_share(3)
@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("seed", range(4))
def test_no_speeds_of_an_optimizer_need_less(seed: int, drift: Drift) -> None:
    rng = np.random.default_rng(seed)
    current = StreamFunctionCurrent(seed, 0.6)
    path = np.column_stack([np.linspace(5, 95, 9), 50 + np.cumsum(rng.normal(0, 6, 9))])
    exponent, speeds = float(rng.choice([2.0, 3.0])), (0.7, 2.0)
    slowest = _voyage(path, current, speeds=speeds, exponent=exponent, drift=drift)
    times, _ = trade_off(path, slowest)
    deadline = float(times[0] + 0.4 * (times[-1] - times[0]))
    voyage = _voyage(path, current, deadline, speeds=speeds, exponent=exponent, drift=drift)
    found = speed_profile(path, voyage)
    pieces = np.concatenate(
        [np.linspace(a, b, 4)[:-1] for a, b in itertools.pairwise(path)] + [path[-1:]]
    )
    oracle = least_fuel(
        pieces, current, speeds, deadline, exponent=exponent, crab=drift == "crab", moving=False
    )
    assert found.fuel <= oracle * 1.0005
    assert deadline * (1 - 1e-6) <= found.arrival <= deadline
    sailed = renew.fuel(found.path, current, voyage.vessel, drift=drift, speeds=found.speeds)
    assert sailed == pytest.approx(found.fuel, rel=1e-4)
    assert (found.speeds >= speeds[0]).all()
    assert (found.speeds <= speeds[1]).all()
    arrivals, fuels = trade_off(path, voyage)
    assert np.interp(deadline, arrivals, fuels) == pytest.approx(found.fuel, rel=2e-3)
    assert (np.diff(fuels) <= 1e-12).all()


def test_too_late_even_at_the_highest_speed() -> None:
    path = np.array([[0.0, 0.0], [30.0, 0.0]])
    found = speed_profile(path, _voyage(path, renew.UniformCurrent(0.0, 0.0), 9.99))
    assert math.isinf(found.fuel)
    assert found.arrival == pytest.approx(10.0)
    just = speed_profile(path, _voyage(path, renew.UniformCurrent(0.0, 0.0), 10.0 + 1e-9))
    assert just.speeds == pytest.approx(3.0)
    assert just.fuel == pytest.approx(90.0)


def test_without_a_choice_the_path_is_sailed_at_the_one_speed() -> None:
    path = np.array([[0.0, 0.0], [30.0, 0.0], [40.0, 10.0]])
    voyage = _voyage(path, renew.UniformCurrent(0.1, 0.0), speeds=(1.5, 1.5))
    found = speed_profile(path, voyage)
    assert np.array_equal(found.path, path)
    assert found.speeds.tolist() == [1.5, 1.5]
    assert found.fuel == pytest.approx(voyage.fuel(path))


SPEEDS, LEGS = (0.75, 2.0), 16


def voyage_and_path(
    seed: int, exponent: float, hotel: float, under_way: float
) -> tuple[Voyage, FloatArray]:
    """A voyage in a moving scene, and a way with a bend."""
    scene = moving_scene(seed)
    middle = (scene.start + scene.goal) / 2 + np.array([6.0, -6.0])
    vessel = replace(PAPER_VESSEL, speed=SPEEDS[1], fuel_exponent=exponent, hotel=hotel)
    voyage = Voyage(
        Waters(scene.chart, scene.current),
        vessel,
        scene.start,
        scene.goal,
        scene.drift,
        scene.departure,
        least_speed=SPEEDS[0],
        deadline=scene.departure + under_way,
    )
    return voyage, np.stack([scene.start, middle, scene.goal])


LEAST = {
    (1, 2.0, 0.0): 391.8602,
    (4, 3.0, 0.0): 427.9928,
    (5, 2.0, 0.0): 304.6388,
    (3, 3.0, 2.0): 838.7151,
}
"""The least fuel that SciPy's SLSQP finds, by seed, exponent and hotel load."""


@pytest.mark.parametrize(("seed", "exponent", "hotel"), LEAST)
def test_no_speeds_of_an_optimizer_need_less_by_the_clock(
    seed: int, exponent: float, hotel: float
) -> None:
    voyage, path = voyage_and_path(seed, exponent, hotel, 200.0)
    found = speeds_by_clock(path, voyage)
    assert 200 * (1 - 2e-6) <= found.arrival - voyage.departure <= 200
    assert found.fuel <= 1.001 * LEAST[seed, exponent, hotel]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "exponent", "hotel"), LEAST)
def test_an_optimizer_finds_its_least_fuel_again(seed: int, exponent: float, hotel: float) -> None:
    voyage, path = voyage_and_path(seed, exponent, hotel, 200.0)
    costs = CostModel(
        voyage.current,
        voyage.start,
        voyage.goal,
        voyage.departure,
        voyage.deadline,
        SPEEDS,
        exponent,
        voyage.drift,
        hotel,
    )
    half = LEGS // 2
    legs = np.vstack(
        [
            np.linspace(a, b, half + 1)[: half + (k == 1)]
            for k, (a, b) in enumerate([(path[0], path[1]), (path[1], path[2])])
        ]
    )

    def flown(speeds: FloatArray) -> tuple[float, float]:
        (fuel,), (arrival,) = costs.flown(legs[None], speeds[None])
        return float(fuel), float(arrival)

    one = constant_speed(path, voyage)
    result = minimize(
        lambda speeds: flown(speeds)[0],
        np.full(LEGS, one),
        method="SLSQP",
        bounds=[SPEEDS] * LEGS,
        constraints={
            "type": "ineq",
            "fun": lambda speeds: (voyage.deadline - flown(speeds)[1]) / 200,
        },
        options={"maxiter": 60, "ftol": 1e-6},
    )
    assert result.fun == pytest.approx(LEAST[seed, exponent, hotel], rel=1e-4)
    # One speed that is just in time needs more.
    fuel, arrival = flown(np.full(LEGS, one))
    assert arrival == pytest.approx(voyage.deadline, abs=0.2)
    assert result.fun < fuel


def test_the_trade_off_falls_and_meets_the_profile() -> None:
    voyage, path = voyage_and_path(1, 2.0, 0.0, 200.0)
    arrivals, fuels = trade_off_by_clock(path, voyage)
    assert (np.diff(arrivals) > 0).all()
    assert (np.diff(fuels) <= 1e-9).all()
    found = speeds_by_clock(path, voyage)
    assert np.interp(voyage.deadline, arrivals, fuels) == pytest.approx(found.fuel, rel=2e-3)


def test_too_late_even_at_the_highest_speed_by_the_clock() -> None:
    voyage, path = voyage_and_path(1, 2.0, 0.0, 60.0)
    found = speeds_by_clock(path, voyage)
    assert math.isinf(found.fuel)
    assert found.arrival > voyage.deadline
