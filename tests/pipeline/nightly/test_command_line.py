"""`renew nightly` as it is called: exit codes, and a line for each fault."""

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from pipeline.cli.main import app
from pipeline.machine.files import file_lock
from tests.pipeline.nightly.nights import (
    REFERENCE,
    plane_night,
    region_night,
    write_forecast,
    write_night,
)


def renew(*arguments: str | Path) -> Result:
    """Run `renew nightly`."""
    return CliRunner().invoke(app, ["nightly", *map(str, arguments)], catch_exceptions=False)


def faults(result: Result) -> list[str]:
    """Return the faults that a command reports."""
    return [
        line.removeprefix("error: ") for line in result.stderr.splitlines() if "error: " in line
    ]


@pytest.mark.parametrize(
    ("cases", "said"),
    [
        (
            'scenario = "palawan-sesaon"',
            "night.toml, line 3: cases[0].scenario: no scenario 'palawan-sesaon' (no such file or",
        ),
        (f'scenario = "{"x" * 5000}"', "night.toml, line 3: cases[0].scenario: scenario: /"),
        (
            'scenario = "single-gyre"\nvessels = ["usv-9m"]',
            "night.toml, line 4: cases[0].vessels: unknown vessel 'usv-9m': did you mean 'usv-7m'?",
        ),
        (
            'scenario = "single-gyre"\nevery = 2',
            "night.toml, line 4: unknown key cases[0].every: choose from currents, departures, ",
        ),
        (
            'scenario = "single-gyre"\ndepartures = { first = "06:00Z", every = "0h" }',
            "night.toml, line 4: cases[0].departures.every = '0h' is no time at all; give one abo",
        ),
        (
            'scenario = "single-gyre"\ndepartures = { first = "24:00Z" }',
            "night.toml, line 4: cases[0].departures.first = '24:00Z' is not a time of day in UTC",
        ),
        (
            'scenario = "single-gyre"\nseasons = ["winter"]',
            "night.toml, line 4: cases[0].seasons: 'winter' is no season of single-gyre; there ar",
        ),
        (
            'scenario = "single-gyre"\nmembers = "*.nc"',
            "night.toml, line 4: cases[0].members: needs a chart; a plane has none",
        ),
        ('scenario = "single-gyre"\npairs = "none.csv"', "night.toml, line 4: cases[0].pairs: "),
        (
            'scenario = "single-gyre"\n[[cases]]\nscenario = "single-gyre"',
            "night.toml, line 5: cases[1].scenario = 'single-gyre': asks for cases of cases[0] aga",
        ),
    ],
)
@pytest.mark.parametrize("command", ["check", "run"])
def test_a_wrong_request(tmp_path: Path, command: str, cases: str, said: str) -> None:
    file = write_night(tmp_path, cases + "\n", keep=3)
    result = renew(command, "--config", file, "--output", tmp_path / "out")
    assert result.exit_code == 2
    (line,) = faults(result)
    assert line.startswith(said)
    assert not (tmp_path / "out").exists()


_OPEN = """time_method = "changing"
departures = { first = 2026-11-22T06:00:00Z, every = "1h", count = 3 }
currents = ["./tide.nc"]
"""
_CHOSEN = """currents = ["still"]
departure = 2026-11-22T06:00:00Z
arrive_by = 2026-11-23T06:00:00Z
speed = { least = 2.0, most = 6.0 }
"""


@pytest.mark.parametrize(
    ("season", "cases", "said"),
    [
        (_OPEN, "", "scenario: season 'tide' of asked leaves its departure open"),
        (_OPEN, 'seasons = ["tide"]', "seasons: season 'tide' of asked leaves its departure open"),
        (_CHOSEN, "", "scenario: season 'tide' of asked has 'speed'"),
    ],
)
def test_a_season_that_leaves_its_departure_open_or_chooses_its_speed_is_refused(
    tmp_path: Path, season: str, cases: str, said: str
) -> None:
    (tmp_path / "asked.toml").write_text(
        'schema_version = 1\nname = "asked"\nvessel = "usv-7m"\nstart = [119.1, 9.5]\n'
        f'goal = [120.1, 9.5]\n[[seasons]]\nname = "tide"\n{season}'
    )
    file = write_night(tmp_path, f'scenario = "./asked.toml"\n{cases}\n')
    result = renew("check", "--config", file, "--output", tmp_path / "out")
    assert result.exit_code == 2
    (line,) = faults(result)
    assert f"cases[0].{said}" in line


