"""All faults of a command line are named at once; help breaks lines between words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.command_reference import commands


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
    output, currents, chart = refusal("run", "palawan-season", *options)
    assert "is not a folder" in output
    assert "--currents = 'palawan' does not exist; it is no source of the catalogue" in currents
    assert "no.gpkg' does not exist" in chart
    *_, season = refusal("plot", "palawan-season", "--season", "spring", "--output", str(file))
    assert "no season 'spring'" in season


@pytest.mark.parametrize(
    ("typed", "named"),
    [
        (
            ("run", "palawan-season", "other", "--limit", "0"),
            [
                "Error: Invalid value for '--limit'",
                "Error: Got unexpected extra argument(s) (other)",
            ],
        ),
        (
            ("go", "--vesel", "--foo=3"),
            [
                "Error: No such option: --vesel (Possible options",
                "Error: No such option: --foo",
                "Error: Missing argument 'START GOAL'",
                "Error: no vessel;",
                "Error: no --month;",
            ],
        ),
        (
            ("plot", "single-gyre", "--format", "x", "--width", "y", "--figure"),
            ["Error: Option '--figure' requires an argument"]
            + [f"Error: Invalid value for '--{name}'" for name in ("format", "width")],
        ),
        (("check",), ["Error: Missing argument 'file'"]),
    ],
)  # fmt: skip
def test_faults_of_usage_are_named_at_once(typed: tuple[str, ...], named: list[str]) -> None:
    faults = refusal(*typed)
    assert len(faults) == len(named)
    for fault, words in zip(faults, named, strict=True):
        assert fault.startswith(words)


@pytest.mark.parametrize(
    ("typed", "named"),
    [
        (("x", "--at", "y"), ["--time"]),
        (
            ("x", "--at", "y", "--time", "2026-01-01T12:00", "--heading", "west"),
            ["--heading", "--time"],
        ),
    ],
)
def test_faults_of_a_voyage_under_way_are_named_though_others_are_missing(
    typed: tuple[str, ...], named: list[str]
) -> None:
    faults = refusal("replan", *typed)
    assert len(faults) == len(named)
    for fault, part in zip(faults, named, strict=True):
        assert part in fault


def test_faults_of_usage_and_of_the_request_are_named_at_once() -> None:
    usage, *request = refusal("go", "12N 120E", "13N 121E", "--sped", "fast", "--month", "2024-13")
    assert usage == "Error: No such option: --sped (Possible options: --speed)"
    assert [line.split()[1] for line in request] == ["the", "--speed", "--month"]
    # The word behind an option that resembles none may be its value: no fault of the positions.
    words = ("12N 120E", "--colour", "red", "13N 121E", "--vessel", "usv-7")
    assert [line.split()[1] for line in refusal("go", *words)] == ["No", "--vessel", "no"]
    _, scenario = refusal("run", "palawan-sesaon", "--limit", "0")
    assert "palawan-season" in scenario


@pytest.mark.parametrize("name", sorted(commands()))
def test_help_breaks_no_line_at_a_hyphen(name: str) -> None:
    shown = CliRunner().invoke(app, [*name.split()[1:], "--help"]).stdout
    assert "Usage: " in shown
    assert not re.findall(r"\w-\n", shown)
    assert shown.isascii() or name == "renew go"  # whose positions have the sign of degrees
    assert "\N{NON-BREAKING HYPHEN}" not in shown
