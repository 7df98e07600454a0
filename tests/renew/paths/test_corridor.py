"""Least-fuel paths, trajectories and contingency turns against independent oracles."""

from __future__ import annotations

import itertools
import math
from functools import partial
from types import SimpleNamespace

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from shapely import Polygon, box

import renew
from renew.inputs.fuel import ground_speed
from renew.kernels.capsules import (
    Capsules,
    Segment,
    capsule_interval,
    legs_are_clear,
    segment_distance,
)
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import TOO_STRONG, quickest_chain
from renew.steering.trajectory import steer
from renew.steering.turning_radius import steerable
from tests.compiler import uncompiled
from tests.strategies import (
    PAPER_VESSEL,
    SIZE,
    StreamFunctionCurrent,
    random_islands,
    random_scene,
    seeds,
    single_gyre,
)

NIMBLE = renew.Vessel(speed=1.0, turn_rate=math.radians(2000))
STILL = renew.UniformCurrent(0.0, 0.0)


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
    assert shortest * (1 - 1e-9) <= best.length <= shortest * 1.003
    assert best.fuel == pytest.approx(best.length)


@settings(max_examples=5, deadline=None)
@given(seed=seeds)
def test_sampling_never_beats_the_optimum_of_its_class(seed: int) -> None:
    chart, current, start, goal = random_scene(seed)
    plan = partial(renew.plan, chart, current, PAPER_VESSEL, start, goal)
    plan = partial(plan, padding="none", classes=4, drift="crab")
    optimal = plan()
    best = {route.homotopy: route.fuel for route in optimal.routes}
    try:
        sampled = plan(method="sampled", samples=300)
    except renew.UnreachableError:
        return
    for route in sampled.routes:
        if route.homotopy in best:
            assert best[route.homotopy] <= route.fuel * (1 + 1e-3)


@settings(max_examples=6, deadline=None)
@given(seed=seeds)
def test_routes_keep_what_they_promise(seed: int) -> None:
    chart, current, start, goal = random_scene(seed)
    try:
        plan = renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=4)
    except renew.UnreachableError as error:
        assert "were rejected" in str(error)  # noqa: PT017  (a crowded scene may have no safe class)
        return
    assert [r.fuel for r in plan.routes] == sorted(r.fuel for r in plan.routes)
    for route in plan.routes:
        line = shapely.LineString(route.path)
        assert route.path[0] == pytest.approx(start)
        assert route.path[-1] == pytest.approx(goal)
        assert chart.extent.covers(line)
        assert line.distance(chart.hard_no_go) == pytest.approx(route.clearance)
        channel = shapely.union_all(shapely.polygons(route.channel)).buffer(1e-5)
        assert channel.covers(line)
        if not route.starts_in_soft_no_go and not route.ends_in_soft_no_go:
            # V is drawn with polygons inside its round ends: exact to 0.5 % of the padding.
            assert line.intersection(route.soft_no_go.buffer(-1e-3)).length < 1e-6
            report = renew.contingency(route, chart, current, PAPER_VESSEL, seed=seed)
            assert report.collisions == 0
        assert route.fuel == pytest.approx(renew.fuel(route.path, current, PAPER_VESSEL))
        assert route.fuel >= route.fuel_bound.value
        check_trajectory(route.trajectory, current, start, goal)


def check_trajectory(
    trajectory: np.ndarray, current: renew.CurrentField, start: np.ndarray, goal: np.ndarray
) -> None:
    """The vessel turns no faster than it can, and moves by its own way and the current alone."""
    time, position, heading = trajectory[:, 0], trajectory[:, 1:3], trajectory[:, 3]
    assert position[0] == pytest.approx(start)
    assert position[-1] == pytest.approx(goal)
    step = np.diff(time)
    assert (step > 0).all()
    assert (np.abs(np.diff(heading)) <= PAPER_VESSEL.turn_rate * step * (1 + 1e-6)).all()
    middle = (heading[1:] + heading[:-1]) / 2
    through = PAPER_VESSEL.speed * np.column_stack([np.cos(middle), np.sin(middle)])
    expected = through + current((position[1:] + position[:-1]) / 2)
    assert np.diff(position, axis=0) / step[:, None] == pytest.approx(expected, abs=0.02)


def test_trajectory_takes_as_long_as_the_crab_model_says() -> None:
    chart, current = single_gyre()
    best = renew.plan(chart, current, PAPER_VESSEL, (10, 10), (90, 90), drift="crab").best
    assert best.trajectory[-1, 0] == pytest.approx(best.fuel, rel=0.01)


def test_a_corner_without_room_cannot_be_steered() -> None:
    zigzag = np.array([[0, 0], [10, 0], [10.2, 0.5], [20, 0.5]], dtype=float)
    assert not steerable(zigzag, STILL, PAPER_VESSEL)
    with pytest.raises(renew.PlanningError, match="to turn in"):
        steer(zigzag, STILL, PAPER_VESSEL)
    gentle = np.array([[0, 0], [20, 0], [40, 5]], dtype=float)
    assert steerable(gentle, STILL, PAPER_VESSEL)
    check_trajectory(steer(gentle, STILL, PAPER_VESSEL), STILL, gentle[0], gentle[-1])


