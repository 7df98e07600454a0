"""Positions, quantities, months and vessels as people write them."""

import math
import re
from datetime import date, timedelta
from pathlib import Path

import pytest
from hypothesis import example, given, strategies as st

from pipeline.errors import RequestError
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.season import period
from pipeline.voyage.positions import Position, halves, joined, read_position
from pipeline.voyage.readers import (
    described_file,
    length_m,
    read_charts,
    read_months,
    read_variables,
    speed_m_s,
    speed_or_range,
    zoned_time,
)
from tests.pipeline.voyage.waters import scenario_of

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


@given(st.floats(-180, 360), st.floats(-180, 360))
@example(5.0, -169.0)
@example(350.0, 5.0)
def test_two_places_are_joined_the_shorter_way_within_the_longitudes_of_a_scenario(
    one: float, other: float
) -> None:
    start, goal = joined(Position(one, 0.0), Position(other, 0.0))
    assert -180 <= min(start.lon, goal.lon) <= max(start.lon, goal.lon) <= 360
    assert abs(goal.lon - start.lon) <= 180 + 1e-9
    for place, given_lon in ((start, one), (goal, other)):
        assert math.remainder(place.lon - given_lon, 360) == pytest.approx(0, abs=1e-9)


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


sizes = st.floats(0, 1e6).map(lambda value: round(value, 4))


@given(sizes, st.sampled_from(["", " "]))
def test_figures_come_back_in_each_unit(size: float, space: str) -> None:
    # The definitions: a nautical mile is 1852 m, a foot is 0.3048 m.
    assert speed_m_s(f"{size:.4f}{space}kn") * 3600 / 1852 == pytest.approx(size)
    assert speed_m_s(f"{size:.4f}{space}km/h") * 3.6 == pytest.approx(size)
    assert speed_m_s(f"{size:.4f}{space}m/s") == pytest.approx(size)
    assert length_m(f"{size:.4f}{space}ft") / 0.3048 == pytest.approx(size)
    assert length_m(f"{size:.4f}{space}m") == length_m(f"{size:.4f}") == pytest.approx(size)
    assert length_m(f"{size:.4f}{space}nm") / 1852 == pytest.approx(size)


def test_a_decimal_comma_and_capitals_are_read() -> None:
    assert speed_m_s("7,2 KM/H") == pytest.approx(2.0)
    assert length_m("1,5M") == 1.5
    assert length_m("0,125nm") == 231.5


@pytest.mark.parametrize("text", ["2026-11-22", "2026-11-22T06", "2026-11-22T06:00:00"])
def test_a_time_with_the_zone_that_its_refusal_asks_for_is_read(text: str) -> None:
    with pytest.raises(ValueError, match="add it: ") as refused:
        zoned_time(text)
    utc, east = map(zoned_time, re.findall(r"2026-\S+(?:Z|\+08:00)", str(refused.value)))
    assert utc - east == timedelta(hours=8)
    with pytest.raises(ValueError, match="is not a time"):
        zoned_time("2026-13-01T00:00+14:00")


@pytest.mark.parametrize(
    "text", ["0001-01-01T00:00+14:00", "0001-01-01T00:00Z", "9999-12-31T23:00Z"]
)
def test_years_beyond_the_clocks_of_libraries_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="of the years 1700 to 2199"):
        zoned_time(text)


@pytest.mark.parametrize("text", ["12", "12 mps", "kn", "", "12kn!", "1e3kn", "nan m/s", "- 3kn"])
def test_a_speed_without_a_known_unit_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 12kn"):
        speed_m_s(text)


@pytest.mark.parametrize("text", ["4kn..9kn", "4..9kn", "4 .. 9 kn", "7.408km/h..9kn"])
def test_a_range_of_speeds_may_give_its_unit_once(text: str) -> None:
    assert speed_or_range(text) == pytest.approx((4 * 1852 / 3600, 9 * 1852 / 3600))


@pytest.mark.parametrize("text", ["", "long", "12kn", "12 m m", "1,200m", "+12,000 ft"])
def test_what_is_no_length_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 90m"):
        length_m(text)


months = st.dates(date(1700, 1, 1), date(2199, 12, 31)).map(lambda day: f"{day:%Y-%m}")


@given(st.lists(months, unique=True, max_size=4))
def test_months_keep_their_order_and_are_periods(texts: list[str]) -> None:
    assert list(read_months(texts)) == texts
    for text in texts:
        begin = period(text).begin
        assert (begin.day, begin.hour) == (1, 0)


def test_every_fault_is_reported() -> None:
    with pytest.raises(ValueError, match="2024-13") as caught:
        read_months(["2024-13", "July", "2024-07", "2024-07", "2024-07-01"])
    assert len(caught.value.args) == 4


VOYAGE = {"start": "40.06W 35N", "goal": "39.94W 35N", "currents": ("still",)}


def vessel_of(**given: str) -> VesselSpec:
    return scenario_of({**VOYAGE, **given})[0].vessel


def faults(**given: str) -> tuple[str, ...]:
    with pytest.raises(RequestError) as caught:
        vessel_of(**given)
    return caught.value.faults


