"""Speed over ground against the triangle of velocities."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from renew.kernels.fuel_law import FuelLaw, efforts, spline_nodes
from renew.kernels.ground_speed import (
    Polar,
    choosing,
    chosen_speeds,
    ground_speed,
    ground_speeds,
    made_good,
)
from tests.compiler import uncompiled
from tests.strategies import angles


@given(strength=st.floats(0.0, 3.0), towards=angles, course=angles, speed=st.floats(0.5, 2.0))
def test_crab_is_the_velocity_triangle_and_projected_is_never_slower(
    strength: float, towards: float, course: float, speed: float
) -> None:
    cx, cy = strength * math.cos(towards), strength * math.sin(towards)
    tx, ty = math.cos(course), math.sin(course)
    current, tangent, left = np.array([cx, cy]), np.array([tx, ty]), np.array([-ty, tx])
    polar = Polar(speed, crab=True)
    crab = ground_speed(cx, cy, tx, ty, polar)
    projected = ground_speed(cx, cy, tx, ty, Polar(speed, crab=False))
    assert projected == pytest.approx(speed + current @ tangent)
    interpreted = uncompiled(ground_speed)(cx, cy, tx, ty, polar)
    assert crab == pytest.approx(interpreted, nan_ok=True)
    if abs(current @ left) > speed * (1 + 1e-9):
        assert math.isnan(crab)
        return
    if abs(current @ left) < speed * (1 - 1e-9):
        # The vessel's velocity through water has its own speed, and points ahead: of the two
        # headings that hold the course this is the faster one.
        through_water = crab * tangent - current
        assert np.linalg.norm(through_water) == pytest.approx(speed)
        assert through_water @ tangent >= 0
        assert crab <= projected + 1e-12


def test_many_at_once_are_each_by_itself() -> None:
    rng = np.random.default_rng(0)
    velocity, bearing = rng.normal(0, 0.7, (50, 2)), rng.uniform(-math.pi, math.pi, 50)
    tangent = np.column_stack([np.cos(bearing), np.sin(bearing)])
    for crab in (False, True):
        polar = Polar(1.0, crab)
        one_by_one = [
            ground_speed(cx, cy, tx, ty, polar)
            for (cx, cy), (tx, ty) in zip(velocity, tangent, strict=True)
        ]
        assert ground_speeds(velocity, tangent, np.ones(len(velocity)), crab) == pytest.approx(
            one_by_one, nan_ok=True
        )


POINTS = ((0.02, 0.4), (0.6, 0.9), (1.3, 2.0), (2.2, 9.0), (3.0, 21.0))
LAWS = [
    *(FuelLaw(exponent) for exponent in (1.0, 1.5, 2.0, 3.0, 4.5)),
    FuelLaw(2.0, 0.8),
    FuelLaw(3.3, 1.4),
    FuelLaw(math.nan, 0.3, spline_nodes(POINTS)),
]


@pytest.mark.parametrize(("seed", "law"), list(enumerate(LAWS)))
def test_the_chosen_speed_is_the_cheapest_of_all(seed: int, law: FuelLaw) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(150):
        most = rng.uniform(0.5, 3)
        least, price = most * rng.uniform(0.05, 0.95), float(rng.choice([0.0, rng.uniform(0, 20)]))
        crab, (along, across) = bool(rng.integers(2)), rng.normal(0, rng.choice([0.1, 0.5, 1.0]), 2)
        polar = choosing(most, crab=crab, least=least, price=price, law=law)
        current, course = np.array([along, across]), np.array([1.0, 0.0])
        speed = float(chosen_speeds(current, course, polar))
        made = float(made_good(current, course, polar))
        speeds = np.linspace(least, most, 20_001)
        with np.errstate(invalid="ignore"):
            way = along + (np.sqrt(speeds**2 - across**2) if crab else speeds)
        rate = np.where(way > 0, way, 0.0) / (efforts(speeds, law) + price)
        if rate.max() <= 0:
            assert not made > 0
            continue
        assert made == pytest.approx(polar.scale * rate.max(), rel=1e-5)
        assert least <= speed <= most
    still = choosing(2.0, crab=True, least=0.5, price=1.3, law=law)
    assert float(made_good(np.zeros(2), np.array([1.0, 0.0]), still)) == pytest.approx(2.0)
