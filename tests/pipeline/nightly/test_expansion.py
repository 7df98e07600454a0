"""From a night's file to its cases."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from pipeline.errors import RequestError
from pipeline.nightly.cases import all_cases, expand
from pipeline.nightly.config import load_config
from tests.pipeline.nightly.nights import plane_night, region_night


def test_some_of_many_cases_are_found_at_once(tmp_path: Path) -> None:
    file = plane_night(tmp_path, pairs=1000)
    departures = 'departures = { first = "06:00Z", every = "1min", count = 10_000 }\n'
    file.write_text(file.read_text() + departures)
    config, begun = load_config(file), time.process_time()
    found = expand(config, only="quick/still/p0007/0601Z+1")
    assert [case.name for case in all_cases(found)] == ["quick/still/p0007/0601Z+1"]
    assert [block.size for block in expand(config, only="quick/still/p0007/")] == [10_000]
    with pytest.raises(RequestError, match=r"there are 10,000,000 .*, more than 20,000; divide"):
        expand(config)
    assert time.process_time() - begun < 5


def test_files_of_currents_may_come_later_and_need_no_time_of_their_own(tmp_path: Path) -> None:
    file = region_night(tmp_path, departures=2)
    scenario = tmp_path / "region.toml"
    steady = 'valid = "2024-07"\ncurrents = ["still"]'
    text = scenario.read_text()
    scenario.write_text(text.replace(steady, 'currents = ["./later.nc"]'))
    (block,) = expand(load_config(file, tmp_path / "out"))
    assert block.scenario.seasons[0].currents == ((str(tmp_path / "later.nc"),),)
    # What the catalogue has is asked at once.
    scenario.write_text(text.replace(steady, 'valid = "2024-07"\ncurrents = ["embedded-hansando"]'))
    with pytest.raises(RequestError, match="embedded-hansando has no "):
        expand(load_config(file, tmp_path / "out"))
