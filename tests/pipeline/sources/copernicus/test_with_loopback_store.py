"""The unmodified client against the loopback store: right data cell by cell, and each fault."""

import base64
import json
import logging
import os
import shutil
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import StageError
from pipeline.machine.store import Store, file_hash
from pipeline.model import CurrentGrid, Land, Note
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.sources.copernicus.adapter import Copernicus
from pipeline.sources.copernicus.client import AnswerLog
from pipeline.stages.fetch import fetch
from tests.loopback_store import world
from tests.loopback_store.datasets import Ocean
from tests.loopback_store.fault_table import ROWS, Row, clients_of, inject
from tests.loopback_store.server import PASSWORD, USERNAME, Fault
from tests.loopback_store.world import LAND, REGION, TOLERANCE_M_S, connected, season, spec
from tests.pipeline.conftest import ACROSS_BOX

MONTHLY = "copernicus-glorys-monthly"


def source(name: str) -> Copernicus:
    """Return a source with one attempt and a short deadline."""
    return Copernicus(spec(name).model_copy(update={"deadline_s": 90.0, "attempts": 1}))


def day(days_ahead: int) -> datetime:
    """Return the midnight of a day, counted from today."""
    return world.today() + timedelta(days=days_ahead)


# --- every dataset ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "valid", "method", "stamps"),
    [
        (MONTHLY, "2024-07", None, ("2024-07-01T00:00",)),
        ("copernicus-glorys-daily", "2024-07-15", None, ("2024-07-15T00:00",)),
        ("copernicus-glorys-climatology", "2024-07", None, ("1993-07-01T00:00",)),
        ("copernicus-forecast-monthly", "2024-07", None, ("2024-07-01T00:00",)),
        ("copernicus-forecast-daily", "2024-07-15", None, ("2024-07-15T00:00",)),
        ("copernicus-forecast-6hourly", "2024-07-15T08:00Z", None, ("2024-07-15T06:00",)),
        ("copernicus-forecast-hourly", "2024-07-15T08:20Z", None, ("2024-07-15T08:30",)),
        ("copernicus-total-hourly", "2024-07-15T08:40Z", None, ("2024-07-15T09:00",)),
        ("copernicus-observed-daily", "2024-07-15", None, ("2024-07-15T00:00",)),
        ("copernicus-observed-recent", "2024-07-15", None, ("2024-07-15T00:00",)),
        (
            "copernicus-forecast-6hourly",
            "2024-07-15",
            None,
            tuple(f"2024-07-15T{hour:02}:00" for hour in (0, 6, 12, 18)),
        ),
        (
            "copernicus-glorys-daily",
            "2024-02",
            None,
            tuple(f"2024-02-{date:02}T00:00" for date in range(1, 30)),
        ),
        (
            "copernicus-total-hourly",
            "2024-07-15T08:30Z",
            "linear",
            ("2024-07-15T08:00", "2024-07-15T09:00"),
        ),
    ],
)
def test_every_dataset_of_the_catalogue_is_downloaded_correctly(
    tmp_path: Path, name: str, valid: str, method: str | None, stamps: tuple[str, ...]
) -> None:
    wanted = season(valid).model_copy(update={"time_method": method})
    with connected(world.store(name), tmp_path / "home"):
        grid = source(name).current(REGION, wanted, LAND, tmp_path)
    moments = [datetime.fromisoformat(stamp).replace(tzinfo=UTC) for stamp in stamps]
    entry = spec(name)
    assert world.max_error_m_s(grid, entry.eastward, entry.northward, *moments) < TOLERANCE_M_S
    assert entry.dataset in grid.credit.name
    assert entry.version in grid.credit.name
    assert grid.credit.text == entry.credit


@pytest.mark.slow
@pytest.mark.parametrize("west", [175.0, -185.0])
def test_a_region_across_180_degrees_is_downloaded_in_one_piece(
    tmp_path: Path, west: float
) -> None:
    region = shapely.box(west, -20, west + 10, -15)
    with connected(world.store(MONTHLY), tmp_path / "home"):
        grid = source(MONTHLY).current(region, season("2024-07"), Land((), (), 0.0), tmp_path)
    assert grid.lon[0] < west
    assert grid.lon[-1] > west + 10
    assert np.allclose(np.diff(grid.lon), 1 / 12, atol=1e-4)
    moment = datetime(2024, 7, 1, tzinfo=UTC)
    assert world.max_error_m_s(grid, "uo", "vo", moment) < TOLERANCE_M_S


