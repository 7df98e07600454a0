"""Nodes on passing edges, and their cost to go against networkx and a plain quadrature."""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from shapely import box

import renew
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.h_signature import Rays
from renew.classes.portal_graph import COARSE, PortalGraph, cost_to_go, leg_time, portal_graph
from renew.classes.triangulation import triangulate
from renew.kernels.capsules import Segment
from tests.compiler import uncompiled
from tests.strategies import PAPER_VESSEL, StreamFunctionCurrent, random_islands, seeds, voyage_on


def graph_of(seed: int, islands: int = 2, peak: float = 0.6) -> PortalGraph:
    """Coarse portal graph of a random scene."""
    chart = renew.Chart(box(0, 0, 200, 200), random_islands(seed, islands))
    voyage = voyage_on(
        chart, (10.0, 10.0), (190.0, 190.0), StreamFunctionCurrent(seed, peak), "crab"
    )
    triangulation = triangulate(chart)
    return portal_graph(
        voyage,
        triangulation,
        Rays.of(chart),
        (triangulation.locate(voyage.start), triangulation.locate(voyage.goal)),
        voyage.table,
        clearance=0.0,
        density=COARSE,
    )


def test_points_on_passing_edges_keep_their_clearance() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(20, 20, 45, 80), box(50, 20, 80, 80)])
    triangulation = triangulate(chart)
    for clearance, classes in ((0.0, 4), (2.0, 4), (2.6, 2)):
        enumerator = ClassEnumerator(
            voyage_on(chart), triangulation, Rays.of(chart), "length", clearance=clearance
        )
        corners = shapely.points(shapely.get_coordinates(chart.hard_no_go))
        for point in shapely.points(enumerator._coarse.graph.points):
            assert shapely.distance(point, corners).min() >= clearance - 1e-9
        # The strait between the islands is 5 m wide.
        assert len(enumerator.channels(10)) == classes


@settings(max_examples=10)
@given(seed=seeds)
def test_the_time_of_a_leg_is_nearly_that_of_eq_4(seed: int) -> None:
    graph = graph_of(seed)
    a, b = np.random.default_rng(seed).uniform(20, 180, (2, 2)).tolist()
    field = renew.GriddedCurrent(graph.table.x, graph.table.y, *np.moveaxis(graph.table.uv, -1, 0))
    exact = renew.fuel(np.array([a, b]), field, PAPER_VESSEL, drift="crab")
    assert leg_time(graph, Segment(*a, *b)) == pytest.approx(exact, rel=0.05)


def test_a_leg_against_too_strong_a_current_is_slow_and_not_impossible() -> None:
    graph = graph_of(0)
    graph = graph._replace(
        table=graph.table._replace(uv=np.broadcast_to([0.0, -2.0], graph.table.uv.shape).copy())
    )
    assert leg_time(graph, Segment(50, 50, 50, 60)) == pytest.approx(100)


@settings(max_examples=8)
@given(seed=seeds)
def test_cost_to_go_is_that_of_networkx_over_the_same_nodes(seed: int) -> None:
    graph = graph_of(seed)
    rng = np.random.default_rng(seed)
    blocked = rng.random((len(graph.neighbours), 4, 4)) < 0.15

    # Arrows point back from the goal: from a node to those by which its triangle can be left.
    backwards: nx.DiGraph[int] = nx.DiGraph()
    backwards.add_node("goal")
    for node, (portal, point) in enumerate(zip(graph.portal, graph.points, strict=True)):
        triangle, entry = divmod(int(portal), 3)
        if triangle == graph.goal_triangle and not blocked[triangle, entry, 3]:
            time = leg_time(graph, Segment(*point, *graph.goal))
            backwards.add_edge("goal", node, weight=time)
        for out, beside in enumerate(graph.neighbours[triangle].tolist()):
            if beside < 0 or out == entry or blocked[triangle, entry, out]:
                continue
            into = 3 * beside + graph.neighbours[beside].tolist().index(triangle)
            for following in range(graph.first[into], graph.first[into + 1]):
                time = leg_time(graph, Segment(*point, *graph.points[following]))
                backwards.add_edge(following, node, weight=time)
    times = nx.single_source_dijkstra_path_length(backwards, "goal")
    expected = [times.get(node, math.inf) for node in range(len(graph.portal))]

    assert cost_to_go(graph, blocked) == pytest.approx(np.array(expected))
    if seed % 4 == 0:
        interpreted = uncompiled(cost_to_go)(graph, blocked)
        assert interpreted == pytest.approx(np.array(expected))


def test_both_ways_through_an_edge_share_its_points() -> None:
    graph = graph_of(3, islands=4)
    for triangle, corner in itertools.product(range(len(graph.neighbours)), range(3)):
        beside = graph.neighbours[triangle, corner]
        if beside >= 0:
            one, other = 3 * triangle + corner, 3 * beside + graph.back[triangle, corner]
            points = [graph.points[graph.first[p] : graph.first[p + 1]] for p in (one, other)]
            assert len(points[0])
            assert points[0] == pytest.approx(points[1])
