"""Faults between the tables of a scenario, and what --charts and --currents replace."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.scenario import catalogue
from pipeline.scenario.loading import (
    asked_currents,
    inline,
    load_scenario,
    parse_scenario,
    scenario_text,
)
from pipeline.scenario.season import StreamConstants
from pipeline.stages.region import require_covered
from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import small_region

SEASON = {"name": "summer", "valid": "2024-07", "currents": ["embedded-palawan"]}


def table(**changes: Any) -> dict[str, Any]:
    """Return a valid scenario's table with some keys changed, or left out where None."""
    given = {**tomllib.loads(small_region("mine")), "seasons": [SEASON], **changes}
    return {key: value for key, value in given.items() if value is not None}


def faults(**changes: Any) -> tuple[str, ...]:
    with pytest.raises(RequestError) as caught:
        parse_scenario(table(**changes))
    return caught.value.faults


def test_the_region_may_be_left_out() -> None:
    scenario = parse_scenario(table(region=None))
    assert scenario.region is None
    assert not scenario.is_planar
    assert "has a [plane] together with [region]" in "".join(faults(plane={"extent": [0, 0, 9, 9]}))


@pytest.mark.parametrize("year", ["0001", "9999"])
def test_times_in_years_that_no_clock_knows_are_refused(year: str) -> None:
    season = {"name": "a", "currents": ["still"], "departure": f"{year}-06-01T00:00:00Z"}
    (fault,) = faults(seasons=[season])
    assert f"departure = {year}-06-01T00:00:00+00:00 is not in the years 1700 to 2199" in fault
    (fault,) = faults(seasons=[{"name": "a", "currents": ["still"], "valid": f"{year}-06"}])
    assert "or a year before 1700 or after 2199" in fault


@pytest.mark.parametrize("given", [20240315, -1.5, "20240315"])
def test_a_number_is_no_time_since_1970(given: object) -> None:
    (fault,) = faults(seasons=[{"name": "a", "currents": ["still"], "departure": given}])
    assert f"departure = {given} is a number; give a time with its zone" in fault


def test_depths_need_a_file_and_a_draught() -> None:
    given = {"length_m": 2.0, "speed_m_s": 1.0, "turn_rate_deg_s": 35.0}
    missing, draught = faults(chart={"depths": "nowhere.nc"}, vessel=given)
    assert missing.startswith("chart.depths = '")
    assert missing.endswith("nowhere.nc' does not exist; give a GEBCO or EMODnet grid in NetCDF")
    assert draught.startswith("vessel.draught_m is missing, and chart.depths needs it")
    (only,) = faults(chart={"depths": "nowhere.nc"}, vessel={**given, "draught_m": 0.5})
    assert "nowhere.nc" in only
    unknown = faults(chart={"depths": "nowhere.nc"}, vessel="no-such-vessel")
    assert not any("draught" in fault for fault in unknown)


@pytest.mark.parametrize("version", [None, 9])
def test_a_missing_or_wrong_version_hides_no_fault_of_another_key(version: int | None) -> None:
    lines = faults(schema_version=version, vessel="no-such-vessel", goal=[118.4])
    for part in ("schema_version", "no-such-vessel", "goal"):
        assert sum(part in line for line in lines) == 1, (part, lines)


def test_all_faults_between_tables_are_reported_at_once() -> None:
    lines = faults(seasons=[SEASON, SEASON], plane={"extent": [0, 0, 9, 9]})
    for part in ("2 seasons called", "together with [region]"):
        assert sum(part in line for line in lines) == 1, (part, lines)
    lines = faults(start=[110.0, 11.0], goal=[110.0, 11.0], chart={"source": "./nowhere.gpkg"})
    for part in ("start = [110.0, 11.0] lies", "same place", "nowhere.gpkg"):
        assert sum(part in line for line in lines) == 1, (part, lines)


def test_loading_asks_no_source(tmp_path: Path) -> None:
    """A file without currents is refused when a run begins, not when a scenario is loaded."""
    file = tmp_path / "currents.nc"
    file.write_bytes(b"no field")
    season = {"name": "july", "valid": "2024-07", "currents": [str(file)]}
    scenario = parse_scenario(table(seasons=[season]))
    with pytest.raises(RequestError, match=r"season 'july': currents.nc: "):
        require_covered(scenario)


