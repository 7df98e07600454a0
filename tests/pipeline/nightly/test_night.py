"""Whole nights, one after the other, in small plane and chart scenarios."""

import csv
import json
import shutil
import sqlite3
from contextlib import closing
from datetime import timedelta
from pathlib import Path
from typing import TypeAlias

import geopandas
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import shapely

import renew
from pipeline.errors import RequestError, StageError
from pipeline.findings.choices import ENSEMBLE_FIGURES, ensemble_figures, side_shares
from pipeline.nightly.config import NightConfig, load_config
from pipeline.nightly.currents import ComeAgainError
from pipeline.nightly.cycles import Partial, Row, rows_of_parts
from pipeline.nightly.night import NightOutcome, run_night
from pipeline.nightly.publishing import check_files
from pipeline.nightly.records import case_lines, earlier_routes, status_lines
from pipeline.scenario.loading import load_scenario
from tests.pipeline.nightly.nights import (
    REFERENCE,
    plane_night,
    region_night,
    rows,
    write_forecast,
    write_night,
)
from tests.pipeline.results import result_of

Ended: TypeAlias = tuple[NightConfig, NightOutcome]


@pytest.fixture(scope="module")
def ended(
    tmp_path_factory: pytest.TempPathFactory, cluster: str
) -> tuple[NightConfig, NightOutcome]:
    """Give a night that has ended."""
    folder = tmp_path_factory.mktemp("finished")
    config = load_config(plane_night(folder, workers=1), folder / "out")
    return config, run_night(config, scheduler=cluster)


@pytest.fixture
def finished(ended: Ended) -> Path:
    """Give its output, to be read only."""
    return ended[0].output


def test_a_first_night_is_whole_and_a_second_run_touches_nothing(
    ended: Ended, finished: Path, cluster: str
) -> None:
    config, outcome = ended
    assert (outcome.exit_code, outcome.reference_time, outcome.fresh) == (0, None, True)
    assert outcome.cases_by_outcome == {"same": 6, "look": 0, "act": 0}
    assert set(outcome.seconds_by_stage) == {"look", "prepare", "plan", "publish", "check"}

    latest = finished / "latest"
    tables = {f"{name}.parquet" for name in ("cases", "history", "routes")}
    others = {"changes.csv", "index.html", "night.json", "routes.gpkg"}
    assert {path.name for path in latest.iterdir()} == tables | others
    assert (latest / "changes.csv").read_text().count("\n") == 1
    assert "<h1>All 6 cases planned</h1>" in (latest / "index.html").read_text()
    table = rows(finished)
    assert [row["case"] for row in table] == [f"quick/still/p{i:04}" for i in range(6)]
    assert {row["status"] for row in table} == {"planned"}
    routes = geopandas.read_parquet(latest / "routes.parquet")
    assert len(routes) == sum(row["routes"] for row in table) == len(routes.geometry.is_valid)
    layer = geopandas.read_file(latest / "routes.gpkg")
    assert set(layer[layer["rank"] == 1]["case"]) == {row["case"] for row in table}

    before = {path: path.stat().st_mtime_ns for path in finished.rglob("*")}
    again = run_night(config, scheduler=cluster)
    assert (again.exit_code, again.fresh, again.cycle) == (0, False, outcome.cycle)
    assert "nothing to do" in again.message
    assert {path: path.stat().st_mtime_ns for path in finished.rglob("*")} == before


