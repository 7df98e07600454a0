"""Copernicus without its service: account, requests, coverage and cache."""

import base64
import configparser
import json
import os
import re
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import StageError
from pipeline.findings.note_words import note_texts
from pipeline.machine.store import Store, file_hash
from pipeline.scenario import catalogue
from pipeline.scenario.loading import load_scenario
from pipeline.sources.copernicus.adapter import Copernicus
from pipeline.sources.copernicus.client import PASSWORD, USERNAME, without_secrets
from pipeline.sources.copernicus.download import cached_metadata, save, staging_folder
from pipeline.stages.fetch import fetch
from tests.loopback_store import world
from tests.loopback_store.world import LAND, REGION, season, spec
from tests.pipeline.conftest import ACROSS_BOX


@pytest.fixture(autouse=True)
def _no_account(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Remove the credentials of the environment and of the client's own file."""
    for name in list(os.environ):
        if name.startswith("COPERNICUS"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path / "home"))


def source(name: str = "copernicus-glorys-monthly") -> Copernicus:
    """Return a source of the catalogue."""
    return Copernicus(spec(name))


# --- without an account -------------------------------------------------------------------------


def test_without_credentials_it_is_unavailable_and_names_the_variables() -> None:
    reason = source().unavailable_reason()
    assert USERNAME in reason
    assert PASSWORD in reason


