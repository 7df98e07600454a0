"""Forecasts that nights keep: their fields at tonight's valid times are members of its currents."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import renew
from pipeline.errors import RequestError
from pipeline.findings.choices import ENSEMBLE_FIGURES, ensemble_figures, side_shares
from pipeline.machine.store import load_artefact
from pipeline.nightly.cases import expand
from pipeline.nightly.config import NightConfig, load_config
from pipeline.nightly.currents import (
    ComeAgainError,
    keep_forecasts,
    kept_forecasts,
    newest_currents,
)
from pipeline.nightly.night import run_night
from pipeline.nightly.worker import NightCurrent
from pipeline.scenario.loading import load_scenario
from pipeline.sources.current_field import Field
from tests.pipeline.nightly.nights import REFERENCE, plane_night, region_night, rows
from tests.pipeline.results import result_of
from tests.pipeline.synthetic_currents import dataset, sea, write

_LON, _LAT = np.arange(117.0, 121.0, 0.25), np.arange(8.0, 12.0, 0.25)
_DAY, _STEPS = timedelta(days=1), 10
# Error of a forecast at its reference time (m/s, rms), and the factor by which it grows in a day.
_ERROR, _GROWTH = 0.02, 1.3


def truth(day: int) -> Field:
    """Return the current of a day after the reference time."""
    return sea(_LON, _LAT, seed=100 + day, speed_m_s=0.3)


def forecast(issued: int, day: int) -> Field:
    """Return the forecast of a day, issued on another: its error grows, and has its own pattern."""
    true, error = truth(day), sea(_LON, _LAT, seed=500 + issued, speed_m_s=_ERROR)
    grown = _GROWTH ** (day - issued)
    return Field(_LON, _LAT, true.u + grown * error.u, true.v + grown * error.v)


def issue(file: Path, issued: int) -> None:
    """Write the forecast that is issued on a day, in place of the one before."""
    days = range(issued, issued + _STEPS)
    times = [(REFERENCE + day * _DAY).replace(tzinfo=None) for day in days]
    data = dataset(*(forecast(issued, day) for day in days), times=times)
    reference = np.datetime64(times[0], "ns")
    about = ((), reference, {"standard_name": "forecast_reference_time"})
    file.parent.mkdir(exist_ok=True)
    write(file, data.assign_coords(forecast_reference_time=about))


def kept_night(folder: Path, members: str = "{}", departures: int = 1) -> NightConfig:
    """Return a night whose members are the forecasts that it keeps."""
    file = region_night(folder, departures)
    scenario = folder / "region.toml"
    tonight = f'["./tonight.nc"]\nmembers = {members}'
    scenario.write_text(scenario.read_text().replace('["still"]', tonight))
    text = file.read_text().replace('members = "currents/*.nc"\n', "")
    text = text.replace('"06:00Z", every = "6h"', '"00:00Z", every = "1d"')
    file.write_text(text)
    return load_config(file, folder / "out")


def keep(config: NightConfig, *, prune: bool = True) -> None:
    """Keep tonight's forecast, as a night does."""
    cases = expand(config)
    newest = newest_currents(cases, datetime.now(UTC))
    keep_forecasts(config.output, cases, newest, prune=prune)


