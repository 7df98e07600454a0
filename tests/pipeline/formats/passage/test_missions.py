"""Missions, their fence and rally points, read from the file, beside the chart as it is fetched."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pymavlink import mavutil, mavwp

from pipeline.findings.result import RunResult
from pipeline.formats.passage.missions import KEPT_SHARE, fence_of, write_mission, write_plan
from pipeline.formats.passage.waypoints import Waypoints, case_waypoints
from pipeline.formats.report.page import plan_section
from tests.pipeline.formats import runs, small_run

LINK = mavutil.mavlink


def season_of(result: RunResult) -> str:
    return result.results[0].name


def best(result: RunResult) -> Waypoints:
    return case_waypoints(result.case(season_of(result)))[0]


def loaded(path: Path) -> list[Any]:
    """The mission's items as ArduPilot's tools load them; the first is home."""
    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    return [loader.wp(index) for index in range(loader.count())]


def written(result: RunResult, folder: Path) -> dict[str, Any]:
    """The first season's plan as it is read back."""
    write_plan(result.case(season_of(result)), folder / "a.plan")
    content: dict[str, Any] = json.loads((folder / "a.plan").read_text(encoding="utf-8"))
    return content


def apart_deg(at: list[tuple[float, float]], points: Waypoints) -> float:
    """Largest difference of (lat, lon) from the waypoints."""
    difference = np.array(at)[:, ::-1] - points.lonlat
    difference[:, 0] = (difference[:, 0] + 180) % 360 - 180
    return float(np.abs(difference).max())


def test_pymavlink_reads_every_waypoint_and_speed(any_run: RunResult, tmp_path: Path) -> None:
    path, points = tmp_path / "a.waypoints", best(any_run)
    write_mission(any_run.case(any_run.results[0].name), path)
    home, *items = loaded(path)
    assert (home.current, home.frame) == (1, LINK.MAV_FRAME_GLOBAL)
    stops = [item for item in items if item.command == LINK.MAV_CMD_NAV_WAYPOINT]
    # 1e-7 degrees: a MAVLink position is a whole number of them.
    assert apart_deg([(item.x, item.y) for item in stops], points) < 2e-7
    assert (home.x, home.y) == (stops[0].x, stops[0].y)
    assert {item.frame for item in stops} == {LINK.MAV_FRAME_GLOBAL_RELATIVE_ALT}
    assert all(-180 <= item.y < 180 and item.z == 0 and item.autocontinue for item in stops)
    speeds = [item for item in items if item.command == LINK.MAV_CMD_DO_CHANGE_SPEED]
    assert [item.param2 for item in speeds] == pytest.approx(points.speed_m_s[:-1], abs=6e-4)
    assert {(item.param1, item.param3) for item in speeds} == {(LINK.SPEED_TYPE_GROUNDSPEED, -1)}
    # The speed of a leg is set at its beginning: when the waypoint before it was reached.
    assert [item.command for item in items] == [stops[0].command] + [
        LINK.MAV_CMD_DO_CHANGE_SPEED,
        LINK.MAV_CMD_NAV_WAYPOINT,
    ] * (len(stops) - 1)


def test_the_mission_takes_as_long_as_its_legs(any_run: RunResult, tmp_path: Path) -> None:
    path, points = tmp_path / "a.waypoints", best(any_run)
    write_mission(any_run.case(any_run.results[0].name), path)
    speeds = [i.param2 for i in loaded(path) if i.command == LINK.MAV_CMD_DO_CHANGE_SPEED]
    passage = sum(points.length_m[:-1] / speeds)
    assert passage == pytest.approx(points.time_s[-1], rel=2e-3)


def test_a_plan_has_the_form_that_qgroundcontrol_documents(
    any_run: RunResult, tmp_path: Path
) -> None:
    """Developer guide, Plan File Format: keys, versions, and items numbered from 1."""
    content = written(any_run, tmp_path)
    assert set(content) == {
        *("fileType", "version", "groundStation", "renew"),
        *("mission", "geoFence", "rallyPoints"),
    }
    assert (content["fileType"], content["version"]) == ("Plan", 1)
    mission = content["mission"]
    assert (mission["version"], content["geoFence"]["version"]) == (2, 2)
    assert mission["firmwareType"] == LINK.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert mission["vehicleType"] == LINK.MAV_TYPE_SURFACE_BOAT
    assert len(mission["plannedHomePosition"]) == 3
    for number, item in enumerate(mission["items"], start=1):
        assert item["type"] == "SimpleItem"
        assert item["doJumpId"] == number
        assert item["autoContinue"] is True
        assert len(item["params"]) == 7
        assert ("Altitude" in item) == (item["command"] == LINK.MAV_CMD_NAV_WAYPOINT)


