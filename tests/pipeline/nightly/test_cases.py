"""From a night's file to its cases: their names, departures and pairs."""

import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from pipeline.errors import RequestError
from pipeline.nightly.cases import all_cases, expand, read_pairs
from pipeline.nightly.config import DepartureSpec, load_config
from tests.pipeline.nightly.nights import plane_night, region_night

_HEAD = "start_lon,start_lat,goal_lon,goal_lat,name"
_ROW = "119.90,10.00,120.24,9.96,a"


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


def leaves(spec: DepartureSpec, reference: datetime) -> list[str]:
    """Return the departures after a reference time."""
    return [f"{one.after(reference):%d %b %H:%M}" for one in spec.departures()]


def test_names_are_the_same_each_night() -> None:
    spec = DepartureSpec(first="06:00Z", every="6h", count=5)
    assert [one.name for one in spec.departures()] == [
        "0600Z",
        "1200Z",
        "1800Z",
        "0000Z+1",
        "0600Z+1",
    ]


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        (datetime(2026, 11, 21, tzinfo=UTC), ["21 Nov 06:00", "22 Nov 18:00"]),
        (datetime(2026, 11, 21, 6, tzinfo=UTC), ["21 Nov 06:00", "22 Nov 18:00"]),
        (datetime(2026, 11, 21, 6, 1, tzinfo=UTC), ["22 Nov 06:00", "23 Nov 18:00"]),
        (datetime(2028, 2, 28, 12, tzinfo=UTC), ["29 Feb 06:00", "01 Mar 18:00"]),
        (datetime(2026, 12, 31, 23, 59, tzinfo=UTC), ["01 Jan 06:00", "02 Jan 18:00"]),
    ],
)
def test_the_first_is_at_or_after_the_reference_time(
    reference: datetime, expected: list[str]
) -> None:
    assert leaves(DepartureSpec(first="06:00Z", every="36h", count=2), reference) == expected


def _read(folder: Path, text: str) -> tuple[int, list[str]]:
    """Return the number of pairs in a file with a text, and its faults."""
    (folder / "pairs.csv").write_text(text)
    pairs, faults = read_pairs(folder / "pairs.csv", is_planar=False)
    return len(pairs), faults


def test_a_column_that_is_not_known_is_named_with_the_nearest_one(tmp_path: Path) -> None:
    read, faults = _read(tmp_path, f"{_HEAD},vessel,departure\n{_ROW},usv-7m,2026-11-22\n")
    assert read == 0
    assert [fault.partition(":")[0] for fault in faults] == ["pairs.csv, row 1"] * 2
    assert "unknown column 'vessel'" in faults[0]
    assert "unknown column 'departure'" in faults[1]
    _, faults = _read(tmp_path, f"{_HEAD.replace('goal_lat', 'goal_lta')}\n{_ROW}\n")
    assert "unknown column 'goal_lta': did you mean 'goal_lat'?" in faults[0]
    assert "has no column goal_lat" in faults[1]


def test_semicolons_are_refused_with_a_remedy_that_works(tmp_path: Path) -> None:
    head, row = _HEAD.replace(",", ";"), _ROW.replace(",", ";").replace(".", ",")
    read, faults = _read(tmp_path, f"{head}\n{row}\n")
    assert read == 0
    (fault,) = faults
    assert fault.startswith(
        "pairs.csv, row 1: is separated by ';'; separate by commas, with points"
    )
    mended = row.replace(",", ".").replace(";", ",")
    assert _read(tmp_path, f"{_HEAD}\n{mended}\n") == (1, [])
