"""Planned again under way: the class is kept or left, and what drift and the forecast changed."""

import math
import pickle
import statistics
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

import renew
from renew._types import FloatArray
from renew.inputs.options import Drift
from tests import clock_oracle
from tests.moving_waters import moving_scene
from tests.oracles import grid_dijkstra, tighten
from tests.renew.steering.motion import assert_sailable
from tests.strategies import PAPER_VESSEL, random_scene, single_gyre
from tests.under_way import Waters, replanned, sailed

CHANNEL = renew.Chart(box(0, 0, 200, 60))
FROM, TO = (20.0, 30.0), (180.0, 30.0)
SHORT = renew.VaryingCurrent([0.0, 400.0], [renew.UniformCurrent(0.0, 0.0)] * 2)
ISLAND = Polygon([(90, 20), (110, 20), (110, 40), (90, 40)])
"""Midway: both sides are as far."""


def on_the_way(route: renew.Route, share: float) -> tuple[FloatArray, float, float]:
    """Where the vessel is (2,), m, when, s, and on which heading (rad), at a share of a track."""
    time, x, y, heading = route.trajectory[int(share * len(route.trajectory))]
    return np.array([x, y]), float(time), float(heading % (2 * math.pi))


def jet(north: float, south: float) -> renew.GriddedCurrent:
    """Return a current (m/s) towards +x beside the island, to its north and to its south."""
    x, y = np.linspace(0, 200, 41), np.linspace(0, 60, 61)
    beside = (abs(x - 100) < 40) & (abs(y - 30) > 5)[:, None]
    u = np.where(beside, np.where(y > 30, north, south)[:, None], 0.0)
    return renew.GriddedCurrent(x, y, u, np.zeros_like(u))


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", range(3))
def test_at_the_place_and_time_planned_it_is_the_same_way_ahead(seed: int) -> None:
    scene = random_scene(seed)
    plan = scene.plan()
    route = plan.best
    again = type(scene.current)(seed, 0.0)
    vars(again).update(vars(scene.current))  # the same current, read once more
    for at in range(0, len(route.path) - 1, max(1, len(route.path) // 6)):
        for given in (None, again):
            found = renew.replan(plan, route.path[at], float(route.times[at]), current=given)
            assert found.answer == "kept"
            ahead = route.fuel - PAPER_VESSEL.fuel_rate * (route.times[at] - route.times[0])
            assert found.fuel == pytest.approx(ahead, rel=1e-6)
            assert found.off == pytest.approx(0, abs=1e-9)
            assert found.late == pytest.approx(0, abs=1e-6)
            assert (found.by_drift, found.by_forecast) == pytest.approx((0, 0), abs=1e-5)
            assert found.best is not None
            away = shapely.LineString(route.path[max(at - 1, 0) :])
            assert away.buffer(0.02).covers(shapely.LineString(found.best.path))


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", range(4))
def test_the_best_way_from_anywhere_is_as_cheap_as_the_oracles(seed: int) -> None:
    scene, newer = random_scene(seed), random_scene(seed + 50).current
    plan = scene.plan(padding="none")
    rng, water, at = np.random.default_rng(seed), scene.chart.water.buffer(-3.0), scene.start
    while not water.contains(shapely.Point(at)) or math.dist(at, scene.start) < 30:
        at = rng.uniform(20, 150, 2)
    found = renew.replan(plan, at, 30.0, current=newer, switch_above=0.0)
    _, path = grid_dijkstra(scene.chart, newer, PAPER_VESSEL, at, scene.goal, 4.0)
    least, _ = tighten(path, scene.chart, newer, PAPER_VESSEL)
    assert found.fuel <= 1.005 * least
    assert found.best is not None
    assert found.best.fuel_bound.value <= least


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4])
def test_in_a_current_that_changes_it_is_as_cheap_as_the_oracle_with_its_clock(seed: int) -> None:
    scene = moving_scene(seed)
    plan = scene.plan(padding="none")
    at, time, _ = on_the_way(plan.best, 0.3)
    off = at + np.array([1.0, -1.0])
    found = renew.replan(plan, off, time + 20.0, switch_above=0.0)
    arguments = scene.current, PAPER_VESSEL
    _, path = clock_oracle.earliest_arrival(
        scene.chart, *arguments, off, scene.goal, time + 20.0, spacing=4.0,
        drift=scene.drift, radius=5,
    )  # fmt: skip
    least, _ = clock_oracle.tighten(
        path, scene.chart, *arguments, time + 20.0, drift=scene.drift, spacing=4.0, width=8.0
    )
    assert found.fuel <= 1.005 * least


