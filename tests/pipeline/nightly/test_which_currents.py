"""Which currents a night plans on: dated ahead of the clock, no longer coming, or changed since."""

from __future__ import annotations

import json
import re
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pipeline.nightly import night as night_module
from pipeline.nightly.config import load_config
from pipeline.nightly.currents import ComeAgainError
from pipeline.nightly.night import NightOutcome, run_night
from tests.pipeline.nightly.nights import (
    REFERENCE,
    plane_night,
    region_night,
    rows,
    write_forecast,
)

_NEXT_YEAR = REFERENCE.replace(year=REFERENCE.year + 5)


def _run(file: Path, cluster: str) -> NightOutcome:
    return run_night(load_config(file, file.parent / "out"), scheduler=cluster)


def _set_clock(monkeypatch: pytest.MonkeyPatch, moment: datetime) -> None:
    class Clock(datetime):
        @classmethod
        def now(cls, tz: object = None) -> datetime:  # type: ignore[override]
            del tz
            return moment

    monkeypatch.setattr(night_module, "datetime", Clock)


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
        _set_clock(patch, _NEXT_YEAR)
        wrong = _run(file, cluster).cycle
    write_forecast(path, REFERENCE + timedelta(days=1))
    with pytest.raises(ComeAgainError, match=rf"if {wrong} is dated wrongly, move .*{wrong} away"):
        _run(file, cluster)
    (tmp_path / "out" / wrong).rename(tmp_path / "elsewhere")
    assert _run(file, cluster).cycle == "2026-11-22T00Z"
    history = [row["cycle"] for row in rows(tmp_path / "out", "history.parquet")]
    assert history == ["2026-11-21T00Z", "2026-11-22T00Z"]


def test_a_clock_before_the_last_night_is_blamed_itself(
    tmp_path: Path, cluster: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = region_night(tmp_path, departures=1)
    path = tmp_path / "currents" / "m1.nc"
    write_forecast(path)
    _run(file, cluster)
    write_forecast(path, REFERENCE + timedelta(days=1))
    with monkeypatch.context() as patch:
        _set_clock(patch, datetime(2001, 1, 1, tzinfo=UTC))
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
    file.write_text(file.read_text().replace("count = 1", "count = 2"))
    assert _run(file, cluster).cycle == f"{first.cycle}-r3"
    assert len(rows(tmp_path / "out")) == 2
    island = tmp_path / "island.geojson"
    island.write_text(island.read_text().replace("118.55", "118.54"))
    assert _run(file, cluster).cycle == f"{first.cycle}-r4"
    said = json.loads((tmp_path / "out" / "latest" / "night.json").read_text())
    assert said["revises"] == f"changed since {first.cycle}-r3: request"
    assert said["revises"] in (tmp_path / "out" / "latest" / "index.html").read_text()
    assert _run(file, cluster).message.startswith("nothing to do")


def test_a_revision_that_was_finished_and_not_named_is_named(tmp_path: Path, cluster: str) -> None:
    file = plane_night(tmp_path, pairs=1)
    first = _run(file, cluster)
    (tmp_path / "pairs.csv").write_text("start_x,start_y,goal_x,goal_y,name\n10,20,90,60,p0000\n")
    second = _run(file, cluster)
    assert second.cycle == f"{first.cycle}-r2"
    link = tmp_path / "out" / "latest"
    link.unlink()
    link.symlink_to(first.cycle)
    assert _run(file, cluster).cycle == second.cycle
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