def test_credentials_of_either_kind_make_it_available(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(USERNAME, "someone")
    assert source().unavailable_reason()
    monkeypatch.setenv(PASSWORD, "something")
    assert not source().unavailable_reason()
    monkeypatch.delenv(USERNAME)
    file = tmp_path / "home" / ".copernicusmarine" / ".copernicusmarine-credentials"
    file.parent.mkdir(parents=True)
    file.write_text("")
    assert not source().unavailable_reason()


def test_without_credentials_the_embedded_table_is_used_with_a_note(across_outputs: Path) -> None:
    small = load_scenario("palawan-season").model_dump(mode="json")
    small["region"]["bbox"] = ACROSS_BOX
    scenario = load_scenario("palawan-season").model_validate(small)
    parts = fetch(scenario, Store(across_outputs / ".artefacts"))
    assert [grid.credit.name for grid in parts.currents] == [
        catalogue.source("embedded-palawan").title
    ] * 2
    assert not parts.failures
    notes = [note for note in note_texts(parts.notes) if note.startswith(("summer", "winter"))]
    reason, summer, winter = notes
    assert reason.startswith("summer, winter: ")
    assert USERNAME in reason
    assert summer.startswith("summer: planned on Embedded table")
    assert winter.startswith("winter: planned on Embedded table")


def test_without_any_usable_source_the_request_is_refused(tmp_path: Path) -> None:
    text = catalogue.scenario_path("palawan-season").read_text()
    path = tmp_path / "only.toml"
    path.write_text(text.replace(', "embedded-palawan"', "").replace("palawan-season", "only"))
    output = tmp_path / "outputs"
    for extra, text in (([], USERNAME), (["--offline"], "leave --offline out")):
        result = CliRunner().invoke(app, ["run", str(path), "--output", str(output), *extra])
        assert result.exit_code == 2
        errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
        assert len(errors) == 2, "one line per season"
        assert all(text in line for line in errors)
        assert not (output / "only").exists()


@pytest.mark.slow
def test_the_client_without_network_gives_a_reason_and_leaves_nothing(tmp_path: Path) -> None:
    # No proxy answers on port 9 (discard), so nothing is reachable.
    offline = Copernicus(source().spec.model_copy(update={"deadline_s": 60.0, "attempts": 1}))
    with pytest.MonkeyPatch.context() as patch:
        for name in ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy"):
            patch.setenv(name, "http://127.0.0.1:9")
        begun = time.monotonic()
        with pytest.raises(StageError, match="copernicus-glorys-monthly: "):
            offline.current(REGION, season("2024-07"), LAND, tmp_path / "downloads")
    assert time.monotonic() - begun < 70
    assert list((tmp_path / "downloads").iterdir()) == []


# --- requests -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", world.names())
def test_a_request_is_strict_pinned_and_wider_than_the_region(name: str) -> None:
    arguments = source(name).asked(REGION, season("2024-07")).arguments
    assert arguments["coordinates_selection_method"] == "strict-inside"
    assert "skip_existing" not in arguments
    assert "overwrite" not in arguments
    west, south, east, north = REGION.bounds
    assert arguments["minimum_longitude"] < west - spec(name).cell_deg
    assert arguments["maximum_longitude"] > east + spec(name).cell_deg
    assert arguments["minimum_latitude"] < south - spec(name).cell_deg
    assert arguments["maximum_latitude"] > north + spec(name).cell_deg
    assert len(spec(name).version) == 6, "the release is pinned"


def test_a_request_does_not_exceed_the_grid() -> None:
    arguments = source().asked(shapely.box(10, -80, 20, 90), season("2024-07")).arguments
    assert (arguments["minimum_latitude"], arguments["maximum_latitude"]) == (-80, 90)


# --- coverage -----------------------------------------------------------------------------------


_TODAY = re.compile(r"today([+-]\d+)")


def dated(text: str) -> str:
    """Replace "today+3" by the day, so that the names of tests have no date."""
    text = text.replace("this month", day(0)[:7]).replace("next month", day(40)[:7])
    return _TODAY.sub(lambda match: day(int(match[1])), text)


def day(days_ahead: int) -> str:
    """Write a day, counted from today."""
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
def test_times_that_a_dataset_may_have_are_requested(name: str, valid: str) -> None:
    assert source(name).uncovered_reason(REGION, season(dated(valid))) == ""


@pytest.mark.parametrize(
    ("name", "valid", "message"),
    [
        ("copernicus-glorys-monthly", "1992-12", "covers January 1993 to some months ago"),
        ("copernicus-glorys-monthly", "this month", "covers January 1993 to some months ago"),
        ("copernicus-glorys-monthly", "2024-07-15", "has time steps of a month, which are longer"),
        ("copernicus-glorys-daily", "today-5", "to some months ago"),
        ("copernicus-forecast-daily", "today+11", "to ten days ahead"),
        ("copernicus-forecast-daily", "next month", "to ten days ahead"),
        ("copernicus-forecast-daily", "2010-07-15", "from November 2020 at the earliest"),
        ("copernicus-total-hourly", "today+12T00:00Z", "to ten days ahead"),
        ("copernicus-observed-recent", "today+0", "covers May 2022 to yesterday"),
        ("copernicus-forecast-monthly", "this month", "the complete months of recent years"),
    ],
)
def test_times_that_it_cannot_have_are_refused_without_a_request(
    name: str, valid: str, message: str
) -> None:
    wanted = season(dated(valid))
    reason = source(name).uncovered_reason(REGION, wanted)
    assert reason.startswith(name)
    assert message in reason
    assert "name another source in 'currents'" in reason
    assert source(name).identity(wanted), "which is called first"


def test_regions_beyond_the_grid_are_refused_with_its_limits() -> None:
    reason = source().uncovered_reason(shapely.box(10, -82, 20, -70), season("2024-07"))
    assert "covers -80 to 90 degrees north, the region reaches from -82 to -70" in reason
    across = shapely.box(178, 10, 184, 20)
    assert source().uncovered_reason(across, season("2024-07")) == ""
    observed = source("copernicus-observed-daily")
    for region in (across, shapely.box(170, 10, 180, 20)):
        assert "can't be requested across 180 degrees" in observed.uncovered_reason(
            region, season("2024-07")
        )
    assert observed.uncovered_reason(REGION, season("2024-07")) == ""


def test_data_that_may_still_change_are_requested_again_each_day() -> None:
    final, forecast = source("copernicus-glorys-daily"), source("copernicus-forecast-daily")
    assert final.identity(season("2024-07-15"))[-1] == ""
    assert forecast.identity(season(day(-60)))[-1] == ""
    today = datetime.now(UTC).date().isoformat()
    for valid in (day(5), day(0), day(-10)):
        assert forecast.identity(season(valid))[-1] == today


@pytest.mark.parametrize("name", world.names())
def test_every_entry_of_the_catalogue_is_consistent(name: str) -> None:
    entry = spec(name)
    assert entry.doi in entry.credit
    assert entry.credit.startswith("Generated using E.U. Copernicus Marine Service Information; ")
    assert entry.url == f"https://doi.org/{entry.doi}"
    assert bool(entry.first_day) == (entry.kind != "climatology")
    # The service's names end in "-m" for means, "-i" for instantaneous fields.
    assert entry.dataset.endswith("-i") == (entry.kind == "instant")
    length = {"month": "_P1M-", "day": "_P1D-", "6 hours": "_PT6H-", "hour": "_PT1H-"}[entry.step]
    assert length in entry.dataset


# --- Credentials do not appear in messages ---


@pytest.fixture
def client_folder(tmp_path: Path) -> Path:
    """Give the client's own folder, empty."""
    folder = tmp_path / "home" / ".copernicusmarine"
    folder.mkdir(parents=True)
    return folder


def test_credentials_are_removed_from_messages(
    client_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(USERNAME, "captain")
    monkeypatch.setenv(PASSWORD, "captain-nemo")
    stored = "[credentials]\nusername = ahab\npassword = moby=dick\n"
    (client_folder / ".copernicusmarine-credentials").write_bytes(base64.b64encode(stored.encode()))
    text = without_secrets("login captain-nemo of captain or ahab with moby=dick failed")
    assert text == "login *** of *** or *** with *** failed"


def test_credentials_are_removed_from_addresses_as_they_are_encoded_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(USERNAME, "nemo@sea.org")
    monkeypatch.setenv(PASSWORD, "p&ss word")
    text = without_secrets(
        "https://s3/uo/1.2?x-cop-client=a&x-cop-user=nemo_of_the_service&b=c, form "
        "username=nemo%40sea.org&password=p%26ss+word, proxy http://me:secret@proxy:3128/"
    )
    assert text == (
        "https://s3/uo/1.2?x-cop-client=a&x-cop-user=***&b=c, form "
        "username=***&password=***, proxy http://***@proxy:3128/"
    )


@pytest.mark.parametrize(
    "stored",
    [
        "username=ahab\npassword=moby-dick\n",
        "[credentials]\nusername: ahab\npassword: moby-dick\n",
        "ahab\nmoby-dick\n",
        "[ahab]\n[moby-dick\n",
    ],
)
def test_errors_of_a_damaged_credentials_file_show_nothing_of_it(
    client_folder: Path, stored: str
) -> None:
    (client_folder / ".copernicusmarine-credentials").write_bytes(base64.b64encode(stored.encode()))
    try:
        configparser.RawConfigParser().read_string(stored)
        error = stored
    except configparser.Error as raised:
        error = str(raised)
    assert "ahab" in error or "moby" in error
    text = without_secrets(error)
    assert "ahab" not in text
    assert "moby-dick" not in text


# --- The cache of downloads: only complete files that match their sidecar are used ---


REQUEST = {"a": 1.5, "b": ["x"]}


def saved(folder: Path) -> Path:
    """Put a file into the cache."""
    file = folder / "data_0.083deg_2024-07_abc.nc"
    with staging_folder(folder) as staging:
        staged = staging / file.name
        staged.write_bytes(b"content")
        save(staged, file, {"request": REQUEST})
    return file


def test_a_cached_file_is_found_by_its_sidecar(tmp_path: Path) -> None:
    file = saved(tmp_path)
    metadata = cached_metadata(file, REQUEST)
    assert metadata is not None
    assert (metadata["sha256"], metadata["bytes"]) == (file_hash(file), 7)
    assert metadata["retrieved_utc"].endswith("+00:00")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "data_0.083deg_2024-07_abc.json",
        "data_0.083deg_2024-07_abc.nc",
    ]


def test_a_cached_file_that_does_not_match_its_sidecar_is_not_used(tmp_path: Path) -> None:
    file = saved(tmp_path)
    assert cached_metadata(file, {"a": 2}) is None
    file.write_bytes(b"cantent")
    assert cached_metadata(file, REQUEST) is None
    file.unlink()
    assert cached_metadata(file, REQUEST) is None
    sidecar = saved(tmp_path).with_suffix(".json")
    for damaged in ("", "[]", "{}", '{"request": ', json.dumps({"request": REQUEST})):
        sidecar.write_text(damaged)
        assert cached_metadata(file, REQUEST) is None
    sidecar.unlink()
    assert cached_metadata(file, REQUEST) is None


def test_staging_folders_of_killed_runs_are_removed_and_those_in_use_are_not(
    tmp_path: Path,
) -> None:
    old, new = tmp_path / "a.partial", tmp_path / "b.partial"
    for folder in (old, new):
        folder.mkdir()
        (folder / "data.nc.XXXXXXXX").write_bytes(b"half")
    os.utime(old, (0, 0))
    with staging_folder(tmp_path) as staging:
        assert sorted(tmp_path.iterdir()) == sorted([new, staging])
    assert list(tmp_path.iterdir()) == [new]