@pytest.mark.slow
def test_members_are_earlier_forecasts_of_the_same_time_and_spread_as_errors_grow(
    tmp_path: Path, cluster: str
) -> None:
    config, tonight = kept_night(tmp_path, departures=3), 4
    for issued in range(tonight + 1):
        issue(tmp_path / "tonight.nc", issued)
        if issued < tonight:
            keep(config)
    assert run_night(config, scheduler=cluster).exit_code == 0

    table = rows(config.output)
    names = [f"{REFERENCE + day * _DAY:%Y-%m-%dT0000Z}" for day in range(tonight, -1, -1)]
    stored = (config.output / ".artefacts" / "night-current").iterdir()
    found = [one for path in stored if (one := load_artefact(path, NightCurrent)) is not None]
    spreads, errors = list[float](), list[float]()
    points = np.random.default_rng(0).uniform(0.2, 0.8, (400, 2))
    for lead, one in enumerate(sorted(found, key=lambda current: current.valid)):
        assert one.members is not None
        assert one.members.names == tuple(names)
        first = one.members.currents[0]
        assert isinstance(first, renew.GriddedCurrent)
        places = np.array([first.x[-1], first.y[-1]]) * points
        flow = np.array([member(places) for member in one.members.currents])
        assert np.allclose(flow.mean(axis=0), one.current(places))
        spreads.append(float(np.sqrt(((flow - flow.mean(axis=0)) ** 2).sum(axis=-1).mean())))
        made, true = forecast(tonight, tonight + lead), truth(tonight + lead)
        errors.append(float(np.sqrt(np.mean((made.u - true.u) ** 2 + (made.v - true.v) ** 2))))
    assert len(found) == len(table) == 3
    for series in (spreads, errors):
        growth = [later / earlier for earlier, later in itertools.pairwise(series)]
        assert growth == pytest.approx([_GROWTH] * 2, rel=0.02)

    for row in table:
        assert row["members_count"] == tonight + 1
        assert 0 <= row["members_flips"] <= row["members_count"]
        assert row["members_p90_fuel"] >= row["members_mean_fuel"] * 0.99
        assert 0 <= row["members_gap"] < 1
        assert row["members_waiting_saves"] >= 0
        assert " in " in row["members_sides"]
        assert not row["members_left_out"]
    page = (config.output / "latest" / "index.html").read_text()
    assert "How sure" in page
    assert f"{table[0]['members_flips'] or 'none'} of 5" in page
    head = (config.output / "latest" / "changes.csv").read_text().strip().split(",")
    assert {"members_count", "members_flips", "members_sides"} <= set(head)


@pytest.mark.slow
def test_the_first_night_plans_in_its_only_forecast(tmp_path: Path, cluster: str) -> None:
    config = kept_night(tmp_path / "kept")
    issue(tmp_path / "kept" / "tonight.nc", 0)
    run_night(config, scheduler=cluster)
    plain = kept_night(tmp_path / "plain")
    scenario = tmp_path / "plain" / "region.toml"
    scenario.write_text(scenario.read_text().replace("members = {}", ""))
    issue(tmp_path / "plain" / "tonight.nc", 0)
    run_night(plain, scheduler=cluster)
    (one,), (other,) = rows(config.output), rows(plain.output)
    assert one == other
    assert one["members_count"] is None


def test_a_quantile_of_few_forecasts_is_refused(tmp_path: Path, cluster: str) -> None:
    config = kept_night(tmp_path, '{ choose = "p90" }')
    issue(tmp_path / "tonight.nc", 0)
    keep(config)
    issue(tmp_path / "tonight.nc", 1)
    with pytest.raises(ComeAgainError, match=r"2 of 2 members can be used, and members\.choose"):
        run_night(config, scheduler=cluster)


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
    close = "" if found.is_sure else "too close to call: "
    assert case["members_sides"] == close + side_shares(found, own)


def test_what_is_kept(tmp_path: Path) -> None:
    """The newest `count` forecasts; a changed one is copied again, and later ones don't count."""
    config, file = kept_night(tmp_path, "{ count = 2 }"), tmp_path / "tonight.nc"
    folder = config.output / ".forecasts"
    for issued in range(4):
        issue(file, issued)
        keep(config, prune=issued == 3)
    names = [path.name for path in sorted(folder.glob("*/*Z"))]
    assert names == ["2026-11-23T0000Z", "2026-11-24T0000Z"]
    (copy,) = folder.glob("*/2026-11-24T0000Z/tonight.nc")
    assert copy.read_bytes() == file.read_bytes()
    before = copy.stat().st_ino
    keep(config)
    assert copy.stat().st_ino == before
    write(file, dataset(forecast(3, 4), times=["2026-11-25"]))
    issue(file, 3)
    keep(config)
    assert copy.stat().st_ino != before

    season = expand(config)[0].seasons[0]
    issue(file, 2)
    (found,) = kept_forecasts(config.output, season, season.currents)
    assert isinstance(found, tuple)
    assert [Path(one).parent.name for one in found] == ["2026-11-23T0000Z"]
    file.unlink()
    assert kept_forecasts(config.output, season, season.currents) == ()


def test_only_a_night_keeps_forecasts(tmp_path: Path) -> None:
    kept_night(tmp_path)
    with pytest.raises(RequestError, match=r"seasons\[0\]\.members \(season 'now'\) has neither"):
        load_scenario(str(tmp_path / "region.toml"))


def test_forecasts_are_kept_of_files_alone(tmp_path: Path) -> None:
    config = kept_night(tmp_path)
    config.path.write_text(config.path.read_text() + 'currents = ["copernicus-forecast-daily"]\n')
    with pytest.raises(RequestError, match="'members' of earlier forecasts, which needs files in"):
        expand(load_config(config.path, config.output))
