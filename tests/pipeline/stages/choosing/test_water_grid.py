"""Ways round islands on a coarse grid."""

from __future__ import annotations

import contextlib

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.geo.lonlat import METRES_PER_DEGREE
from pipeline.sources.current_field import LandMask
from pipeline.stages.water_grid import WaterGrid

SHAPE = (7, 9)
EVERYWHERE = (-180.0, -90.0, 360.0, 90.0)


def near_the_equator(is_water: np.ndarray) -> WaterGrid:
    """Return cells of 0.01 degrees, where a degree of longitude is as long as one of latitude."""
    ny, nx_ = is_water.shape
    return WaterGrid(np.arange(nx_) / 100, np.arange(ny) / 100, is_water)


def oracle(is_water: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> float | None:
    """Return the length of the shortest path in cells, from a graph built step by step."""
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
    ways = near_the_equator(is_water).shortest_paths(start, goal)
    known = oracle(is_water, start, goal)
    if known is None:
        assert not ways
        return
    [way] = ways
    assert way.length_m == pytest.approx(known * METRES_PER_DEGREE / 100, rel=1e-6)
    assert is_water[way.cells[:, 0], way.cells[:, 1]].all()
    assert way.cells[0].tolist() == list(start)
    assert way.cells[-1].tolist() == list(goal)


def swept(cells: np.ndarray, centre: np.ndarray) -> float:
    """Return the angle (rad) that a path of cells (n, 2) sweeps as seen from a place (2,)."""
    y, x = (cells - centre).T
    return float(np.diff(np.unwrap(np.arctan2(y, x))[[0, -1]])[0])


def shortest_on_each_side(
    is_water: np.ndarray, start: tuple[int, int], goal: tuple[int, int], island: np.ndarray
) -> list[float]:
    """Return lengths in cells by a search over (cell, parity of crossings of a ray north)."""
    row, column = island[island[:, 0].argmax()].tolist()
    graph = nx.Graph()
    for r, c in np.argwhere(is_water).tolist():
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            beside = [(r + down, c), (r, c + right), (r + down, c + right)]
            if all(
                0 <= y < is_water.shape[0] and 0 <= x < is_water.shape[1] and is_water[y, x]
                for y, x in beside
            ):
                crosses = min(c, c + right) == column and right != 0 and r + down / 2 > row
                for parity in (0, 1):
                    there = (r + down, c + right, parity ^ crosses)
                    graph.add_edge((r, c, parity), there, weight=np.hypot(down, right))
    lengths = []
    for parity in (0, 1):
        with contextlib.suppress(nx.NetworkXNoPath, nx.NodeNotFound):
            ends = (*start, 0), (*goal, parity)
            lengths.append(float(nx.shortest_path_length(graph, *ends, weight="weight")))
    return sorted(lengths)


@given(arrays(np.bool_, SHAPE, elements=st.sampled_from([True, True, True, True, False])))
@settings(max_examples=60)
def test_ways_on_both_sides_are_as_short_as_those_of_another_search(is_water: np.ndarray) -> None:
    start, goal = (0, 0), (SHAPE[0] - 1, SHAPE[1] - 1)
    is_water[start] = is_water[goal] = True
    is_water[3, 4] = False
    grid = near_the_equator(is_water)
    number = int(grid.islands[3, 4])
    island = np.argwhere(grid.islands == number)
    ways = grid.shortest_paths(start, goal, number)
    known = shortest_on_each_side(is_water, start, goal, island)
    assert [way.length_m for way in ways] == pytest.approx(
        [length * METRES_PER_DEGREE / 100 for length in known], rel=1e-6
    )
    if len(ways) == 2:
        turns = (swept(ways[0].cells, island[0]) - swept(ways[1].cells, island[0])) / (2 * np.pi)
        assert round(turns) % 2 == 1
        assert turns == pytest.approx(round(turns))


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