@settings(max_examples=30)
@given(seed=seeds)
def test_capsule_interval_matches_dense_distances(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, p, q = rng.uniform(0, 10, (4, 2))
    if seed % 5 == 0:
        q = p
    if seed % 7 == 0:
        b = a
    radius = float(rng.uniform(0.1, 4))
    leg, axis = Segment(*a.tolist(), *b.tolist()), Segment(*p.tolist(), *q.tolist())
    enter, leave = capsule_interval(leg, axis, radius)
    s = np.linspace(0, 1, 2001)
    inside = segment_distance(a + s[:, None] * (b - a), p, q) < radius
    expected = (s >= enter) & (s <= leave)
    assert (inside != expected).sum() <= 2
    # The same without the compiler.
    assert uncompiled(capsule_interval)(leg, axis, radius) == pytest.approx((enter, leave))


def test_turns_agree_with_a_stiff_integrator() -> None:
    current = StreamFunctionCurrent(4, 0.7)
    path = np.array([[50.0, 60.0], [51.0, 60.0]])
    # A wall that the turn to port reaches in the true field, or just not.
    course = 0.0
    tangent = np.array([math.cos(course), math.sin(course)])
    velocity = current(path[:1])[0]
    across = velocity[1]
    heading = -math.asin(across / PAPER_VESSEL.speed)
    assert tangent @ velocity > -1

    def motion(time: float, position: np.ndarray) -> np.ndarray:
        theta = heading + PAPER_VESSEL.turn_rate * time
        return np.array([math.cos(theta), math.sin(theta)]) + current(position)

    period = PAPER_VESSEL.turn_period
    track = solve_ivp(motion, (0, period), path[0], rtol=1e-9, atol=1e-9, dense_output=True)
    north = float(track.sol(np.linspace(0, period, 2000))[1].max())
    for gap, collides in ((0.02, False), (-0.02, True)):
        wall = box(0, north + gap, SIZE, north + gap + 5)
        chart = renew.Chart(box(0, 0, SIZE, SIZE), [wall])
        report = renew.contingency(
            SimpleNamespace(path=path[[0, 0]] + [[0, 0], [1e-6, 0]]),
            chart,
            current,
            PAPER_VESSEL,
        )
        # Draws of the spread may reach the wall as well; the field itself must, or must not.
        assert report.trials == 2 * 5 * 2
        if collides:
            assert report.collisions >= 2
        else:
            assert report.collisions < report.trials / 2


def test_contingency_counts_what_it_flies() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 52, 60, 70)])
    route = SimpleNamespace(path=np.array([[10.0, 50.0], [90.0, 50.0]]))
    report = renew.contingency(route, chart, STILL, PAPER_VESSEL, spacing=1.0)
    assert report.trials == 81 * 2 * 5
    assert len(report.points) == len(report.collided) == 81
    # 2 m from the wall, a still-water turn to port sweeps 2 v/ω = 3.27 m: every one beside it
    # touches, and none that begins beyond its reach.
    beside = (report.points[:, 0] > 40) & (report.points[:, 0] < 60)
    assert report.collided[beside].all()
    far = (report.points[:, 0] < 36) | (report.points[:, 0] > 64)
    assert not report.collided[far].any()
    wide = SimpleNamespace(path=np.array([[10.0, 48.5], [90.0, 48.5]]))
    assert renew.contingency(wide, chart, STILL, PAPER_VESSEL).collisions == 0
    with pytest.raises(renew.ParameterError, match="spacing = 0"):
        renew.contingency(route, chart, STILL, PAPER_VESSEL, spacing=0)


def test_padding_none_wraps_corners_that_can_still_be_steered() -> None:
    island = Polygon([(30, 20), (70, 20), (50, 80)])
    chart = renew.Chart(box(0, 0, 100, 100), [island])
    plan = renew.plan(chart, STILL, PAPER_VESSEL, (10, 50), (90, 50), padding="none")
    assert len(plan.routes) == 2
    for route in plan.routes:
        assert route.clearance < 0.1 * PAPER_VESSEL.turning_radius
        assert not shapely.LineString(route.path).intersects(island.buffer(-1e-6))
        track = shapely.LineString(route.trajectory[:, 1:3])
        assert not track.intersects(island.buffer(-0.01))


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_quickest_chain_is_the_best_of_all_chains(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, count = 4, 5
    points = np.cumsum(rng.uniform(0.5, 2, (rows, 1, 1)), axis=0) * [[[1.0, 0.0]]]
    points = points + rng.normal(0, 1, (rows, count, 2)) * [0.1, 2.0]
    points[[0, -1]] = points[[0, -1], :1]
    velocity = rng.normal(0, 0.3, points.shape)
    velocity[[0, -1]] = velocity[[0, -1], :1]
    velocity[0] = 0.2  # the start lies in water that can be sailed
    start, end = rng.uniform(0, 5, (2, 2, 2))
    capsules = Capsules(start, end, rng.uniform(0.1, 0.6, 2))
    exempt = np.zeros((2, 2), dtype=bool)
    for crab in (False, True):
        arguments = (points, velocity, Polar(1.0, crab), capsules, exempt)
        arrival, chain = quickest_chain(*arguments)
        best = math.inf
        for choice in itertools.product(range(count), repeat=rows - 2):
            total = 0.0
            index = (0, *choice, 0)
            for row, (i, j) in enumerate(itertools.pairwise(index)):
                a, b = points[row, i], points[row + 1, j]
                if not legs_are_clear(a[None], b[None], capsules)[0]:
                    total = math.inf
                    break
                tangent = (b - a) / np.linalg.norm(b - a)
                current = np.stack([velocity[row, i], velocity[row + 1, j]])
                speeds = ground_speed(current, tangent, 1.0, "crab" if crab else "projected")
                if (current[1] ** 2).sum() >= TOO_STRONG or (speeds <= 0).any():
                    total = math.inf
                    break
                total += float(np.linalg.norm(b - a) * (1 / speeds).mean())
            best = min(best, total)
        assert arrival == pytest.approx(best)
        without_compiler = uncompiled(quickest_chain)(*arguments)
        assert without_compiler[0] == pytest.approx(arrival)
        assert without_compiler[1].tolist() == chain.tolist()
