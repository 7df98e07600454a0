"""Reduced rows against those of random walks, and their number against networkx."""

from __future__ import annotations

import networkx as nx
import numpy as np
from hypothesis import given
from shapely import box

import renew
from renew.classes.dual_graph import dual_graph, visits
from renew.classes.h_signature import Rays
from renew.classes.reduced_rows import (
    RayColumns,
    SearchTask,
    first_row,
    no_words,
    number_of_classes,
    row_after,
    triangles_of,
)
from renew.classes.roadmap import START, Resolution, roadmap
from renew.classes.triangulation import Triangulation, triangulate
from tests.strategies import examples, seeds, voyage_on


def task_of(seed: int) -> tuple[SearchTask, Triangulation]:
    """Three random islands, which may touch."""
    rng = np.random.default_rng(seed)
    islands = [box(x, y, x + 12, y + 9) for x, y in rng.uniform(18, 70, (3, 2))]
    chart = renew.Chart(box(0, 0, 100, 100), islands)
    voyage, triangulation = voyage_on(chart, (9.7, 10.3), (90.2, 89.8)), triangulate(chart)
    graph = roadmap(
        voyage, triangulation, voyage.table, clearance=0.0, resolution=Resolution(400, 2)
    )
    rays = Rays.of(chart)
    none = np.zeros((len(triangulation.triangles), 4, 4), dtype=bool)
    return SearchTask(graph, RayColumns(rays.x, rays.y, rays.island), none), triangulation


@examples(4, 10)
@given(seed=seeds)
def test_the_row_of_a_walk_is_what_is_left_of_its_triangles(seed: int) -> None:
    task, triangulation = task_of(seed)
    # Words that the compiled code adds don't come back from one call for the next one.
    nowhere = np.empty(0)
    task = task._replace(rays=RayColumns(nowhere, nowhere, np.empty(0, dtype=np.int64)))
    graph, rng = task.graph, np.random.default_rng(seed)
    rows, words, used, row, node = first_row(task), no_words(), 1, 0, START
    expected = [int(graph.triangle[START])]
    for _ in range(200):
        leg = int(rng.integers(graph.first[node], graph.first[node + 1]))
        other = int(graph.head[leg])
        after, rows, used = row_after(task, words, rows, used, row, leg)
        if after < 0:  # it would enter a triangle twice, or lead astray
            continue
        crossed = visits(graph.points[[node, other]], triangulation.corners).triangle.tolist()
        for triangle in [*crossed, int(graph.triangle[other])]:
            if len(expected) > 1 and triangle == expected[-2]:
                expected.pop()
            elif triangle != expected[-1]:
                expected.append(triangle)
        assert triangles_of(rows, after).tolist() == expected
        row, node = after, other


@examples(8, 20)
@given(seed=seeds)
def test_the_number_of_classes_is_that_of_simple_paths(seed: int) -> None:
    task, triangulation = task_of(seed)
    ends = task.graph.triangle[:2].tolist()
    paths = len(list(nx.all_simple_paths(dual_graph(triangulation), *ends)))
    paths = paths if ends[0] != ends[1] else 1
    for most in (3, 1000):
        found, _, _ = number_of_classes(task, no_words(), first_row(task), most)
        assert found == min(paths, most)
