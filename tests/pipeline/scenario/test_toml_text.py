"""A scenario that is spelled as TOML is the same when it is read again."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given, strategies as st

from pipeline.scenario import catalogue
from pipeline.scenario.loading import inline, load_scenario, parse_scenario, scenario_text

values = st.recursive(
    st.booleans()
    | st.integers(-(2**60), 2**60)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=8,
)


@given(values)
def test_values_come_back(value: object) -> None:
    assert tomllib.loads(f"key = {inline(value)}") == {"key": value}


@pytest.mark.parametrize(
    "name", [n for n in catalogue.names("scenarios") if not n.startswith("boston-")]
)
def test_scenarios_of_the_catalogue_come_back(name: str) -> None:
    scenario = load_scenario(name)
    text = scenario_text(scenario)
    assert parse_scenario(tomllib.loads(text)) == scenario
    assert f'vessel = "{scenario.vessel.name}"' in text


def test_defaults_are_left_out_and_a_changed_vessel_is_a_table() -> None:
    table = load_scenario("palawan-usv").model_dump(mode="json")
    table["vessel"]["speed_m_s"] = 4.0
    table["seasons"][0]["departure"] = "2026-07-01T08:00:00+02:00"
    scenario = parse_scenario(table)
    text = scenario_text(scenario)
    assert "samples" not in text
    assert "[vessel]" in text
    assert parse_scenario(tomllib.loads(text)) == scenario
