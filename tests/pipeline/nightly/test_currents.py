"""Which currents a night plans on: the newest, by files or a service, and what they change."""

import json
import re
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pipeline.nightly.cases import expand
from pipeline.nightly.config import load_config
from pipeline.nightly.currents import ComeAgainError, Newest, newest_currents
from pipeline.nightly.cycles import cycle_time, is_cycle
from pipeline.nightly.night import NightOutcome, run_night
from tests.loopback_store import world
from tests.loopback_store.world import connected
from tests.pipeline.nightly.nights import (
    REFERENCE,
    plane_night,
    region_night,
    rows,
    set_clock,
    write_forecast,
    write_night,
)

FORECAST = "copernicus-forecast-daily"


def newest(file: Path) -> Newest:
    """Return the newest currents of a night."""
    return newest_currents(expand(load_config(file)), datetime.now(UTC))


def forecast_night(folder: Path) -> Path:
    """Write a night on the service's forecast alone."""
    return write_night(folder, f'scenario = "palawan-usv"\ncurrents = ["{FORECAST}"]\n')


@pytest.mark.slow
def test_the_services_last_step_names_the_cycle(tmp_path: Path) -> None:
    last = world.today() - timedelta(days=3)
    store = world.store(FORECAST, ends=last.date().isoformat())
    with connected(store, tmp_path / "home"):
        found = newest(forecast_night(tmp_path))
    assert found.time == last
    assert found.cycle.startswith(f"{last:%Y-%m-%dT%H}Z-")
    assert found.departures_from == last - timedelta(days=10)


@pytest.mark.slow
def test_a_service_that_is_down_asks_to_come_again(tmp_path: Path) -> None:
    proxies = ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy")
    gone = dict.fromkeys(proxies, "http://127.0.0.1:9")
    with (
        connected(world.store(FORECAST), tmp_path / "home", gone),
        pytest.raises(ComeAgainError, match=f"no currents are there yet: {FORECAST}"),
    ):
        newest(forecast_night(tmp_path))


def test_without_an_account_a_stand_in_names_the_cycle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("USERNAME", "PASSWORD"):
        monkeypatch.delenv(f"COPERNICUSMARINE_SERVICE_{name}", raising=False)
    found = newest(write_night(tmp_path, 'scenario = "palawan-usv"\n'))
    assert found.cycle.startswith("2024-01-28T00Z-")
    with pytest.raises(ComeAgainError, match="needs a free Copernicus Marine account"):
        newest(forecast_night(tmp_path))


def test_the_name_follows_the_files_and_not_the_clock(tmp_path: Path) -> None:
    file = region_night(tmp_path)
    path = write_forecast(tmp_path / "currents" / "m1.nc", says_reference=False)
    first = newest(file)
    assert first.cycle.startswith("2026-11-23T00Z-")
    assert newest(file) == first
    path.unlink()
    write_forecast(path, says_reference=False, seed=2)
    other = newest(file)
    assert other.time == first.time
    assert other.cycle != first.cycle
    path.unlink()
    write_forecast(path, REFERENCE + timedelta(hours=6, minutes=30))
    assert newest(file).cycle == "2026-11-21T0630Z"


def test_names_of_cycles() -> None:
    assert cycle_time("2026-11-21T00Z") == REFERENCE
    assert cycle_time("2028-02-29T0630Z-0123abcd") is not None
    assert cycle_time("2026-02-30T00Z") is None
    assert cycle_time("undated-0123abcd") is None
    assert [is_cycle(name) for name in ("undated-0123abcd", "latest", "only", "2026-11-21")] == [
        True,
        False,
        False,
        False,
    ]


@pytest.mark.parametrize("says_reference", [True, False])
def test_a_cycle_is_named_by_its_currents(tmp_path: Path, says_reference: bool) -> None:
    file = region_night(tmp_path)
    write_forecast(tmp_path / "currents" / "m1.nc", says_reference=says_reference)
    write_forecast(
        tmp_path / "currents" / "m2.nc",
        REFERENCE - timedelta(hours=12),
        says_reference=says_reference,
    )
    found = newest(file)
    if says_reference:
        assert found.cycle == "2026-11-21T00Z"
    else:
        assert found.cycle.startswith("2026-11-23T00Z-")
    assert found.departures_from == REFERENCE


# --- nights on them ---


_NEXT_YEAR = REFERENCE.replace(year=REFERENCE.year + 5)


def _run(file: Path, cluster: str) -> NightOutcome:
    return run_night(load_config(file, file.parent / "out"), scheduler=cluster)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("says_reference", [True, False])
def test_a_forecast_dated_in_the_future_blocks_nothing(
    tmp_path: Path, cluster: str, says_reference: bool
) -> None:
    """Alone it is refused with both times; beside a right one its own cases fail."""
    file = region_night(tmp_path, departures=1)
    wrong = tmp_path / "currents" / "wrong.nc"
    write_forecast(wrong, _NEXT_YEAR, says_reference=says_reference)
    refused = r"wrong\.nc: its .*, 2031-11-2\d 00:00 UTC, is more than .* ahead of this machine's"
    with pytest.raises(ComeAgainError, match=refused):
        _run(file, cluster)
    assert not (tmp_path / "out").exists()
    write_forecast(tmp_path / "currents" / "right.nc")
    outcome = _run(file, cluster)
    assert (outcome.cycle, outcome.exit_code) == ("2026-11-21T00Z", 10)
    right, dated_ahead = rows(tmp_path / "out")
    assert (right["status"], dated_ahead["status"]) == ("planned", "failed")
    assert re.search(refused, dated_ahead["reason"])


