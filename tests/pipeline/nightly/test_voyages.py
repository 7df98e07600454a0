"""Voyages under way in a night: planned again from their last position, and reported."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from pipeline.errors import RequestError
from pipeline.nightly.cases import expand
from pipeline.nightly.config import load_config
from pipeline.nightly.night import run_night
from pipeline.nightly.voyages import planned_again
from pipeline.voyage.under_way import last_fix
from tests.pipeline.nightly.nights import plane_night
from tests.pipeline.voyage import sailing

# Half an hour after the departure: near the plan's place, and north of the island.
NEAR, NORTH = (119.0290, 9.5224), (119.035, 9.545)


def night(folder: Path, results: Path) -> Path:
    """A night in a plane, with a voyage on its way and one whose results are damaged."""
    file = plane_night(folder)
    sailing.tide_file(folder / "tonight.nc", faster=1.3)
    (folder / "broken").mkdir()
    table = """
[[voyages]]
results = "{results}"
positions = "{positions}"
currents = "tonight.nc"
"""
    file.write_text(
        file.read_text()
        + table.format(results=results, positions="ship.nmea")
        + table.format(results="broken", positions="ship.nmea")
    )
    return file


def log(folder: Path, *places: tuple[float, float]) -> None:
    """Write positions, the last one half an hour after the departure, and a line that is cut."""
    at = [1800.0 - 60 * later for later in range(len(places))][::-1]
    lines = [sailing.rmc(one, *place) for one, place in zip(at, places, strict=True)]
    (folder / "ship.nmea").write_text("\n".join([*lines, lines[-1][:20]]))


def test_a_night_plans_voyages_under_way_again(tmp_path: Path, results: Path, cluster: str) -> None:
    config = load_config(night(tmp_path, results), tmp_path / "out")
    log(tmp_path, NORTH, NEAR)
    outcome = run_night(config, scheduler=cluster)
    latest = tmp_path / "out" / "latest"
    kept, broken = csv.DictReader((latest / "voyages.csv").read_text().splitlines())
    assert (kept["voyage"], kept["answer"], kept["outcome"]) == ("strait", "kept", "same")
    assert (kept["time"], float(kept["lon"])) == ("2026-11-22T06:50:00+00:00", NEAR[0])
    assert float(kept["by_forecast"]) > 0
    written = results.parent / kept["results"]
    assert json.loads((written / "manifest.json").read_bytes())["scenario"] == written.name
    assert (broken["answer"], broken["outcome"], broken["fuel"]) == ("failed", "act", "")
    record = json.loads((latest / "night.json").read_bytes())
    assert "voyages.csv" in record["sha256"]
    assert [one.partition(":")[0] for one in record["notes"]] == ["voyage broken"]
    assert "voyage broken" in (latest / "index.html").read_text()
    assert outcome.exit_code == 10
    # A second run has nothing to do.
    assert not run_night(config, scheduler=cluster).fresh


@pytest.mark.slow
def test_a_switch_is_to_be_looked_at(tmp_path: Path, results: Path) -> None:
    config = load_config(night(tmp_path, results), tmp_path / "out")
    log(tmp_path, NORTH)
    found = planned_again(config, config.spec.voyages[0])
    assert (found["answer"], found["outcome"]) == ("switched", "look")
    assert found["fuel"] < 0.98 * found["kept_fuel"]
    assert found["reason"].startswith("Switched: take the other way")


def test_a_voyage_without_a_position_says_so(tmp_path: Path, results: Path) -> None:
    config = load_config(night(tmp_path, results), tmp_path / "out")
    (tmp_path / "ship.nmea").write_text("$GPRMC,,V,,,,,,,,,,N*53\n")
    found = planned_again(config, config.spec.voyages[0])
    assert (found["outcome"], found["reason"][:39]) == (
        "act",
        "positions: ship.nmea ends without a pos",
    )
    assert "fuel" not in found


def test_the_last_position_of_a_long_log_is_found(tmp_path: Path) -> None:
    log(tmp_path, NEAR)
    file = tmp_path / "ship.nmea"
    file.write_text("x" * 3_000_000 + "\n" + file.read_text())
    fix = last_fix(file)
    assert fix is not None
    assert (fix.lon, fix.lat) == pytest.approx(NEAR)


def test_a_voyage_without_files_is_refused_with_its_line(tmp_path: Path) -> None:
    file = plane_night(tmp_path)
    table = '[[voyages]]\nresults = "gone"\npositions = "no.nmea"\ncurrents = "a"\n'
    file.write_text(f"{file.read_text()}\n{table}")
    with pytest.raises(RequestError) as caught:
        expand(load_config(file, tmp_path / "out"))
    first, second = caught.value.faults
    assert "voyages[0].results = 'gone' does not exist" in first
    assert "voyages[0].positions = 'no.nmea' does not exist" in second
    assert first.startswith(f"{file.name}, line ")
