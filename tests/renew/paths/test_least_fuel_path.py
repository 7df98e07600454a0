"""Least-fuel paths against a visibility graph and against random chains."""

import itertools
import math
from functools import partial

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from shapely import box

import renew
from renew.paths.least_fuel_path import path_near, path_through_sections, refined_path
from tests.renew.paths.scenes import corridor_in_scene, corridor_of
from tests.strategies import SIZE, STILL, examples, random_islands, random_scene, seeds

NIMBLE = renew.Vessel(speed=1.0, turn_rate=math.radians(2000))


def visibility_length(chart: renew.Chart, start: np.ndarray, goal: np.ndarray) -> float:
    """Length of the shortest path by a visibility graph: the oracle for still water."""
    nodes = np.vstack([start, goal, *(shapely.get_coordinates(p)[:-1] for p in chart.no_go)])
    land = chart.hard_no_go.buffer(-1e-7)
    graph: nx.Graph = nx.Graph()
    for i, j in itertools.combinations(range(len(nodes)), 2):
        sight = shapely.LineString(nodes[[i, j]])
        if not sight.intersects(land) and chart.extent.covers(sight):
            graph.add_edge(i, j, weight=sight.length)
    return float(nx.shortest_path_length(graph, 0, 1, weight="weight"))


@settings(max_examples=6, deadline=None)
@given(seed=seeds)
def test_still_water_gives_the_shortest_path(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, count=4))
    start, goal = np.array([10.0, 10.0]), np.array([190.0, 190.0])
    best = renew.plan(chart, STILL, NIMBLE, start, goal, padding="none", classes=12).best
    shortest = visibility_length(chart, start, goal)
    assert shortest * (1 - 1e-9) <= best.length <= shortest * 1.0005
    assert best.fuel == pytest.approx(best.length)


@examples(2, 5)
@given(seed=seeds)
def test_no_sampled_path_needs_less_than_the_least_fuel_path_of_its_class(seed: int) -> None:
    plan = partial(random_scene(seed).plan, padding="none", classes=4, drift="crab")
    optimal = plan()
    best = {route.homotopy: route.fuel for route in optimal.routes}
    try:
        sampled = plan(method="sampled", samples=300)
    except renew.UnreachableError:
        return
    for route in sampled.routes:
        if route.homotopy in best:
            assert best[route.homotopy] <= route.fuel * (1 + 1e-3)


@pytest.mark.parametrize("scene", [0, 3, 5])
def test_the_refined_path_needs_no_more_than_the_rough_one_and_both_are_clear(scene: int) -> None:
    corridor = corridor_in_scene(scene)
    voyage = corridor.voyage
    rough = path_near(corridor, path_through_sections(corridor))
    path = refined_path(corridor, rough)
    for one in (rough, path):
        assert one[[0, -1]].tolist() == [voyage.start.tolist(), voyage.goal.tolist()]
        assert corridor.legs_clear(one).all()
    assert voyage.fuel(path) <= voyage.fuel(rough) * (1 + 1e-4)


@pytest.mark.parametrize("place", range(3))
def test_bulging_out_of_the_channel_over_open_water_saves_fuel(place: int) -> None:
    voyage = random_scene(2).voyage
    corridor = corridor_of(voyage, "none", place=place)
    within = path_through_sections(corridor)
    bulging = refined_path(corridor, path_near(corridor, within))
    # The channel's triangles come first among those of the corridor.
    own = shapely.polygons(corridor.corners[: len(corridor.channel.triangles)])
    channel = shapely.union_all(own).buffer(1e-6)
    assert channel.covers(shapely.LineString(within))
    assert not channel.covers(shapely.LineString(bulging))
    assert voyage.fuel(within) > 1.03 * voyage.fuel(bulging)
