"""Texts of the exchange formats, against values computed by hand."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from pipeline.findings.result import RunResult
from pipeline.findings.text import duration
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    case_waypoints,
    leg_text,
    time_after,
    waypoint_names,
    wrapped_longitude,
)
from pipeline.write import formats_of
from tests.pipeline.formats import runs


def test_routes_of_a_plane_are_not_for_a_plotter(
    result: RunResult, planar_result: RunResult
) -> None:
    assert any(name.endswith(".gpx") for name in formats_of(result))
    assert not any(name.endswith((".gpx", ".pdf")) for name in formats_of(planar_result))


def test_a_knot_is_a_nautical_mile_an_hour() -> None:
    assert pytest.approx(19.438, abs=1e-3) == 10 * KNOTS_PER_M_S


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0 h 00 min"), (29, "0 h 00 min"), (14_055, "3 h 54 min"), (360_000, "100 h 00 min")],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("longitude", "normal"),
    [
        (0.0, 0.0),
        (179.5, 179.5),
        (180.0, -180.0),
        (181.8, -178.2),
        (-180.0, -180.0),
        (-181.0, 179.0),
        (359.5, -0.5),
        (179.999_999_999, -180.0),
    ],
)
def test_longitudes_are_from_minus_180_to_below_180(longitude: float, normal: float) -> None:
    assert wrapped_longitude(longitude) == pytest.approx(normal, abs=1e-8)
    assert wrapped_longitude(longitude) < 180


def test_times_are_in_utc_and_whole_seconds() -> None:
    departure = datetime(2026, 3, 1, 1, 0, 0, 700_000, tzinfo=timezone(timedelta(hours=2)))
    assert time_after(departure, 3600.4) == datetime(2026, 3, 1, 0, 0, 0, tzinfo=UTC)
    with pytest.raises(ValueError, match="no time zone; add one"):
        time_after(departure.replace(tzinfo=None), 0)


def test_waypoints_are_named_by_their_position_and_via_points_as_such() -> None:
    places = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0], [4.0, 0.0]])
    assert waypoint_names(places, np.empty((0, 2))) == ("Start", "WP02", "WP03", "Goal")
    # Positions of waypoints are rounded to a millimetre.
    assert waypoint_names(places, np.array([[3.001, 2.0]])) == ("Start", "WP02", "WP03 via", "Goal")


def test_limits_are_a_mile_at_most_and_due_north_is_000() -> None:
    (points,) = case_waypoints(runs.open_sea().case(runs.SEASON))
    assert "cross-track limits 1852 m to port, 1852 m to starboard" in leg_text(points, 0)
    north = replace(points, course_deg=np.full_like(points.course_deg, 359.97))
    assert leg_text(north, 0).startswith("course 000.0°, ")


def test_a_leg_is_described_in_a_navigators_units() -> None:
    points = case_waypoints(runs.across_180().case(runs.SEASON))[0]
    text = leg_text(points, 0)
    course, miles, knots, time = text.partition(";")[0].split(", ")
    assert course == f"course {points.course_deg[0]:05.1f}°"
    assert float(miles.removesuffix(" NM")) * 1852 == pytest.approx(points.length_m[0], abs=10)
    assert float(knots.removesuffix(" kn")) * 1852 / 3600 == pytest.approx(
        points.speed_m_s[0], abs=0.003
    )
    assert time == duration(points.time_s[1])
    assert f"cross-track limits {int(points.port_m[0])} m to port" in text
