"""The referee against calculations that share no code with it."""

import math

import numpy as np
import pytest
import shapely
from scipy.integrate import quad, solve_ivp

import renew
from experiments.referee.referee import judged, one_turn_a_station
from renew.voyage.voyage import Voyage, Waters
from tests.experiments.scenes import CURRENT, VESSEL, islands_voyage

# Round both islands to their right.
AROUND = np.array([(6.0, 7.0), (32.0, 14.0), (48.0, 32.0), (54.0, 52.0)])


def test_fuel_is_the_integral_of_equation_4() -> None:
    def slowness(place: float, leg: int) -> float:
        a, b = AROUND[leg], AROUND[leg + 1]
        tangent = (b - a) / np.linalg.norm(b - a)
        x, y = np.pi * (a + place * (b - a)) / 60
        current = 0.6 * np.array([-math.sin(x) * math.cos(y), math.cos(x) * math.sin(y)])
        return float(np.linalg.norm(b - a) / (1.0 + current @ tangent))

    by_quad = sum(quad(slowness, 0, 1, args=(leg,))[0] for leg in range(len(AROUND) - 1))
    found = judged(AROUND, islands_voyage(), spacing=1.0)
    assert found.fuel == pytest.approx(by_quad, rel=1e-8)
    assert found.length == pytest.approx(sum(math.dist(a, b) for a, b in zip(AROUND, AROUND[1:])))  # noqa: B905, RUF007


def test_clearance_is_the_least_distance_of_dense_points() -> None:
    dense = np.concatenate([np.linspace(a, b, 4000) for a, b in zip(AROUND, AROUND[1:])])  # noqa: B905, RUF007
    land = islands_voyage().chart.no_go
    least = min(shapely.distance(shapely.points(dense), polygon).min() for polygon in land)
    found = judged(AROUND, islands_voyage(), spacing=1.0)
    assert found.clearance == pytest.approx(least, abs=1e-3)
    assert not found.crosses_land


def test_a_path_over_land_is_found_out() -> None:
    straight = AROUND[[0, -1]]
    found = judged(straight, islands_voyage(), spacing=1.0)
    assert found.crosses_land
    assert found.clearance == 0
    assert found.collisions > 0
    assert found.full_collisions > 0


def test_a_path_along_the_shore_does_not_cross_it() -> None:
    along = np.array([(6.0, 7.0), (36.0, 20.0), (36.0, 50.0), (54.0, 52.0)])
    found = judged(along, islands_voyage(), spacing=1.0)
    assert not found.crosses_land
    # Charts are snapped to a grid of 1e-9 of their diagonal.
    assert found.clearance == pytest.approx(0, abs=1e-6)


def test_a_hairpin_can_not_be_steered() -> None:
    hairpin = np.array([(6.0, 7.0), (6.5, 7.0), (6.0, 7.1), (6.5, 7.2), (54.0, 9.0), (54.0, 52.0)])
    assert not judged(hairpin, islands_voyage(), spacing=1.0).is_steerable
    assert judged(AROUND, islands_voyage(), spacing=1.0).is_steerable


def test_one_turn_a_station_flies_as_the_equation_of_motion_does() -> None:
    # A bar that only the turn to one side reaches: of two seeds one draws that side.
    chart_with = _bar_beside
    start, goal = np.array([20.0, 30.0]), np.array([20.5, 30.0])
    reach = {side: _furthest_north(start, side) for side in (1, -1)}
    high, low = max(reach.values()), min(reach.values())
    assert high > low + 1
    bar = (high + low) / 2
    voyage = chart_with(bar, start, goal)
    counts = {
        one_turn_a_station(
            np.stack([start, goal]), voyage.chart, CURRENT, VESSEL, spacing=10.0, seed=seed
        )
        for seed in range(12)
    }
    # Two stations, each to one side: none, one or both of the turns meet the bar.
    assert counts == {(0, 2), (1, 2), (2, 2)}


def _bar_beside(bar: float, start: np.ndarray, goal: np.ndarray) -> Voyage:
    chart = renew.Chart(shapely.box(0, 0, 60, 60), [shapely.box(5, bar, 40, bar + 2)])
    return Voyage(Waters(chart, CURRENT), VESSEL, start, goal, "projected")


def _furthest_north(start: np.ndarray, side: int) -> float:
    """The northernmost point of a full turn, by a solver of differential equations."""
    u, v = CURRENT(start)
    # Heading that holds an eastward course.
    heading = math.asin(-v / VESSEL.speed)

    def motion(t: float, place: np.ndarray) -> list[float]:
        ahead = heading + side * VESSEL.turn_rate * t
        drift = CURRENT(np.asarray(place))
        return [math.cos(ahead) + drift[0], math.sin(ahead) + drift[1]]

    del u
    flown = solve_ivp(motion, (0, VESSEL.turn_period), start, rtol=1e-8, max_step=0.05)
    return float(flown.y[1].max())


def test_a_path_from_elsewhere_is_refused() -> None:
    with pytest.raises(renew.ParameterError, match=r"off the start or the goal; give one from"):
        judged(AROUND + 1.0, islands_voyage(), spacing=1.0)
