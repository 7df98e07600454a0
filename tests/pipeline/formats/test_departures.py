"""The sweep of departures as files, and the scenario as it was asked for."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.findings.result import RunResult
from pipeline.formats.tables import write_scenario, write_table
from pipeline.model import DepartureChoice
from pipeline.scenario.catalogue import read_toml
from pipeline.scenario.season import Season
from pipeline.write import formats_of
from tests.pipeline.results import rows_of
from tests.pipeline.tidal_run import DEPARTURE, planned

WINDOW = {"first": DEPARTURE.isoformat(), "every": "1h", "count": 3}


@pytest.fixture(scope="module")
def result() -> RunResult:
    """A run whose departure was chosen among three, of which one can't be sailed."""
    run = planned()
    best = rows_of(run)[0]
    season = run.scenario.seasons[0].model_dump(exclude_none=True)
    asked = Season.model_validate({**season, "departure": None, "departures": WINDOW})
    choice = DepartureChoice(
        season="tide",
        first=DEPARTURE,
        departures_s=np.array([0.0, 3600.0, 7200.0]),
        fuels=np.array([best.fuel, 1.5 * best.fuel, math.inf]),
        durations_s=np.array([best.duration_s, 1.5 * best.duration_s, math.inf]),
        homotopies=(best.homotopy, "p9", ""),
        reasons=("", "", "all 2 classes were rejected"),
        chosen_s=0.0,
        unproven_s=1800.0,
        asked=asked,
    )
    return replace(run, departures=(choice,))


def test_each_departure_has_a_row_and_the_best_its_proof(result: RunResult, tmp_path: Path) -> None:
    write_table(result, tmp_path / "departures.csv")
    with (tmp_path / "departures.csv").open(newline="", encoding="utf-8") as file:
        first, second, none = csv.DictReader(file)
    best = rows_of(result)[0]
    assert first["departure"] == "2026-11-22T06:20:00Z"
    assert float(first["hours"]) == best.duration_s / 3600
    assert float(first["fuel"]) == best.fuel
    assert (first["way"], first["is_best"], first["unproven_min"]) == (best.way, "True", "30.0")
    assert (second["homotopy"], second["way"], second["is_best"]) == ("p9", "", "False")
    assert second["unproven_min"] == ""
    assert (none["arrival"], none["hours"], none["fuel"]) == ("", "", "")
    assert none["reason"] == "all 2 classes were rejected"


def test_the_files_are_written_where_a_departure_was_chosen(result: RunResult) -> None:
    assert "departures.csv" in formats_of(result)
    assert "departures.csv" not in formats_of(planned())


def test_the_scenario_holds_what_was_asked(result: RunResult, tmp_path: Path) -> None:
    write_scenario(result, tmp_path / "scenario.toml")
    data = read_toml(tmp_path / "scenario.toml")
    (season,) = data["seasons"]
    assert "departure" not in season
    assert season["departures"]["count"] == 3
    assert Season.model_validate(season) == result.departures[0].asked