@pytest.mark.slow
def test_the_last_step_of_a_dataset_can_be_downloaded(tmp_path: Path) -> None:
    last = (day(-30).replace(day=1) - timedelta(days=1)).replace(day=1)
    store = world.store(MONTHLY, ends=last.date().isoformat())
    with connected(store, tmp_path / "home"):
        grid = source(MONTHLY).current(REGION, season(f"{last:%Y-%m}"), LAND, tmp_path)
    assert world.max_error_m_s(grid, "uo", "vo", last) < TOLERANCE_M_S


# --- the cache ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_cached_file_is_used_again_unless_it_is_damaged(tmp_path: Path) -> None:
    name, store = MONTHLY, world.store(MONTHLY)
    moment = datetime(2024, 7, 1, tzinfo=UTC)
    with connected(store, tmp_path / "home"):
        grid = source(name).current(REGION, season("2024-07"), LAND, tmp_path / "cache")
        (file,) = (tmp_path / "cache").glob("*.nc")
        requests = len(store.requests)
        again = source(name).current(REGION, season("2024-07"), LAND, tmp_path / "cache")
        assert len(store.requests) == requests, "nothing was requested"
        assert np.array_equal(again.u, grid.u, equal_nan=True)
        assert again.credit == grid.credit
        damaged = bytearray(file.read_bytes())
        damaged[-200] ^= 1
        file.write_bytes(damaged)
        third = source(name).current(REGION, season("2024-07"), LAND, tmp_path / "cache")
        assert len(store.requests) > requests
        assert world.max_error_m_s(third, "uo", "vo", moment) < TOLERANCE_M_S
        assert json.loads(file.with_suffix(".json").read_text())["sha256"] == file_hash(file)


@pytest.mark.slow
def test_a_forecast_cached_yesterday_is_out_of_date_today(tmp_path: Path) -> None:
    name = "copernicus-forecast-daily"
    wanted = season(day(2).date().isoformat())
    store = world.store(name)
    with connected(store, tmp_path / "home"):
        source(name).current(REGION, wanted, LAND, tmp_path / "cache")
        (sidecar,) = (tmp_path / "cache").glob("*.json")
        requests = len(store.requests)
        source(name).current(REGION, wanted, LAND, tmp_path / "cache")
        assert len(store.requests) == requests, "cached today"
        facts = json.loads(sidecar.read_text())
        facts["retrieved_utc"] = day(-1).isoformat()
        sidecar.write_text(json.dumps(facts))
        source(name).current(REGION, wanted, LAND, tmp_path / "cache")
        assert len(store.requests) > requests
    assert len(list((tmp_path / "cache").iterdir())) == 2, "the new file has replaced the old one"


@pytest.mark.slow
def test_a_killed_run_ends_its_client_and_the_next_one_cleans_up(
    tmp_path: Path, root: Path
) -> None:
    name, cache = "copernicus-forecast-daily", tmp_path / "cache"
    store = world.store(name)
    store.faults.append(Fault("*/uo/*", "stall"))
    script = (
        "import pathlib, sys\n"
        "from pipeline.sources.copernicus.adapter import Copernicus\n"
        "from tests.loopback_store.world import LAND, REGION, season, spec\n"
        f"source = Copernicus(spec({name!r}))\n"
        "source.current(REGION, season('2024-10-05'), LAND, pathlib.Path(sys.argv[1]))\n"
    )
    with connected(store, tmp_path / "home"):
        with subprocess.Popen([sys.executable, "-c", script, str(cache)], cwd=root) as run:
            for _ in range(600):
                if any("/uo/" in path for _, path, _ in store.requests):
                    break
                time.sleep(0.1)
            run.kill()
        (left,) = cache.glob("*.partial")
        os.utime(left, (0, 0))  # what a killed process left is removed when it is a day old
        for _ in range(50):
            if not clients_of(store):
                break
            time.sleep(0.1)
        assert not clients_of(store)
        store.faults.clear()
        grid = source(name).current(REGION, season("2024-10-05"), LAND, cache)
    assert world.max_error_m_s(grid, "uo", "vo", datetime(2024, 10, 5, tzinfo=UTC)) < TOLERANCE_M_S
    assert {path.suffix for path in cache.iterdir()} == {".nc", ".json"}


