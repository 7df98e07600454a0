"""What was planned on other currents than the preferred ones says so first, or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import small_region

TEXT = (
    small_region("stand-in")
    + """[chart]
tolerance_m = 500
[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["copernicus-glorys-monthly", "embedded-palawan"]
[planner]
classes = 1
"""
)


@pytest.fixture
def file(tmp_path: Path) -> str:
    """Return the path of a scenario that prefers a source which needs the network."""
    path = tmp_path / "across.toml"
    path.write_text(TEXT, encoding="utf-8")
    return str(path)


def test_the_currents_that_were_used_and_not_used_stand_below_the_table(
    file: str, across_outputs: Path
) -> None:
    arguments = ["run", file, "--offline", "--output", str(across_outputs)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    table, below = result.stdout.split("\n\n", 1)
    assert table.startswith("season ")
    assert below.startswith("Currents NOT used: summer: copernicus-glorys-monthly needs")
    assert "needs the network" in below.splitlines()[0]
    assert "- planned on Embedded " in below
    assert "- routes keep an offing of" in below
    assert "- no depths in this chart: the draught was not used" in result.stdout


def test_choices_are_reported_and_no_land_was_missed(tmp_path: Path) -> None:
    """A plane without obstacles: nothing to choose, and nothing to turn away from."""
    path = tmp_path / "open.toml"
    path.write_text(small_plane("open").replace("obstacles", "# obstacles"), encoding="utf-8")
    arguments = ["run", str(path), "--output", str(tmp_path / "outputs")]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    head, row = result.stdout.splitlines()[:2]
    assert head.split()[0] == "season"
    assert row.split()[-1] == "-"


def test_strict_plans_nothing_on_a_stand_in(file: str, across_outputs: Path) -> None:
    plans = set(across_outputs.glob(".artefacts/plan/*"))
    arguments = ["run", file, "--offline", "--strict", "--output", str(across_outputs)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 1
    assert result.stdout == ""
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert "season 'summer' would be planned on" in lines[0]
    assert "needs the network" in lines[0]
    assert set(across_outputs.glob(".artefacts/plan/*")) == plans


def test_quiet_and_json_take_the_tables_place(file: str, across_outputs: Path) -> None:
    arguments = ["run", file, "--offline", "--output", str(across_outputs)]
    quiet = CliRunner().invoke(app, [*arguments, "--quiet"], catch_exceptions=False)
    assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (0, "", "")
    done = CliRunner().invoke(app, [*arguments, "--quiet", "--json"], catch_exceptions=False)
    assert done.stderr == ""
    assert [route["rank"] for route in json.loads(done.stdout)["routes"]] == [1]
    wrong = CliRunner().invoke(app, ["run", "palawan-saeson", "--quiet"])
    assert wrong.exit_code == 2
    assert "palawan-season" in wrong.stderr


def test_a_single_class_is_not_plural(file: str, across_outputs: Path) -> None:
    arguments = ["run", file, "--offline", "--output", str(across_outputs)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert "In report.html: 1 route." in result.stdout
    assert "1 classes" not in result.stdout
    assert "1 routes" not in result.stdout
