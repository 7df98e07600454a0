"""The k best chains against all rows of triangles and the quickest chain in each."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from shapely import box

import renew
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.dual_graph import dual_graph
from renew.classes.h_signature import Rays
from renew.classes.portal_graph import leg_time
from renew.classes.triangulation import triangulate
from renew.kernels.capsules import Segment
from tests.strategies import StreamFunctionCurrent, seeds, voyage_on

if TYPE_CHECKING:
    from renew._types import FloatArray
    from renew.inputs.arguments import Order


@pytest.mark.parametrize("order", ["length", "fuel"])
@settings(max_examples=15)
@given(seed=seeds)
def test_classes_come_in_the_order_of_their_quickest_chains(order: Order, seed: int) -> None:
    # All rows of triangles by networkx, and the quickest chain of nodes in each, node by node.
    rng = np.random.default_rng(seed)
    islands = [box(x, y, x + 12, y + 9) for x, y in rng.uniform(18, 70, (3, 2))]
    chart = renew.Chart(box(0, 0, 100, 100), islands)
    triangulation = triangulate(chart)
    voyage = voyage_on(chart, current=StreamFunctionCurrent(seed, 0.5))
    enumerator = ClassEnumerator(voyage, triangulation, Rays.of(chart), order)
    start, goal = voyage.start, voyage.goal
    graph = enumerator._coarse.graph

    def times(here: FloatArray, there: FloatArray) -> FloatArray:
        """Times (h, t) over the legs between points; in still water, at 1 m/s, their lengths."""
        if order == "length":
            return np.asarray(np.linalg.norm(there - here[:, None], axis=2))
        legs = itertools.product(here.tolist(), there.tolist())
        time = [leg_time(graph, Segment(*a, *b)) for a, b in legs]
        return np.array(time).reshape(len(here), len(there))

    def quickest(row: list[int]) -> float:
        points, time = start[None], np.zeros(1)
        for one, other in itertools.pairwise(row):
            portal = 3 * other + triangulation.neighbours[other].tolist().index(one)
            following = graph.points[graph.first[portal] : graph.first[portal + 1]]
            time = (time[:, None] + times(points, following)).min(axis=0)
            points = following
        return float((time + times(points, goal[None])[:, 0]).min())

    found = [quickest(c.triangles.tolist()) for c in enumerator.channels(1000)]
    assert found == pytest.approx(sorted(found))
    endpoints = triangulation.locate(start), triangulation.locate(goal)
    rows = nx.all_simple_paths(dual_graph(triangulation), *endpoints)
    assert found == pytest.approx(sorted(quickest(row) for row in rows))
