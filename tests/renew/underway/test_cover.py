"""Ways to havens along a route: what is claimed covered or uncovered, and what is refused."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew._types import FloatArray
from tests.oracles import grid_dijkstra
from tests.strategies import PAPER_VESSEL, single_gyre

STATES: tuple[Any, ...] = ("covered", "uncovered", "not settled")
START, GOAL = (10.0, 10.0), (90.0, 90.0)


def haven(name: str, x: float, y: float, **hours: float) -> renew.Haven:
    return renew.Haven(name, np.array([x, y]), **hours)


NORTH_WEST, SOUTH_EAST = haven("north-west", 15, 85), haven("south-east", 85, 15)


Scene: TypeAlias = tuple[renew.Route, renew.Chart, renew.CurrentField]


@pytest.fixture(scope="module")
def gyre() -> Scene:
    chart, current = single_gyre().parts[:2]
    return renew.plan(chart, current, PAPER_VESSEL, START, GOAL).best, chart, current


@pytest.fixture(scope="module")
def covers(gyre: Scene) -> Callable[[float], renew.Coverage]:
    """Give the ways to two havens within a time (s), each looked for once."""
    route, chart, current = gyre
    havens = [NORTH_WEST, SOUTH_EAST]
    return cache(
        lambda within: renew.cover(route, chart, current, PAPER_VESSEL, havens, within=within)
    )


def on_track(route: renew.Route, time: float) -> FloatArray:
    """Where the vessel is at a time (s) if it is on time (2,), m."""
    track = route.trajectory
    return np.array([np.interp(time, track[:, 0], track[:, column]) for column in (1, 2)])


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("within", [20.0, 40.0])
def test_what_is_claimed_along_a_route_in_a_gyre(
    gyre: Scene, covers: Callable[[float], renew.Coverage], within: float
) -> None:
    (route, chart, current), found = gyre, covers(within)
    ends = [one.end for one in found.stretches]
    assert found.stretches[0].begin == route.trajectory[0, 0]
    assert ends[-1] == route.trajectory[-1, 0]
    assert [one.begin for one in found.stretches[1:]] == ends[:-1]
    assert {"covered", "uncovered"} <= {one.state for one in found.stretches}
    assert sum(found.share(one) for one in STATES) == pytest.approx(1)
    for stretch in found.stretches:
        place = on_track(route, stretch.begin)
        if stretch.state == "covered":
            way = stretch.diversion
            assert way is not None
            assert way.time - stretch.begin + way.duration <= within + 1e-6
            assert math.dist(way.route.path[0], on_track(route, way.time)) < 1e-6
            assert math.dist(way.route.path[-1], way.haven.place) < 1e-9
            assert abs(math.remainder(way.route.trajectory[0, 3] - way.heading, 2 * math.pi)) < 1e-6
        elif stretch.state == "uncovered":
            for one in (NORTH_WEST, SOUTH_EAST):
                fuel, _ = grid_dijkstra(chart, current, PAPER_VESSEL, place, one.place, 5.0)
                assert fuel / PAPER_VESSEL.fuel_rate > within
    (last,) = [one for one in found.abort_points if one.diversion.haven is NORTH_WEST]
    assert last.diversion.longest <= within
    assert found.at(last.diversion.time + 1e-6).state != "uncovered"
    assert found.at((last.not_after + route.trajectory[-1, 0]) / 2).state == "uncovered"


@pytest.mark.slow
def test_who_is_late_keeps_the_endurance_and_finds_the_haven_open(gyre: Scene) -> None:
    route, chart, current = gyre
    begin, end, late = route.trajectory[0, 0], route.trajectory[-1, 0], 0.1
    endurance, closes = 1.2 * route.fuel, begin + 0.6 * (end - begin)
    shut = haven("north-west", 15, 85, closes=closes)
    found = renew.cover(
        route, chart, current, PAPER_VESSEL, [shut, SOUTH_EAST],
        within=60.0, endurance=endurance, lateness=late,
    )  # fmt: skip
    covered = [one.diversion for one in found.stretches if one.diversion is not None]
    assert "north-west" in {way.haven.name for way in covered}
    for way in covered:
        arrives = way.time + late * (way.time - begin) + way.route.duration
        assert PAPER_VESSEL.fuel_rate * (arrives - begin) <= endurance + 1e-6
        assert arrives <= way.haven.closes + 1e-6


def test_the_endurance_gives_a_point_of_no_return() -> None:
    start, current = (20.0, 50.0), renew.UniformCurrent(0.2, 0.0)
    chart = renew.Chart(box(0, 0, 200, 100), [box(90, 40, 100, 60)])
    route = renew.plan(chart, current, PAPER_VESSEL, start, (180.0, 50.0), classes=1).best
    haven_there = haven("north", 100, 85)
    found = renew.cover(
        route, chart, current, PAPER_VESSEL, [haven_there], endurance=1.5 * route.fuel
    )
    last = found.no_return
    assert last is not None
    back = last.diversion
    assert math.dist(back.route.path[-1], start) < 1e-9
    rate = PAPER_VESSEL.fuel_rate
    assert rate * (back.time - route.times[0]) + back.fuel <= 1.5 * route.fuel * (1 + 1e-9)
    assert back.time <= last.not_after


def test_the_nearest_haven_changes_at_an_equal_point() -> None:
    chart = renew.Chart(box(0, 0, 400, 100))
    current = renew.UniformCurrent(0.2, 0.0)
    route = renew.plan(chart, current, PAPER_VESSEL, (20.0, 50.0), (380.0, 50.0)).best
    havens = [haven("west", 60, 20), haven("east", 340, 20)]
    found = renew.cover(route, chart, current, PAPER_VESSEL, havens, within=400.0)
    assert found.is_covered
    (equal,) = found.equal_points
    assert (equal.before.haven.name, equal.after.haven.name) == ("west", "east")
    assert equal.before.duration == pytest.approx(equal.after.duration, abs=3.0)
    # With the current it is nearer to the haven that lies against it.
    assert equal.after.place[0] < 200


def turns_round(path: FloatArray, place: tuple[float, float]) -> int:
    """How many times a closed path (n, 2) leads round a place."""
    angles = np.unwrap(np.arctan2(path[:, 1] - place[1], path[:, 0] - place[0]))
    return round(float(angles[-1] - angles[0]) / (2 * math.pi))


@pytest.mark.slow
@pytest.mark.parametrize("dearer_by", [0.02, 0.1])
def test_up_to_a_last_place_the_vessel_can_change_to_each_other_class(dearer_by: float) -> None:
    islands = {(175.0, 105.0): box(150, 60, 200, 150), (270.0, 55.0): box(260, 40, 280, 70)}
    chart = renew.Chart(box(0, 0, 400, 200), list(islands.values()))
    current = renew.UniformCurrent(0.2, 0.0)
    plan = renew.plan(chart, current, PAPER_VESSEL, (20.0, 100.0), (380.0, 100.0))
    route, rate = plan.best, PAPER_VESSEL.fuel_rate
    found = renew.cover(
        route, chart, current, PAPER_VESSEL, [haven("west", 60, 20)],
        within=100.0, others=plan.routes, dearer_by=dearer_by,
    )  # fmt: skip
    assert [turn.other for turn in found.class_turns] == list(plan.routes[1:])

    def is_class_of(other: renew.Route, time: float, way: FloatArray) -> bool:
        track = route.trajectory[route.trajectory[:, 0] < time, 1:3]
        ring = np.vstack([track, way, other.path[::-1]])
        ring = shapely.get_coordinates(shapely.segmentize(shapely.LineString(ring), 1.0))
        return all(turns_round(np.vstack([ring, ring[:1]]), one) == 0 for one in islands)

    for turn in found.class_turns:
        way, most = turn.diversion, (1 + dearer_by) * turn.other.fuel
        assert is_class_of(turn.other, way.time, way.route.path)
        assert turn.fuel == pytest.approx(rate * (way.time - route.times[0]) + way.fuel)
        assert turn.fuel <= most
        assert math.dist(way.route.path[0], on_track(route, way.time)) < 1e-6
        # A little later every way of the class is too dear, even without an arc at its begin.
        later = way.time + route.duration / 32
        place = tuple(on_track(route, later).tolist())
        ahead = renew.plan(chart, current, PAPER_VESSEL, place, (380.0, 100.0))
        fuels = [one.fuel for one in ahead.routes if is_class_of(turn.other, later, one.path)]
        assert rate * (later - route.times[0]) + min(fuels, default=math.inf) > most * 0.99


@pytest.mark.slow
def test_late_vessels_are_covered_in_a_current_that_changes() -> None:
    chart = renew.Chart(box(0, 0, 400, 100), [box(150, 30, 170, 60)])
    against = renew.UniformCurrent(0.5, 0.0)
    current = renew.VaryingCurrent(
        [0.0, 200.0, 3000.0], [renew.UniformCurrent(0.0, 0.0), against, against]
    )
    options: dict[str, Any] = {"lateness": 0.1, "min_lateness": 5.0}
    route = renew.plan(chart, current, PAPER_VESSEL, (20.0, 50.0), (380.0, 50.0), **options).best
    west = haven("west", 60, 20)
    found = renew.cover(route, chart, current, PAPER_VESSEL, [west], within=150.0, **options)
    covered = [one for one in found.stretches if one.state == "covered"]
    assert covered
    vessel, rate = PAPER_VESSEL, PAPER_VESSEL.fuel_rate
    for stretch in covered:
        way = stretch.diversion
        assert way is not None
        for time in (stretch.begin, (stretch.begin + stretch.end) / 2):
            off = max(0.1 * (time - route.times[0]), 5.0)
            track = route.trajectory[:, :3]
            ahead = track[(track[:, 0] > time) & (track[:, 0] < way.time), 1:]
            path = np.vstack([on_track(route, time), ahead, way.route.path])
            path = path[np.append(True, np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9)]
            for leaving in (max(time - off, 0.0), time, time + off):
                fuel = renew.fuel(path, current, vessel, departure=leaving)
                assert fuel / rate <= 150.0 + 1e-6


def test_a_current_of_later_hours_leaves_nothing_open_before_them() -> None:
    chart = renew.Chart(box(0, 0, 160, 100))
    still, back = renew.UniformCurrent(0.0, 0.0), renew.UniformCurrent(-0.6, 0.0)
    current = renew.VaryingCurrent([0.0, 250.0, 300.0, 3000.0], [still, still, back, back])
    route = renew.plan(chart, current, PAPER_VESSEL, (80.0, 50.0), (140.0, 50.0)).best
    found = renew.cover(route, chart, current, PAPER_VESSEL, [haven("west", 60, 20)], within=40.0)
    # In still water it is 58 s to the haven, in the current of later hours only 36 s.
    place = on_track(route, 30.0)
    assert math.dist(place, (60.0, 20.0)) > 55.0
    assert found.at(30.0).state == "uncovered"
    assert 39.0 < found.at(30.0).least <= math.dist(place, (60.0, 20.0))
    for stretch in found.stretches:
        if stretch.state == "uncovered":
            begin = on_track(route, stretch.begin)
            assert stretch.least <= math.dist(begin, (60.0, 20.0)) / 0.4


@pytest.mark.slow
def test_a_route_of_one_long_leg_in_a_current_that_rises_fast_is_its_own() -> None:
    chart = renew.Chart(box(0, 0, 320, 100))
    still, back = renew.UniformCurrent(0.0, 0.0), renew.UniformCurrent(-0.6, 0.0)
    current = renew.VaryingCurrent([0.0, 250.0, 300.0, 3000.0], [still, still, back, back])
    route = renew.plan(chart, current, PAPER_VESSEL, (20.0, 50.0), (300.0, 50.0)).best
    assert len(route.path) == 2
    found = renew.cover(route, chart, current, PAPER_VESSEL, [haven("west", 60, 20)], within=60.0)
    assert found.at(0.0).state == "covered"


def test_few_ways_cover_what_many_stations_were_needed_for(
    covers: Callable[[float], renew.Coverage],
) -> None:
    covered = [one for one in covers(20.0).stretches if one.state == "covered"]
    ways = [one.diversion for one in covered if one.diversion is not None]
    assert len(set(ways)) == len(ways)
    for one, way in zip(covered, ways, strict=True):
        assert way.time >= one.end - 1e-9
        assert one.longest == pytest.approx(way.time - one.begin + way.longest)
        assert one.longest <= 20.0 + 1e-6


@pytest.mark.slow
def test_the_way_to_a_haven_waits_until_it_opens() -> None:
    chart, still = renew.Chart(box(0, 0, 200, 100)), renew.UniformCurrent(0.0, 0.0)
    route = renew.plan(chart, still, PAPER_VESSEL, (20.0, 50.0), (180.0, 50.0)).best
    open_late = haven("late", 100, 20, opens=route.duration * 0.8)
    found = renew.cover(route, chart, still, PAPER_VESSEL, [open_late], within=120.0)
    for way in found.diversions:
        assert way.time + way.duration >= open_late.opens - 1e-9
    closed = replace(open_late, opens=-math.inf, closes=30.0)
    found = renew.cover(route, chart, still, PAPER_VESSEL, [closed], within=120.0)
    assert not found.share("covered")
    causes = [str(one.cause) for one in found.stretches if one.cause is not None]
    assert any("closes at 30" in cause for cause in causes)


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ({}, "no limit is given"),
        ({"within": 1.0}, "within = 1.0 s must be at least that of one full turn, "),
        ({"within": math.nan}, "within = nan"),
        ({"within_fuel": -1.0}, "within_fuel = -1.0 fuel units"),
        ({"endurance": 10.0}, "must be at least the route's own fuel, 8"),
    ],
)
def test_limits_that_no_route_can_keep_are_refused(
    gyre: Scene, given: dict[str, Any], part: str
) -> None:
    route, chart, current = gyre
    with pytest.raises(renew.ParameterError, match=part):
        renew.cover(route, chart, current, PAPER_VESSEL, [NORTH_WEST], **given)


def test_havens_that_cannot_be_used_are_left_out_by_name(gyre: Scene) -> None:
    route, chart, current = gyre
    land = shapely.union_all(np.array(chart.no_go)).representative_point()
    on_land = haven("quay", land.x, land.y) if chart.no_go else None
    outside, shut = haven("far", 500, 85), haven("shut", 15, 85, opens=-9.0, closes=-1.0)
    bad = [one for one in (on_land, outside, shut) if one is not None]
    found = renew.cover(route, chart, current, PAPER_VESSEL, [*bad, NORTH_WEST], within=12.0)
    assert found.havens == (NORTH_WEST,)
    assert [one.name for one, _ in found.left_out] == [one.name for one in bad]
    for one, reason in found.left_out:
        assert one.name in str(reason)
    with pytest.raises(renew.GoalInNoGoError, match=r"far .* lies off the chart"):
        renew.cover(route, chart, current, PAPER_VESSEL, bad, within=30.0)
    with pytest.raises(renew.ParameterError, match="havens is empty"):
        renew.cover(route, chart, current, PAPER_VESSEL, [], within=30.0)
    with pytest.raises(renew.ParameterError, match="give vessel, current and drift"):
        renew.cover(route, chart, renew.GyreCurrent(0.1, 100, 100), PAPER_VESSEL, bad, within=30.0)
    with pytest.raises(renew.ParameterError, match="closes"):
        haven("no hours", 1, 1, opens=5.0, closes=4.0)
