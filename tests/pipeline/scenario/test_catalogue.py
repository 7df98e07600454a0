"""The catalogue's entries."""

from pathlib import Path

import pytest

from pipeline.errors import RequestError
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.region import ChartSpec
from pipeline.sources.registry import current_source, land_source

SHARED = Path(__file__).parents[3].parent / "shared"


@pytest.mark.parametrize("name", catalogue.names("scenarios"))
def test_every_scenario_is_valid_and_named_as_its_file(name: str) -> None:
    assert load_scenario(name).name == name


@pytest.mark.parametrize("name", catalogue.names("vessels"))
def test_every_vessel_turns_within_five_lengths(name: str) -> None:
    spec = catalogue.vessel(name)
    assert spec.name == name
    # IMO MSC.137(76) allows a tactical diameter of 5 lengths.
    assert 2 * planner_vessel(spec).turning_radius < 5 * spec.length_m


@pytest.mark.parametrize("name", catalogue.names("sources"))
def test_every_source_has_its_adapter(name: str) -> None:
    spec = catalogue.source(name)
    assert spec.name == name
    if spec.adapter == "osm-land":
        assert land_source(ChartSpec.model_validate({"source": name}), None).identity
    elif isinstance(spec, catalogue.ChartEntry):
        with pytest.raises(RequestError, match=f"{name}.*--charts"):
            land_source(ChartSpec.model_validate({"source": name}), None)
    else:
        season = load_scenario("palawan-season").seasons[0]
        assert current_source(name).identity(season)


def test_the_embedded_table_and_credit_lines_are_the_given_ones() -> None:
    given = SHARED / "facts" / "palawan_currents.csv"
    if not given.is_file():
        pytest.skip("needs ../shared/facts/palawan_currents.csv, which is absent here")
    assert (catalogue.root() / "currents/palawan.csv").read_bytes() == given.read_bytes()
    spec = catalogue.source("embedded-palawan")
    assert spec.adapter == "embedded-table"
    header = " ".join(
        line.strip("# ") for line in given.read_text().splitlines() if line.startswith("#")
    )
    for words in ("OCM surface analysis M-B0071-000", "Central Weather Administration (Taiwan)"):
        assert words in header
        assert words in spec.seasons["summer"].credit
    copernicus = "Generated using E.U. Copernicus Marine Service Information"
    assert copernicus in header
    assert copernicus in spec.seasons["winter"].credit


def test_palawan_is_as_asked_for() -> None:
    season = load_scenario("palawan-season")
    assert (season.start, season.goal) == ((120.30, 12.80), (116.80, 7.70))
    assert (season.scale, season.planner.classes) == (1000, 16)
    assert (season.vessel.speed_m_s, season.vessel.turn_rate_deg_s) == (1.0, 35.0)
    usv = load_scenario("palawan-usv")
    assert (usv.region, usv.start, usv.goal) == (season.region, season.start, season.goal)
    assert (usv.scale, usv.vessel.length_m) == (1, 7.0)
