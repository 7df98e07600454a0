"""Missions: what pymavlink reads back, and the grammar of QGroundControl's plans."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil, mavwp

from pipeline.findings.result import RunResult
from pipeline.formats.passage.missions import write_mission, write_plan
from pipeline.formats.passage.waypoints import Waypoints, case_waypoints
from tests.pipeline.formats import runs

LINK = mavutil.mavlink


def best(result: RunResult) -> Waypoints:
    return case_waypoints(result.case(result.results[0].name))[0]


def loaded(path: Path) -> list[Any]:
    """The mission's items as ArduPilot's tools load them; the first is home."""
    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    return [loader.wp(index) for index in range(loader.count())]


def plan(result: RunResult, path: Path) -> dict[str, Any]:
    write_plan(result.case(result.results[0].name), path)
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
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
    content = plan(any_run, tmp_path / "a.plan")
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
    items = plan(any_run, tmp_path / "a.plan")["mission"]["items"]
    for ours, theirs in zip(items, loaded(path)[1:], strict=True):
        assert (ours["command"], ours["frame"]) == (theirs.command, theirs.frame)
        params = [theirs.param1, theirs.param2, theirs.param3, theirs.param4]
        assert ours["params"] == pytest.approx([*params, theirs.x, theirs.y, theirs.z], abs=2e-7)


@pytest.mark.parametrize("writer", [write_plan, write_mission])
def test_what_cannot_be_written_is_an_os_error(tmp_path: Path, writer: Callable[..., None]) -> None:
    with pytest.raises(OSError, match="nowhere"):
        writer(runs.across_180().case(runs.SEASON), tmp_path / "nowhere" / "a")
