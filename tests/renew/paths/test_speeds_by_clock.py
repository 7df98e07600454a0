"""Speeds along a given path as the current changes: an optimizer, the deadline, the trade-off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from renew._types import FloatArray
from renew.paths.speeds_by_clock import constant_speed, speeds_by_clock, trade_off_by_clock
from renew.voyage.voyage import SpeedRange, Voyage, Waters
from tests.moving_waters import moving_scene
from tests.speed_clock_oracle import CostModel
from tests.strategies import PAPER_VESSEL

SPEEDS, LEGS = (0.75, 2.0), 16


def voyage_and_path(seed: int, exponent: float, under_way: float) -> tuple[Voyage, FloatArray]:
    """A voyage in a moving scene, and a way with a bend."""
    scene = moving_scene(seed)
    middle = (scene.start + scene.goal) / 2 + np.array([6.0, -6.0])
    vessel = replace(PAPER_VESSEL, speed=SPEEDS[1], fuel_exponent=exponent)
    choice = SpeedRange(SPEEDS[0], deadline=scene.departure + under_way)
    voyage = Voyage(
        Waters(scene.chart, scene.current),
        vessel,
        scene.start,
        scene.goal,
        scene.drift,
        scene.departure,
        choice=choice,
    )
    return voyage, np.stack([scene.start, middle, scene.goal])


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(("seed", "exponent"), [(1, 2.0), (4, 3.0), (5, 2.0)])
def test_no_speeds_of_an_optimizer_need_less(seed: int, exponent: float) -> None:
    voyage, path = voyage_and_path(seed, exponent, 200.0)
    found = speeds_by_clock(path, voyage)
    assert 200 * (1 - 2e-6) <= found.arrival - voyage.departure <= 200
    costs = CostModel(
        voyage.current,
        voyage.start,
        voyage.goal,
        voyage.departure,
        voyage.deadline,
        SPEEDS,
        exponent,
        voyage.drift == "crab",
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
    assert found.fuel <= 1.001 * result.fun
    # One speed that is just in time needs more.
    fuel, arrival = flown(np.full(LEGS, one))
    assert arrival == pytest.approx(voyage.deadline, abs=0.2)
    assert found.fuel < fuel


def test_the_trade_off_falls_and_meets_the_profile() -> None:
    voyage, path = voyage_and_path(1, 2.0, 200.0)
    arrivals, fuels = trade_off_by_clock(path, voyage)
    assert (np.diff(arrivals) > 0).all()
    assert (np.diff(fuels) <= 1e-9).all()
    found = speeds_by_clock(path, voyage)
    assert np.interp(voyage.deadline, arrivals, fuels) == pytest.approx(found.fuel, rel=2e-3)


def test_too_late_even_at_the_highest_speed() -> None:
    voyage, path = voyage_and_path(1, 2.0, 60.0)
    found = speeds_by_clock(path, voyage)
    assert math.isinf(found.fuel)
    assert found.arrival > voyage.deadline
