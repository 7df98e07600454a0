"""Channels: the banks of their passing edges, their transitions and their midline."""

from __future__ import annotations

import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings

from renew.classes.channel import Channel
from renew.classes.dual_graph import dual_graph
from renew.classes.triangulation import triangulate
from tests.strategies import random_scene, seeds


@settings(max_examples=10)
@given(seed=seeds)
def test_each_passing_edge_is_shared_and_has_its_left_end_to_the_left(seed: int) -> None:
    chart, _, start, goal = random_scene(seed)
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
    chart, *_ = random_scene(0)
    triangulation = triangulate(chart)
    first = 0
    second = int(triangulation.neighbours[first].max())
    channel = Channel.of(triangulation, np.array([first, second]))
    assert channel.transitions == [(-1, first, second), (first, second, -1)]
    assert channel.name == "e"
