"""The dual graph against Euler's count."""

from __future__ import annotations

import networkx as nx
import shapely
from hypothesis import given, settings
from shapely import box

import renew
from renew.classes.dual_graph import dual_graph
from renew.classes.triangulation import triangulate
from tests.strategies import SIZE, random_islands, seeds


@settings(max_examples=25)
@given(seed=seeds)
def test_dual_graph_has_one_cycle_for_each_island(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed))
    dual = dual_graph(triangulate(chart))
    parts = shapely.get_parts(chart.water)  # islands that overlap may enclose some water
    assert nx.number_connected_components(dual) == len(parts)
    cycles = dual.number_of_edges() - dual.number_of_nodes() + len(parts)
    assert cycles == sum(len(part.interiors) for part in parts)
