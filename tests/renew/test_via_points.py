"""Via points: passed in order, with least fuel over all combinations, and safely."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew._types import FloatArray
from renew.inputs.options import Padding
from renew.voyage.voyage import Voyage, Waters
from tests.clock_oracle import earliest_arrival
from tests.moving_waters import moving_scene
from tests.oracles import grid_dijkstra
from tests.strategies import PAPER_VESSEL, SIZE, random_scene, single_gyre

START, GOAL = (10.0, 10.0), (90.0, 90.0)
# How closely via points are passed, m: 2 % of the turning radius.
MISS = 0.02 * PAPER_VESSEL.turning_radius
ROUND_TRIPS = [
    [(10.0, 90.0)],
    [(50.0, 58.0)],
    [(10.0, 90.0), (90.0, 10.0)],
    [(80.0, 20.0), (20.0, 20.0), (80.0, 20.0)],
]


def gyre_plan(via: Sequence[tuple[float, float]], **options: Any) -> renew.Plan:
    return single_gyre().plan(**{"classes": 4, "via": via, **options})


def passed_in_order(line: FloatArray, via: Sequence[tuple[float, float]]) -> bool:
    """Whether a line (n, 2) comes by all points one after the other, by walking along it."""
    dense = shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), MISS / 4))
    at = 0
    for point in via:
        near = np.flatnonzero(np.hypot(*(dense[at:] - point).T) <= 1.2 * MISS)
        if not len(near):
            return False
        at += int(near[0])
    return True


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("via", ROUND_TRIPS)
def test_path_and_track_pass_the_points_in_order_and_turn_within_the_turn_rate(
    via: list[tuple[float, float]],
) -> None:
    scene = single_gyre()
    for route in gyre_plan(via).routes:
        for line in (route.path, route.trajectory[:, 1:3]):
            assert passed_in_order(line, via)
            assert (line[[0, -1]] == [START, GOAL]).all()
        turned = np.abs(np.diff(route.trajectory[:, 3]))
        allowed = PAPER_VESSEL.turn_rate * np.diff(route.trajectory[:, 0])
        assert (turned <= allowed * (1 + 1e-6)).all()
        # Also at the via points themselves: every 0.2 m beside them.
        assert scene.turns(route, spacing=0.2).collisions == 0
        assert route.fuel == pytest.approx(renew.fuel(route.path, scene.current, PAPER_VESSEL))
        assert route.times[-1] == pytest.approx(route.duration)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("via", ROUND_TRIPS)
@pytest.mark.parametrize("padding", ["none", "adaptive"])
def test_the_best_needs_hardly_more_than_the_best_of_each_part(
    via: list[tuple[float, float]], padding: Padding
) -> None:
    chart, current = single_gyre().parts[:2]
    best = gyre_plan(via, padding=padding).best
    parts = [
        renew.plan(chart, current, PAPER_VESSEL, *ends, padding=padding, classes=4).best.fuel
        for ends in itertools.pairwise([START, *via, GOAL])
    ]
    # What the turns at the points themselves cost: half a circle of the turning radius at most.
    turns = len(via) * np.pi * PAPER_VESSEL.turning_radius / (1 - 0.8)
    assert sum(parts) * (1 - 1e-3) <= best.fuel <= sum(parts) + turns
    assert best.fuel_bound.value <= sum(parts)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [1, 2])
def test_no_way_through_a_point_is_better_by_an_independent_search(seed: int) -> None:
    scene = random_scene(seed)
    via = np.array([SIZE - 15.0, 15.0])
    plan = scene.plan(via=[via], padding="none")
    least = sum(
        grid_dijkstra(scene.chart, scene.current, PAPER_VESSEL, a, b, spacing=5.0)[0]
        for a, b in itertools.pairwise([scene.start, via, scene.goal])
    )
    # The grid's paths run in 32 directions: they are dearer by up to 1 %, and tighter at the point.
    assert plan.best.fuel <= 1.01 * least
    assert plan.best.fuel_bound.value <= least
    fuels = [route.fuel for route in plan.routes]
    assert fuels == sorted(fuels)
    assert len({route.homotopy for route in plan.routes}) == len(fuels)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [0, 2])
def test_the_clock_runs_on_at_a_point(seed: int) -> None:
    scene, via = moving_scene(seed), np.array([0.9 * SIZE, 0.1 * SIZE])
    best = scene.plan(via=[via], padding="none").best
    least = 0.0
    for ends in itertools.pairwise([scene.start, via, scene.goal]):
        fuel, _ = earliest_arrival(
            scene.chart,
            scene.current,
            PAPER_VESSEL,
            *ends,
            scene.departure + least,
            spacing=4.0,
            drift=scene.drift,
        )
        least += fuel
    assert best.fuel <= 1.015 * least
    assert best.fuel_bound.value <= 1.01 * least
    exact = renew.fuel(
        best.path, scene.current, PAPER_VESSEL, drift=scene.drift, departure=scene.departure
    )
    assert best.fuel == pytest.approx(exact, rel=1e-9)


def test_turns_are_safe_early_on_time_and_late_all_the_way() -> None:
    scene, via = moving_scene(4), np.array([0.9 * SIZE, 0.1 * SIZE])
    best = scene.plan(via=[via], min_lateness=10.0, classes=4).best
    turns = scene.turns(best, min_lateness=10.0)
    assert turns.collisions == 0
    assert turns.trials > 3000


@pytest.mark.slow
def test_departures_and_arrivals_are_found_through_points_as_well() -> None:
    scene, via = moving_scene(4), [(0.9 * SIZE, 0.1 * SIZE)]
    asked: dict[str, Any] = {"padding": "none", "classes": 2, "via": via}
    found = scene.plan_departures([0.0, 80.0], **asked)
    for departure, fuel in zip(found.departures.tolist(), found.fuels.tolist(), strict=True):
        alone = scene.plan(departure=departure, **asked).best
        assert fuel == pytest.approx(alone.fuel, rel=1e-3)
    by = float(found.arrivals[-1]) + 20.0
    route = scene.plan(departure=0.0, arrive_by=by, **asked).best
    assert route.times[-1] <= by
    assert route.times[0] > 80.0


def test_a_round_trip_ends_where_it_began() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 40, 60, 60)])
    still = renew.UniformCurrent(0.0, 0.0)
    plan = renew.plan(chart, still, PAPER_VESSEL, START, START, via=[GOAL], padding="none")
    # Out on one side, and back on the same or the other.
    assert plan.best.fuel == pytest.approx(2 * (np.hypot(30, 50) * 2), rel=0.03)
    assert len(plan.routes) >= 4
    assert {name.count("/") for name in (route.homotopy for route in plan.routes)} == {1}


def test_all_faults_of_points_are_reported_at_once_with_the_remedy() -> None:
    with pytest.raises(renew.ViaInNoGoError) as refused:
        gyre_plan([(62.0, 40.0), (200.0, 50.0), (20.0, 20.0), (20.0, 20.0)])
    text = str(refused.value)
    assert "via[0] (62, 40) m lies in the no-go zone" in text
    assert (
        "via[1] (200, 50) m lies off the chart, 100 m from the nearest water at (100, 50) m" in text
    )
    assert "via[2] and via[3] are the same point (20, 20) m; move one" in text
    with pytest.raises(
        renew.ParameterError, match=r"via\[0\] = 5 must be two .*via\[1\] = \(1, nan\)"
    ):
        gyre_plan([5, (1, float("nan"))])  # type: ignore[list-item]
    with pytest.raises(renew.ParameterError, match=r"method = 'optimal', not 'sampled'; .*'fuel'"):
        gyre_plan([(20.0, 20.0)], method="sampled", order="length")


def test_a_point_where_no_turn_is_safe_is_refused_with_the_reason() -> None:
    # Five metres off an island, within the reach of a turn; without padding it will do.
    with pytest.raises(renew.UnreachableError, match=r"via point .* within the padding"):
        gyre_plan([(39.5, 39.9)], classes=1)
    assert gyre_plan([(39.5, 39.9)], padding="none").routes


def test_a_path_is_cut_where_it_comes_by_for_the_first_time() -> None:
    chart = renew.Chart(box(0, 0, 100, 100))
    via = np.array([[50.0, 10.0], [80.0, 10.0], [50.0, 10.0]])
    voyage = Voyage(
        Waters(chart, renew.UniformCurrent(0.0, 0.0)),
        PAPER_VESSEL,
        np.array(START),
        np.array((10.0, 90.0)),
        "projected",
        via=via,
    )
    path = np.array([[10.0, 10.0], [80.0, 10.0], [20.0, 10.0], [10.0, 90.0]])
    pieces = voyage.cut(path)
    assert [piece.tolist() for piece in pieces] == [
        [[10.0, 10.0], [50.0, 10.0]],
        [[50.0, 10.0], [80.0, 10.0]],
        [[80.0, 10.0], [50.0, 10.0]],
        [[50.0, 10.0], [20.0, 10.0], [10.0, 90.0]],
    ]
    assert voyage.missed(path).tolist() == [0.0, 0.0, 0.0]
    assert voyage.missed(path[[0, 1, 3]])[2] > 1.0