def test_drift_and_forecast_are_told_apart() -> None:
    plan = renew.plan(CHANNEL, renew.UniformCurrent(0.2, 0.0), PAPER_VESSEL, FROM, TO)
    late, way = 5.0, 100.0
    time = 60.0 / 1.2 + late
    found = renew.replan(plan, (80.0, 30.0), time, current=renew.UniformCurrent(-0.1, 0.0))
    assert found.late == pytest.approx(late)
    assert found.burnt == pytest.approx(time)
    assert found.by_drift == pytest.approx(late)
    assert found.by_forecast == pytest.approx(way / 0.9 - way / 1.2)
    assert found.saved == pytest.approx(0.0, abs=1e-6)
    assert found.fuel == pytest.approx(way / 0.9)
    # 30 m abeam to starboard, where the current is no other: the way back is what it costs.
    off = renew.replan(plan, (80.0, 10.0), 50.0, burnt=70.0)
    assert off.off == pytest.approx(20.0)
    straight = np.array([100.0, 20.0])
    made = 1 + 0.2 * straight[0] / np.linalg.norm(straight)
    assert off.fuel == pytest.approx(float(np.linalg.norm(straight)) / made, rel=1e-4)
    assert off.burnt + off.fuel == pytest.approx(
        plan.best.fuel + off.by_drift + off.by_forecast - off.saved
    )
    assert off.by_drift > 20.0


@pytest.mark.parametrize(("north", "answer"), [(0.32, "kept"), (0.42, "switched")])
def test_another_class_has_to_save_more_than_the_threshold(north: float, answer: str) -> None:
    chart = renew.Chart(box(0, 0, 200, 60), [ISLAND])
    plan = renew.plan(chart, jet(0.29, 0.3), PAPER_VESSEL, FROM, TO)
    assert plan.best.path[:, 1].min() < 20
    newer = jet(north, 0.3)
    found = renew.replan(plan, (40.0, 30.0), 16.0, current=newer)
    anew = renew.plan(chart, newer, PAPER_VESSEL, (40.0, 30.0), TO, departure=16.0)
    assert anew.best.path[:, 1].max() > 40  # without a threshold the north is better both times
    south = next(route for route in anew.routes if route.path[:, 1].min() < 20)
    assert found.kept is not None
    assert found.kept.fuel == pytest.approx(south.fuel, rel=3e-3)
    assert found.answer == answer
    saves = 1 - anew.best.fuel / found.kept.fuel
    assert (saves > 0.02) == (answer == "switched")
    expected = anew.best.fuel if answer == "switched" else found.kept.fuel
    assert found.fuel == pytest.approx(expected, rel=1e-3)
    assert renew.replan(plan, (40.0, 30.0), 16.0, current=newer, switch_above=1).answer == "kept"


def test_a_class_that_is_shut_is_left_and_where_all_are_there_is_no_way() -> None:
    chart = renew.Chart(box(0, 0, 200, 60), [ISLAND])
    plan = renew.plan(chart, jet(0.29, 0.3), PAPER_VESSEL, FROM, TO)
    switched = renew.replan(plan, (40.0, 31.0), 16.0, current=jet(0.2, -1.5))
    assert switched.answer == "switched"
    assert switched.best is not None
    assert switched.best.path[:, 1].max() > 40
    assert switched.kept is None
    shut = renew.replan(plan, (40.0, 31.0), 16.0, current=jet(-1.5, -1.5))
    assert (shut.answer, shut.best, shut.fuel) == ("no way", None, math.inf)
    assert isinstance(shut.cause, renew.UnreachableError)


def shut_ahead(*havens: renew.Haven, **given: Any) -> renew.Replanned:
    """Planned again west of the island, where a jet has shut both sides of it."""
    chart = renew.Chart(box(0, 0, 200, 60), [ISLAND])
    plan = renew.plan(chart, jet(0.29, 0.3), PAPER_VESSEL, FROM, TO)
    newer = jet(-1.5, -1.5)
    return renew.replan(plan, (40.0, 31.0), 16.0, current=newer, havens=havens, **given)


