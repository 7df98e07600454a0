"""Distances from legs, and the times when a vessel is due, against geodesics and finer legs."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pyproj
import pytest
from hypothesis import given, strategies as st

from pipeline.underway.track import Track

GEOD = pyproj.Geod(ellps="WGS84")


def features(points: list[tuple[float, float]], curve: str = "Loxodrome") -> list[dict[str, Any]]:
    """Waypoints at 5 m/s with limits of 300 m to port and 700 m to starboard."""
    lengths = [GEOD.inv(*a, *b)[2] for a, b in itertools.pairwise(points)]
    times = np.concatenate([[0.0], np.cumsum(lengths) / 5]).tolist()
    leg = {"port_m": 300.0, "starboard_m": 700.0, "speed_over_ground_m_s": 5.0}
    none = dict.fromkeys(leg)
    return [
        {
            "properties": {
                **(none if at == len(points) - 1 else leg),
                "time_s": times[at],
                "geometry_type": curve,
            },
            "geometry": {"coordinates": list(point)},
        }
        for at, point in enumerate(points)
    ]


@given(
    lon=st.floats(-180, 180),
    lat=st.floats(-69, 69),
    course=st.floats(0, 360),
    length=st.floats(2e3, 4e4),
    off=st.floats(-2000, 2000),
    share=st.floats(0.1, 0.9),
)
def test_distances_and_times_are_those_of_geodesics(
    lon: float, lat: float, course: float, length: float, off: float, share: float
) -> None:
    """A leg of 40 km at 69 degrees sags by 83 m from its geodesic, which is left out of account."""
    end = GEOD.fwd(lon, lat, course, length)[:2]
    foot = GEOD.fwd(lon, lat, course, share * length)
    at = GEOD.fwd(foot[0], foot[1], foot[2] + 180 + 90, off)[:2]
    place = Track.of(features([(lon, lat), end])).nearest(*at, None)
    sag = length**2 / 8 / 6.37e6 * np.tan(np.radians(abs(lat) + 0.4))
    assert place.off_m == pytest.approx(off, abs=1.1 * sag + 2e-3 * abs(off) + 0.1)
    assert place.due_s == pytest.approx(share * length / 5, abs=0.01 * length / 5 + 10)
    if abs(place.off_m) > 1:
        assert place.limit_m == (700 if place.off_m > 0 else 300)


@pytest.mark.parametrize("lat", [0.0, 45.0, 65.0])
def test_a_long_loxodrome_is_one_and_due_by_true_distance(lat: float) -> None:
    track = Track.of(features([(170.0, lat), (-170.0, lat)]))
    for lon in (172.0, 180.0, -180.0, -174.5):
        place = track.nearest(lon, lat, None)
        share = ((lon - 170) % 360) / 20
        assert abs(place.off_m) < 1e-3  # along a parallel
        last = track.due_s[-1] + track.lasts_s[-1]
        assert place.due_s == pytest.approx(share * last, rel=1e-9)
        north = track.nearest(lon, lat + 0.01, None)
        assert north.off_m == pytest.approx(-GEOD.inv(lon, lat, lon, lat + 0.01)[2], rel=2e-3)


def test_in_high_latitudes_legs_are_geodesics() -> None:
    begin, end = (10.0, 75.0), (40.0, 78.0)
    track = Track.of(features([begin, end], "Orthodrome"))
    points = GEOD.npts(*begin, *end, 99)
    for at, point in enumerate(points, start=1):
        place = track.nearest(point[0], point[1], None)
        assert abs(place.off_m) < 20
        assert place.due_s == pytest.approx(at / 100 * track_ends(track), rel=1e-3, abs=5)


def track_ends(track: Track) -> float:
    return float(track.due_s[-1] + track.lasts_s[-1])


def test_a_place_passed_twice_is_told_apart_by_the_clock() -> None:
    """Out along 9 N and back 200 m beside it: both limits hold a place between them."""
    there, back = [(119.0, 9.0), (119.5, 9.0)], [(119.5, 9.0018), (119.0, 9.0018)]
    track = Track.of(features([*there, *back]))
    ends = track_ends(track)
    out, home = (track.nearest(119.2, 9.0010, share * ends) for share in (0.2, 0.8))
    assert (out.leg, home.leg) == (0, 2)
    assert abs(out.off_m) == pytest.approx(110.6, abs=1)
    assert abs(home.off_m) == pytest.approx(88.5, abs=1)
    assert track.nearest(119.2, 9.0010, None).leg == 2  # the nearer one


def test_beyond_the_ends_the_ends_are_nearest() -> None:
    track = Track.of(features([(119.0, 9.0), (119.1, 9.0)]))
    before, beyond = track.nearest(118.9, 9.0, None), track.nearest(119.2, 9.0, None)
    assert before.due_s == 0.0
    assert beyond.due_s == pytest.approx(track_ends(track))
    assert abs(beyond.off_m) == pytest.approx(beyond.ahead_m) == pytest.approx(10993, rel=1e-3)