def test_a_second_night_sails_the_first_ones_routes_again(
    tmp_path: Path, cluster: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "out"
    file = region_night(tmp_path, departures=1, keep=1, workers=1)
    write_forecast(tmp_path / "currents" / "m1.nc")
    first = run_night(load_config(file, output), scheduler=cluster)
    assert first.cycle == "2026-11-21T00Z"
    assert [row["case"] for row in rows(output)] == ["around/now/-/0600Z/-/m1"]
    assert rows(output)[0]["leaves"].isoformat() == "2026-11-21T06:00:00+00:00"

    write_forecast(tmp_path / "currents" / "m1.nc", REFERENCE + timedelta(days=1), seed=7)
    kept, clear = list[Row](), Partial.clear

    def look_and_clear(partial: Partial) -> None:
        kept.extend(row for part in rows_of_parts(partial.folder) for row in part)
        clear(partial)

    monkeypatch.setattr(Partial, "clear", look_and_clear)
    second = run_night(load_config(file, output), scheduler=cluster)
    assert second.cycle == "2026-11-22T00Z"
    # Ended before this, it would have gone on from here.
    assert {row["case"] for row in kept} == {row["case"] for row in rows(output)}
    with (output / "latest" / "changes.csv").open(newline="") as changes:
        changed = list(csv.DictReader(changes))
    assert [row["earlier_cycle"] for row in changed] == ["2026-11-21T00Z"]
    for row in rows(output):
        # Tonight's best is best of all that is safe tonight.
        if row["keep_fuel"] < row["fuel"] * (1 - 1e-3):
            assert "no longer keeps the clearance" in row["why"]
        assert row["saving_percent"] == pytest.approx(100 * (1 - row["fuel"] / row["keep_fuel"]))
        assert row["apart_m"] >= 0
        assert (row["outcome"] == "same") == (not row["why"])
    history = pq.read_table(output / "latest" / "history.parquet").to_pylist()
    assert [row["cycle"] for row in history] == ["2026-11-21T00Z", "2026-11-22T00Z"]
    # The oldest cycles have gone.
    assert {path.name for path in output.glob("2026*")} == {"2026-11-22T00Z"}

    write_forecast(tmp_path / "currents" / "m1.nc")
    with pytest.raises(ComeAgainError, match="older than those of the last cycle"):
        run_night(load_config(file, output), scheduler=cluster)
    assert (output / "latest").resolve().name == "2026-11-22T00Z"


@pytest.mark.slow
def test_changing_currents_are_sailed_by_each_cases_own_clock(tmp_path: Path, cluster: str) -> None:
    """Each case equals a run of the season from its departure, and so does yesterday's route."""
    output, forecast = tmp_path / "out", tmp_path / "currents" / "m1.nc"
    file = region_night(tmp_path)
    scenario = tmp_path / "region.toml"
    text = scenario.read_text().replace("scale = 1000", "scale = 1")
    text = text.replace('valid = "2024-07"', 'time_method = "changing"\nmax_hours = 20')
    scenario.write_text(text)
    write_forecast(forecast, changes=True)
    assert run_night(load_config(file, output), scheduler=cluster).exit_code == 0
    first = rows(output)
    assert first[0]["fuel"] != pytest.approx(first[1]["fuel"], rel=1e-4)
    write_forecast(forecast, REFERENCE + timedelta(days=1), seed=7, changes=True)
    run_night(load_config(file, output), scheduler=cluster)
    for yesterday, case in zip(first, rows(output), strict=True):
        leaves = case["leaves"].isoformat()
        own = text.replace('["still"]', f'["{forecast}"]\ndeparture = {leaves}')
        scenario.write_text(own)
        result = result_of(load_scenario(str(scenario)), tmp_path / "run")
        routes = [row for row in rows(output, "routes.parquet") if row["case"] == case["case"]]
        assert len(routes) == len(result.routes)
        for row, route in zip(routes, result.routes, strict=True):
            for name in (
                *("fuel", "fuel_per_distance", "length_m", "duration_s", "clearance_m"),
                *("optimality_gap", "trials", "collisions"),
            ):
                assert row[name] == getattr(route.metrics, name)
            assert row["class"] == route.metrics.homotopy
            assert row["side"] == route.metrics.main_passage
            lonlat = result.water.projection.to_lonlat(route.route.path)
            assert shapely.from_wkb(row["geometry"]) == shapely.LineString(lonlat)
        path = shapely.get_coordinates(shapely.from_wkb(yesterday["geometry"]))
        kept = renew.fuel(
            result.water.projection.to_plane(path),
            result.case("now").case.current,
            result.cases[0].case.vessel,
            drift=result.scenario.planner.drift,
            chart=result.water.chart,
        )
        assert case["keep_fuel"] == pytest.approx(kept, rel=1e-12)


@pytest.mark.slow
def test_half_a_forecast_is_planned_as_far_as_it_goes(tmp_path: Path, cluster: str) -> None:
    write_forecast(tmp_path / "currents" / "m1.nc", steps=3)
    file = region_night(tmp_path, departures=4)
    outcome = run_night(load_config(file, tmp_path / "out"), scheduler=cluster)
    assert outcome.exit_code == 10
    assert [row["status"] for row in rows(tmp_path / "out")] == ["planned"] * 2 + ["failed"] * 2
    assert "none within" in rows(tmp_path / "out")[3]["reason"]


def test_no_case_at_all_could_be_planned(tmp_path: Path, cluster: str) -> None:
    plane_night(tmp_path)
    text = (tmp_path / "quick.toml").read_text()
    wall = "[[[40, 0], [60, 0], [60, 100], [40, 100]]]"
    text = text.replace("[[[40, 30], [60, 30], [60, 70], [40, 70]]]", wall)
    (tmp_path / "quick.toml").write_text(text)
    with pytest.raises(StageError, match="no case could be planned"):
        run_night(load_config(tmp_path / "night.toml", tmp_path / "out"), scheduler=cluster)
    (partial,) = (tmp_path / "out").glob("*.partial")
    assert partial.is_dir()
    assert not (tmp_path / "out" / "latest").exists()


@pytest.mark.slow
def test_a_pair_within_the_charts_margin_is_planned(tmp_path: Path, cluster: str) -> None:
    """Its goal lies 22 m off the island, and the chart is accurate to 50 m."""
    write_forecast(tmp_path / "currents" / "m1.nc")
    file = region_night(tmp_path, departures=1)
    region = (tmp_path / "region.toml").read_text().replace("paper-asv", "usv-7m")
    region = region.replace("scale = 1000", "scale = 1").replace("tolerance_m = 500\n", "")
    region = region.replace('padding = "none"\n', "")
    (tmp_path / "region.toml").write_text(region)
    file.write_text(file.read_text() + 'pairs = "pairs.csv"\n')
    (tmp_path / "pairs.csv").write_text(
        "start_lon,start_lat,goal_lon,goal_lat,name\n"
        "118.40,10.20,118.60,10.30,open\n118.40,10.20,118.50,10.3102,close\n"
    )
    run_night(load_config(file, tmp_path / "out"), scheduler=cluster)
    away, close = rows(tmp_path / "out")
    assert [away["status"], close["status"]] == ["planned"] * 2, close["reason"]
    assert 0 < close["clearance_m"] < 25
    assert away["clearance_m"] > 50
    assert away["collisions"] == 0


def test_a_case_alone_has_an_output_of_its_own(tmp_path: Path, cluster: str) -> None:
    config = load_config(plane_night(tmp_path, workers=1), tmp_path / "out")
    run_night(config, only="quick/still/p0002", scheduler=cluster)
    assert not (tmp_path / "out" / "latest").exists()
    (row,) = rows(tmp_path / "out" / "only" / "quick_still_p0002")
    assert row["case"] == "quick/still/p0002"
    with pytest.raises(RequestError, match="no case is called 'quick/still/p9'"):
        run_night(config, only="quick/still/p9", scheduler=cluster)


def test_status_and_show(tmp_path: Path, finished: Path) -> None:
    output = tmp_path / "out"
    with pytest.raises(RequestError, match="no finished cycle"):
        list(case_lines(output, "quick"))
    assert next(status_lines(output)).startswith("latest: none")
    output = finished
    assert "6 cases (6 same, 0 look, 0 act)" in next(status_lines(output))
    assert "case: quick/still/p0003" in list(case_lines(output, "quick/still/p0003"))
    with pytest.raises(RequestError, match="no case is called 'p3'"):
        list(case_lines(output, "p3"))


def test_damage_is_found_before_anything_is_published(tmp_path: Path, finished: Path) -> None:
    folder = tmp_path / "cycle"
    shutil.copytree(finished / "latest", folder)
    check_files(folder, 6)
    with pytest.raises(StageError, match="6 rows for 7 cases"):
        check_files(folder, 7)
    with closing(sqlite3.connect(folder / "routes.gpkg")) as database:
        database.execute("DROP TABLE routes")
    with pytest.raises(StageError, match="a file does not open"):
        check_files(folder, 6)


def test_the_file_of_a_night_says_when_it_was_made(finished: Path) -> None:
    said = json.loads((finished / "latest" / "night.json").read_text())
    assert said["cases_by_status"] == {"planned": 6}
    assert said["begun"] <= said["finished"]


def test_write_night_is_refused_with_file_and_line(tmp_path: Path) -> None:
    file = write_night(tmp_path, 'scenario = "single-gyre"\nevery = 1\n', keep=0)
    with pytest.raises(RequestError) as caught:
        load_config(file)
    assert caught.value.faults[0].startswith("night.toml, line 1: keep = 0 is below 1")
    assert caught.value.faults[1].startswith("night.toml, line 4: unknown key cases[0].every")


def test_a_table_of_an_earlier_version_without_islands_is_read(tmp_path: Path) -> None:
    row = {
        "case": "quick/still",
        "status": "planned",
        "side": "west of Palawan",
        "class": "p1",
        "fuel": 3.0,
        "arrival": None,
        "geometry": shapely.to_wkb(shapely.LineString([(0, 0), (1, 2)])),
    }
    pq.write_table(pa.Table.from_pylist([row]), tmp_path / "cases.parquet")
    routes = earlier_routes("2026-11-20T00Z", tmp_path / "cases.parquet")
    assert list(routes) == ["quick/still"]
    assert routes["quick/still"].columns()["earlier_side"] == "west of Palawan"
    assert routes["quick/still"].island == ""


@pytest.mark.slow
def test_a_case_with_members_equals_a_run_of_its_season(tmp_path: Path, cluster: str) -> None:
    file, members = plane_night(tmp_path, pairs=1), "{ spread = 0.1, eddy_km = 0.05, count = 6 }"
    scenario = tmp_path / "quick.toml"
    scenario.write_text(
        scenario.read_text().replace("[planner]", f"members = {members}\n[planner]")
    )
    file.write_text(file.read_text().replace('pairs = "pairs.csv"\n', ""))
    run_night(load_config(file, tmp_path / "out"), scheduler=cluster)
    result = result_of(load_scenario(str(scenario)), tmp_path / "run")
    (case,) = rows(tmp_path / "out")
    own = [one.metrics for one in result.routes]
    found = result.results[0].ensemble
    assert found is not None
    for row, metrics in zip(rows(tmp_path / "out", "routes.parquet"), own, strict=True):
        for name in ("fuel", "trials", "members_share", "members_cvar90_fuel", "members_regret"):
            assert row[name] == getattr(metrics, name)
    figures = {name: case[name] for name in ENSEMBLE_FIGURES}
    assert figures == ensemble_figures(found, own)
    close = "" if found.close == (1,) else "too close to call: "
    assert case["members_sides"] == close + side_shares(found, own)
