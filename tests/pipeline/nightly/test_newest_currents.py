"""Which currents are newest: by files, by a loopback store of the service, or unknown."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pipeline.nightly.cases import expand
from pipeline.nightly.config import load_config
from pipeline.nightly.currents import ComeAgainError, Newest, newest_currents
from pipeline.nightly.cycles import cycle_time, is_cycle
from tests.loopback_store import world
from tests.loopback_store.world import connected
from tests.pipeline.nightly.nights import REFERENCE, region_night, write_forecast, write_night

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
