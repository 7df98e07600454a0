"""The text file of a night, read by the monitoring system's own parser."""

from __future__ import annotations

import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from pipeline.cli.night_watch import write_metrics
from pipeline.nightly.night import NightOutcome

NIGHT = NightOutcome(
    cycle="2026-11-21T00Z",
    started=datetime(2026, 11, 21, 2, tzinfo=UTC),
    finished=datetime(2026, 11, 21, 3, 30, 0, 250_000, tzinfo=UTC),
    reference_time=datetime(2026, 11, 21, tzinfo=UTC),
    exit_code=0,
    cases_by_outcome={"same": 997, "look": 2, "act": 1},
    seconds_by_stage={"plan": 4000.12345, "publish": 12.0},
)
NEXT_EVENING = timedelta(hours=22)
Samples = dict[tuple[str, tuple[str, ...]], float]


def read(text: str) -> Samples:
    """Values by the names of metrics, without their common beginning, and the labels' values."""
    return {
        (one.name.removeprefix("renew_nightly_"), tuple(one.labels.values())): one.value
        for family in text_string_to_metric_families(text)
        for one in family.samples
        if family.type == "gauge" and family.documentation
    }


def test_a_night_is_read_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "metrics" / "renew.prom"
    assert write_metrics(path, NIGHT) == ""
    assert read(path.read_text("utf-8")) == {
        ("last_success_timestamp_seconds", ()): NIGHT.finished.timestamp(),
        ("forecast_reference_timestamp_seconds", ()): 1795219200.0,
        ("last_run_timestamp_seconds", ()): NIGHT.finished.timestamp(),
        ("last_exit_code", ()): 0,
        ("stage_seconds", ("plan",)): 4000.123,
        ("stage_seconds", ("publish",)): 12.0,
        ("cases", ("same",)): 997,
        ("cases", ("look",)): 2,
        ("cases", ("act",)): 1,
    }
    assert [file.name for file in path.parent.iterdir()] == ["renew.prom"]
    assert path.stat().st_mode & 0o044 == 0o044, "the exporter is another user"


@pytest.mark.parametrize("code", [1, 3, 5, 143])
def test_a_night_that_failed_keeps_the_last_success(tmp_path: Path, code: int) -> None:
    path = tmp_path / "renew.prom"
    later = replace(
        NIGHT,
        finished=NIGHT.finished + NEXT_EVENING,
        reference_time=NIGHT.finished,
        exit_code=code,
        cases_by_outcome={},
    )
    write_metrics(path, NIGHT)
    for _ in range(2):
        write_metrics(path, later)
    found = read(path.read_text("utf-8"))
    assert found["last_success_timestamp_seconds", ()] == NIGHT.finished.timestamp()
    assert found["forecast_reference_timestamp_seconds", ()] == 1795219200.0
    assert found["last_run_timestamp_seconds", ()] == later.finished.timestamp()
    assert found["last_exit_code", ()] == code
    assert ("cases", ("same",)) not in found
    # Published, though with something to look at: counts as a success again.
    write_metrics(path, replace(later, exit_code=10))
    found = read(path.read_text("utf-8"))
    assert found["last_success_timestamp_seconds", ()] == later.finished.timestamp()


@pytest.mark.parametrize("damaged", [b"", b"\xff\xfe", b"renew_nightly_last_success_time"])
def test_without_an_earlier_success_none_is_made_up(tmp_path: Path, damaged: bytes) -> None:
    path = tmp_path / "renew.prom"
    path.write_bytes(damaged)
    write_metrics(path, replace(NIGHT, exit_code=1, reference_time=None))
    found = read(path.read_text("utf-8"))
    assert ("last_success_timestamp_seconds", ()) not in found
    assert ("forecast_reference_timestamp_seconds", ()) not in found


def test_a_reader_never_sees_half_a_file(tmp_path: Path) -> None:
    path = tmp_path / "renew.prom"
    many = {f"outcome-{number}": number for number in range(2000)}
    night = replace(NIGHT, cases_by_outcome=many)
    write_metrics(path, night)
    written = threading.Event()

    def write() -> None:
        for _ in range(20):
            write_metrics(path, night)
        written.set()

    writer = threading.Thread(target=write)
    writer.start()
    seen = set()
    while not written.is_set():
        seen.add(path.read_text("utf-8"))
    writer.join()
    assert [len(read(text)) for text in seen] == [len(read(path.read_text("utf-8")))]


def test_a_failure_to_write_is_reported_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert write_metrics(tmp_path / "file" / "renew.prom", NIGHT).startswith(
        f"--metrics: can't write {tmp_path}/file/renew.prom: "
    )
    (tmp_path / "renew.prom").mkdir()
    assert "renew.prom: Is a directory" in write_metrics(tmp_path / "renew.prom", NIGHT)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file", "renew.prom"]