def test_both_missions_are_the_same(any_run: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "a.waypoints"
    write_mission(any_run.case(any_run.results[0].name), path)
    items = written(any_run, tmp_path)["mission"]["items"]
    for ours, theirs in zip(items, loaded(path)[1:], strict=True):
        assert (ours["command"], ours["frame"]) == (theirs.command, theirs.frame)
        params = [theirs.param1, theirs.param2, theirs.param3, theirs.param4]
        assert ours["params"] == pytest.approx([*params, theirs.x, theirs.y, theirs.z], abs=2e-7)


# ArduPilot Rover's storage for fences on a Pixhawk, bytes, in three areas (StorageManager.cpp), and
# what each part takes (AC_PolyFence_loader.cpp).
FENCE_BYTES, HEADER, END, POLYGON, VERTEX = 160 + 256 + 256, 4, 1, 2, 8
RUNS: dict[str, Callable[[], RunResult]] = {
    "small": small_run.parts,
    "north": runs.far_north,
    "long": runs.long_way,
    "random 0": lambda: runs.random_run(0),
    "random 1": lambda: runs.random_run(1),
    "open sea": runs.open_sea,
}


@pytest.fixture(scope="module", params=RUNS)
def fenced(request: pytest.FixtureRequest) -> RunResult:
    return RUNS[request.param]()


def polygons(result: RunResult, folder: Path) -> list[tuple[bool, np.ndarray]]:
    """Each polygon in the file: whether it is the inclusion, and its ring (n, 2), lon/lat."""
    fence = written(result, folder)["geoFence"]
    assert (fence["version"], fence["circles"]) == (2, [])
    assert all(set(one) == {"version", "inclusion", "polygon"} for one in fence["polygons"])
    return [(one["inclusion"], np.array(one["polygon"])[:, ::-1]) for one in fence["polygons"]]


def allowed_by(found: list[tuple[bool, np.ndarray]]) -> shapely.Geometry:
    """What a fence allows: the inside of its first polygon, outside the others, lon/lat."""
    inclusion, *exclusions = [shapely.Polygon(ring) for _, ring in found]
    return shapely.difference(inclusion, shapely.union_all(exclusions))


def no_go(result: RunResult) -> shapely.Geometry:
    """Land as fetched, hard no-go zone and V of the best route, planner's plane."""
    route = result.case(season_of(result)).routes[0].route
    return shapely.union_all([*result.water.chart.no_go, *result.water.land, route.soft_no_go])


def test_what_the_fence_allows_is_open_water(fenced: RunResult, tmp_path: Path) -> None:
    """A point of V or land is outside the inclusion polygon or inside an exclusion polygon."""
    found = polygons(fenced, tmp_path)
    assert [inclusion for inclusion, _ in found] == [True] + [False] * (len(found) - 1)
    allowed = allowed_by(found)
    west, south, east, north = allowed.bounds
    places = np.random.default_rng(1).uniform([west, south], [east, north], (100_000, 2))
    places = places[shapely.contains_xy(allowed, places)]
    places = np.concatenate([places, *(ring for _, ring in found)])
    plane = fenced.water.projection.to_plane(places)
    assert len(places) > 1_000
    shut = no_go(fenced)
    shapely.prepare(shut)
    assert not shapely.contains_xy(shut, plane).any()
    assert shapely.contains_xy(fenced.water.chart.extent, plane).all()


def test_few_vertices_and_the_legs_inside_by_their_limits(
    fenced: RunResult, tmp_path: Path
) -> None:
    found = polygons(fenced, tmp_path)
    assert all(len(ring) >= 3 for _, ring in found)
    room = HEADER + sum(POLYGON + VERTEX * len(ring) for _, ring in found) + END
    assert room <= FENCE_BYTES
    scene, points = fenced.water, best(fenced)
    rings = [
        shapely.LinearRing(scene.projection.to_plane(shapely.get_coordinates(dense)))
        for _, ring in found
        for dense in [shapely.segmentize(shapely.LinearRing(ring), 1e-3)]
    ]
    inside = shapely.Polygon(found[0][1])
    for at in range(len(points.lonlat) - 1):
        ends = points.lonlat[at : at + 2]
        assert shapely.contains_xy(inside, ends).all()
        leg = shapely.LineString(scene.projection.to_plane(np.linspace(ends[0], ends[1], 200)))
        apart = min(leg.distance(ring) for ring in rings) * scene.projection.scale
        stretch = float(scene.projection.point_scale(ends).min())
        limit = min(points.port_m[at], points.starboard_m[at])
        # The leg is drawn straight in degrees here: off the loxodrome by metres on long legs.
        bend = points.length_m[at] ** 2 / 5e7 * np.tan(np.radians(np.abs(ends[:, 1]).max()))
        assert apart / stretch >= KEPT_SHARE * limit - bend - 0.5


@pytest.mark.parametrize("room", [300, 270, 100])
def test_a_fence_is_made_smaller_or_left_out_where_there_is_less_room(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The polygons share the room: the same run's fence takes 403 bytes where there are 672."""
    monkeypatch.setattr("pipeline.formats.passage.missions.STORAGE_BYTES", room)
    found = polygons(replace(small_run.parts()), tmp_path)
    assert HEADER + sum(POLYGON + VERTEX * len(ring) for _, ring in found) + END <= room
    assert bool(found) == (room >= 270)


def test_open_sea_is_fenced_as_far_as_the_chart(tmp_path: Path) -> None:
    result = runs.open_sea()
    [(_, ring)] = polygons(result, tmp_path)
    fenced = shapely.Polygon(result.water.projection.to_plane(ring))
    assert fenced.area == pytest.approx(result.water.chart.extent.area, rel=1e-2)


@pytest.mark.parametrize("name", ["across_180", "harbours"])
def test_nothing_is_promised_across_180_degrees_or_from_v(name: str, tmp_path: Path) -> None:
    result = getattr(runs, name)()
    content = written(result, tmp_path)
    assert content["geoFence"]["polygons"] == content["rallyPoints"]["points"] == []
    assert fence_of(result.case(season_of(result))) is None


@pytest.mark.parametrize(("name", "is_fenced"), [("open_sea", True), ("harbours", False)])
def test_the_passage_plan_says_hold_and_where_there_is_no_fence(
    name: str, *, is_fenced: bool
) -> None:
    result = getattr(runs, name)()
    found = plan_section(result.case(season_of(result)))
    assert found is not None
    assert any("set Loiter or Hold, not return" in text for text in found["sentences"])
    assert any("no fence" in text for text in found["sentences"]) != is_fenced
