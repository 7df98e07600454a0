"""Currents that change on the way: published optima, an oracle with a clock, the bound, turns."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from shapely import box

import renew
from renew._types import FloatArray
from tests.clock_oracle import duration
from tests.moving_waters import Drifting, moving_scene
from tests.strategies import PAPER_VESSEL, SIZE, random_islands, random_scene, seeds

# Metres for a unit of length of the published cases; a vessel of 1 m/s whose turns are small.
UNIT = 100.0
NIMBLE = renew.Vessel(speed=1.0, turn_rate=10.0, length=0.01)


def circular(points: FloatArray) -> FloatArray:
    """The flow u = 0.9 y, v = -0.9 x (Techy, 2011)."""
    return 0.9 / UNIT * np.stack([points[..., 1], -points[..., 0]], axis=-1)


def four_vortices(points: FloatArray) -> FloatArray:
    """Flow of four vortices (Ferraro, Martín de Diego & Sato Martín de Almagro, 2021)."""
    total = np.zeros(points.shape)
    for x, y, sense in ((2, 2, -1), (4, 4, -1), (2, 5, -1), (5, 1, 1)):
        dx, dy = points[..., 0] / UNIT - x, points[..., 1] / UNIT - y
        swirl = np.stack([-dy, dx], axis=-1) / (3 * (dx**2 + dy**2) + 1)[..., None]
        total += 1.7 * sense * swirl
    return total


def swinging(epsilon: float) -> renew.SwingingGyre:
    """Shadden's gyre with A = 0.1 and ω = 1."""
    return renew.SwingingGyre(0.1, 2 * UNIT, UNIT, epsilon, 1 / UNIT)


@pytest.mark.gate_share(2)
@pytest.mark.parametrize(
    ("current", "extent", "start", "goal", "least"),
    [
        (circular, (-1, -1, 2, 2), (math.cos(math.pi / 6), 0.5), (0, 1), 1.974938),
        (four_vortices, (-1, -2, 8, 7), (0, 0), (6, 2), 8.949456),
        (swinging(0.0), (0, 0, 2, 1), (1.5, 0.5), (0.5, 0.5), 1.005784),
        (swinging(0.25), (0, 0, 2, 1), (1.5, 0.5), (0.5, 0.5), 0.988808),
    ],
    ids=["circular", "four vortices", "gyre at rest", "swinging gyre"],
)
def test_published_least_times_are_met_within_a_thousandth(
    current: Callable[[FloatArray], FloatArray] | renew.CurrentField,
    extent: tuple[float, ...],
    start: tuple[float, float],
    goal: tuple[float, float],
    least: float,
) -> None:
    chart = renew.Chart(box(*(UNIT * np.array(extent))), [])
    ends = (UNIT * np.array(start), UNIT * np.array(goal))
    best = renew.plan(chart, current, NIMBLE, *ends, padding="none", drift="crab").best
    assert best.duration / UNIT == pytest.approx(least, rel=1e-3)
    assert best.fuel_bound.value <= least * UNIT * (1 + 1e-6)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", range(3))
def test_a_uniform_current_that_changes_is_used_as_well_as_can_be(seed: int) -> None:
    rng = np.random.default_rng(seed)
    strength, turns, phase = rng.uniform(0.2, 0.6), rng.uniform(0.5, 3), rng.uniform(0, 6)
    omega = 2 * math.pi * turns / 100

    def at(time: FloatArray) -> FloatArray:
        return strength * np.stack([np.cos(omega * time + phase), np.sin(0.7 * omega * time)], -1)

    current = renew.VaryingCurrent(
        np.linspace(0, 400, 401),
        lambda points, time: np.broadcast_to(at(np.asarray(time)), points.shape),
    )
    # The vessel holds one heading. It arrives when its way through the water equals the distance to
    # the goal less the current's drift by then.
    time = np.linspace(0, 400, 400_001)
    middle = at((time[1:] + time[:-1]) / 2) * np.diff(time)[:, None]
    carried = np.vstack([np.zeros(2), np.cumsum(middle, axis=0)])
    least = time[np.argmax(np.linalg.norm([100, 0] - carried, axis=1) <= time)]
    chart = renew.Chart(box(-60, -60, 160, 60), [])
    best = renew.plan(chart, current, NIMBLE, (0, 0), (100, 0), padding="none", drift="crab").best
    assert best.duration == pytest.approx(least, rel=5e-4)
    assert best.duration >= least * (1 - 1e-5)
    assert best.fuel_bound.value <= least * (1 + 1e-5)


# Fuel of the oracle's path in scene 4 on a grid of 4 m, which takes seconds to find.
LEAST = 250.6040677


@pytest.mark.slow
def test_the_fuel_kept_is_that_of_the_oracle() -> None:
    assert moving_scene(4).oracle(4.0) == pytest.approx(LEAST, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4])
def test_a_moving_scene_is_planned_as_well_as_by_a_fine_oracle(seed: int) -> None:
    check_beside_the_oracle(seed, moving_scene(seed).oracle(2.0))


def test_a_moving_scene_is_planned_as_well_as_by_an_oracle_and_stays_above_the_bound() -> None:
    check_beside_the_oracle(4, LEAST)


