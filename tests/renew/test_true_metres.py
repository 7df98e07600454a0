"""Voyages on a plane that stretches the earth, beside great circles and an own integration.

Mercator's plane of a sphere is conformal, with cosh(y / R) metres to a true one; its shortest ways
are great circles, whose length is known in closed form.
"""

import itertools
import math

import numpy as np
import pytest
import shapely

import renew
from renew._types import FloatArray
from renew.inputs.current import FunctionCurrent
from renew.inputs.options import Drift

RADIUS = 6_371_000.0
VESSEL = renew.Vessel(speed=6.0, turn_rate=0.01)
# Degrees: 3,300 km, on which the plane's own straight line is 1 % longer.
START, GOAL = (0.0, 40.0), (40.0, 45.0)


def in_plane(place: tuple[float, float]) -> FloatArray:
    """Project longitude and latitude, degrees, by Mercator."""
    longitude, latitude = np.radians(place)
    return RADIUS * np.array([longitude, math.asinh(math.tan(latitude))])


def scale(points: FloatArray) -> FloatArray:
    """Metres of the plane per true metre."""
    return np.asarray(np.cosh(points[..., 1] / RADIUS))


def great_circle(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the shortest way on the sphere, m."""
    (west, south), (east, north) = np.radians([one, other])
    square = math.sin((north - south) / 2) ** 2
    square += math.cos(south) * math.cos(north) * math.sin((east - west) / 2) ** 2
    return 2 * RADIUS * math.asin(math.sqrt(square))


def chart(*islands: shapely.Polygon) -> renew.Chart:
    """Water around both ends."""
    (west, south), (east, north) = in_plane(START), in_plane(GOAL)
    extent = shapely.box(west - 3e5, south - 1.5e6, east + 3e5, north + 2e6)
    return renew.Chart(extent, islands, point_scale=scale)


def eddies(points: FloatArray) -> FloatArray:
    """Return velocities (..., 2), m/s, of a smooth current of up to 1.4 m/s."""
    x, y = points[..., 0] / 6e5, points[..., 1] / 7e5
    return np.stack([np.sin(y) * np.cos(x / 2), np.cos(x) * np.sin(y / 2)], axis=-1)


def turning(points: FloatArray, time: FloatArray) -> FloatArray:
    """Return the eddies, which turn round once in five days."""
    clock = 2 * np.pi * np.asarray(time)[..., None] / 432_000
    return eddies(points) * np.cos(clock) + eddies(points + 3e5) * np.sin(clock)


def sailed_s(path: FloatArray, current: renew.CurrentField, *, crab: bool) -> float:
    """Sail along a path in short steps of true metres; return the seconds."""
    now = 0.0
    for begin, end in itertools.pairwise(path):
        count = max(1, math.ceil(float(np.hypot(*(end - begin))) / 2_000))
        step = (end - begin) / count
        length = float(np.hypot(*step))
        tangent = step / length
        for k in range(count):
            middle = begin + (k + 0.5) * step
            u, v = current.velocity(middle, np.float64(now + length / 12))
            along, across = u * tangent[0] + v * tangent[1], v * tangent[0] - u * tangent[1]
            made = along + math.sqrt(VESSEL.speed**2 - (across**2 if crab else 0.0))
            now += length / float(scale(middle)) / made
    return now


def test_in_still_water_the_way_is_a_great_circle() -> None:
    plan = renew.plan(chart(), renew.UniformCurrent(0, 0), VESSEL, in_plane(START), in_plane(GOAL))
    shortest = great_circle(START, GOAL)
    best = plan.best
    assert best.length == pytest.approx(shortest, rel=1e-5)
    assert best.duration == pytest.approx(best.length / VESSEL.speed, rel=1e-9)
    assert best.fuel == pytest.approx(VESSEL.fuel_rate * best.duration, rel=1e-12)
    assert best.trajectory[-1, 0] == pytest.approx(best.duration, rel=1e-5)
    assert best.fuel_bound.value <= VESSEL.fuel_rate * shortest / VESSEL.speed
    assert best.optimality_gap < 0.01
    # Straight in the plane, it would be longer by far.
    straight = renew.fuel(
        np.stack([in_plane(START), in_plane(GOAL)]), lambda p: 0 * p, VESSEL, chart=chart()
    )
    assert straight > 1.005 * best.fuel


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("drift", ["projected", "crab"])
@pytest.mark.parametrize("changes", [False, True])
def test_in_a_current_times_are_those_of_true_metres(drift: Drift, *, changes: bool) -> None:
    """Two sides of an island, each beside an own integration, and none below the bound."""
    island = shapely.box(*in_plane((15, 38)), *in_plane((25, 47)))
    current: renew.CurrentField = FunctionCurrent(eddies)
    if changes:
        current = renew.VaryingCurrent(np.arange(0.0, 1_000_000, 21_600), turning)
    water = chart(island)
    plan = renew.plan(
        water, current, VESSEL, in_plane(START), in_plane(GOAL), drift=drift, classes=2
    )
    assert len(plan.routes) == 2
    for route in plan.routes:
        expected = sailed_s(route.path, current, crab=drift == "crab")
        assert route.duration == pytest.approx(expected, rel=1e-4)
        assert route.fuel_bound.value <= route.fuel
        assert renew.contingency(route, water, current, VESSEL, spacing=20_000).collisions == 0
    again = renew.assess(
        plan.best.path, water, current, VESSEL, drift=drift, classes=2, padding="none"
    )
    assert again.fuel == pytest.approx(plan.best.fuel, rel=1e-9)


def test_a_choice_of_speeds_is_in_time_by_true_metres() -> None:
    within = 1.3 * great_circle(START, GOAL) / VESSEL.speed
    plan = renew.plan(
        chart(),
        FunctionCurrent(eddies),
        VESSEL,
        in_plane(START),
        in_plane(GOAL),
        speed=(3.0, 6.0),
        arrive_by=within,
    )
    assert 0.999 * within < plan.best.duration <= within
    assert plan.best.fuel_bound.value <= plan.best.fuel


def test_a_scale_of_one_everywhere_is_a_plane() -> None:
    """Nothing changes by more than rounding."""
    extent, island = shapely.box(0, 0, 10_000, 8_000), shapely.box(3_000, 2_000, 6_000, 5_000)
    current = renew.GyreCurrent(1.5, 10_000, 8_000)
    vessel = renew.Vessel(speed=2.0, turn_rate=0.05)
    plans = [
        renew.plan(one, current, vessel, (500, 500), (9_000, 7_000))
        for one in (
            renew.Chart(extent, [island]),
            renew.Chart(extent, [island], point_scale=lambda points: np.ones(points.shape[:-1])),
        )
    ]
    for one, other in zip(plans[0].routes, plans[1].routes, strict=True):
        assert other.fuel == pytest.approx(one.fuel, rel=1e-9)
        assert other.fuel_bound.value == pytest.approx(one.fuel_bound.value, rel=1e-4)


def test_turns_are_as_wide_as_the_plane_draws_them() -> None:
    """Where a plane doubles all lengths, so does padding; fuel and times are unchanged."""
    extent, island = shapely.box(0, 0, 10_000, 8_000), shapely.box(3_000, 2_000, 6_000, 5_000)
    vessel, still = renew.Vessel(speed=2.0, turn_rate=0.02), renew.UniformCurrent(0.3, 0.1)
    true = renew.plan(renew.Chart(extent, [island]), still, vessel, (500, 500), (9_000, 7_000))
    double = renew.plan(
        renew.Chart(
            shapely.box(0, 0, 20_000, 16_000),
            [shapely.box(6_000, 4_000, 12_000, 10_000)],
            point_scale=lambda points: np.full(points.shape[:-1], 2.0),
        ),
        still,
        vessel,
        (1_000, 1_000),
        (18_000, 14_000),
    )
    for one, other in zip(true.routes, double.routes, strict=True):
        assert other.fuel == pytest.approx(one.fuel, rel=1e-6)
        assert other.clearance == pytest.approx(2 * one.clearance, rel=1e-6)
        assert other.length == pytest.approx(one.length, rel=1e-6)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda points: np.zeros(points.shape[:-1]), "above 0"),
        (lambda _: np.ones(3), "shape"),
        (lambda points: np.full(points.shape[:-1], np.nan), "above 0"),
    ],
)
def test_a_scale_that_is_none_is_refused(wrong: object, said: str) -> None:
    with pytest.raises(renew.ParameterError, match=said):
        renew.Chart(shapely.box(0, 0, 10, 10), point_scale=wrong)  # type: ignore[arg-type]