def haven(name: str, x: float, y: float, **hours: float) -> renew.Haven:
    return renew.Haven(name, np.array([x, y]), **hours)


def test_where_no_way_leads_on_it_turns_off_to_the_haven_of_least_fuel() -> None:
    near, far, beyond = haven("near", 30, 12), haven("far", 12, 50), haven("beyond", 180, 30)
    found = shut_ahead(far, beyond, near)
    assert found.answer == "turn off"
    assert isinstance(found.cause, renew.UnreachableError)
    assert [one.haven.name for one in found.turn_offs] == ["near", "far"]
    assert [one.name for one, _ in found.havens_left_out] == ["beyond"]
    assert found.saved == 0
    chart = renew.Chart(box(0, 0, 200, 60), [ISLAND])
    for one in found.turn_offs:
        alone = renew.plan(
            chart, jet(-1.5, -1.5), PAPER_VESSEL, (40.0, 31.0), one.haven.place, departure=16.0
        ).best
        assert one.fuel == pytest.approx(alone.fuel, rel=1e-3)
        assert one.arrival == pytest.approx(16.0 + alone.duration, rel=1e-3)
    assert found.plan is not None
    assert found.fuel == found.turn_offs[0].fuel
    assert found.plan.best.path[-1] == pytest.approx(near.place)
    at, time, heading = on_the_way(found.plan.best, 0.5)
    onwards = renew.replan(found.plan, at, time, heading=heading)
    assert onwards.answer == "kept"
    assert onwards.best is not None
    assert onwards.best.path[-1] == pytest.approx(near.place)


def test_it_turns_off_from_its_heading_and_no_hard_over_turn_meets_land() -> None:
    found = shut_ahead(haven("behind", 15, 31), heading=0.0)
    assert found.best is not None
    assert found.best.trajectory[0, 3] == pytest.approx(0.0)
    assert found.fuel > shut_ahead(haven("behind", 15, 31)).fuel
    for at in np.linspace(0, len(found.best.trajectory) - 1, 7).astype(int):
        turn = found.best.trajectory[max(at - 1, 0) : at + 1]
        rate = np.abs(np.diff(turn[:, 3])) / np.diff(turn[:, 0])
        assert (rate <= PAPER_VESSEL.turn_rate * (1 + 1e-6)).all()


def test_a_haven_counts_with_its_hours() -> None:
    arrival = shut_ahead(haven("near", 30, 12)).turn_offs[0].arrival
    shut = shut_ahead(haven("near", 30, 12, closes=arrival - 1), haven("far", 12, 50))
    assert [one.haven.name for one in shut.turn_offs] == ["far"]
    assert "closes at" in str(shut.havens_left_out[0][1])
    waits = shut_ahead(haven("near", 30, 12, opens=arrival + 500), haven("far", 12, 50))
    assert [one.haven.name for one in waits.turn_offs] == ["far", "near"]
    assert waits.turn_offs[1].arrival == arrival + 500
    in_time = shut_ahead(haven("near", 30, 12)).turn_offs[0].fuel
    assert waits.turn_offs[1].fuel == pytest.approx(in_time + 500 * PAPER_VESSEL.fuel_rate)


def test_without_a_haven_in_reach_there_is_no_way_and_with_a_way_none_is_planned() -> None:
    lost = shut_ahead(haven("beyond", 180, 30), haven("on the island", 100, 30))
    assert (lost.answer, lost.plan, lost.turn_offs) == ("no way", None, ())
    assert len(lost.havens_left_out) == 2
    plan = single_gyre().plan()
    kept = renew.replan(plan, plan.best.path[0], 0.0, havens=[haven("near", 20, 20)])
    assert (kept.answer, kept.turn_offs, kept.havens_left_out) == ("kept", (), ())
    with pytest.raises(renew.ParameterError, match=r"havens\[0\]"):
        renew.replan(plan, plan.best.path[0], 0.0, havens=["near"])  # type: ignore[list-item]


