"""The k best paths against Dijkstra's algorithm over pairs of (node, reduced row of triangles)."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from shapely import box

import renew
from renew._types import FloatArray, IntArray
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.dual_graph import dual_graph, visits
from renew.classes.h_signature import Rays
from renew.classes.k_best_paths import k_best_paths, time_to_go
from renew.classes.reduced_rows import RayColumns, SearchTask
from renew.classes.roadmap import GOAL, START, Resolution, Roadmap, roadmap
from renew.classes.triangulation import Triangulation, triangulate
from renew.kernels.viterbi import Stream
from renew.voyage.voyage import Voyage
from tests.strategies import StreamFunctionCurrent, examples, seeds, voyage_on

FEW = Resolution(144, 2)


def scene(seed: int) -> Voyage:
    """Three random islands, which may touch, in a moderate current."""
    rng = np.random.default_rng(seed)
    islands = [box(x, y, x + 12, y + 9) for x, y in rng.uniform(18, 70, (3, 2))]
    chart = renew.Chart(box(0, 0, 100, 100), islands)
    return voyage_on(chart, (9.7, 10.3), (90.2, 89.8), StreamFunctionCurrent(seed, 0.5))


def found_in(
    voyage: Voyage, triangulation: Triangulation, graph: Roadmap, count: int
) -> tuple[list[IntArray], list[FloatArray]]:
    rays = Rays.of(voyage.chart)
    none = np.zeros((len(triangulation.triangles), 4, 4), dtype=bool)
    columns = RayColumns(rays.x, rays.y, rays.island)
    task = SearchTask(graph, columns, none)
    stream = Stream(voyage.table, voyage.polar, voyage.clock)
    rows, paths = k_best_paths(task, time_to_go(graph), stream, count, 1_000_000)
    return rows, [graph.points[nodes] for nodes in paths]


def times_of(graph: Roadmap, paths: Sequence[FloatArray]) -> list[float]:
    """Times over the legs of paths, s."""
    node = {tuple(point): k for k, point in enumerate(graph.points.tolist())}
    tails = np.repeat(np.arange(len(graph.points)), np.diff(graph.first))
    legs = zip(tails.tolist(), graph.head.tolist(), graph.time.tolist(), strict=True)
    least: dict[tuple[int, int], float] = {}
    for tail, head, time in legs:
        least[tail, head] = min(time, least.get((tail, head), math.inf))
    return [
        sum(least[leg] for leg in itertools.pairwise(node[tuple(one)] for one in path.tolist()))
        for path in paths
    ]


def best_times(graph: Roadmap, triangulation: Triangulation) -> dict[tuple[int, ...], float]:
    """Least time of each simple row of triangles, by Dijkstra over (node, reduced row)."""
    best: dict[tuple[int, tuple[int, ...]], float] = {}
    queue: list[tuple[float, int, tuple[int, ...]]] = [(0.0, START, (int(graph.triangle[START]),))]
    found: dict[tuple[int, ...], float] = {}
    first, heads, times = graph.first.tolist(), graph.head.tolist(), graph.time.tolist()
    of, corners = graph.triangle.tolist(), triangulation.corners
    crossed = [
        [*visits(graph.points[[node, head]], corners).triangle.tolist(), of[head]]
        for node in range(len(graph.points))
        for head in heads[first[node] : first[node + 1]]
    ]
    while queue:
        now, node, row = heapq.heappop(queue)
        if (node, row) in best:
            continue
        best[node, row] = now
        if node == GOAL:
            found[row] = now
            continue
        for leg in range(first[node], first[node + 1]):
            after = list(row)
            for triangle in crossed[leg]:
                if triangle == after[-1]:
                    continue
                if len(after) > 1 and triangle == after[-2]:
                    after.pop()
                else:
                    after.append(triangle)
            if len(set(after)) == len(after):
                heapq.heappush(queue, (now + times[leg], heads[leg], tuple(after)))
    return found


@examples(1, 3)
@given(seed=seeds)
def test_paths_are_the_quickest_of_every_row_in_the_order_of_their_times(seed: int) -> None:
    voyage = scene(seed)
    triangulation = triangulate(voyage.chart)
    graph = roadmap(voyage, triangulation, voyage.table, clearance=0.0, resolution=FEW)
    rows, paths = found_in(voyage, triangulation, graph, 1000)
    times = times_of(graph, paths)
    assert times == pytest.approx(sorted(times), rel=1e-4)
    expected = best_times(graph, triangulation)
    assert {tuple(row.tolist()) for row in rows} == set(expected)
    for row, time in zip(rows, times, strict=True):
        assert time == pytest.approx(expected[tuple(row.tolist())], rel=1e-4)


@settings(max_examples=10)
@given(seed=seeds)
def test_k_paths_are_the_first_k_of_all(seed: int) -> None:
    voyage = scene(seed)
    triangulation = triangulate(voyage.chart)
    graph = roadmap(voyage, triangulation, voyage.table, clearance=0.0, resolution=FEW)
    _, every = found_in(voyage, triangulation, graph, 1000)
    for count in (1, 3):
        _, few = found_in(voyage, triangulation, graph, count)
        assert len(few) == min(count, len(every))
        assert times_of(graph, few) == pytest.approx(times_of(graph, every[:count]), rel=1e-4)


@pytest.mark.parametrize("order", ["length", "fuel"])
@settings(max_examples=15)
@given(seed=seeds)
def test_a_channel_is_in_the_class_of_the_path_that_found_it(order: str, seed: int) -> None:
    voyage = scene(seed)
    triangulation, rays = triangulate(voyage.chart), Rays.of(voyage.chart)
    channels = ClassEnumerator.of(voyage, triangulation, rays, order).channels(1000)  # type: ignore[arg-type]
    endpoints = triangulation.locate(voyage.start), triangulation.locate(voyage.goal)
    rows = {tuple(row) for row in nx.all_simple_paths(dual_graph(triangulation), *endpoints)}
    assert {tuple(channel.triangles.tolist()) for channel in channels} == rows or endpoints[
        0
    ] == endpoints[1]
    for channel in channels:
        assert channel.found_by is not None
        assert rays.word(channel.found_by.points) == channel.word
        assert math.dist(channel.found_by.points[-1], voyage.goal) == 0
        # A path along a passing edge counts for both triangles.
        inner = shapely.buffer(shapely.polygons(triangulation.corners), -1e-6)
        crossed = shapely.intersects(inner, shapely.LineString(channel.found_by.points))
        assert set(crossed.nonzero()[0].tolist()) <= set(channel.found_by.triangles.tolist())
