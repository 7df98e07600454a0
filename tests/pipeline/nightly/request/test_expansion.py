"""From a night's file to its cases."""

from __future__ import annotations

import time
from pathlib import Path

from pipeline.nightly.request.config import load_config
from pipeline.nightly.request.expansion import expand
from tests.pipeline.nightly.nights import plane_night


def test_a_case_is_found_among_millions_at_once(tmp_path: Path) -> None:
    file = plane_night(tmp_path, pairs=1000)
    departures = 'departures = { first = "06:00Z", every = "1min", count = 10_000 }\n'
    file.write_text(file.read_text() + departures)
    config, begun = load_config(file), time.process_time()
    found = expand(config, only="quick/still/p0007/0601Z+1", yes=True)
    assert [case.name for case in found] == ["quick/still/p0007/0601Z+1"]
    assert len(expand(config, only="quick/still/p0007/", yes=True)) == 10_000
    assert len(expand(config, only="quick/still", yes=True)) == 10_000_000
    assert time.process_time() - begun < 5
