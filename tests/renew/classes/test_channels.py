"""Chart, homotopy classes and channels against independent counts and oracles."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from shapely import Polygon, box

import renew
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.dual_graph import dual_graph
from renew.classes.h_signature import Rays, name
from renew.classes.triangulation import Triangulation, triangulate
from tests.strategies import SIZE, random_islands, seeds, single_gyre, voyage_on

if TYPE_CHECKING:
    from renew.inputs.arguments import Order

LAKE = box(20, 20, 80, 80).difference(box(40, 40, 60, 60))


def chart_of(islands: list[Polygon]) -> renew.Chart:
    return renew.Chart(box(0, 0, 100, 100), islands)


def test_bad_geometry_is_named_all_at_once() -> None:
    bow_tie = Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])
    endless = Polygon([(0, 0), (math.inf, 0), (0, 1)])
    with pytest.raises(renew.GeometryError) as caught:
        chart_of([box(1, 1, 2, 2), bow_tie, endless])
    assert "no_go[1] is not valid: Self-intersection[5 5]" in str(caught.value)
    assert "no_go[2] has coordinates that are not finite" in str(caught.value)
    with pytest.raises(renew.GeometryError, match="no water is left"):
        chart_of([box(-1, -1, 101, 101)])


def channels_of(
    chart: renew.Chart, *, smallest: float = 0.0, order: Order = "length"
) -> tuple[Triangulation, ClassEnumerator]:
    mesh = triangulate(chart)
    return mesh, ClassEnumerator(voyage_on(chart), mesh, Rays.of(chart, smallest), order)


def test_both_orders_find_every_simple_path_once() -> None:
    chart, _ = single_gyre()
    mesh, search = channels_of(chart)
    ends = mesh.locate(np.array([10.0, 10.0])), mesh.locate(np.array([90.0, 90.0]))
    expected = {tuple(path) for path in nx.all_simple_paths(dual_graph(mesh), *ends)}
    found = [tuple(c.triangles.tolist()) for c in search.channels(1000)]
    depth_first = [
        tuple(c.triangles.tolist())
        for c in channels_of(chart, order="depth-first")[1].channels(1000)
    ]
    assert len(found) == len(set(found))
    assert set(found) == set(depth_first) == expected


@settings(max_examples=15)
@given(seed=seeds)
def test_classes_come_in_the_order_of_their_cheapest_chains(seed: int) -> None:
    # Every row of triangles by networkx, and the shortest chain of points in each by hand.
    rng = np.random.default_rng(seed)
    islands = [box(x, y, x + 12, y + 9) for x, y in rng.uniform(18, 70, (3, 2))]
    mesh, search = channels_of(chart_of(islands))
    start, goal = np.array([10.0, 10.0]), np.array([90.0, 90.0])
    nodes = search._coarse.graph

    def shortest(row: list[int]) -> float:
        points, lengths = start[None], np.zeros(1)
        for one, other in itertools.pairwise(row):
            gate = 3 * other + mesh.neighbours[other].tolist().index(one)
            onwards = nodes.points[nodes.first[gate] : nodes.first[gate + 1]]
            legs = np.linalg.norm(onwards[None] - points[:, None], axis=2)
            points, lengths = onwards, (lengths[:, None] + legs).min(axis=0)
        return float((lengths + np.linalg.norm(goal - points, axis=1)).min())

    found = [shortest(c.triangles.tolist()) for c in search.channels(1000)]
    assert found == pytest.approx(sorted(found))
    ends = mesh.locate(start), mesh.locate(goal)
    rows = nx.all_simple_paths(dual_graph(mesh), *ends)
    assert found == pytest.approx(sorted(shortest(row) for row in rows))


def test_points_on_passing_edges_keep_their_clearance() -> None:
    chart = chart_of([box(20, 20, 45, 80), box(50, 20, 80, 80)])
    mesh = triangulate(chart)
    for clearance, classes in ((0.0, 4), (2.0, 4), (2.6, 2)):
        search = ClassEnumerator(
            voyage_on(chart), mesh, Rays.of(chart), "length", clearance=clearance
        )
        corners = shapely.points(shapely.get_coordinates(chart.hard_no_go))
        for point in shapely.points(search._coarse.graph.points):
            assert shapely.distance(point, corners).min() >= clearance - 1e-9
        # Between the islands the gap is 5 m wide.
        assert len(search.channels(10)) == classes


def test_channels_around_islands_without_a_ray_are_one_class() -> None:
    islets = [box(x, y, x + 1, y + 1) for x, y in ((30, 25), (45, 50), (60, 55), (72, 70))]
    chart = chart_of([*islets, box(35, 60, 60, 85)])
    assert len(channels_of(chart)[1].channels(100)) > 8
    names = [c.name for c in channels_of(chart, smallest=5.0)[1].channels(100)]
    assert sorted(names) == ["e", "s1"]


def test_a_blocked_transition_gives_the_next_channel_of_the_class() -> None:
    islets = [box(x, y, x + 1, y + 1) for x, y in ((30, 25), (45, 50), (60, 55))]
    _, search = channels_of(chart_of([*islets, box(35, 60, 60, 85)]), smallest=5.0)
    first = search.channels(1)[0]
    blocked = {first.transitions[len(first.transitions) // 2]}
    again = next(c for c in search.channels(10, blocked) if c.word == first.word)
    assert again.triangles.tolist() != first.triangles.tolist()
    assert blocked.isdisjoint(again.transitions)


def test_goal_in_a_lake_is_unreachable() -> None:
    chart = chart_of([LAKE])
    mesh = triangulate(chart)
    voyage = voyage_on(chart, (5.0, 5.0), (50.0, 50.0))
    with pytest.raises(renew.UnreachableError, match="separates them"):
        ClassEnumerator(voyage, mesh, Rays.of(chart), "length")


def test_words_name_classes_and_nothing_else() -> None:
    chart = chart_of([box(40, 40, 60, 60), box(20, 70, 30, 80)])
    rays = Rays.of(chart)
    above = np.array([[5.0, 50.0], [50.0, 90.0], [95.0, 50.0]])
    below = np.array([[5.0, 50.0], [50.0, 10.0], [95.0, 50.0]])
    assert rays.word(below) == ()
    assert rays.word(above) == (2, 1) or rays.word(above) == (1,)
    # A detour that goes out and back the same way is no other class.
    there_and_back = np.array([[5, 50], [50, 90], [25, 50], [50, 90], [95, 50]], dtype=float)
    assert rays.word(there_and_back) == rays.word(above)
    # Once round the first island is.
    around = np.vstack([above, [[50.0, 10.0], [5.0, 50.0]]])
    assert rays.word(around)
    assert name(()) == "e"
    assert name((2, -1)) == "s2.p1"


@settings(max_examples=25)
@given(seed=seeds)
def test_words_do_not_change_when_a_path_is_wiggled(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed))
    rays = Rays.of(chart)
    rng = np.random.default_rng(seed)
    path = np.vstack([[5.0, 5.0], rng.uniform(0, SIZE, (4, 2)), [195.0, 195.0]])
    line = shapely.LineString(path)
    for _ in range(10):
        i = rng.integers(1, 5)
        moved = path.copy()
        moved[i] += rng.normal(0, 5, 2)
        swept = shapely.union_all(
            [
                shapely.convex_hull(shapely.MultiPoint([path[i], moved[i], path[j]]))
                for j in (i - 1, i + 1)
            ]
        )
        if not swept.intersects(chart.hard_no_go) and not line.intersects(chart.hard_no_go):
            assert rays.word(moved) == rays.word(path)