def check_beside_the_oracle(seed: int, least: float) -> None:
    """Check a scene's plan, its bound, and its clock."""
    scene = moving_scene(seed)
    best = scene.plan(padding="none").best
    assert best.fuel <= 1.005 * least
    assert best.fuel_bound.value <= least
    # The fuel is that of the path, by another's clock.
    taken = duration(best.path, scene.current, PAPER_VESSEL, scene.departure, scene.drift)
    assert best.duration == pytest.approx(taken, rel=2e-4)
    assert best.times[0] == scene.departure
    assert best.times[-1] == pytest.approx(scene.departure + best.duration)
    assert best.trajectory[0, 0] == scene.departure
    again = renew.fuel(
        best.path, scene.current, PAPER_VESSEL, drift=scene.drift, departure=scene.departure
    )
    # The clock is settled by iteration, begun at other times.
    assert again == pytest.approx(best.fuel, rel=1e-10)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [1, 5])
def test_turns_early_on_time_and_late_are_clear(seed: int) -> None:
    scene = moving_scene(seed)
    for route in scene.plan(classes=3).routes:
        flown = scene.turns(route)
        assert flown.trials == 3 * 10 * len(flown.points)
        assert flown.collisions == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3])
def test_a_steady_current_in_two_equal_slices_is_the_same_current(seed: int) -> None:
    scene = random_scene(seed)
    steady = scene.plan()
    again = scene.in_current(renew.VaryingCurrent([0.0, 1e5], [scene.current] * 2)).plan()
    assert {r.homotopy for r in again.routes} == {r.homotopy for r in steady.routes}
    for one, other in zip(again.routes, steady.routes, strict=True):
        assert one.fuel == pytest.approx(other.fuel, rel=1e-9)
    assert again.best.optimality_gap == pytest.approx(steady.best.optimality_gap, abs=5e-3)


@pytest.mark.slow
def test_a_field_and_a_clock_that_are_shifted_together_give_the_same_route() -> None:
    day = 86_400.0
    field = Drifting(5, 0.6, 230.0)
    times = np.arange(0.0, 900.0, 10.0)
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(5, 4))

    def later(points: FloatArray, time: FloatArray) -> FloatArray:
        return field(points, time - day)

    one, other = (
        renew.plan(
            chart,
            renew.VaryingCurrent(times + shift, function),
            PAPER_VESSEL,
            (10, 10),
            (190, 190),
            departure=20.0 + shift,
            classes=4,
        )
        for shift, function in ((0.0, field), (day, later))
    )
    assert [r.homotopy for r in one.routes] == [r.homotopy for r in other.routes]
    assert one.best.path == pytest.approx(other.best.path, abs=1e-3)
    assert one.best.fuel == pytest.approx(other.best.fuel, rel=1e-6)


def test_an_arrival_after_the_end_of_the_currents_is_refused() -> None:
    scene = random_scene(3, 0.3)
    short = scene.in_current(renew.VaryingCurrent([0.0, 50.0], [scene.current] * 2))
    with pytest.raises(renew.UnreachableError, match=r"known until 50 s.*depart earlier$"):
        short.plan(classes=2, padding="none")
    with pytest.raises(renew.ParameterError, match="departure = 60 s lies outside"):
        short.plan(departure=60)


def test_a_gap_in_the_way_that_the_current_shuts_for_a_while_is_sailed_when_it_is_open() -> None:
    # A wall with one gap, through which the tide runs at 1.4 m/s against 1.0 m/s, and back.
    walls = [box(95, -1, 105, 90), box(95, 110, 105, 201)]
    chart = renew.Chart(box(0, 0, 200, 200), walls)

    def tide(points: FloatArray, time: FloatArray) -> FloatArray:
        near = np.exp(-(((points[..., 0] - 100) / 20) ** 2))
        u = 1.4 * near * np.cos(2 * np.pi * np.asarray(time) / 600)
        return np.stack([u, np.zeros_like(u)], axis=-1)

    current = renew.VaryingCurrent(np.arange(0.0, 2400.0, 10.0), tide)
    route = renew.plan(
        chart, current, PAPER_VESSEL, (10, 100), (190, 100), departure=90, padding="none"
    ).best
    inside = np.abs(route.trajectory[:, 1] - 100) < 20
    strength = np.linalg.norm(
        current.velocity(route.trajectory[inside, 1:3], route.trajectory[inside, 0]), axis=1
    )
    assert strength.max() < 1.0


@settings(max_examples=5, deadline=None)
@given(seed=seeds)
def test_fields_are_checked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(1, 2, 4))
    still = renew.UniformCurrent(0, 0)
    with pytest.raises(renew.ParameterError, match="3 currents for 4 times"):
        renew.VaryingCurrent(times, [still] * 3)
    with pytest.raises(renew.ParameterError, match=r"times\[1\] = .* s does not come after times"):
        renew.VaryingCurrent(times[[1, 0]], [still] * 2)
    with pytest.raises(renew.ParameterError, match="not finite"):
        renew.VaryingCurrent([0.0, math.nan], [still] * 2)
    hole = renew.VaryingCurrent(times, lambda points, _: np.full(points.shape, math.nan))
    with pytest.raises(renew.ParameterError, match="not finite, or beyond"):
        hole.velocity(np.zeros((2, 2)), 1.0)
