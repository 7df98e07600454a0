"""The yardstick is sound: known shortest paths on either side, and never below the oracle."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from tests.oracles import grid_dijkstra
from tests.strategies import PAPER_VESSEL, STILL, random_scene
from tests.yardstick import Grid, Wall, keep_out, passage_time

# The stencil's widest gap is 11.3 degrees: courses are off by 5.7 at most, and ways 0.5 % longer.
DETOUR = 1.005


@pytest.mark.parametrize(("side", "beyond"), [(1, 5.0), (-1, 15.0)])
def test_it_finds_the_way_round_an_island_on_each_side(side: int, beyond: float) -> None:
    island = shapely.box(49, 15, 51, 35)
    clearance, speed = 3.0, 2.0
    start, goal = np.array([10.0, 30.0]), np.array([90.0, 30.0])
    wall = Wall(np.array([50.0, 25.0]), np.array([1.0, 0.0]))
    barred = keep_out([island], clearance)
    extent = shapely.box(0, 0, 100, 60)
    grid = Grid.over(extent, barred, STILL, speed, start, goal, 1.0)
    path = grid.best_on_each_side(wall)[side]
    # A taut string: tangents to circles around the island's corners, arcs, and the island's width.
    apart = math.hypot(39, beyond)
    turned = math.atan2(beyond, 39) + math.asin(clearance / apart)
    shortest = 2 * (math.sqrt(apart**2 - clearance**2) + clearance * turned) + 2
    assert wall.halves(path[:-1], path[1:]).sum() == side
    assert shapely.LineString(path).distance(island) >= clearance
    assert shortest <= passage_time(path, STILL, speed) * speed <= DETOUR * shortest + 1


def test_it_prices_a_current_as_the_oracle_does() -> None:
    scene = random_scene(1)
    chart, current, start, goal = scene.parts
    barred = keep_out(chart.no_go, 0.0)
    path = Grid.over(chart.extent, barred, current, PAPER_VESSEL.speed, start, goal, 4.0).best()
    assert path is not None
    time = passage_time(path, current, PAPER_VESSEL.speed)
    fuel, finer = grid_dijkstra(*scene.asked, 4.0, radius=5)
    assert passage_time(finer, current, PAPER_VESSEL.speed) == pytest.approx(fuel, rel=1e-3)
    assert time == pytest.approx(fuel, rel=1e-2)


def test_it_finds_nothing_where_there_is_no_way() -> None:
    barred = shapely.box(40, -1, 60, 61)
    start, goal = np.array([10.0, 30.0]), np.array([90.0, 30.0])
    grid = Grid.over(shapely.box(0, 0, 100, 60), barred, STILL, 1.0, start, goal, 2.0)
    assert grid.best() is None
