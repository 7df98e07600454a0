"""The service of currents fails at night: a loopback store without a login, or without data."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from distributed import LocalCluster

from pipeline.nightly.config import NightConfig, load_config
from pipeline.nightly.currents import ComeAgainError
from pipeline.nightly.night import run_night
from pipeline.scenario import catalogue
from tests.loopback_store import world
from tests.loopback_store.datasets import Ocean
from tests.loopback_store.server import Fault, LoopbackStore
from tests.pipeline.nightly.nights import contents, region_night, rows

FORECAST = "copernicus-forecast-daily"
LOGIN = "*/openid-connect/token"


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Give a scheduler whose worker is a thread of this process, which asks the service once."""
    once = world.spec(FORECAST).model_copy(update={"attempts": 1, "deadline_s": 90.0})
    source = catalogue.source
    monkeypatch.setattr(
        catalogue, "source", lambda name: once if name == FORECAST else source(name)
    )
    # Fewer of the client's own attempts, which take two minutes otherwise.
    monkeypatch.setenv("COPERNICUSMARINE_HTTPS_RETRIES", "1")
    with LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        host="127.0.0.1",
        dashboard_address=":0",
    ) as cluster:
        yield str(cluster.scheduler_address)


def forecast_night(folder: Path) -> NightConfig:
    """Read a night of two departures, a day apart, on the service's forecast."""
    file = region_night(folder)
    text = file.read_text().replace('members = "currents/*.nc"', f'currents = ["{FORECAST}"]')
    file.write_text(text.replace('every = "6h"', 'every = "24h"'))
    return load_config(file, folder / "out")


@contextlib.contextmanager
def service(
    home: Path, last: datetime, *faults: Fault, data_until: datetime | None = None
) -> Iterator[LoopbackStore]:
    """Run the service with a forecast up to a day, and with data as far as that or less."""
    data = world.dataset(FORECAST, ends=last.date().isoformat())
    if data_until is not None:
        there = tuple(time for time in data.times if time <= data_until)
        data = replace(data, stored_times=there)
    store = LoopbackStore(Ocean(), (data,), world.authority(), list(faults))
    with world.connected(store, home):
        yield store


@pytest.mark.slow
def test_a_login_that_fails_leaves_the_last_night_and_the_next_run_makes_it_up(
    tmp_path: Path, threads: str
) -> None:
    config, home = forecast_night(tmp_path), tmp_path / "home"
    tonight = world.today() - timedelta(days=3)  # no departure on the same day as those before
    with service(home, tonight - timedelta(days=2)):
        before = run_night(config, scheduler=threads)
    assert [row["status"] for row in rows(config.output)] == ["planned"] * 2
    with (
        service(home, tonight, Fault(LOGIN, 503)) as store,
        pytest.raises(ComeAgainError, match=r"no currents are there yet: .*auth\.marine\.cop"),
    ):
        run_night(config, scheduler=threads)
    assert any(path.endswith("/token") for _, path, _ in store.requests)
    assert (config.output / "latest").resolve().name == before.cycle
    with service(home, tonight):
        after = run_night(config, scheduler=threads)
    assert after.cycle.startswith(f"{tonight:%Y-%m-%d}")
    assert [row["status"] for row in rows(config.output)] == ["planned"] * 2
    # As if the login had never failed.
    other = replace(config, output=tmp_path / "undisturbed")
    with service(home, tonight - timedelta(days=2)):
        run_night(other, scheduler=threads)
    with service(home, tonight):
        run_night(other, scheduler=threads)
    assert contents(config.output) == contents(other.output)


@pytest.mark.slow
def test_a_login_that_fails_between_two_downloads_fails_the_cases_of_the_second(
    tmp_path: Path, threads: str
) -> None:
    config = forecast_night(tmp_path)
    tonight = world.today() - timedelta(days=3)
    with service(tmp_path / "home", tonight, Fault(LOGIN, 503, after=1)):
        outcome = run_night(config, scheduler=threads)
    assert outcome.exit_code == 10
    planned, failed = rows(config.output)
    assert (planned["status"], failed["status"]) == ("planned", "failed")
    assert "auth.marine.copernicus.eu can't be reached" in failed["reason"]
    assert (failed["outcome"], failed["routes"]) == ("act", 0)


@pytest.mark.slow
def test_half_a_forecast_of_the_service_is_planned_as_far_as_its_data_go(
    tmp_path: Path, threads: str
) -> None:
    """Its catalogue names all steps, but only the first departure's day has data."""
    config = forecast_night(tmp_path)
    tonight = world.today() - timedelta(days=3)
    first = tonight - timedelta(days=world.spec(FORECAST).days_ahead)
    with service(tmp_path / "home", tonight, data_until=first):
        outcome = run_night(config, scheduler=threads)
    assert outcome.exit_code == 10
    assert outcome.cycle.startswith(f"{tonight:%Y-%m-%d}")
    planned, failed = rows(config.output)
    assert (planned["status"], failed["status"]) == ("planned", "failed")
    assert planned["leaves"].date() == first.date()
    assert "its times are" in failed["reason"]
