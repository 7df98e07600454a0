"""The commands `list`, `show`, `check` and `--version`."""

import json
import os
import re
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import listed
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.season import Season
from pipeline.sources.registry import current_source
from tests.commands import PYTHON, ended, ran


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
    station = CliRunner().invoke(app, ["show", "boston"]).stderr
    assert "`renew tide show boston`" in station


def test_the_list_says_what_a_scenario_needs() -> None:
    listed = json.loads(CliRunner().invoke(app, ["list", "--json"]).stdout)
    needs = {entry["name"]: entry["needs"] for entry in listed["scenarios"]}
    assert set(needs) == set(catalogue.names("scenarios"))
    assert needs["palawan-season"] == needs["single-gyre"] == "runs offline"
    for name in ("hansando", "far-east"):
        assert needs[name].startswith("offline: winter; summer needs a Copernicus Marine account")
    assert needs["boston-enc"].startswith("needs --charts with S-57 cells and a Copernicus")


@pytest.mark.parametrize("name", catalogue.names("scenarios"))
def test_what_runs_offline_has_a_current_there(name: str) -> None:
    """The list's word against the sources': those that are asked for a current of the region."""
    content = catalogue.entry("scenarios", name)
    [needs] = [entry["needs"] for entry in listed()["scenarios"] if entry["name"] == name]
    region = shapely.box(*content["region"]["bbox"]) if "region" in content else None
    for table in content["seasons"]:
        season = Season.model_validate(table)
        sources = [current_source(source) for source in season.currents]
        offline = region is None or any(
            not source.needs_network(region, season, Path())
            and not source.uncovered_reason(region, season)
            for source in sources
        )
        needs_account = f"{season.name} needs" in needs or (
            needs.startswith("needs") and "Copernicus" in needs
        )
        assert offline != needs_account, season.name


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_complete_scenarios_and_vessels(shell: str) -> None:
    def completed(words: str) -> str:
        # Each shell passes its words in its own way; fish and zsh pass the whole line.
        environment = {
            "_RENEW_COMPLETE": f"complete_{shell}",
            "COMP_WORDS": words,
            "COMP_CWORD": str(len(words.split()) - 1),
            "_TYPER_COMPLETE_ARGS": words,
            "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        }
        script = "from pipeline.cli.main import app; app(prog_name='renew')"
        return ended(*PYTHON, script, env={**os.environ, **environment}).stdout

    assert "palawan-season" in completed("renew run pal")
    assert "hansando" not in completed("renew run pal")
    assert "usv-7m" in completed("renew go --vessel us")


def test_help_has_whole_sentences_and_options_in_groups() -> None:
    commands = CliRunner().invoke(app, ["--help"]).stdout
    assert "..." not in commands.partition("Commands:")[2]
    help_text = CliRunner().invoke(app, ["go", "--help"]).stdout
    groups = [line.rstrip(":") for line in help_text.splitlines() if re.fullmatch(r"\w.*:", line)]
    assert groups[:6] == ["Arguments", "Vessel", "When", "Water", "Limits", "Output"]
    assert "--clearance" in help_text.partition("Limits:")[2].partition("Output:")[0]


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
    assert ran(*PYTHON, script) == "[]\n"


@pytest.fixture(scope="module")
def declared_version(root: Path) -> str:
    """Return the version in pyproject.toml."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return str(project["version"])


def test_version_in_a_checkout(declared_version: str) -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert (result.exit_code, result.stdout) == (0, f"renew {declared_version}\n")


def test_version_in_an_installation(root: Path, tmp_path: Path, declared_version: str) -> None:
    """An unpacked wheel is what an installation consists of."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    ran(*build, cwd=root)
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    script = (
        f"import sys; sys.path.insert(0, {str(site)!r}); import pipeline.cli.main as cli; "
        "print(cli.__file__); cli.app(['--version'])"
    )
    done = ran(*PYTHON, script, cwd=tmp_path)
    assert done.splitlines() == [
        str(site / "pipeline" / "cli" / "main.py"),
        f"renew {declared_version}",
    ]