# --- end to end ---------------------------------------------------------------------------------

_VOYAGE = """
schema_version = 1
name = "voyage"
vessel = "paper-asv"
scale = 1000
start = [118.75, 9.35]
goal = [119.15, 9.9]
[region]
bbox = {box}
[planner]
classes = 2
[[seasons]]
name = "july"
valid = "2024-07"
currents = ["copernicus-glorys-monthly"]
"""


def test_a_run_on_the_services_currents_is_credited_cached_and_keeps_the_account_secret(
    tmp_path: Path, across_outputs: Path
) -> None:
    output = tmp_path / "outputs"
    shutil.copytree(across_outputs / ".artefacts", output / ".artefacts")
    path = tmp_path / "voyage.toml"
    path.write_text(_VOYAGE.format(box=ACROSS_BOX))
    table = load_scenario("palawan-season").model_dump(mode="json")
    table["region"]["bbox"] = ACROSS_BOX
    across = Scenario.model_validate(table)
    ocean = Ocean(fetch(across, Store(output / ".artefacts"), offline=True).land.polygons)
    store = world.store(MONTHLY, ocean=ocean)
    with connected(store, tmp_path / "home"):
        ran = CliRunner().invoke(app, ["run", str(path), "--output", str(output)])
    assert ran.exit_code == 0, ran.output
    entry = spec(MONTHLY)

    manifest = json.loads((output / "voyage" / "manifest.json").read_text())
    (credit,) = manifest["current_sources"]
    assert (credit["season"], credit["valid"]) == ("july", "2024-07")
    assert credit["name"] == f"{entry.product}, {entry.dataset} {entry.version}"
    assert credit["text"] == entry.credit
    assert entry.credit in (output / "voyage" / "report.html").read_text()

    (file,) = (output / ".artefacts" / "downloads").glob("*.nc")
    sidecar = json.loads(file.with_suffix(".json").read_text())
    assert sidecar["sha256"] == file_hash(file)
    assert sidecar["retrieved_utc"] == credit["retrieved"]
    assert (sidecar["dataset"], sidecar["version"]) == (entry.dataset, entry.version)
    assert (sidecar["doi"], sidecar["request"]["times"]) == (entry.doi, ["2024-07"])

    for secret in (USERNAME, PASSWORD):
        assert secret not in ran.output
        for encoded in (secret.encode(), base64.b64encode(secret.encode()).rstrip(b"=")):
            written = [path for path in tmp_path.rglob("*") if path.is_file()]
            assert not [path.name for path in written if encoded in path.read_bytes()]

    # The service has stopped. The artefact of the current is enough, and so is the cached file
    # alone.
    moment, asked = datetime(2024, 7, 1, tzinfo=UTC), load_scenario(str(path))
    for _ in range(2):
        (grid,) = fetch(asked, Store(output / ".artefacts"), offline=True).currents
        assert world.max_error_m_s(grid, "uo", "vo", moment, ocean=ocean) < TOLERANCE_M_S
        shutil.rmtree(output / ".artefacts" / "current")


# --- The fault table: each row is injected into a download of the unmodified client ---


@pytest.mark.gate_share(3)
@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, id=row.name, marks=() if row.is_quick else (pytest.mark.slow,))
        for row in ROWS
    ],
)
def test_no_fault_causes_a_wrong_field_a_hang_or_leftovers(row: Row, tmp_path: Path) -> None:
    outcome = inject(row, tmp_path)
    assert not outcome.is_wrong(row), f"accepted, with an error of {outcome.error_m_s} m/s"
    assert not outcome.is_hung, f"took {outcome.seconds:.1f} s of {outcome.limit_s:.1f} s"
    assert not outcome.has_leftovers, f"left {outcome.leftovers}, {outcome.clients} clients"
    for part in row.message:
        assert part in outcome.reason
    assert bool(outcome.reason) == bool(row.message), outcome.reason
    for secret in (USERNAME, PASSWORD):
        assert secret not in outcome.reason
        assert secret not in outcome.written


# --- The process that downloads notes what was missing ---


