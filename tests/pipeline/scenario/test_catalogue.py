"""The catalogue's entries, and the commands that show them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import RequestError
from pipeline.loading import load_scenario
from pipeline.scenario import catalogue
from pipeline.scenario.region import ChartSpec
from pipeline.sources.registry import current_source, land_source

SHARED = Path(__file__).parents[3].parent / "shared"


@pytest.mark.parametrize("name", catalogue.names("scenarios"))
def test_every_scenario_is_sound_and_called_as_its_file(name: str) -> None:
    assert load_scenario(name).name == name


@pytest.mark.parametrize("name", catalogue.names("vessels"))
def test_every_vessel_turns_within_five_lengths(name: str) -> None:
    spec = catalogue.vessel(name)
    assert spec.name == name
    # IMO MSC.137(76) allows a tactical diameter of 5 lengths.
    assert 2 * spec.vessel().turning_radius < 5 * spec.length_m


@pytest.mark.parametrize("name", catalogue.names("sources"))
def test_every_source_has_its_adapter(name: str) -> None:
    spec = catalogue.source(name)
    assert spec.name == name
    if isinstance(spec, catalogue.OsmLandSpec):
        assert land_source(ChartSpec.model_validate({"source": name}), None).identity
    elif isinstance(spec, catalogue.ChartEntry):
        with pytest.raises(RequestError, match=f"{name}.*--charts"):
            land_source(ChartSpec.model_validate({"source": name}), None)
    else:
        season = load_scenario("palawan-season").seasons[0]
        assert current_source(name).identity(season)


def test_the_embedded_figures_and_credit_lines_are_the_given_ones() -> None:
    given = SHARED / "facts" / "palawan_currents.csv"
    if not given.is_file():
        pytest.skip("needs ../shared/facts/palawan_currents.csv, which is absent here")
    assert catalogue.table("palawan.csv").read_bytes() == given.read_bytes()
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


def test_list_and_show_print_what_can_be_run_and_read_again(tmp_path: Path) -> None:
    listed = CliRunner().invoke(app, ["list"])
    assert listed.exit_code == 0
    for section in catalogue.SECTIONS:
        assert all(name in listed.stdout for name in catalogue.names(section))
    shown = CliRunner().invoke(app, ["show", "palawan-usv"])
    copy = tmp_path / "copy.toml"
    copy.write_text(shown.stdout, encoding="utf-8")
    assert load_scenario(str(copy)) == load_scenario("palawan-usv")
    missed = CliRunner().invoke(app, ["show", "usv-7"])
    assert missed.exit_code == 2
    assert "did you mean 'usv-7m'?" in missed.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["list"], ["show", "palawan-season"]])
def test_small_commands_load_no_heavy_library(arguments: list[str]) -> None:
    script = (
        "import sys\n"
        "from typer.testing import CliRunner\n"
        "from pipeline.cli.main import app\n"
        f"assert CliRunner().invoke(app, {arguments!r}).exit_code == 0\n"
        "heavy = {'copernicusmarine', 'xarray', 'geopandas', 'dask', 'distributed', 'numba',\n"
        "         'matplotlib', 'scipy', 'shapely', 'renew'}\n"
        "print(sorted(heavy & sys.modules.keys()))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert ended.stdout == "[]\n"


def test_version() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout.startswith("renew ")