def test_a_path_keeps_its_blanks_and_accents(tmp_path: Path) -> None:
    """As macOS writes them: an accent is a character of its own."""
    file = tmp_path / "two  blanks, cafe\N{COMBINING ACUTE ACCENT}.geojson"
    file.write_text("{}")
    chart = {"source": {"path": str(file)}}
    found = parse_scenario(table(title="two  blanks", chart=chart, avoid=[{"path": str(file)}]))
    assert [source.path for source in found.chart.source] == [str(file)]
    assert [area.path for area in found.avoid] == [str(file)]
    assert found.title == "two blanks"


def test_start_and_goal_may_not_be_the_same_place() -> None:
    assert "are the same place, [118.4, 10.2]" in faults(goal=[118.4, 10.2])[0]
    plane = tomllib.loads(small_plane("plane"))
    with pytest.raises(RequestError, match="same place"):
        parse_scenario({**plane, "goal": plane["start"]})


def test_swapped_coordinates_are_recognised() -> None:
    (line,) = faults(start=[10.2, 118.4])
    assert "is not a place on earth" in line
    assert "did you mean [118.4, 10.2]?" in line
    # Where both orders are places on earth, the region decides.
    aegean = {"bbox": [23.0, 35.0, 29.0, 38.5]}
    line = faults(region=aegean, start=[37.9, 23.5], goal=[28.3, 36.5])[0]
    assert "km outside the region" in line
    assert "did you mean [23.5, 37.9]?" in line
    assert "move it inside" in faults(start=[110.0, 11.0])[0]


def test_places_on_earth_are_asked_for_without_a_region_too() -> None:
    assert "not a place on earth" in faults(region=None, start=[10.2, 118.4])[0]


def test_without_a_region_the_currents_must_cover_start_and_goal() -> None:
    scenario = parse_scenario(table(region=None, start=[23.5, 37.9], goal=[28.3, 36.5]))
    with pytest.raises(RequestError) as caught:
        require_covered(scenario)
    (line,) = caught.value.faults
    assert "season 'summer': embedded-palawan has no data west of 114.75" in line


def test_sources_and_files_may_be_asked_for_together() -> None:
    asked = asked_currents(["/a.nc", "still", "/b.nc"])
    assert asked == [["/a.nc", "/b.nc"], "still"]
    assert asked_currents(["still"]) == ["still"]


def test_seasons_that_an_asked_table_lacks_are_left_out_with_a_note() -> None:
    notes: list[str] = []
    asked = ["embedded-hansando"]
    scenario = load_scenario("hansando", currents=asked, on_note=notes.append)
    assert [season.name for season in scenario.seasons] == ["winter"]
    assert notes == ["season 'summer' is left out: embedded-hansando has no such season"]
    # Still water has every season, and where none is left the request is refused.
    assert len(load_scenario("hansando", currents=[*asked, "still"]).seasons) == 2
    with pytest.raises(RequestError, match="has no data"):
        require_covered(load_scenario("hansando", currents=["embedded-palawan"]))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"constant": "a.nc"}, "unknown key seasons[0].currents[0].constant: did you mean 'const"),
        ({}, "seasons[0].currents[0].constants is missing; give the path of a NetCDF file as"),
        ({"constants": 3}, "seasons[0].currents[0].constants = 3 is not text; give the path of"),
        (
            {"constants": "a.nc", "residual": "daily"},
            'currents[0].residual = "daily" is not one of the possible values; give files, ',
        ),
        (3, "seasons[0].currents[0] = 3 is not text; give sources' names"),
    ],
)
def test_faults_of_tidal_streams_are_told_by_their_key(given: object, message: str) -> None:
    season = {"name": "tide", "time_method": "changing", "departure": "2026-09-10T06:00:00Z"}
    assert any(message in fault for fault in faults(seasons=[{**season, "currents": [given]}]))


def test_paths_of_tidal_streams_begin_at_the_scenario(tmp_path: Path) -> None:
    streams = {"constants": "pass.nc", "residual": "./daily.nc"}
    season = {
        "name": "tide",
        "time_method": "changing",
        "departure": "2026-09-10T06:00:00Z",
        "currents": [streams],
    }
    (found,) = parse_scenario(table(seasons=[season], scale=1), tmp_path).seasons[0].currents
    assert found == StreamConstants(
        constants=str(tmp_path / "pass.nc"), residual=(str(tmp_path / "daily.nc"),)
    )


# --- A scenario that is spelled as TOML is the same when it is read again ---


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
