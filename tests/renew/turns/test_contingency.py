"""Hard-over turns flown along a route, and the place where it is nearest to land."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from shapely import box

import renew
from renew.inputs.current import TabulatedCurrent
from renew.turns.contingency import fly_turns, perturbations, stations
from renew.turns.turn_reach import MAX_DEVIATIONS, turn_reach
from tests.renew.turns.test_turn_reach import begun
from tests.strategies import PAPER_VESSEL, SIZE, STILL, StreamFunctionCurrent, random_scene, seeds

BOUNDS = (0.0, 0.0, SIZE, SIZE)


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_turns_in_a_table_are_the_turns_in_its_field(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = StreamFunctionCurrent(seed, 0.8).table(BOUNDS)
    points, course = rng.uniform(20, SIZE - 20, (6, 2)), rng.uniform(-math.pi, math.pi, 6)
    deviations = rng.uniform(-MAX_DEVIATIONS, MAX_DEVIATIONS, (6, 3, 2))

    class NotTabulated(renew.CurrentField):
        """The same field by another type: flown step by step in NumPy."""

        def __call__(self, points: np.ndarray) -> np.ndarray:
            return TabulatedCurrent(table)(points)

    one, other = (
        fly_turns(begun(points, course), field, PAPER_VESSEL, deviations)
        for field in (TabulatedCurrent(table), NotTabulated())
    )
    assert one == pytest.approx(other, abs=1e-9)


def test_turns_agree_with_an_adaptive_integrator() -> None:
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
    for distance, collides in ((0.02, False), (-0.02, True)):
        wall = box(0, north + distance, SIZE, north + distance + 5)
        chart = renew.Chart(box(0, 0, SIZE, SIZE), [wall])
        report = renew.contingency(
            SimpleNamespace(path=path[[0, 0]] + [[0, 0], [1e-6, 0]]), chart, current, PAPER_VESSEL
        )
        # Perturbed turns may reach the wall as well; the one in the field itself must, or must not.
        assert report.trials == 2 * 5 * 2
        if collides:
            assert report.collisions >= 2
        else:
            assert report.collisions < report.trials / 2


def test_contingency_counts_its_turns_and_their_collisions() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 52, 60, 70)])
    route = SimpleNamespace(path=np.array([[10.0, 50.0], [90.0, 50.0]]))
    report = renew.contingency(route, chart, STILL, PAPER_VESSEL, spacing=1.0)
    assert report.trials == 81 * 2 * 5
    assert len(report.points) == len(report.collided) == 81
    # 2 m from the wall, a still-water turn to port is 2 v/ω = 3.27 m wide: each one that begins
    # beside the wall touches it, and none that begins out of its reach.
    beside = (report.points[:, 0] > 40) & (report.points[:, 0] < 60)
    assert report.collided[beside].all()
    far = (report.points[:, 0] < 36) | (report.points[:, 0] > 64)
    assert not report.collided[far].any()
    wide = SimpleNamespace(path=np.array([[10.0, 48.5], [90.0, 48.5]]))
    assert renew.contingency(wide, chart, STILL, PAPER_VESSEL).collisions == 0
    with pytest.raises(renew.ParameterError, match="spacing = 0"):
        renew.contingency(route, chart, STILL, PAPER_VESSEL, spacing=0)


def test_stations_stand_evenly_along_a_path_and_know_its_course() -> None:
    path = np.array([[0, 0], [3, 0], [3, 0], [3, 4.5]], dtype=float)
    points, course = stations(path, 2.0)
    assert points == pytest.approx(np.array([[0, 0], [2, 0], [3, 1], [3, 3], [3, 4.5]]))
    assert np.degrees(course) == pytest.approx([0, 0, 90, 90, 90])
    alone, _ = stations(path[1:3], 2.0)
    assert alone.tolist() == [[3, 0]]


def test_perturbations_follow_the_spread_of_the_current_around_a_point() -> None:
    deviations = np.array([[[0.0, 0.0], [1.0, -2.0]]])
    point = np.array([[50.0, 50.0]])
    uniform = renew.UniformCurrent(0.4, 0.3)
    for changes in perturbations(point, uniform, PAPER_VESSEL, deviations, np.zeros(1)):
        assert changes == pytest.approx(np.zeros((1, 2)))

    def sheared(points: np.ndarray) -> np.ndarray:
        speed = 0.5 + 0.05 * (points[..., 1] - 50)
        return np.stack([speed, np.zeros_like(speed)], axis=-1)

    class Sheared(renew.CurrentField):
        def __call__(self, points: np.ndarray) -> np.ndarray:
            return sheared(points)

    speed_change, direction_change = perturbations(
        point, Sheared(), PAPER_VESSEL, deviations, np.zeros(1)
    )
    # Its direction is the same everywhere; its speed differs as on two rings and in their middle.
    radius = PAPER_VESSEL.turning_radius
    angle = np.radians(np.arange(0, 360, 45))
    offsets = np.concatenate([[0.0], radius * np.sin(angle), 2 * radius * np.sin(angle)])
    assert speed_change == pytest.approx(np.array([[0.0, np.std(0.05 * offsets)]]))
    assert direction_change == pytest.approx(np.zeros((1, 2)))


@pytest.fixture(scope="module")
def planned() -> tuple[renew.Route, renew.CurrentField, renew.Tightest]:
    scene = random_scene(5)
    route = scene.plan(classes=1).best
    found = renew.tightest(route, scene.current, PAPER_VESSEL)
    assert found is not None
    return route, scene.current, found


def test_it_is_where_the_route_is_nearest_to_land(
    planned: tuple[renew.Route, renew.CurrentField, renew.Tightest],
) -> None:
    route, _, found = planned
    way = shapely.LineString(route.path)
    assert found.gap == pytest.approx(shapely.LineString(found.edge).distance(way))
    assert found.gap == pytest.approx(route.clearance, abs=0.3 * PAPER_VESSEL.turning_radius)
    assert shapely.Point(found.point).distance(way) < 1e-9
    assert shapely.Point(found.point).distance(shapely.LineString(found.edge)) == pytest.approx(
        found.gap
    )
    # The path lies outside the soft no-go zone.
    assert found.gap >= found.padding


def test_turns_reach_no_further_than_the_risk_allows(
    planned: tuple[renew.Route, renew.CurrentField, renew.Tightest],
) -> None:
    _, current, found = planned
    assert found.reaches.shape == (4096,)
    assert (found.reaches > found.gap).mean() <= 0.06
    # Begun on the course in the current there, a turn reaches no further than most draws do.
    mean = current.velocity(found.point, 0.0)
    away = found.edge.mean(axis=0) - found.point
    normal = np.array([found.edge[0, 1] - found.edge[1, 1], found.edge[1, 0] - found.edge[0, 0]])
    normal = normal / np.linalg.norm(normal) * np.sign(normal @ away)
    reach = turn_reach(PAPER_VESSEL, np.asarray(found.heading), mean, normal)
    assert found.reaches.min() < reach < np.quantile(found.reaches, 0.95)


def test_a_route_without_padding_has_no_such_place() -> None:
    scene = random_scene(5)
    route = scene.plan(classes=1, padding="none").best
    assert renew.tightest(route, scene.current, PAPER_VESSEL) is None