def logged(*lines: str) -> AnswerLog:
    """Return the log after urllib3 has written some lines."""
    log = AnswerLog()
    for line in lines:
        log.emit(logging.LogRecord("urllib3", logging.DEBUG, "", 0, line, (), None))
    return log


def test_missing_chunks_are_noted(capsys: pytest.CaptureFixture[str]) -> None:
    store = "/arco/PRODUCT/data_202311/timeChunked.zarr"
    log = logged(
        f'http://mds.invalid:80 "GET {store}/uo/378.2.67.224?x-cop-user=nemo HTTP/1.1" 403 0',
        f'http://mds.invalid:80 "GET http://mds.invalid{store}/vo/1.2.3?x=y HTTP/1.1" 404 243',
        f'http://mds.invalid:80 "GET {store}/uo/378.2.67.225 HTTP/1.1" 200 1000',
        f'http://mds.invalid:80 "GET {store}/.zattrs HTTP/1.1" 403 0',
        "Starting new HTTPS connection (1): mds.invalid:443",
    )
    assert log.missing_chunks == {(store, (378, 2, 67, 224)), (store, (1, 2, 3))}
    assert capsys.readouterr().err == ""


def test_errors_of_the_service_are_reported_without_the_user_name(
    capsys: pytest.CaptureFixture[str],
) -> None:
    logged('http://mds.invalid:80 "GET /a.zarr/uo/1.2?x-cop-user=nemo HTTP/1.1" 503 0')
    assert capsys.readouterr().err == "the service answers 503 for /a.zarr/uo/1.2\n"


# --- Currents of the service that change on the way, through its unmodified client ---


DEPARTURE = datetime(2024, 7, 15, 8, 20, tzinfo=UTC)
HOUR = timedelta(hours=1)
HOURLY, SIX_HOURLY, DAILY, HOURLY_MEANS = (
    "copernicus-total-hourly",
    "copernicus-forecast-6hourly",
    "copernicus-forecast-daily",
    "copernicus-forecast-hourly",
)


def midnight(day: int) -> datetime:
    """Return a midnight of July 2024."""
    return datetime(2024, 7, day, tzinfo=UTC)


def fetched(name: str, hours: float, folder: Path, departure: datetime = DEPARTURE) -> CurrentGrid:
    """Fetch a voyage's currents as a run does, which first asks whether they are there."""
    asked = world.changing_season(name, departure, hours)
    assert source(name).uncovered_reason(REGION, asked) == ""
    return source(name).current(REGION, asked, LAND, folder)


# --- which steps --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "hours", "valid", "stamps"),
    [
        (HOURLY, 5.0, "08:00Z/14:00Z", [midnight(15) + k * HOUR for k in range(8, 15)]),
        (
            HOURLY_MEANS,
            3.0,
            "07:30Z/11:30Z",
            [midnight(15) + (k + 0.5) * HOUR for k in range(7, 12)],
        ),
        (
            SIX_HOURLY,
            20.0,
            "06:00Z/2024-07-16T06:00Z",
            [midnight(15) + k * HOUR for k in range(6, 31, 6)],
        ),
        (DAILY, 60.0, "", [midnight(day) for day in range(14, 19)]),
    ],
)
def test_all_steps_from_before_departure_to_the_last_arrival_are_fields(
    tmp_path: Path, name: str, hours: float, valid: str, stamps: list[datetime]
) -> None:
    with connected(world.store(name), tmp_path / "home"):
        grid = fetched(name, hours, tmp_path)
    entry = spec(name)
    # The service labels the mean of a day with its first moment; it is valid in the middle.
    to_middle = 12 * HOUR if name == DAILY else 0 * HOUR
    assert grid.times_s.tolist() == [
        (stamp + to_middle - DEPARTURE).total_seconds() for stamp in stamps
    ]
    assert grid.times_s[0] <= 0 < grid.times_s[1]
    assert grid.times_s[-2] < 3600 * hours <= grid.times_s[-1]
    for step, stamp in enumerate(stamps):
        error = world.max_error_m_s(grid, entry.eastward, entry.northward, stamp, step=step)
        assert error < TOLERANCE_M_S
    assert np.ptp(grid.u, axis=0)[np.isfinite(grid.u[0])].max() > 0.005, "they do change"
    if valid:
        first, last = valid.split("/")
        ends = (first, last if "T" in last else f"2024-07-15T{last}")
        assert grid.valid == f"2024-07-15T{ends[0]}/{ends[1]}"
    assert (Note.of("steps-are-means", step="day") in grid.notes) == (name == DAILY)


