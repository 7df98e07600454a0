"""Copernicus: what can be shown without its service. No part of the client is replaced."""

from __future__ import annotations

import os
import re
import time
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import StageError
from pipeline.loading import load_scenario
from pipeline.scenario import catalogue
from pipeline.sources.currents.copernicus.account import PASSWORD, USERNAME
from pipeline.sources.currents.copernicus.adapter import Copernicus
from pipeline.stages.fetch import fetch
from pipeline.store import Store
from tests.loopback_store import world
from tests.loopback_store.world import LAND, REGION, season, spec
from tests.pipeline.conftest import ACROSS_BOX

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(autouse=True)
def _no_account(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No credentials in the environment, and none in the client's own file."""
    for name in list(os.environ):
        if name.startswith("COPERNICUS"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path / "home"))


def source(name: str = "copernicus-glorys-monthly") -> Copernicus:
    """Return a source of the catalogue."""
    return Copernicus(spec(name))


# --- without an account -------------------------------------------------------------------------


def test_without_credentials_it_is_unavailable_and_says_what_to_set() -> None:
    reason = source().unavailable()
    assert USERNAME in reason
    assert PASSWORD in reason


def test_credentials_of_either_kind_make_it_available(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(USERNAME, "someone")
    assert source().unavailable()
    monkeypatch.setenv(PASSWORD, "something")
    assert not source().unavailable()
    monkeypatch.delenv(USERNAME)
    file = tmp_path / "home" / ".copernicusmarine" / ".copernicusmarine-credentials"
    file.parent.mkdir(parents=True)
    file.write_text("")
    assert not source().unavailable()


def test_without_credentials_the_embedded_table_steps_in_and_says_so(across_outputs: Path) -> None:
    small = load_scenario("palawan-season").model_dump(mode="json")
    small["region"]["bbox"] = ACROSS_BOX
    scenario = load_scenario("palawan-season").model_validate(small)
    parts = fetch(scenario, Store(across_outputs / ".artefacts"))
    assert [grid.credit.name for grid in parts.fetched.currents] == [
        catalogue.source("embedded-palawan").title
    ] * 2
    assert not parts.failures
    told = [note for note in parts.fetched.notes if note.startswith(("summer", "winter"))]
    asked, summer, winter = told
    assert asked.startswith("summer, winter: ")
    assert USERNAME in asked
    assert summer.startswith("summer: planned on Embedded table")
    assert winter.startswith("winter: planned on Embedded table")


def test_with_nothing_else_to_ask_the_request_is_refused(tmp_path: Path) -> None:
    text = catalogue.scenario_path("palawan-season").read_text()
    path = tmp_path / "only.toml"
    path.write_text(text.replace(', "embedded-palawan"', "").replace("palawan-season", "only"))
    output = tmp_path / "outputs"
    for extra, word in (([], USERNAME), (["--offline"], "leave --offline out")):
        result = CliRunner().invoke(app, ["run", str(path), "--output", str(output), *extra])
        assert result.exit_code == 2
        errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
        assert len(errors) == 2, "a line for each season"
        assert all(word in line for line in errors)
        assert not (output / "only").exists()


@pytest.mark.slow
def test_the_real_client_without_a_network_ends_as_a_reason_and_leaves_nothing(
    tmp_path: Path,
) -> None:
    # No proxy answers on port 9 (discard), and nothing else is reachable through it.
    unlucky = Copernicus(source().spec.model_copy(update={"deadline_s": 60.0, "attempts": 1}))
    with pytest.MonkeyPatch.context() as patch:
        for name in ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy"):
            patch.setenv(name, "http://127.0.0.1:9")
        begun = time.monotonic()
        with pytest.raises(StageError, match="copernicus-glorys-monthly: "):
            unlucky.current(REGION, season("2024-07"), LAND, tmp_path / "downloads")
    assert time.monotonic() - begun < 70
    assert list((tmp_path / "downloads").iterdir()) == []


# --- what is asked for --------------------------------------------------------------------------


@pytest.mark.parametrize("name", world.names())
def test_a_request_is_strict_pinned_and_wider_than_the_region(name: str) -> None:
    request = source(name).request(REGION)
    assert request["coordinates_selection_method"] == "strict-inside"
    assert "skip_existing" not in request
    assert "overwrite" not in request
    west, south, east, north = REGION.bounds
    assert request["minimum_longitude"] < west - spec(name).cell_deg
    assert request["maximum_longitude"] > east + spec(name).cell_deg
    assert request["minimum_latitude"] < south - spec(name).cell_deg
    assert request["maximum_latitude"] > north + spec(name).cell_deg
    assert len(spec(name).version) == 6, "the release is pinned"


def test_at_the_grids_own_ends_no_more_is_asked_for_than_there_is() -> None:
    request = source().request(shapely.box(10, -80, 20, 90))
    assert (request["minimum_latitude"], request["maximum_latitude"]) == (-80, 90)


# --- what is covered ----------------------------------------------------------------------------


_TODAY = re.compile(r"today([+-]\d+)")


def dated(text: str) -> str:
    """Write the day for "today+3"; tests are named without a date."""
    text = text.replace("this month", day(0)[:7]).replace("next month", day(40)[:7])
    return _TODAY.sub(lambda found: day(int(found[1])), text)


def day(days_ahead: int) -> str:
    """Spell a day, counted from today."""
    return (datetime.now(UTC) + timedelta(days=days_ahead)).date().isoformat()


@pytest.mark.parametrize(
    ("name", "valid"),
    [
        ("copernicus-glorys-monthly", "1993-01"),
        ("copernicus-glorys-monthly", "2024-07"),
        ("copernicus-glorys-daily", "1993-01"),
        ("copernicus-glorys-daily", "2024-07-15"),
        ("copernicus-glorys-climatology", "1802-07"),
        ("copernicus-glorys-climatology", "2100-07-15"),
        ("copernicus-forecast-daily", "today+0"),
        ("copernicus-forecast-daily", "today+10"),
        ("copernicus-forecast-6hourly", "today+9T18:00Z"),
        ("copernicus-forecast-hourly", "today-30T18:20Z"),
        ("copernicus-total-hourly", "today+3T18:20Z"),
        ("copernicus-observed-recent", "today-1"),
    ],
)
def test_times_that_a_dataset_may_hold_are_asked_for(name: str, valid: str) -> None:
    assert source(name).uncovered(REGION, season(dated(valid))) == ""


@pytest.mark.parametrize(
    ("name", "valid", "said"),
    [
        ("copernicus-glorys-monthly", "1992-12", "covers January 1993 to some months ago"),
        ("copernicus-glorys-monthly", "this month", "covers January 1993 to some months ago"),
        ("copernicus-glorys-monthly", "2024-07-15", "holds steps of a month, which are longer"),
        ("copernicus-glorys-daily", "today-5", "to some months ago"),
        ("copernicus-forecast-daily", "today+11", "to ten days ahead"),
        ("copernicus-forecast-daily", "next month", "to ten days ahead"),
        ("copernicus-forecast-daily", "2010-07-15", "from November 2020 at the earliest"),
        ("copernicus-total-hourly", "today+12T00:00Z", "to ten days ahead"),
        ("copernicus-observed-recent", "today+0", "covers May 2022 to yesterday"),
        ("copernicus-forecast-monthly", "this month", "the whole months of recent years"),
    ],
)
def test_times_that_it_cannot_hold_are_refused_before_anybody_is_asked(
    name: str, valid: str, said: str
) -> None:
    asked = season(dated(valid))
    reason = source(name).uncovered(REGION, asked)
    assert reason.startswith(name)
    assert said in reason
    assert "name another source in 'currents'" in reason
    assert source(name).identity(asked), "which is asked for first"


def test_regions_beyond_the_grid_are_refused_with_its_limits() -> None:
    reason = source().uncovered(shapely.box(10, -82, 20, -70), season("2024-07"))
    assert "reaches from -80 to 90 degrees north, the region from -82 to -70" in reason
    across = shapely.box(178, 10, 184, 20)
    assert source().uncovered(across, season("2024-07")) == ""
    observed = source("copernicus-observed-daily")
    for region in (across, shapely.box(170, 10, 180, 20)):
        assert "can't be asked across 180 degrees" in observed.uncovered(region, season("2024-07"))
    assert observed.uncovered(REGION, season("2024-07")) == ""


def test_what_may_still_change_is_asked_for_anew_each_day() -> None:
    final, forecast = source("copernicus-glorys-daily"), source("copernicus-forecast-daily")
    assert final.identity(season("2024-07-15"))[-1] == ""
    assert forecast.identity(season(day(-60)))[-1] == ""
    today = datetime.now(UTC).date().isoformat()
    for valid in (day(5), day(0), day(-10)):
        assert forecast.identity(season(valid))[-1] == today


@pytest.mark.parametrize("name", world.names())
def test_every_entry_of_the_catalogue_is_whole(name: str) -> None:
    entry = spec(name)
    assert entry.doi in entry.credit
    assert entry.credit.startswith("Generated using E.U. Copernicus Marine Service Information; ")
    assert entry.url == f"https://doi.org/{entry.doi}"
    assert bool(entry.first_day) == (entry.kind != "climatology")
    # Their own names say it: "-m" is a mean, "-i" instantaneous.
    assert entry.dataset.endswith("-i") == (entry.kind == "instant")
    length = {"month": "_P1M-", "day": "_P1D-", "6 hours": "_PT6H-", "hour": "_PT1H-"}[entry.step]
    assert length in entry.dataset