@pytest.mark.parametrize("depth", [0.3, 2.0])
def test_inside_v_it_leaves_by_about_the_nearest_way(depth: float) -> None:
    chart = renew.Chart(box(0, 0, 200, 60), [box(40, 0, 160, 20)])
    plan = renew.plan(chart, renew.UniformCurrent(0.1, 0.0), PAPER_VESSEL, (20.0, 30.0), TO)
    zone = plan.best.soft_no_go
    edge = zone.bounds[3]
    at = np.array([70.0, edge - depth])
    found = renew.replan(plan, at, 60.0, heading=0.0)
    assert found.best is not None
    inside = shapely.LineString(found.best.path).intersection(zone)
    assert inside.length <= depth + 2.5 * PAPER_VESSEL.turning_radius
    assert shapely.distance(shapely.LineString(found.best.path), chart.hard_no_go) > 0
    assert found.best.starts_in_soft_no_go


@pytest.mark.gate_share(2)
@pytest.mark.parametrize("heading", [None, 0.0, 2.5])
@pytest.mark.parametrize("across", [0.0, 0.35])
@pytest.mark.parametrize("drift", ["projected", "crab"])
def test_its_fuel_is_that_of_its_own_path(
    drift: Drift, across: float, heading: float | None
) -> None:
    chart = renew.Chart(box(0, 0, 200, 60), [box(40, 0, 160, 20)])
    steady = renew.UniformCurrent(0.1, across)
    turning = renew.VaryingCurrent([0.0, 900.0], [steady, renew.UniformCurrent(-0.3, across)])
    for current in (steady, turning):
        plan = renew.plan(chart, current, PAPER_VESSEL, (20.0, 30.0), TO, drift=drift)
        # Inside the soft no-go zone, which it leaves first; and off the plan in open water.
        for at in ((70.0, plan.best.soft_no_go.bounds[3] - 1.0), (70.0, 45.0)):
            best = renew.replan(plan, at, 60.0, heading=heading).best
            assert best is not None
            alone = renew.fuel(best.path, current, PAPER_VESSEL, drift=drift, departure=60.0)
            assert best.fuel == pytest.approx(alone, rel=1e-9)
            assert best.times[-1] - 60.0 == pytest.approx(best.duration, rel=1e-9)
            assert len(best.times) == len(best.path)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", range(3))
def test_from_any_heading_the_track_is_one_that_the_vessel_can_sail(seed: int) -> None:
    scene = random_scene(seed)
    plan = scene.plan(drift="crab")
    rng = np.random.default_rng(seed)
    for share in (0.05, 0.3, 0.5, 0.7):
        at, time, planned = on_the_way(plan.best, share)
        for heading in (planned, *rng.uniform(-math.pi, math.pi, 3)):
            found = renew.replan(plan, at, time, heading=heading).best
            assert found is not None
            track = found.trajectory
            assert_sailable(track, scene.current, at, scene.goal)
            assert math.cos(track[0, 3] - heading) == pytest.approx(1.0)
            assert not shapely.intersects(shapely.LineString(track[:, 1:3]), scene.chart.hard_no_go)
            assert found.times[-1] == pytest.approx(track[-1, 0], rel=2e-3)
            assert found.fuel == pytest.approx(found.times[-1] - time)


def test_via_points_that_are_passed_are_not_passed_again() -> None:
    via = [(10.0, 60.0), (60.0, 90.0)]
    plan = single_gyre().plan(via=via)
    line = shapely.LineString(plan.best.path)
    share = (line.project(shapely.Point(via[0])) + 5.0) / line.length
    at = np.array(line.interpolate(share, normalized=True).coords[0])
    time = float(
        np.interp(line.project(shapely.Point(at)), _along(plan.best.path), plan.best.times)
    )
    found = renew.replan(plan, at + np.array([1.0, 0.5]), time)
    assert found.answer == "kept"
    assert found.best is not None
    ahead = shapely.LineString(found.best.path)
    assert ahead.distance(shapely.Point(via[1])) < 0.02 * PAPER_VESSEL.turning_radius
    assert ahead.distance(shapely.Point(via[0])) > 3.0


