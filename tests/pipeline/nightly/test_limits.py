"""Nights with limits of waves: each departure has hours of its own, and new waves are planned."""

from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pipeline.nightly.config import load_config
from pipeline.nightly.night import NightOutcome, run_night
from tests.pipeline.nightly.nights import REFERENCE, region_night, rows, write_forecast

HOURS = 96


def write_waves(path: Path, until: int) -> None:
    """Write waves of 2 m everywhere for some hours, and of half a metre after them."""
    lon, lat = np.arange(118.0, 119.5, 0.25), np.arange(9.0, 10.7, 0.25)
    height = np.full((HOURS, lat.size, lon.size), 0.5)
    height[:until] = 2.0
    begin = np.datetime64(REFERENCE.replace(tzinfo=None), "ns")
    axes = {
        "time": begin + np.arange(HOURS).astype("timedelta64[h]").astype("timedelta64[ns]"),
        "latitude": ("latitude", lat, {"units": "degrees_north"}),
        "longitude": ("longitude", lon, {"units": "degrees_east"}),
    }
    about = {"units": "m", "standard_name": "sea_surface_wave_significant_height"}
    waves = xr.Dataset({"swh": (("time", "latitude", "longitude"), height, about)}, axes)
    waves.to_netcdf(path, engine="netcdf4")


def limited_night(folder: Path, limits: str) -> Path:
    """Write a night at true scale with limits."""
    file = region_night(folder, departures=2)
    scenario = folder / "region.toml"
    text = scenario.read_text().replace("scale = 1000", "scale = 1")
    scenario.write_text(f"{text}[limits]\n{limits}\n")
    write_forecast(folder / "currents" / "one.nc", steps=20, changes=True)
    return file


def _run(file: Path, cluster: str) -> NightOutcome:
    return run_night(load_config(file, file.parent / "out"), scheduler=cluster)


@pytest.mark.slow
def test_a_departure_into_waves_fails_and_a_later_one_is_planned(
    tmp_path: Path, cluster: str
) -> None:
    file = limited_night(tmp_path, 'waves = ["waves.nc"]\nwave_m = 1.2')
    write_waves(tmp_path / "waves.nc", until=9)
    _run(file, cluster)
    early, late = rows(tmp_path / "out")
    assert early["status"] == "failed"
    assert (
        "the start 118.4000 E 10.2000 N lies in water with waves of up to 2.0 m" in early["reason"]
    )
    assert "2026-11-21 09:00 UTC" in early["reason"]
    assert late["status"] == "planned"
    assert late["leaves"] - early["leaves"] == timedelta(hours=6)
    assert late["worst_wave_m"] == pytest.approx(0.5)
    write_waves(tmp_path / "waves.nc", until=0)
    _run(file, cluster)
    assert [row["status"] for row in rows(tmp_path / "out")] == ["planned", "planned"]
