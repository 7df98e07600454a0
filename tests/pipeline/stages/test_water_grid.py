"""Ways round islands on a coarse grid."""

import contextlib
import math

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.geo.projection import METRES_PER_DEGREE, Projection
from pipeline.sources.current_field import LandMask
from pipeline.stages.project import extent_polygon
from pipeline.stages.region import grown
from pipeline.stages.water_grid import (
    FAR_WAY,
    DirectLine,
    WaterGrid,
    choose_region,
    rounded_outward,
    widened_by,
)
from tests.strategies import examples
from tests.true_scale import GEOD

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
    [(length_m, cells)] = ways
    assert length_m == pytest.approx(known * METRES_PER_DEGREE / 100, rel=1e-6)
    assert is_water[cells[:, 0], cells[:, 1]].all()
    assert cells[0].tolist() == list(start)
    assert cells[-1].tolist() == list(goal)


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
    assert [length_m for length_m, _ in ways] == pytest.approx(
        [length * METRES_PER_DEGREE / 100 for length in known], rel=1e-6
    )
    if len(ways) == 2:
        turns = (swept(ways[0][1], island[0]) - swept(ways[1][1], island[0])) / (2 * np.pi)
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


# --- The region of a voyage, on synthetic seas and on the world's ---


WORLD = (-180.0, -89.0, 360.0, 89.0)


def mask(*land: shapely.Polygon) -> LandMask:
    """Make a mask of boxes."""
    return LandMask(lambda lon, lat: shapely.contains_xy(shapely.union_all(land), lon, lat), WORLD)


def region(
    start: tuple[float, float], goal: tuple[float, float], *land: shapely.Polygon
) -> list[float]:
    return list(choose_region(DirectLine.between(start, goal), lambda _: mask(*land), WORLD)[0])


def test_open_water_gives_start_and_goal_with_a_margin() -> None:
    west, south, east, north = region((10, 50), (12, 51))
    assert (west, south, east, north) == pytest.approx((9.75, 49.84, 12.25, 51.16), abs=0.06)


@given(st.floats(-170, 170), st.floats(-70, 70), st.floats(0, 360), st.floats(5e3, 2e6))
@examples(12, 40)
def test_start_and_goal_keep_a_tenth_of_their_distance_from_the_edge(
    lon: float, lat: float, bearing: float, distance_m: float
) -> None:
    goal = GEOD.fwd(lon, lat, bearing, distance_m)[:2]
    goal = (goal[0] + 360 * round((lon - goal[0]) / 360), goal[1])
    if not -70 <= goal[1] <= 70 or not -180 <= goal[0] <= 360:
        return
    west, south, east, north = region((lon, lat), goal)
    for x, y in ((lon, lat), goal):
        for edge in ((west, y), (east, y), (x, south), (x, north)):
            if abs(edge[0]) < 180:
                assert GEOD.inv(x, y, *edge)[2] > 0.095 * distance_m


def test_both_ways_round_an_island_are_inside() -> None:
    island = shapely.box(10.9, 49, 11.1, 52.5)
    _, south, _, north = region((10, 50.5), (12, 50.5), island)
    assert south < 48.9
    assert north > 52.6
    # The direct line alone would need far less.
    assert region((10, 50.5), (12, 50.5))[1] > 50


def test_a_way_that_no_navigator_thinks_of_is_not_inside() -> None:
    wall = shapely.box(10.9, 44, 11.1, 51)  # 720 km long; its northern end is near
    _, south, _, north = region((10, 50.5), (12, 50.5), wall)
    assert north > 51
    assert south > 49


def test_the_way_round_a_continent_is_inside_and_the_continent_is_not() -> None:
    wall = shapely.box(10.9, -80, 11.1, 53)
    _, south, _, north = region((10, 50.5), (12, 50.5), wall)
    assert north > 53
    assert south > 49


def test_a_way_that_is_further_than_the_first_search_is_found() -> None:
    wall = shapely.box(10.9, -80, 11.1, 58)
    assert region((10, 50.5), (12, 50.5), wall)[3] > 58


def test_a_region_ends_where_the_currents_do() -> None:
    limits = (9.9, 50.4, 12.1, 50.6)
    voyage = DirectLine.between((10, 50.5), (12, 50.5))
    assert choose_region(voyage, lambda _: mask(), limits)[0] == limits


def test_a_voyage_over_180_degrees_continues() -> None:
    west, _, east, _ = region((178.5, -17.5), (181.0, -16.5))
    assert (west < 178.4, east > 181.1) == (True, True)
    assert east - west < 4


def test_bounds_are_rounded_outward_and_to_few_digits() -> None:
    assert rounded_outward((1.23456, -2.34567, 3.00001, 4.0)) == (1.23, -2.35, 3.01, 4.0)
    rounded = rounded_outward((10.00001, 50.00001, 10.02, 50.03))
    assert np.allclose(rounded, (10.0, 50.0, 10.02, 50.03), atol=2e-3)
    assert rounded[0] <= 10.00001
    assert rounded[3] >= 50.03


def test_a_margin_in_metres_is_that_on_the_ground() -> None:
    west, south, _, north = widened_by((10, 60, 12, 61), 50_000)
    assert GEOD.inv(10, 61, west, 61)[2] >= 50_000
    assert GEOD.inv(10, 60, 10, south)[2] == pytest.approx(50_000, rel=0.01)
    assert GEOD.inv(12, 61, 12, north)[2] == pytest.approx(50_000, rel=0.01)


