"""Quantities with units, and months."""

from __future__ import annotations

import math
from datetime import date
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.season import period
from pipeline.voyage.quantities import length_m, read_months, speed_m_s, speed_range_m_s
from tests.pipeline.voyage.waters import scenario_of

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


@pytest.mark.parametrize("text", ["12", "12 mph", "kn", "", "12kn!", "1e3kn", "nan m/s", "- 3kn"])
def test_a_speed_without_a_known_unit_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 12kn"):
        speed_m_s(text)


@pytest.mark.parametrize("text", ["4kn..9kn", "4..9kn", "4 .. 9 kn", "7.408km/h..9kn"])
def test_a_range_of_speeds_may_give_its_unit_once(text: str) -> None:
    assert speed_range_m_s(text) == pytest.approx((4 * 1852 / 3600, 9 * 1852 / 3600))


@pytest.mark.parametrize("text", ["", "long", "12kn", "12 m m"])
def test_what_is_no_length_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 90m"):
        length_m(text)


months = st.dates(max_value=date(9998, 12, 31)).map(lambda day: f"{day:%Y-%m}".zfill(7))


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


# --- The vessel: by name, by file, by figures ---


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


@given(st.floats(1, 60), st.floats(10, 5000))
def test_the_vessel_turns_on_the_circle_that_is_given(speed_kn: float, circle_m: float) -> None:
    speed, circle = f"{speed_kn:.3f}kn", f"{circle_m:.3f}m"
    vessel = vessel_of(speed=speed, length="90m", turning_circle=circle, draught="4m")
    assert 2 * planner_vessel(vessel).turning_radius == pytest.approx(round(circle_m, 3))
    # A full circle takes its circumference at that speed.
    circumference = vessel.speed_m_s * 360 / vessel.turn_rate_deg_s
    assert circumference == pytest.approx(math.pi * round(circle_m, 3))
    assert (vessel.length_m, vessel.draught_m) == (90, 4)


def test_all_faults_are_reported_at_once() -> None:
    found = faults(speed="12", length="-3m", draught="deep")
    assert [line.split()[0] for line in found[:-1]] == ["--speed", "--length", "--draught"]
    assert "lacks --turning-circle" in found[-1]
    assert faults()[0].startswith("no vessel; give --vessel")
    assert "both describe" in faults(vessel="usv-7m", speed="12kn")[0]


def test_an_unknown_name_suggests_the_near_one_and_a_missing_file_says_so() -> None:
    assert "did you mean 'usv-7m'?" in faults(vessel="usv7m")[0]
    assert "does not exist" in faults(vessel="./nowhere.toml")[0]
