"""The dual graph against Euler's formula, its searches against networkx, and crossed triangles."""

import itertools
import math

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings, strategies as st
from shapely import box

import renew
from renew.classes.dual_graph import (
    Channel,
    dual_graph,
    is_connected,
    simple_paths,
    surroundings,
    visits,
    widest_gap,
    without_dead_ends,
)
from renew.classes.triangulation import triangulate
from tests.strategies import SIZE, random_islands, random_scene, seeds


@settings(max_examples=25)
@given(seed=seeds)
def test_dual_graph_has_one_cycle_for_each_island(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed))
    dual = dual_graph(triangulate(chart))
    parts = shapely.get_parts(chart.water)  # islands that overlap may enclose some water
    assert nx.number_connected_components(dual) == len(parts)
    cycles = dual.number_of_edges() - dual.number_of_nodes() + len(parts)
    assert cycles == sum(len(part.interiors) for part in parts)


@settings(max_examples=25)
@given(seed=seeds)
def test_dead_ends_are_what_is_left_of_no_way(seed: int) -> None:
    # A bay with land around it, behind a strait, beside the random islands.
    bay = [box(0, 160, 80, 162), box(83, 160, SIZE, 162)]
    chart = renew.Chart(box(0, 0, SIZE, SIZE), [*random_islands(seed), *bay])
    triangulation = triangulate(chart)
    first, last = np.random.default_rng(seed).integers(0, len(triangulation.triangles), 2).tolist()
    dual = dual_graph(triangulation)
    assume(first != last and nx.has_path(dual, first, last))
    found = without_dead_ends(triangulation.neighbours, first, last)
    assert not found.all()
    # Whatever lies on a cycle, or between two cycles, once the ends are joined.
    dual.add_edges_from([(-1, first), (-1, last)])
    assert set(np.flatnonzero(found).tolist()) == set(nx.k_core(dual, 2)) - {-1}


def test_triangles_on_both_sides_of_a_wall_are_not_connected() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, -1, 60, 101), box(10, 10, 20, 20)])
    triangulation = triangulate(chart)
    dual = dual_graph(triangulation)
    for one, other in itertools.combinations(range(len(triangulation.triangles)), 2):
        assert is_connected(triangulation, one, other) == nx.has_path(dual, one, other)


@settings(max_examples=15)
@given(seed=seeds)
def test_simple_paths_are_all_that_networkx_finds_in_its_order(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, 4))
    triangulation = triangulate(chart)
    dual = dual_graph(triangulation)
    last = max(nx.node_connected_component(dual, 0))
    found = list(simple_paths(triangulation, 0, last, 1_000_000))
    assert found == list(nx.all_simple_paths(dual, 0, last))
    # With fewer steps it gives up earlier, and finds the first of them.
    some = list(simple_paths(triangulation, 0, last, 50))
    assert some == found[: len(some)]


@settings(max_examples=10)
@given(seed=seeds)
def test_the_widest_gap_is_that_of_the_best_of_all_ways(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, 3))
    triangulation = triangulate(chart)
    dual = dual_graph(triangulation)
    one = 0
    other = max(nx.node_connected_component(dual, one))
    ways = nx.all_simple_edge_paths(dual, one, other)
    widest = max(min(dual.edges[edge]["width"] for edge in way) for way in ways)
    gap = widest_gap(triangulation, one, other)
    assert gap is not None
    assert math.dist(*gap) == pytest.approx(widest)
    assert widest_gap(triangulation, one, one) is None


@given(seed=seeds, layers=st.integers(0, 3))
@settings(max_examples=15)
def test_surroundings_are_as_near_as_asked_and_know_the_nearest_place(
    seed: int, layers: int
) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, 4))
    triangulation = triangulate(chart)
    dual = dual_graph(triangulation)
    row = nx.shortest_path(dual, 0, max(nx.node_connected_component(dual, 0)))
    found = surroundings(triangulation, row, layers)
    distance = nx.multi_source_dijkstra_path_length(dual, set(row), weight=None)
    assert list(found)[: len(row)] == row
    assert set(found) == {triangle for triangle, edges in distance.items() if edges <= layers}
    for triangle, place in found.items():
        assert nx.shortest_path_length(dual, triangle, row[place]) == distance[triangle]