def is_a_chart(bounds: tuple[float, float, float, float]) -> bool:
    """Whether bounds keep off the poles, span half the world at most, and have a valid outline."""
    west, south, east, north = bounds
    outline = extent_polygon(shapely.box(*bounds), Projection.for_region(shapely.box(*bounds)))
    return east - west <= 180 and south > -90 and north < 90 and outline.is_valid


@given(
    lon=st.floats(-180, 180),
    lat=st.floats(-88.5, 88.5),
    width=st.floats(0.01, 179),
    height=st.floats(0.01, 20),
    metres=st.floats(2_000, 2e7),
)
def test_no_margin_reaches_round_the_world_or_over_a_pole(
    lon: float, lat: float, width: float, height: float, metres: float
) -> None:
    bounds = (lon, max(-88.9, lat - height), lon + width, lat)
    assert is_a_chart(rounded_outward(widened_by(bounds, metres)))
    assert is_a_chart(grown(bounds, range(4), metres, (-540.0, -89.0, 540.0, 89.0)))


def test_a_search_from_a_fjord_in_the_far_north_does_not_go_round_the_world() -> None:
    # A goal inside land has no way on any grid, so that the search grows as far as it may.
    searched: list[tuple[float, float, float, float]] = []

    def mask_of(bounds: tuple[float, float, float, float]) -> LandMask:
        searched.append(bounds)
        return mask(shapely.box(15, 60, 25, 75))

    choose_region(DirectLine.between((12.88, 68.02), (20.0, 68.64)), mask_of, WORLD)
    assert len(searched) > 1
    assert all(map(is_a_chart, searched))


@pytest.mark.gate_share(2)
@pytest.mark.parametrize(
    ("start", "goal", "inside"),
    [
        # Palawan: its northern and southern end.
        ((120.30, 12.80), (116.80, 7.70), [(119.5, 11.4), (117.1, 8.3)]),
        # Naples to Syracuse: round Sicily by the west, and through the Strait of Messina.
        ((14.3, 40.8), (15.35, 37.03), [(12.4, 37.9), (15.6, 38.2)]),
        # Naples to Bari: round the heel of Italy.
        ((14.2, 40.8), (16.9, 41.2), [(18.5, 39.8), (15.6, 38.2)]),
        # Across 180 degrees: round Vanua Levu and Viti Levu.
        ((177.3, -17.7), (180.1, -16.7), [(178.7, -18.2), (179.0, -16.1)]),
    ],
)
def test_real_waters_hold_what_a_navigator_thinks_of(
    start: tuple[float, float], goal: tuple[float, float], inside: list[tuple[float, float]]
) -> None:
    world = LandMask.world()
    bounds = choose_region(DirectLine.between(start, goal), lambda _: world, WORLD)[0]
    for place in inside:
        assert shapely.box(*bounds).contains(shapely.Point(place)), (bounds, place)


def test_no_island_is_cut_whose_far_side_a_voyage_might_use() -> None:
    """The direct line passes south of the island, and the region would cut it in two."""
    island = shapely.box(119.0, 10.1, 121.0, 11.2)
    voyage = DirectLine.between((118.0, 10.0), (122.0, 10.0))
    bounds, leaves_out = choose_region(voyage, lambda _: mask(island), WORLD)
    assert not leaves_out
    assert shapely.box(*bounds).contains(island)


def test_a_region_says_that_it_leaves_out_a_long_way() -> None:
    island = shapely.box(119.0, 10.1, 121.0, 12.9)
    voyage = DirectLine.between((118.0, 10.0), (122.0, 10.0))
    bounds, leaves_out = choose_region(voyage, lambda _: mask(island), WORLD)
    # By hand: to the north-western corner, along the north and back, in degrees of about one size.
    assert (2 * math.hypot(1.0, 2.9) + 2.0) / 4.0 > FAR_WAY
    assert leaves_out
    assert bounds[3] < 12.9


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    ("start", "goal", "island"),
    [
        # South or north of Gonâve, which the region once cut in two.
        ((-72.42, 18.62), (-74.6, 19.9), (-73.05, 18.85)),
        # Both sides of Bornholm, which lies beside the line from Simrishamn to Gdynia.
        ((14.6, 55.4), (18.9, 54.7), (14.95, 55.12)),
    ],
)
def test_real_islands_beside_the_line_are_whole(
    start: tuple[float, float], goal: tuple[float, float], island: tuple[float, float]
) -> None:
    world = LandMask.world()
    bounds = choose_region(DirectLine.between(start, goal), lambda _: world, WORLD)[0]
    grid = WaterGrid.of(world, bounds)
    row, column = grid.cells(np.array([island]))[0]
    number = int(grid.islands[row, column])
    assert number
    assert not grid.leaves(number)


def test_islands_behind_an_end_are_not_taken_for_islands_between() -> None:
    """Luzon lies behind the start: ways round it are more than thrice as long."""
    world = LandMask.world()
    voyage = DirectLine.between((120.30, 12.80), (116.80, 7.70))
    (west, south, east, north), leaves_out = choose_region(voyage, lambda _: world, WORLD)
    assert (east - west) * (north - south) < 50
    assert north < 15
    assert leaves_out