@pytest.mark.slow
def test_the_cache_serves_every_departure_with_the_same_steps(tmp_path: Path) -> None:
    store = world.store(SIX_HOURLY)
    with connected(store, tmp_path / "home"):
        early = fetched(SIX_HOURLY, 10, tmp_path / "cache", midnight(15) + 7 * HOUR)
        requests = len(store.requests)
        late = fetched(SIX_HOURLY, 9, tmp_path / "cache", midnight(15) + 8 * HOUR)
        assert len(store.requests) == requests, "nothing was requested"
        assert np.array_equal(early.u, late.u, equal_nan=True)
        assert (early.times_s - late.times_s == 3600).all()
        fetched(SIX_HOURLY, 11, tmp_path / "cache", midnight(15) + 8 * HOUR)
        assert len(store.requests) > requests, "a step more"


@pytest.mark.slow
def test_a_forecast_that_ends_before_the_last_arrival_is_taken_to_its_end(tmp_path: Path) -> None:
    departure = world.today() + timedelta(days=9, hours=2)
    with connected(world.store(SIX_HOURLY), tmp_path / "home"):
        grid = fetched(SIX_HOURLY, 500, tmp_path / "cache", departure)
        again = fetched(SIX_HOURLY, 500, tmp_path / "cache", departure)
    assert grid.times_s.tolist() == [3600.0 * hour for hour in range(-2, 41, 6)]
    assert np.array_equal(again.u, grid.u, equal_nan=True)
    last = world.today() + timedelta(days=10, hours=18)
    assert world.max_error_m_s(grid, "uo", "vo", last, step=-1) < TOLERANCE_M_S


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("is_listed", [False, True])
def test_a_hole_is_named_by_the_times_around_it(tmp_path: Path, is_listed: bool) -> None:
    whole = world.dataset(SIX_HOURLY).times
    steps = tuple(time for time in whole if time != midnight(16))
    store = world.store(
        SIX_HOURLY, times=whole if is_listed else steps, stored_times=steps if is_listed else None
    )
    with (
        connected(store, tmp_path / "home"),
        pytest.raises(StageError, match="between 2024-07-15T18 and 2024-07-16T06") as caught,
    ):
        fetched(SIX_HOURLY, 40, tmp_path)
    assert "name another" in str(caught.value)


@pytest.mark.slow
def test_a_chunk_that_is_lacking_at_one_time_alone(tmp_path: Path) -> None:
    """A part of the third step is not delivered; no gap is planned through."""
    store = world.store(SIX_HOURLY)
    # The client asks for the steps in their order.
    number = world.dataset(SIX_HOURLY).times.index(midnight(15) + 18 * HOUR)
    store.faults.append(Fault(f"*/uo/{number}.0.*", 404))
    store.faults.append(Fault(f"*/uo/{number // 64}.*", 404))
    with connected(store, tmp_path / "home"), pytest.raises(StageError, match="cells of water"):
        fetched(SIX_HOURLY, 20, tmp_path)
    assert not list(tmp_path.glob("*.nc"))


@pytest.mark.parametrize(
    ("name", "departure", "words"),
    [
        ("copernicus-glorys-climatology", DEPARTURE, "does not show how currents change"),
        # A day more than the ten: the test may run past midnight.
        (HOURLY, world.today() + timedelta(days=12, hours=1), "covers November 2020 to ten days"),
        (HOURLY, datetime(2020, 10, 31, 23, tzinfo=UTC), "covers November 2020 to ten days"),
        (DAILY, datetime(2020, 11, 1, 6, tzinfo=UTC), "from November 2020 at the earliest"),
    ],
)
def test_departures_without_steps_around_them_are_refused_without_a_request(
    name: str, departure: datetime, words: str
) -> None:
    asked = world.changing_season(name, departure, 24)
    reason = source(name).uncovered_reason(REGION, asked)
    assert words in reason
    assert f"{departure:%Y-%m-%dT%H:%MZ}" in reason
    assert "name another source in 'currents'" in reason
    assert source(name).identity(asked), "which is called first"
