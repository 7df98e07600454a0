"""Positions as people write them."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.voyage.positions import Position, halves, joined, read_position

longitudes = st.floats(-180, 180).map(lambda degrees: round(degrees, 6))
latitudes = st.floats(-90, 90).map(lambda degrees: round(degrees, 6))
# An arc second, in degrees.
SECOND = 1 / 3600


@pytest.mark.parametrize(
    "text",
    [
        "120.30,12.80",
        "120.3 12.8",
        " 120.3 , 12.8 ",
        "120,30 12,80",
        "120,30; 12,80",
        "12.80N 120.30E",
        "12.80N,120.30E",
        "N12.80 E120.30",
        "E 120.30, N 12.80",
        "12°48'N 120°18'E",
        "12º48′N, 120º18′E",
        "12 48 N 120 18 E",
        "12°48’00”N 120°18’00”E",
        "12 48.0n 120 18.0e",
        "N12 48 E120 18",
        "120°18', 12°48'",
        "120 18 12 48",
        "12.8,120.3",
        "+120.3,+12.8",
        "12-48N 120-18E",
        "N12-48.0 E120-18.0",
    ],
)
def test_every_way_of_writing_gives_the_same_place(text: str) -> None:
    position = read_position(text)
    assert (position.lon, position.lat) == pytest.approx((120.3, 12.8))


def test_a_swapped_order_is_noted_only_where_it_is_the_only_possible_one() -> None:
    assert "latitude, longitude" in read_position("12.8,120.3").note
    assert read_position("12.8N 120.3E").note == ""
    plain = read_position("37.9,23.6")
    assert (plain.lon, plain.lat) == (37.9, 23.6)
    assert "read as longitude 37.9, latitude 23.6" in plain.note
    assert plain.either_order
    assert read_position("120.3,12.8").note == read_position("23.6E 37.9N").note == ""


@given(longitudes, latitudes)
def test_decimal_degrees_come_back(lon: float, lat: float) -> None:
    for text in (f"{lon:.6f},{lat:.6f}", f"{lon:.6f} {lat:.6f}", f"{lon:.6f}; {lat:.6f}"):
        position = read_position(text)
        assert (position.lon, position.lat) == pytest.approx((lon, lat), abs=1e-9)


@given(longitudes, latitudes)
def test_hemispheres_come_back_in_either_order(lon: float, lat: float) -> None:
    north, east = "NS"[lat < 0], "EW"[lon < 0]
    for text in (
        f"{abs(lat):.6f}{north} {abs(lon):.6f}{east}",
        f"{north}{abs(lat):.6f},{east}{abs(lon):.6f}",
        f"{abs(lon):.6f} {east}, {abs(lat):.6f} {north}",
    ):
        position = read_position(text)
        assert (position.lon, position.lat) == pytest.approx((lon, lat), abs=1e-9)


def degrees_minutes_seconds(degrees: float) -> str:
    seconds = round(abs(degrees) / SECOND)
    return f"{seconds // 3600}°{seconds // 60 % 60:02d}'{seconds % 60:02d}\""


@given(longitudes, latitudes)
def test_degrees_minutes_and_seconds_come_back_to_half_a_second(lon: float, lat: float) -> None:
    north, east = "NS"[lat < 0], "EW"[lon < 0]
    text = f"{degrees_minutes_seconds(lat)}{north} {degrees_minutes_seconds(lon)}{east}"
    position = read_position(text)
    assert (position.lon, position.lat) == pytest.approx((lon, lat), abs=0.51 * SECOND)


def test_minus_before_zero_degrees_counts() -> None:
    position = read_position("-0°30', -0 15")
    assert (position.lon, position.lat) == (-0.5, -0.25)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("12.8", "pair of coordinates"),
        ("1,2,3", "pair of coordinates"),
        ("somewhere", "is not a position"),
        ("12.8N 7.7N", "one of E and W"),
        ("12.8N 120.3", "one of E and W"),
        ("-12.8S 120.3E", "both a sign and S"),
        ("12.5 30 N 120 18 E", "fraction"),
        ("12 75 N 120 18 E", "75 minutes"),
        ("120.3,95", "latitude 95"),
        ("400,12", "longitude 400"),
        ("100,100", "latitude 100"),
        ("12'48°N 120°18'E", "another order"),
        ("", "pair of coordinates"),
    ],
)
def test_what_can_not_be_read_says_why(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        read_position(text)


def ends(*words: str) -> tuple[Position, Position]:
    start, goal = map(read_position, halves(words))
    return joined(start, goal)


def test_words_without_quotes_make_two_positions() -> None:
    start, goal = ends("12°48N", "120°18E", "7°42N", "116°48E")
    assert (start.lon, start.lat, goal.lon, goal.lat) == pytest.approx((120.3, 12.8, 116.8, 7.7))
    with pytest.raises(RequestError, match="in quotes"):
        halves(["120.3,12.8", "7.7N", "116.8E"])


def test_the_goal_continues_across_180_degrees() -> None:
    start, goal = ends("179E 17S", "179W 18S")
    assert (start.lon, goal.lon) == (179, 181)
    # Samoa to Tonga: a region may need room beyond 180 degrees.
    start, goal = ends("171.75W 13.83S", "175.2W 21.13S")
    assert (start.lon, goal.lon) == pytest.approx((188.25, 184.8))
    start, goal = ends("-179,-18", "179,-17")
    assert (start.lon, goal.lon) == (181, 179)


@given(st.text(max_size=30))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        position = read_position(text)
    except ValueError:
        return
    assert -180 <= position.lon <= 360
    assert -90 <= position.lat <= 90
