"""The vessel: by name, by file, by figures."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.voyage.vessel_options import VesselFigures, vessel_spec

NONE = VesselFigures()


def faults(named: str, figures: VesselFigures = NONE) -> tuple[str, ...]:
    with pytest.raises(RequestError) as caught:
        vessel_spec(named, figures)
    return caught.value.faults


def test_a_name_is_the_entry_of_the_catalogue() -> None:
    assert vessel_spec("usv-7m", NONE) == catalogue.vessel("usv-7m")


def test_a_file_has_the_keys_of_an_entry(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text((catalogue.root() / "vessels" / "usv-7m.toml").read_text(encoding="utf-8"))
    assert vessel_spec(str(file), NONE) == catalogue.vessel("usv-7m")
    file.write_text("length_m = -7\nspeed = 5\n")
    found = faults(str(file))
    assert any("length_m" in line for line in found)
    assert any("speed" in line for line in found)
    assert all(str(file) in line for line in found)


@given(st.floats(1, 60), st.floats(10, 5000))
def test_the_vessel_turns_on_the_circle_that_is_given(speed_kn: float, circle_m: float) -> None:
    figures = VesselFigures(f"{speed_kn:.3f}kn", "90m", f"{circle_m:.3f}m", "4m")
    vessel = vessel_spec("", figures)
    assert 2 * planner_vessel(vessel).turning_radius == pytest.approx(round(circle_m, 3))
    # A full circle takes its circumference at that speed.
    circumference = vessel.speed_m_s * 360 / vessel.turn_rate_deg_s
    assert circumference == pytest.approx(math.pi * round(circle_m, 3))
    assert (vessel.length_m, vessel.draught_m) == (90, 4)


def test_all_faults_are_reported_at_once() -> None:
    found = faults("", VesselFigures("12", "-3m", "", "deep"))
    assert [line.split()[0] for line in found[1:]] == ["--speed", "--length", "--draught"]
    assert "lacks --turning-circle" in found[0]
    assert faults("")[0].startswith("no vessel; give --vessel")
    assert "both describe" in faults("usv-7m", VesselFigures("12kn"))[0]


def test_an_unknown_name_suggests_the_near_one_and_a_missing_file_says_so() -> None:
    assert "did you mean 'usv-7m'?" in faults("usv7m")[0]
    assert "does not exist" in faults("./nowhere.toml")[0]
