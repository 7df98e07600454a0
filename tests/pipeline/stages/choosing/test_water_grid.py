"""Ways round islands on a coarse grid."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.sources.quality.field import LandMask
from pipeline.stages.choosing.water_grid import WaterGrid

SHAPE = (7, 9)
EVERYWHERE = (-180.0, -90.0, 360.0, 90.0)


def near_the_equator(is_water: np.ndarray) -> WaterGrid:
    """Return cells of 0.01 degrees, where a degree of longitude is as long as one of latitude."""
    ny, nx_ = is_water.shape
    return WaterGrid(np.arange(nx_) / 100, np.arange(ny) / 100, is_water)


def oracle(is_water: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> float | None:
    """Return the length of the shortest way in cells, from a graph that is built step by step."""
    graph = nx.Graph()
    for row, column in np.argwhere(is_water).tolist():
        graph.add_node((row, column))
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            there = (row + down, column + right)
            beside = [(row + down, column), (row, column + right), there]
            if all(
                0 <= r < is_water.shape[0] and 0 <= c < is_water.shape[1] and is_water[r, c]
                for r, c in beside
            ):
                graph.add_edge((row, column), there, weight=np.hypot(down, right))
    try:
        return float(nx.shortest_path_length(graph, start, goal, weight="weight"))
    except nx.NetworkXNoPath:
        return None


@given(arrays(np.bool_, SHAPE, elements=st.sampled_from([True, True, False])))
@settings(max_examples=60)
def test_the_way_is_as_short_as_that_of_another_search(is_water: np.ndarray) -> None:
    start, goal = (0, 0), (SHAPE[0] - 1, SHAPE[1] - 1)
    is_water[start] = is_water[goal] = True
    way = near_the_equator(is_water).shortest_way(start, goal)
    known = oracle(is_water, start, goal)
    if way is None or known is None:
        assert way is None
        assert known is None
        return
    assert way.length_m == pytest.approx(known * METRES_PER_DEGREE / 100, rel=1e-6)
    assert is_water[way.cells[:, 0], way.cells[:, 1]].all()
    assert way.cells[0].tolist() == list(start)
    assert way.cells[-1].tolist() == list(goal)


def test_a_barrier_of_cells_that_touch_by_a_corner_is_tight() -> None:
    grid = near_the_equator(np.ones((9, 9), dtype=bool))
    diagonal = np.stack([np.arange(9), np.arange(9)], axis=1)
    assert grid.shortest_way((8, 0), (0, 8), diagonal) is None
    assert grid.shortest_way((8, 0), (0, 8), diagonal[:-1]) is not None


def test_cells_are_square_on_the_ground_and_water_is_found_near_a_harbour() -> None:
    mask = LandMask(lambda lon, lat: (lon < 10.05) & (lat < 60.1), EVERYWHERE)
    grid = WaterGrid.of(mask, (10.0, 60.0, 12.0, 61.0))
    east, north = np.diff(grid.lon).mean(), np.diff(grid.lat).mean()
    assert east * np.cos(np.radians(60.5)) == pytest.approx(north, rel=0.01)
    cell = grid.water_near(10.045, 60.05)
    assert cell is not None
    assert grid.is_water[cell]
    assert abs(grid.lon[cell[1]] - 10.05) < 2 * east
    assert grid.water_near(10.0, 60.0) is None


def test_an_island_is_one_piece_and_a_continent_leaves_the_grid() -> None:
    is_water = np.ones((20, 20), dtype=bool)
    is_water[8:12, 8:12] = False
    is_water[:, 0] = False
    grid = near_the_equator(is_water)
    island, continent = grid.islands[10, 10], grid.islands[10, 0]
    assert (grid.islands == island).sum() == 16
    assert not grid.leaves(int(island))
    assert grid.leaves(int(continent))