def _along(path: FloatArray) -> FloatArray:
    """Lengths (n,), m, from a path's start to its points."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def test_areas_that_are_shut_then_are_kept_out_of() -> None:
    gate = renew.ShutArea(box(95, 0, 105, 32), 110.0, 400.0, name="range")
    still = renew.UniformCurrent(0.0, 0.0)
    plan = renew.plan(CHANNEL, still, PAPER_VESSEL, FROM, TO, avoid=[gate])
    assert plan.best.fuel == pytest.approx(160.0, rel=1e-3)  # it passes before
    found = renew.replan(plan, (50.0, 30.0), 90.0, heading=0.0)  # an hour late: it is shut
    assert found.best is not None
    assert shapely.LineString(found.best.path).distance(gate.polygon) > 0
    assert found.fuel > 130.5


def test_on_the_margin_around_land_it_begins_in_the_nearest_water() -> None:
    land = box(90, 0, 110, 18)
    chart = renew.Chart(box(0, 0, 200, 60), [land.buffer(2)], land=[land])
    plan = renew.plan(chart, renew.UniformCurrent(0.1, 0.0), PAPER_VESSEL, FROM, TO)
    found = renew.replan(plan, (100.0, 19.0), 70.0)
    assert found.moved == pytest.approx(1.0, abs=0.04)
    assert found.best is not None
    assert found.best.path[0] == pytest.approx([100.0, 20.0], abs=0.04)
    with pytest.raises(renew.StartInNoGoError, match=r"at \(100, 10\) m lies in the no-go zone"):
        renew.replan(plan, (100.0, 10.0), 70.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"at": (math.nan, 1.0)}, "at = "),
        ({"at": (300.0, 30.0)}, "off the chart, 200.00 m"),
        ({"time": math.inf}, "time = inf s must be finite"),
        ({"time": -7.0}, "time = -7 s lies 7 s before the departure, 0 s"),
        ({"heading": 400.0}, "heading = 400.0 must lie between"),
        ({"burnt": -1.0}, "burnt = -1.0 fuel units"),
        ({"switch_above": 2.0}, "switch_above = 2.0 must be a share from 0 to 1"),
        ({"current": 3}, "current"),
        ({"time": 500.0, "current": SHORT}, "for which the current is known, 0 s to 400 s"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_what_it_is_off_by(
    given: dict[str, Any], message: str
) -> None:
    asked: dict[str, Any] = {"at": (50.0, 50.0), "time": 50.0, **given}
    with pytest.raises(renew.PlanningError) as raised:
        renew.replan(single_gyre().plan(classes=1), **asked)
    assert message in str(raised.value)


def test_plans_that_cannot_be_planned_again_say_why() -> None:
    plan = single_gyre().plan(classes=1)
    read = pickle.loads(pickle.dumps(plan))  # noqa: S301 - its own
    with pytest.raises(renew.ParameterError, match="a plan that was pickled has lost its current"):
        renew.replan(read, (50.0, 50.0), 50.0)
    kept = replace(read, voyage=plan.voyage)
    assert renew.replan(kept, plan.best.path[5], float(plan.best.times[5])).answer == "kept"
    with pytest.raises(renew.ParameterError, match="previous chose speeds"):
        renew.replan(single_gyre().plan(classes=1, speed=(0.9, 1.1)), (50.0, 50.0), 50.0)


@pytest.mark.slow
def test_voyages_planned_again_in_each_forecast_arrive_nearly_as_soon_as_can_be() -> None:
    seas = [Waters.of(seed) for seed in range(0, 100, 2)]
    plans = [sea.plan(sea.forecast(0.0)) for sea in seas]
    again = [replanned(sea, plan) for sea, plan in zip(seas, plans, strict=True)]
    assert not any(one.stranded for one in again)
    assert statistics.median(one.switches for one in again) <= 1
    known = [sailed(sea, sea.plan(sea.truth)).arrival for sea in seas]
    beside = [one.arrival / best for one, best in zip(again, known, strict=True)]
    assert statistics.median(beside) <= 1.02
    never = [sailed(sea, plan).arrival for sea, plan in zip(seas, plans, strict=True)]
    # A forecast may be worse than the one before; it hardly ever costs more than half a per cent.
    later = [one.arrival / late - 1 for one, late in zip(again, never, strict=True)]
    assert sum(share <= 0 for share in later) >= 0.8 * len(seas)
    assert sum(share <= 5e-3 for share in later) >= 0.95 * len(seas)
