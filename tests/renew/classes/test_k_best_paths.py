"""The k best paths, reduced rows and channels against networkx and Dijkstra's algorithm."""

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
from renew.classes.k_best_paths import (
    RayColumns,
    SearchTask,
    first_row,
    k_best_paths,
    no_words,
    number_of_classes,
    row_after,
    time_to_go,
    triangles_of,
)
from renew.classes.roadmap import GOAL, START, Resolution, Roadmap, roadmap
from renew.classes.triangulation import Triangulation, triangulate
from renew.inputs.options import Order
from renew.kernels.viterbi import Stream
from renew.voyage.voyage import Voyage
from tests.strategies import (
    StreamFunctionCurrent,
    chart_of,
    examples,
    seeds,
    single_gyre,
    voyage_on,
)


def scene(seed: int) -> Voyage:
    """Three random islands, which may touch, in a moderate current."""
    rng = np.random.default_rng(seed)
    islands = [box(x, y, x + 12, y + 9) for x, y in rng.uniform(18, 70, (3, 2))]
    chart = renew.Chart(box(0, 0, 100, 100), islands)
    return voyage_on(chart, (9.7, 10.3), (90.2, 89.8), StreamFunctionCurrent(seed, 0.5))


def task_of(voyage: Voyage, cells: int = 144) -> tuple[SearchTask, Triangulation]:
    """The task of a search on a coarse roadmap, and the triangles of its rows."""
    triangulation, rays = triangulate(voyage.chart), Rays.of(voyage.chart)
    resolution = Resolution(cells, 2)
    graph = roadmap(voyage, triangulation, voyage.table, clearance=0.0, resolution=resolution)
    none = np.zeros((len(triangulation.triangles), 4, 4), dtype=bool)
    return SearchTask(graph, RayColumns(rays.x, rays.y, rays.island), none), triangulation


def found_in(
    task: SearchTask, voyage: Voyage, count: int
) -> tuple[list[IntArray], list[FloatArray]]:
    stream = Stream(voyage.table, voyage.polar, voyage.clock)
    rows, paths = k_best_paths(task, time_to_go(task.graph), stream, count, 1_000_000)
    return rows, [task.graph.points[nodes] for nodes in paths]


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
    task, triangulation = task_of(voyage)
    rows, paths = found_in(task, voyage, 1000)
    times = times_of(task.graph, paths)
    assert times == pytest.approx(sorted(times), rel=1e-4)
    expected = best_times(task.graph, triangulation)
    assert {tuple(row.tolist()) for row in rows} == set(expected)
    for row, time in zip(rows, times, strict=True):
        assert time == pytest.approx(expected[tuple(row.tolist())], rel=1e-4)


@settings(max_examples=10)
@given(seed=seeds)
def test_k_paths_are_the_first_k_of_all(seed: int) -> None:
    voyage = scene(seed)
    task, _ = task_of(voyage)
    _, every = found_in(task, voyage, 1000)
    for count in (1, 3):
        _, few = found_in(task, voyage, count)
        assert len(few) == min(count, len(every))
        first = times_of(task.graph, every[:count])
        assert times_of(task.graph, few) == pytest.approx(first, rel=1e-4)


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


@examples(1, 10)
@given(seed=seeds)
def test_the_row_of_a_walk_is_what_is_left_of_its_triangles(seed: int) -> None:
    task, triangulation = task_of(scene(seed), 400)
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


@examples(4, 20)
@given(seed=seeds)
def test_the_number_of_classes_is_that_of_simple_paths(seed: int) -> None:
    task, triangulation = task_of(scene(seed), 400)
    ends = task.graph.triangle[:2].tolist()
    paths = len(list(nx.all_simple_paths(dual_graph(triangulation), *ends)))
    paths = paths if ends[0] != ends[1] else 1
    for most in (3, 1000):
        found, _, _ = number_of_classes(task, no_words(), first_row(task), most)
        assert found == min(paths, most)


LAKE = box(20, 20, 80, 80).difference(box(40, 40, 60, 60))


def enumerator_on(
    chart: renew.Chart, *, min_size: float = 0.0, order: Order = "length"
) -> tuple[Triangulation, ClassEnumerator]:
    triangulation = triangulate(chart)
    rays = Rays.of(chart)
    rays = rays.only(rays.size >= min_size)
    return triangulation, ClassEnumerator.of(voyage_on(chart), triangulation, rays, order)


def test_both_orders_find_every_simple_path_once() -> None:
    chart = single_gyre().chart
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
