"""The class enumerator: every simple path once, one channel a class, blocked transitions."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from shapely import Polygon, box

import renew
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.dual_graph import dual_graph
from renew.classes.h_signature import Rays
from renew.classes.triangulation import Triangulation, triangulate
from renew.inputs.options import Order
from tests.strategies import single_gyre, voyage_on

LAKE = box(20, 20, 80, 80).difference(box(40, 40, 60, 60))


def chart_of(islands: list[Polygon]) -> renew.Chart:
    return renew.Chart(box(0, 0, 100, 100), islands)


def enumerator_on(
    chart: renew.Chart, *, min_size: float = 0.0, order: Order = "length"
) -> tuple[Triangulation, ClassEnumerator]:
    triangulation = triangulate(chart)
    rays = Rays.of(chart)
    rays = rays.only(rays.size >= min_size)
    return triangulation, ClassEnumerator.of(voyage_on(chart), triangulation, rays, order)


def test_both_orders_find_every_simple_path_once() -> None:
    chart, _ = single_gyre()
    triangulation, enumerator = enumerator_on(chart)
    endpoints = (triangulation.locate(np.array([x, x])) for x in (10.0, 90.0))
    expected = {tuple(path) for path in nx.all_simple_paths(dual_graph(triangulation), *endpoints)}
    found = [tuple(c.triangles.tolist()) for c in enumerator.channels(1000)]
    depth_first = [
        tuple(c.triangles.tolist())
        for c in enumerator_on(chart, order="depth-first")[1].channels(1000)
    ]
    assert len(found) == len(set(found))
    assert set(found) == set(depth_first) == expected


def test_channels_around_islands_without_a_ray_are_one_class() -> None:
    islets = [box(x, y, x + 1, y + 1) for x, y in ((30, 25), (45, 50), (60, 55), (72, 70))]
    chart = chart_of([*islets, box(35, 60, 60, 85)])
    assert len(enumerator_on(chart)[1].channels(100)) > 8
    names = [c.name for c in enumerator_on(chart, min_size=5.0)[1].channels(100)]
    assert sorted(names) == ["e", "s1"]


def test_a_blocked_transition_gives_the_next_channel_of_the_class() -> None:
    islets = [box(x, y, x + 1, y + 1) for x, y in ((30, 25), (45, 50), (60, 55))]
    _, enumerator = enumerator_on(chart_of([*islets, box(35, 60, 60, 85)]), min_size=5.0)
    first = enumerator.channels(1)[0]
    blocked = {first.transitions[len(first.transitions) // 2]}
    again = next(c for c in enumerator.channels(10, blocked) if c.word == first.word)
    assert again.triangles.tolist() != first.triangles.tolist()
    assert blocked.isdisjoint(again.transitions)


def test_a_goal_in_a_lake_is_unreachable() -> None:
    chart = chart_of([LAKE])
    triangulation = triangulate(chart)
    voyage = voyage_on(chart, (5.0, 5.0), (50.0, 50.0))
    with pytest.raises(renew.UnreachableError, match="separates them"):
        ClassEnumerator.of(voyage, triangulation, Rays.of(chart), "length")