def test_a_name_is_the_entry_of_the_catalogue() -> None:
    assert vessel_of(vessel="usv-7m") == catalogue.vessel("usv-7m")


def test_a_file_has_the_keys_of_an_entry(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text((catalogue.root() / "vessels" / "usv-7m.toml").read_text(encoding="utf-8"))
    assert vessel_of(vessel=str(file)) == catalogue.vessel("usv-7m")
    file.write_text("length_m = -7\nspeed = 5\n")
    found = faults(vessel=str(file))
    assert any("length_m" in line for line in found)
    assert any("speed" in line for line in found)
    assert all(str(file) in line for line in found)


@given(st.floats(1, 60), st.floats(200, 5000))
def test_the_vessel_turns_on_the_circle_that_is_given(speed_kn: float, circle_m: float) -> None:
    speed, circle = f"{speed_kn:.3f}kn", f"{circle_m:.3f}m"
    vessel = vessel_of(speed=speed, length="90m", turning_circle=circle, draught="4m")
    assert 2 * planner_vessel(vessel).turning_radius == pytest.approx(round(circle_m, 3))
    # A full circle takes its circumference at that speed.
    circumference = vessel.speed_m_s * 360 / vessel.turn_rate_deg_s
    assert circumference == pytest.approx(math.pi * round(circle_m, 3))
    assert (vessel.length_m, vessel.draught_m) == (90, 4)


def test_a_vessel_beyond_physics_is_refused() -> None:
    (fault,) = faults(speed="500kn", length="9m", turning_circle="1m")
    assert fault.startswith("speed_m_s = 257.2")
    assert fault.endswith("is above 42; give the speed through water in m/s (--speed)")
    for circle, what in (("5m", "5 m with 4.3 g"), ("400km", "4e+05 m with 5.4e-05 g")):
        (fault,) = faults(speed="20kn", length="9m", turning_circle=circle)
        assert f"which no vessel does: that is a circle of {what}" in fault
        assert "turn_rate_deg_s (--turning-circle)" in fault


def test_all_faults_are_reported_at_once() -> None:
    found = faults(speed="12", length="-3m", draught="deep")
    assert [line.split()[0] for line in found[:-1]] == ["--speed", "--length", "--draught"]
    assert "lacks --turning-circle" in found[-1]
    assert faults()[0].startswith("no vessel; give --vessel")
    assert "both describe" in faults(vessel="usv-7m", speed="12kn")[0]


def test_an_unknown_name_suggests_the_near_one_and_a_missing_file_says_so() -> None:
    assert "did you mean 'usv-7m'?" in faults(vessel="usv7m")[0]
    assert "does not exist" in faults(vessel="./nowhere.toml")[0]


def test_typed_values_are_taken_as_they_are() -> None:
    """Also a longitude that Python writes with an exponent."""
    assert (read_position((1e-5, 12.8)).lon, read_position((-1e-5, 12.8)).lat) == (1e-5, 12.8)
    assert speed_or_range((1e-5, 9.0)) == (1e-5, 9.0)
    for place in ((float("nan"), 0.0), (0.0, float("nan")), (0.0, float("inf"))):
        with pytest.raises(ValueError, match="give one from"):
            read_position(place)
    for speeds, fault in (((0.0, 9.0), "0 or less"), ((9.0, 4.0), "above its end")):
        with pytest.raises(ValueError, match=fault):
            speed_or_range(speeds)


def test_facts_about_a_file_stand_behind_its_path(tmp_path: Path) -> None:
    file = tmp_path / "rocks, all.geojson"
    file.write_text("{}")
    read = described_file("give a file")
    text = f"{file},layer=a,b,crs=EPSG:4326,radius=50m,accuracy=0.1km"
    assert read(text) == {
        "path": str(file),
        "layer": "a,b",
        "crs": "EPSG:4326",
        "radius_m": 50.0,
        "accuracy_m": 100.0,
    }
    assert read(file) == {"path": str(file)}
    for wrong, said in ((f"{file},radius=far", "far"), (f"{file},radius=-1m", "above 0")):
        with pytest.raises(ValueError, match=said):
            read(wrong)
    with pytest.raises(ValueError, match="give no accuracy, but layer"):
        described_file("give a file", ("layer",))(f"{file},accuracy=4m")
    with pytest.raises(ValueError, match=r"does not exist; give a file"):
        read(f"{tmp_path / 'none'},radius=50m")


def test_charts_are_names_and_files(tmp_path: Path) -> None:
    file = tmp_path / "rocks.geojson"
    file.write_text("{}")
    path = {"path": str(file)}
    assert read_charts(["osm-land", f"{file},radius=1m"]) == (
        {"name": "osm-land"},
        {**path, "radius_m": 1.0},
    )
    assert read_charts(file) == read_charts(str(file)) == (path,)


@pytest.mark.parametrize("names", ["water_u,water_v", "water_u water_v", ["water_u", "water_v"]])
def test_two_variables(names: str | list[str]) -> None:
    assert read_variables(names) == ("water_u", "water_v")
    with pytest.raises(ValueError, match="is not two names"):
        read_variables("water_u")
