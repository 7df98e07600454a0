"""All faults of a request are named at once; help breaks lines between words."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.reference import commands


def refusal(*arguments: str) -> list[str]:
    """What a refused command line prints to standard error, a line for each fault."""
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert not result.stdout
    return [line for line in result.stderr.splitlines() if line.lower().startswith("error")]


def test_a_voyage_is_refused_with_all_its_faults(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    faults = refusal(
        "go", "95N,10E", "12.8N,Q", "--vessel", "usv-7", "--length", "long", "--via", "nowhere",
        "--depart", "today", "--until", "tomorrow", "--month", "2024-07", "--clearance", "-5m",
        "--charts", "./no.gpkg", "--depths", "./no.nc", "--avoid", "./no.geojson",
        "--currents", "./none.nc", "--name", "A B", "--output", str(file),
    )  # fmt: skip
    named = (
        "--output", "start = ", "goal = ", "--via", "--vessel 'usv-7'", "both describe the vessel",
        "--length", "--clearance", "--depart today", "--until tomorrow", "--depart and --month",
        "--avoid", "--charts", "--depths", "--currents", "--name",
    )  # fmt: skip
    assert len(faults) == len(named)
    for part in named:
        assert any(part in fault for fault in faults), part


def test_a_scenario_is_refused_with_all_the_faults_of_its_options(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    options = ("--charts", "./no.gpkg", "--currents", "palawan", "--output", str(file))
    output, chart, currents = refusal("run", "palawan-season", *options)
    assert "is not a folder" in output
    assert "--currents = 'palawan' does not exist; it is no source of the catalogue" in currents
    assert "no.gpkg' does not exist" in chart
    *_, season = refusal("plot", "palawan-season", "--season", "spring", "--output", str(file))
    assert "no season 'spring'" in season


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (("run", "palawan-season", "--limit", "0"), "Error: Invalid value for '--limit'"),
        (("go", "--vesel", "usv-7m"), "Error: No such option: --vesel (Possible options"),
        (("go",), "Error: Missing argument 'START GOAL'"),
        (("check", "one", "two"), "Error: Got unexpected extra argument"),
    ],
)
def test_a_command_line_that_cannot_be_read_is_refused(typed: tuple[str, ...], said: str) -> None:
    (fault,) = refusal(*typed)
    assert fault.startswith(said)


def test_faults_of_a_voyage_under_way_are_named_at_once() -> None:
    faults = refusal("replan", "x", "--at", "y", "--time", "noon", "--departed", "earlier")
    named = ("RESULTS", "--at", "--time", "--departed")
    for part, fault in zip(named, faults, strict=True):
        assert part in fault


@pytest.mark.parametrize("name", sorted(commands()))
def test_help_breaks_no_line_at_a_hyphen(name: str) -> None:
    shown = CliRunner().invoke(app, [*name.split()[1:], "--help"]).stdout
    assert "Usage: " in shown
    assert not re.findall(r"\w-\n", shown)
    assert shown.isascii() or name == "renew go"  # whose positions have the sign of degrees
    assert "\N{NON-BREAKING HYPHEN}" not in shown
