"""The roadmap's legs against shapely and scipy: clear of land, and timed by Eq. 4."""

import itertools

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely import box

import renew
from renew.classes.k_best_paths import time_to_go
from renew.classes.roadmap import GOAL, START, Resolution, Roadmap, roadmap
from renew.classes.triangulation import triangulate
from renew.voyage.fuel import passage
from renew.voyage.voyage import Voyage
from tests.bounded_scenes import eddy_scene
from tests.strategies import PAPER_VESSEL, examples, random_scene, seeds, voyage_on

CELLS = Resolution(900, 2)


def roadmap_of(voyage: Voyage, clearance: float = 0.0, resolution: Resolution = CELLS) -> Roadmap:
    return roadmap(
        voyage, triangulate(voyage.chart), voyage.table, clearance=clearance, resolution=resolution
    )


def legs_of(graph: Roadmap) -> tuple[np.ndarray, np.ndarray]:
    """Ends of all legs (m, 2)."""
    tail = np.repeat(np.arange(len(graph.points)), np.diff(graph.first))
    return graph.points[tail], graph.points[graph.head]


@examples(4, 10)
@given(seed=seeds, clearance=st.sampled_from([0.0, 1.0, 4.0]))
def test_no_leg_touches_land(seed: int, clearance: float) -> None:
    scene = random_scene(seed)
    graph = roadmap_of(scene.voyage, clearance)
    legs = shapely.linestrings(np.stack(legs_of(graph), axis=1))
    inside = shapely.buffer(scene.chart.hard_no_go, -1e-6)
    assert not shapely.intersects(legs, inside).any()
    # Nodes of the grid keep their distance from the shore of their triangle.
    assert len(graph.head) > 1000


@settings(max_examples=10)
@given(seed=seeds)
def test_legs_that_are_left_out_touch_land_or_lie_on_the_frame(seed: int) -> None:
    scene = random_scene(seed)
    graph = roadmap_of(scene.voyage)
    here = np.flatnonzero(
        np.linalg.norm(graph.points - graph.points[len(graph.points) // 2], axis=1) < 12
    )
    known = {
        (int(a), int(b)) for a in here for b in graph.head[graph.first[a] : graph.first[a + 1]]
    }
    step = np.sqrt(scene.chart.extent.area / CELLS.cells) * 1.01
    for a in here.tolist():
        for b in here.tolist():
            apart = np.linalg.norm(graph.points[a] - graph.points[b])
            if 0 < apart <= step and (a, b) not in known:
                leg = shapely.LineString(graph.points[[a, b]])
                assert leg.distance(scene.chart.hard_no_go) < 1e-9


def test_times_are_those_of_eq_4_both_ways() -> None:
    scene = random_scene(3, 0.5)
    voyage = scene.voyage
    graph = roadmap_of(voyage, resolution=Resolution(10_000, 2))
    tails, heads = legs_of(graph)
    for leg in range(0, len(tails), 997):
        for a, b, time in ((tails, heads, graph.time), (heads, tails, graph.back)):
            path = np.stack([a[leg], b[leg]])
            exact = passage(path, scene.current, PAPER_VESSEL).durations.sum()
            assert time[leg] == pytest.approx(exact, rel=0.01)


def test_times_of_long_legs_through_small_eddies_are_those_of_eq_4() -> None:
    scene = eddy_scene(32, 10, 3)
    graph = roadmap_of(scene.voyage, resolution=Resolution(22_500, 4))
    tails, heads = legs_of(graph)
    long = np.flatnonzero(np.linalg.norm(heads - tails, axis=1) > 40)
    assert len(long) > 20
    for leg in long.tolist():
        path = np.stack([tails[leg], heads[leg]])
        exact = passage(path, scene.current, PAPER_VESSEL).durations.sum()
        assert graph.time[leg] == pytest.approx(exact, rel=0.01)


def test_the_time_to_go_is_that_of_dijkstra() -> None:
    graph = roadmap_of(random_scene(1).voyage)
    count = len(graph.points)
    there = csr_array((graph.back, graph.head, graph.first), shape=(count, count))
    assert time_to_go(graph) == pytest.approx(dijkstra(there, indices=GOAL))


def test_what_a_leg_crosses_leads_from_its_triangle_to_the_other() -> None:
    graph = roadmap_of(random_scene(2).voyage)
    tail = np.repeat(np.arange(len(graph.points)), np.diff(graph.first))
    number = np.diff(graph.first_crossed)
    assert set(number.tolist()) > {0, 1, 2}
    for leg, (first, last) in enumerate(itertools.pairwise(graph.first_crossed.tolist())):
        triangle = graph.triangle[tail[leg]]
        for crossed in graph.crossed[first:last].tolist():
            assert crossed // 3 == triangle
            triangle = graph.mesh.neighbours[triangle, crossed % 3]
        assert triangle == graph.triangle[graph.head[leg]]


def test_gates_lead_through_a_strait_far_narrower_than_a_cell() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(48, -1, 52, 49.95), box(48, 50.05, 52, 101)])
    voyage = voyage_on(chart, (10.0, 50.0), (90.0, 50.0))
    assert np.isfinite(time_to_go(roadmap_of(voyage))[START])
    assert not np.isfinite(time_to_go(roadmap_of(voyage, clearance=0.06))[START])


def test_a_short_voyage_in_a_large_chart_has_fine_cells_around_it_and_coarse_ones_afar() -> None:
    chart = renew.Chart(box(0, 0, 10_000, 10_000), [box(5_010, 4_995, 5_015, 5_020)])
    graph = roadmap_of(voyage_on(chart, (5_000.0, 5_005.0), (5_030.0, 5_006.0)))
    near = np.linalg.norm(graph.points - [5_015, 5_005], axis=1) < 30
    assert near.sum() > 100
    assert len(graph.points) < 20_000
    assert graph.points.min() < 200
    assert graph.points.max() > 9_800
    assert np.isfinite(time_to_go(graph)[START])


def test_a_strip_of_a_chart_has_no_more_nodes_than_others() -> None:
    chart = renew.Chart(box(0, 0, 1e6, 1), [box(4e5, 0.4, 4.1e5, 0.6)])
    graph = roadmap_of(voyage_on(chart, (1.0, 0.5), (999_999.0, 0.5)))
    assert len(graph.points) < 10 * CELLS.cells