@given(seed=seeds, bulge=st.integers(1, 12))
@settings(max_examples=15)
def test_surroundings_go_with_a_path_that_bulges_out_of_its_row(seed: int, bulge: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, 4))
    triangulation = triangulate(chart)
    dual = dual_graph(triangulation)
    row = [0]
    crossed = {n for n, _ in zip(nx.bfs_tree(dual, 0), range(bulge), strict=False)}
    found = surroundings(triangulation, row, 1, crossed)
    wanted = crossed.union(*(dual[triangle] for triangle in crossed))
    assert set(found) == wanted
    assert set(found.values()) == {0}


@settings(max_examples=10)
@given(seed=seeds)
def test_each_passing_edge_is_shared_and_has_its_left_end_to_the_left(seed: int) -> None:
    chart, _, start, goal = random_scene(seed).parts
    triangulation = triangulate(chart)
    row = nx.shortest_path(
        dual_graph(triangulation), triangulation.locate(start), triangulation.locate(goal)
    )
    channel = Channel.of(triangulation, np.array(row), (1, -2))
    assert channel.name == "s1.p2"
    midline = channel.midline(start, goal)
    assert midline[[0, -1]].tolist() == [start.tolist(), goal.tolist()]
    corners = triangulation.corners
    for place, (one, other) in enumerate(itertools.pairwise(row)):
        left, right = channel.left[place], channel.right[place]
        for triangle in (one, other):
            assert {tuple(left), tuple(right)} < set(map(tuple, corners[triangle].tolist()))
        along = corners[other].mean(axis=0) - corners[one].mean(axis=0)
        across = left - right
        assert along[0] * across[1] - along[1] * across[0] > 0
        assert midline[place + 1] == pytest.approx((left + right) / 2)


def test_transitions_name_the_triangles_before_and_after() -> None:
    triangulation = triangulate(random_scene(0).chart)
    first = 0
    second = int(triangulation.neighbours[first].max())
    channel = Channel.of(triangulation, np.array([first, second]))
    assert channel.transitions == [(-1, first, second), (first, second, -1)]
    assert channel.name == "e"


@given(scene=st.integers(0, 4), seed=st.integers(0, 10_000), legs=st.integers(1, 12))
@example(scene=0, seed=49, legs=1)  # a path on land, through no triangle
def test_visits_are_the_pieces_into_which_triangles_cut_a_path(
    scene: int, seed: int, legs: int
) -> None:
    chart = random_scene(scene).chart
    corners = triangulate(chart).corners
    xmin, ymin, xmax, ymax = chart.bounds
    path = np.random.default_rng(seed).uniform((xmin, ymin), (xmax, ymax), (legs + 1, 2))

    found = visits(path, corners)

    inside = shapely.intersection(shapely.polygons(corners), shapely.LineString(path))
    assert set(found.triangle.tolist()) == set(np.flatnonzero(shapely.length(inside) > 0).tolist())
    # Each visit begins and ends in its triangle, and no triangle follows itself.
    for places in (found.enter, found.leave):
        triangles = shapely.polygons(corners[found.triangle])
        outside = shapely.distance(triangles, shapely.points(places))
        assert outside.max(initial=0.0) < 1e-9 * (xmax - xmin)
    assert all(one != other for one, other in itertools.pairwise(found.triangle.tolist()))


def test_a_triangle_entered_again_is_visited_twice_and_one_only_touched_is_not_visited() -> None:
    below = [(0, 0), (4, 0), (2, 2)]
    above = [(4, 0), (6, 2), (2, 2)]
    touched = [(6, 2), (8, 0), (8, 4)]
    path = np.array([(1.0, 0.5), (4.0, 1.0), (1.5, 1.0), (3.0, 2.0), (6.0, 2.0)])

    found = visits(path, np.array([below, above, touched], dtype=float))

    assert found.triangle.tolist() == [0, 1, 0, 1]
    np.testing.assert_allclose(found.enter[0], path[0])
    np.testing.assert_allclose(found.leave[0], found.enter[1])
    np.testing.assert_allclose(found.leave[-1], path[-1])
