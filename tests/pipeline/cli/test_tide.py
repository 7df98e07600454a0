"""`renew tide`: high and low waters in UTC, as text and as JSON; where constants are written."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.sources.tide_stations import find_station


def run(*args: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["tide", *args])
    return done.exit_code, done.stdout, done.stderr


def test_high_and_low_waters_are_the_extremes_of_the_heights() -> None:
    code, text, _ = run("show", "boston", "--from", "2026-11-22", "--to", "2026-11-23", "--json")
    assert code == 0
    found = json.loads(text)
    assert (found["station"], found["datum"], found["mean_level_m"]) == ("BOSTON", "MLLW", 1.586)
    waters = found["waters"]
    assert [one["kind"] for one in waters] == ["high", "low"] * 4
    tide = find_station("boston").tide(np.datetime64("2026-11-22"))
    for one in waters:
        since = np.datetime64(one["time"][:-1]) - np.datetime64("2026-11-22")
        around = tide.heights(float(since / np.timedelta64(1, "s")) + np.arange(-7200.0, 7201, 60))
        extreme = around.max() if one["kind"] == "high" else around.min()
        assert one["height_m"] == pytest.approx(extreme, abs=6e-4)
        assert abs(around[120] - extreme) < 1e-3


def test_the_table_has_a_line_for_each_and_the_datum() -> None:
    code, text, _ = run("show", "boston", "--from", "2026-11-22", "--to", "2026-11-22")
    assert code == 0
    head, *lines = text.splitlines()
    assert head == "BOSTON: predicted heights over MLLW, without weather; times are UTC"
    assert len(lines) == 6
    for line in lines[:4]:
        assert re.fullmatch(r"2026-11-22  \d\d:\d\d  +-?\d\.\d\d m  (high|low)", line)
    assert lines[4] == "Mean sea level is 1.59 m over MLLW."


def test_faults_of_station_and_times_are_named_together() -> None:
    code, _, errors = run("show", "bosto", "--from", "noon", "--to", "2026-13-01")
    assert code == 2
    assert len(errors.strip().splitlines()) == 3
    assert "--from: 'noon' is not a time" in errors
    assert "did you mean 'boston'" in errors
    code, _, errors = run("show", "boston", "--from", "2026-11-22", "--to", "2026-11-21")
    assert code == 2
    assert "give an end after the beginning" in errors


@pytest.mark.parametrize("day", ["0001-01-01", "9999-12-31"])
def test_a_year_beyond_the_clocks_of_libraries_is_refused(day: str) -> None:
    code, _, errors = run("show", "boston", "--from", day)
    assert (code, errors.startswith(f"error: --from: {day!r} is not a time (")) == (2, True)


def test_a_week_from_today_is_listed_where_no_times_are_given() -> None:
    code, text, _ = run("show", "boston", "--json")
    assert code == 0
    assert 26 <= len(json.loads(text)["waters"]) <= 29


@pytest.mark.parametrize(
    ("out", "reason"),
    [("a" * 300, "too long a path"), (".", "can't be a file"), ("a\0b", "embedded null ")],
)
def test_a_file_of_constants_that_cannot_be_written_is_refused_at_once(
    out: str, reason: str
) -> None:
    code, _, said = run("fit", "nothing.nc", "--out", out)
    assert code == 2
    assert "--out" in said
    assert reason in said