def test_all_faults_at_once(tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text(
        "start_x,start_y,goal_x,goal_y,name\n1,x,90,50,one\n10,50,90,50,Two\n10,50,10,50,three\n"
        "10,50,90,50,four\n10,50,90,500,four\n10,50\n"
    )
    file = write_night(
        tmp_path, 'scenario = "single-gyre"\nvessels = ["none"]\npairs = "pairs.csv"\n'
    )
    result = renew("run", "--config", file, "--output", tmp_path / "out")
    assert result.exit_code == 2
    rows = [line.partition("pairs.csv, row ")[2] for line in faults(result)[1:]]
    assert [row.partition(":")[0] for row in rows] == ["2", "3", "4", "7", "6", "6"]
    assert "line 3: cases[0].vessels: unknown vessel 'none'" in faults(result)[0]
    assert not (tmp_path / "out").exists()


def test_pairs_on_land_are_named_by_their_row(tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text(
        "start_lon,start_lat,goal_lon,goal_lat,name\n120.3,12.8,116.8,7.7,sea\n"
        "118.7,9.8,116.8,7.7,land\n"
    )
    cases = 'scenario = "palawan-season"\npairs = "pairs.csv"\ncurrents = ["embedded-palawan"]\n'
    file = write_night(tmp_path, cases)
    for command in ("check", "run"):
        result = renew(command, "--config", file, "--output", tmp_path / "out")
        assert result.exit_code == 2
        (line,) = faults(result)
        assert "line 3: cases[0].pairs: pairs.csv, row 3: start = [118.7, 9.8] lies on land" in line
    assert not (tmp_path / "out").exists()


def test_currents_not_there_yet_ask_to_come_again(tmp_path: Path) -> None:
    result = renew("run", "--config", region_night(tmp_path), "--output", tmp_path / "out")
    assert result.exit_code == 5
    assert "no currents are there yet: no file matches" in result.stderr
    assert "come again" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_second_job_says_who_is_at_work(tmp_path: Path) -> None:
    output = tmp_path / "out"
    with file_lock(output / ".nightly.lock"):
        holder = {"pid": os.getpid(), "host": "ship", "since": "2026-11-21T02:00:00Z"}
        (output / ".nightly.lock").write_text(json.dumps(holder))
        result = renew("run", "--config", plane_night(tmp_path), "--output", output)
        assert result.exit_code == 4
        assert f"process {os.getpid()} on ship, since 2026-11-21T02:00:00Z" in result.stderr
        assert f"at work: process {os.getpid()}" in renew("status", "--output", output).stdout
    assert "at work: nobody" in renew("status", "--output", output).stdout


def test_what_a_night_prints(tmp_path: Path, cluster: str) -> None:
    output = tmp_path / "out"
    write_forecast(tmp_path / "currents" / "m.nc", REFERENCE)
    file = region_night(tmp_path, departures=1, stale_hours=1e-3)
    done = renew("run", "--config", file, "--output", output, "--scheduler", cluster)
    assert done.exit_code == 10
    assert done.stdout == "2026-11-21T00Z: 0 same, 1 look, 0 act\n"
    stages = [json.loads(line) for line in done.stderr.splitlines()]
    assert [one["stage"] for one in stages if one["event"] == "done"] == [
        "look",
        "prepare",
        "plan",
        "publish",
        "check",
    ]
    shown = renew("show", "around", "--output", output)
    assert "outcome: look\nwhy: the currents are " in shown.stdout
    again = renew("run", "--config", file, "--output", output)
    assert again.exit_code == 5
    assert "nothing new: the last night used these currents, of 2026-11-21T00Z" in again.stderr