@pytest.mark.slow
def test_a_cycle_in_the_way_is_named_with_the_remedy(
    tmp_path: Path, cluster: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was published by a clock that was years ahead; moved away, the night goes on."""
    file = region_night(tmp_path, departures=1)
    path = tmp_path / "currents" / "m1.nc"
    write_forecast(path)
    _run(file, cluster)
    write_forecast(path, _NEXT_YEAR)
    with monkeypatch.context() as patch:
        set_clock(patch, _NEXT_YEAR)
        wrong = _run(file, cluster).cycle
    write_forecast(path, REFERENCE + timedelta(days=1))
    with pytest.raises(ComeAgainError, match=rf"if {wrong} is dated wrongly, move .*{wrong} away"):
        _run(file, cluster)
    (tmp_path / "out" / wrong).rename(tmp_path / "elsewhere")
    assert _run(file, cluster).cycle == "2026-11-22T00Z"
    history = [row["cycle"] for row in rows(tmp_path / "out", "history.parquet")]
    assert history == ["2026-11-21T00Z", "2026-11-22T00Z"]


@pytest.mark.slow
def test_a_clock_before_the_last_night_is_blamed_itself(
    tmp_path: Path, cluster: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = region_night(tmp_path, departures=1)
    path = tmp_path / "currents" / "m1.nc"
    write_forecast(path)
    _run(file, cluster)
    write_forecast(path, REFERENCE + timedelta(days=1))
    with monkeypatch.context() as patch:
        set_clock(patch, datetime(2001, 1, 1, tzinfo=UTC))
        said = r"^this machine.s clock says 2001-01-01 00:00 UTC, and the last night ended at 20"
        with pytest.raises(ComeAgainError, match=said):
            _run(file, cluster)
    assert _run(file, cluster).cycle == "2026-11-22T00Z"


def test_a_forecast_that_stops_coming_is_no_success(tmp_path: Path, cluster: str) -> None:
    file = region_night(tmp_path, departures=1, stale_hours=36)
    path = tmp_path / "currents" / "m1.nc"
    write_forecast(path, REFERENCE - timedelta(days=30))
    assert _run(file, cluster).fresh
    with pytest.raises(ComeAgainError, match="used these currents, of 2026-10-22T00Z, and"):
        _run(file, cluster)


def test_a_corrected_file_and_a_changed_request_are_planned_again(
    tmp_path: Path, cluster: str
) -> None:
    file = region_night(tmp_path, departures=1)
    path = tmp_path / "currents" / "m1.nc"
    write_forecast(path)
    first = _run(file, cluster)
    fuel = rows(tmp_path / "out")[0]["fuel"]
    assert _run(file, cluster).message.startswith("nothing to do")
    path.touch()
    assert _run(file, cluster).message.startswith("nothing to do")
    write_forecast(path, seed=5)
    second = _run(file, cluster)
    assert (second.cycle, second.fresh) == (f"{first.cycle}-r2", True)
    assert rows(tmp_path / "out")[0]["fuel"] != fuel
    assert rows(tmp_path / "out")[0]["earlier_cycle"] == first.cycle
    island = tmp_path / "island.geojson"
    island.write_text(island.read_text().replace("118.55", "118.54"))
    assert _run(file, cluster).cycle == f"{first.cycle}-r3"
    said = json.loads((tmp_path / "out" / "latest" / "night.json").read_text())
    assert said["revises"] == f"changed since {first.cycle}-r2: request"
    assert said["revises"] in (tmp_path / "out" / "latest" / "index.html").read_text()
    assert _run(file, cluster).message.startswith("nothing to do")


@pytest.mark.slow
def test_a_revision_that_was_finished_and_not_named_is_named(tmp_path: Path, cluster: str) -> None:
    file = plane_night(tmp_path, pairs=1)
    first = _run(file, cluster)
    (tmp_path / "pairs.csv").write_text("start_x,start_y,goal_x,goal_y,name\n10,20,90,60,p0000\n")
    second = _run(file, cluster)
    assert second.cycle == f"{first.cycle}-r2"
    link = tmp_path / "out" / "latest"
    for left in ("the link of the night before", "nothing"):
        link.unlink()
        if left != "nothing":
            link.symlink_to(first.cycle)
        named = _run(file, cluster)
        assert (named.cycle, named.exit_code) == (second.cycle, second.exit_code)
        assert link.resolve().name == second.cycle
    shutil.rmtree(tmp_path / "out" / second.cycle)
    assert _run(file, cluster).cycle == second.cycle


def test_a_plane_is_planned_as_its_scenario_now_asks(tmp_path: Path, cluster: str) -> None:
    """Its chart is stored with the planner's options, which were changed since."""
    file, scenario = plane_night(tmp_path, pairs=1), tmp_path / "quick.toml"
    _run(file, cluster)
    assert rows(tmp_path / "out")[0]["routes"] == 2
    scenario.write_text(scenario.read_text().replace("classes = 2", "classes = 1"))
    _run(file, cluster)
    assert rows(tmp_path / "out")[0]["routes"] == 1
