"""The vessel: by name, by file, by figures."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from tests.pipeline.voyage.waters import scenario_of

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
