"""The water of nearly best routes: nobody gets from start to goal nearly as cheaply outside it."""

import contextlib
import pickle

import numpy as np
import pytest
import shapely

import renew
from renew._types import FloatArray
from tests.renew.planner.test_adrift_water import ENDS, EXTENT, VESSEL, drawn


def outside(water: shapely.Geometry, chart: renew.Chart, count: int) -> FloatArray:
    """Return places (n, 2) on the chart's water just beyond the edge of other water."""
    edge = shapely.boundary(shapely.buffer(water, 60.0, quad_segs=2))
    along = np.linspace(0, 1, count + 2)[1:-1]
    places = shapely.line_interpolate_point(edge, along, normalized=True)
    points = shapely.get_coordinates(places)
    off = shapely.dwithin(chart.hard_no_go, places, 1.0) | shapely.intersects(water, places)
    return np.asarray(points[~off & shapely.contains_xy(chart.extent, points)])


@pytest.mark.parametrize(("along", "across"), [(0.0, 0.0), (0.5, 0.2), (-0.4, 0.3)])
def test_in_open_water_it_is_what_straight_legs_say(along: float, across: float) -> None:
    """In a uniform current the best way through a place has two straight legs."""
    chart, current = renew.Chart(EXTENT), renew.UniformCurrent(along, across)
    plan = renew.plan(chart, current, VESSEL, *ENDS, drift="crab")
    water = renew.near_best(plan)
    inside = np.random.default_rng(1).uniform(0, 20_000, (4_000, 2))

    def through(points: FloatArray) -> FloatArray:
        start, goal = np.array(ENDS)
        time = np.zeros(len(points))
        for way in (points - start, goal - points):
            length = np.linalg.norm(way, axis=1)
            tx, ty = (way / length[:, None]).T
            ahead, aside = along * tx + across * ty, across * tx - along * ty
            time += length / (ahead + np.sqrt(VESSEL.speed**2 - aside**2))
        return np.asarray(time * VESSEL.fuel_rate / plan.best.fuel)

    is_in = shapely.intersects_xy(water, inside)
    cost = through(inside)
    assert cost[~is_in].min() > 1.01
    # It is hardly larger than the water that routes within 1 % reach.
    assert cost[is_in].max() < 1.03
    assert 0.02 < is_in.mean() < 0.4


@pytest.mark.gate_share(2)
@pytest.mark.parametrize("seed", range(125))
def test_an_adversary_finds_no_nearly_best_route_outside_it(seed: int) -> None:
    """It looks for the best routes through places just outside: 1,000 in all waters."""
    chart, current, ends = drawn(seed)
    plan = renew.plan(chart, current, VESSEL, *ends, classes=4)
    tried = 0
    for place in outside(renew.near_best(plan), chart, 12):
        # Beside land there may be no room to turn.
        with contextlib.suppress(renew.UnreachableError):
            via = renew.plan(chart, current, VESSEL, *ends, via=[place], padding="none", classes=1)
            tried += 1
            assert via.best.fuel > 1.01 * plan.best.fuel
    assert tried >= 4


def test_it_is_known_in_steady_currents_from_start_to_goal_alone() -> None:
    chart, current = renew.Chart(EXTENT), renew.UniformCurrent(0.1, 0.0)
    plan = renew.plan(chart, current, VESSEL, *ENDS)
    with pytest.raises(renew.ParameterError, match=r"excess = 0 must be a share above 0"):
        renew.near_best(plan, 0)
    through = renew.plan(chart, current, VESSEL, *ENDS, via=[(9_000, 9_000)])
    for other in (through, pickle.loads(pickle.dumps(plan))):  # noqa: S301 - own
        with pytest.raises(renew.ParameterError, match="known in steady currents only"):
            renew.near_best(other)
