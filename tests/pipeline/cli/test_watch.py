"""`renew watch` as a process: fed by a pipe or a file that grows, killed, begun again."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.conftest import ROOT
from tests.pipeline.processes import renew, started
from tests.pipeline.underway.sailing import rmc, sailed

Damage = Callable[[str, str, str], Path]
# Longer than a watch looks away from its file, s.
PAUSE_S = 1.5


@contextlib.contextmanager
def following(*command: str) -> Iterator[tuple[subprocess.Popen[str], Callable[[], str]]]:
    """Start a watch, with a function that waits for its next line; killed after two minutes."""
    with started(*command, cwd=ROOT) as process:
        assert process.stdout is not None
        timer = threading.Timer(120, process.kill)
        timer.start()
        try:
            yield process, process.stdout.readline
        finally:
            timer.cancel()


def lines(results: Path, *, until: float = 6000.0, every: float = 20.0) -> list[str]:
    """A voyage that drifts off its plan and comes back, again and again."""
    seconds = np.arange(0.0, until, every)
    places = sailed(results, seconds)
    places[:, 1] += 0.01 * np.sin(seconds / 900)
    return [rmc(at, *place) for at, place in zip(seconds, places.tolist(), strict=True)]


def watch(results: Path, *args: str, text: str = "") -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["watch", str(results), *args], input=text)
    return done.exit_code, done.stdout, done.stderr


def piped(results: Path, data: bytes) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        renew("watch", str(results), "--positions", "-"), input=data, capture_output=True,
        check=True, cwd=ROOT,
    )  # fmt: skip


def test_a_pipe_and_a_file_give_the_same_events(results: Path, tmp_path: Path) -> None:
    file = tmp_path / "positions.nmea"
    file.write_text("\r\n".join(lines(results)) + "\r\n$GPRMC,1")
    done = piped(results, file.read_bytes())
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert {one["event"] for one in events} == {"on_plan", "off_plan", "replan"}
    assert b"positions: 300; 1 broken" in done.stderr
    code, text, errors = watch(results, "--positions", str(file), "--once")
    assert (code, text) == (0, done.stdout.decode())
    assert "positions: 300; 1 broken" in errors


def test_killed_and_begun_again_it_says_the_same(results: Path, tmp_path: Path) -> None:
    """It is killed while the file grows, several times; the last one is interrupted."""
    file, rng = tmp_path / "positions.nmea", random.Random(3)  # noqa: S311 - a test's seed
    stream = "\n".join(lines(results)).encode() + b"\n"
    whole = piped(results, stream).stdout.decode().splitlines()
    file.write_bytes(b"")
    command = renew("watch", str(results), "--positions", str(file))
    for share in (0.3, 0.7):
        with file.open("ab") as growing:
            growing.write(stream[file.stat().st_size : int(share * len(stream))])
        with following(*command) as (process, line):
            said = [line() for _ in range(rng.randint(1, 4))]
            process.kill()
        assert [one.strip() for one in said] == whole[: len(said)]
    with following(*command) as (process, line):
        first = line()
        with file.open("ab") as growing:
            growing.write(stream[file.stat().st_size :])
        said = [first, *(line() for _ in whole[1:])]
        time.sleep(PAUSE_S)  # positions after the last event
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=30)
    assert [one.strip() for one in said] == whole
    assert (rest, process.returncode) == ("", 128 + signal.SIGINT)
    assert errors.splitlines()[-1] == "positions: 300"


def test_a_log_that_is_rotated_is_followed(results: Path, tmp_path: Path) -> None:
    file, sentences = tmp_path / "positions.nmea", lines(results, until=400, every=100)
    file.write_text(sentences[0] + "\n")
    command = renew("watch", str(results), "--positions", str(file), "--every", "1min")
    with following(*command) as (process, line):
        assert json.loads(line())["time"] == "2026-11-22T06:20:00Z"
        file.rename(tmp_path / "positions.1")
        file.write_text(sentences[1] + "\n")
        assert json.loads(line())["time"] == "2026-11-22T06:21:40Z"
        file.write_text("")  # cut short in place
        time.sleep(PAUSE_S)
        with file.open("a") as growing:
            growing.write(sentences[2][:20])
            growing.flush()
            time.sleep(PAUSE_S)
            growing.write(sentences[2][20:] + "\n")
        assert json.loads(line())["time"] == "2026-11-22T06:23:20Z"
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) == 128 + signal.SIGTERM


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--positions", "missing.nmea"], "missing.nmea can't be read (No such file"),
        (["--positions", "-", "--season", "winter"], "'winter' was not planned"),
        (["--positions", "-", "--every", "soon"], "--every = 'soon' is not an interval"),
        (["--positions", "-", "--departed", "noon"], "--departed noon is not a time"),
        (["--positions", "-", "--departed", "2026-11-22T06:00Z"], "leave the option out"),
    ],
)
def test_a_wrong_request_has_one_clear_error(results: Path, args: list[str], said: str) -> None:
    code, text, errors = watch(results, *args)
    assert (code, text) == (2, "")
    assert said in errors
    assert len(errors.splitlines()) == 1


@pytest.fixture
def damaged(results: Path, tmp_path: Path) -> Damage:
    """A function that copies the results with one text replaced in a file."""

    def damage(name: str, old: str, new: str) -> Path:
        folder = tmp_path / "copy"
        folder.mkdir(exist_ok=True)
        for file in results.iterdir():
            if file.suffix in {".json", ".geojson"}:
                (folder / file.name).write_bytes(file.read_bytes())
        changed = (folder / name).read_text()
        assert old in changed
        (folder / name).write_text(changed.replace(old, new))
        return folder

    return damage


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("manifest.json", '"schema_version": 1', '"schema_version": 9'),
        ("manifest.json", '"seasons"', '"saisons"'),
        ("manifest.json", "{", "["),
        ("strait-tide.geojson", '"port_m"', '"left_m"'),
        ("strait-tide.geojson", '"waypoint"', '"point"'),
        ("strait-tide.geojson", '"geometry_type": "Loxodrome"', '"geometry_type": null'),
        ("strait-tide.geojson", "119.0", '"119.0'),
    ],
)
def test_damaged_results_are_refused(damaged: Damage, name: str, old: str, new: str) -> None:
    folder = damaged(name, old, new)
    code, _, errors = watch(folder, "--positions", "-", text="")
    assert code == 2, errors
    assert "run the scenario again" in errors


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    code, _, errors = watch(tmp_path, "--positions", "-")
    assert code == 2
    assert "manifest.json does not exist; give the folder of a finished run" in errors


@pytest.mark.slow
def test_a_million_lines_need_little_memory(results: Path, tmp_path: Path) -> None:
    """A tenth of them are damaged; memory is the process's own, as the system measures it."""
    file, rng = tmp_path / "positions.nmea", np.random.default_rng(1)
    sentences = lines(results, until=200_000.0, every=0.2)
    assert len(sentences) == 1_000_000
    for at in rng.choice(len(sentences), 100_000, replace=False).tolist():
        sentences[at] = sentences[at][: rng.integers(1, 60)]
    file.write_text("\n".join(sentences))
    # The kernel's high-water mark: that of `getrusage` begins with the memory of this process.
    code = (
        "import re, sys; from pathlib import Path; from pipeline.cli.main import app; "
        f"app({['watch', str(results), '--positions', str(file), '--once']!r}, "
        "standalone_mode=False); "
        "status = Path('/proc/self/status').read_text(); "
        "print(re.search(r'VmHWM:\\s+(\\d+)', status)[1], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    said, memory_kb = done.stderr.splitlines()[-2:]
    assert said.startswith("positions: 900,000; 100,000 broken"), said
    assert int(memory_kb) * 1024 < 200e6
