"""A power cut at any moment of a night: what is published is whole, and is mended next."""

from __future__ import annotations

import shutil
from datetime import timedelta
from pathlib import Path

import pytest

from pipeline.nightly.config import load_config
from pipeline.nightly.night import run_night
from tests.pipeline.nightly.killed_nights import leftovers, night
from tests.pipeline.nightly.nights import REFERENCE, contents, region_night, write_forecast
from tests.robustness.disk import has_strace
from tests.robustness.power_cuts import Cuts

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not has_strace(), reason="needs strace, and the right to use it"),
]


def test_a_power_cut_in_a_night(tmp_path: Path, cluster: str) -> None:
    file, output = region_night(tmp_path, departures=2, workers=1), tmp_path / "out"
    forecast = tmp_path / "currents" / "m1.nc"
    write_forecast(forecast, REFERENCE - timedelta(days=1))
    run_night(load_config(file, output), scheduler=cluster)
    write_forecast(forecast, seed=7)
    shutil.copytree(output, tmp_path / "undisturbed", symlinks=True)
    run_night(load_config(file, tmp_path / "undisturbed"), scheduler=cluster)
    expected = contents(tmp_path / "undisturbed")
    cuts = Cuts(tmp_path, output, "latest", [*night(file, output)])

    def again() -> None:
        run_night(load_config(file, output), scheduler=cluster)
        assert contents(output) == expected
        assert leftovers(output) == []

    count = cuts.start_again(again)
    print(f"night: {cuts.summary}, {count} starts")  # noqa: T201
