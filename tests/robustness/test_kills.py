"""A run may be killed in any stage: the next one ends as if nothing had happened."""

from __future__ import annotations

import collections
import contextlib
import json
import queue
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.pipeline.processes import started
from tests.pipeline.small_region import small_region
from tests.pipeline.synthetic_currents import dataset, sea, write
from tests.robustness.frozen_clock import frozen_clock

STAGES = ("fetch", "simplify", "project", "plan", "evaluate", "write")
EXIT_CODES = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
# Time within which any stage begins or ends, s.
_LONG_S = 300.0
# Artefacts of the fetch, which takes as long as all other stages together.
_FETCHED = ("land", "current", "downloads")
_BEGUN = re.compile(r'"stage": "(\w+)", "event": "begun"')


@dataclass(frozen=True)
class Bench:
    """An output folder to be copied and run in, and how it looks before and after a whole run.

    `start` holds the results of an earlier version of the scenario; `fetched` artefacts that
    spare the fetch. `old` and `new` are the results' contents by file name, `paths` all that is in
    the output folder after a run.
    """

    scenario: Path
    start: Path
    fetched: Path
    old: dict[str, bytes]
    new: dict[str, bytes]
    paths: set[str]
    seconds: dict[str, float]

    @classmethod
    def prepare(cls, folder: Path, earlier: str, text: str) -> Bench:
        """Run an earlier version of a scenario, then the present one, without disturbance."""
        # The manifest names the folder that the command line names, without those around it.
        scenario, start, end = (folder / name for name in ("scenario.toml", "start/out", "end/out"))
        scenario.write_text(earlier)
        run_to_the_end(scenario, start)
        old = results(start)
        for artefacts in (start / ".artefacts").iterdir():
            if artefacts.is_dir():
                shutil.rmtree(artefacts)
        scenario.write_text(text)
        shutil.copytree(start, end, symlinks=True)
        seconds = _durations(scenario, end)
        return cls(scenario, start, end / ".artefacts", old, results(end), paths_in(end), seconds)

    def output(self, stage: str) -> Path:
        """Return a new output folder for a run that is to be killed in a stage."""
        output = self.start.parents[1] / "killed" / self.start.name
        shutil.rmtree(output, ignore_errors=True)
        shutil.copytree(self.start, output, symlinks=True)
        if stage != "fetch":
            for name in _FETCHED:
                with contextlib.suppress(FileNotFoundError):
                    shutil.copytree(self.fetched / name, output / ".artefacts" / name)
        return output


def killed(bench: Bench, stage: str, fraction: float, number: signal.Signals) -> tuple[Path, str]:
    """Kill a run some way through a stage; return its output folder, and where it was killed."""
    while True:
        output = bench.output(stage)
        with started(*_command(bench.scenario, output)) as process:
            lines = _Lines(process)
            if stage == "evaluate":
                _wait_for_plan(output, process)
            else:
                lines.wait_for(stage)
            time.sleep(fraction * bench.seconds[stage])
            process.send_signal(number)
            code = process.wait(_LONG_S)
            place = lines.last_stage()
        if code == 0:  # this run was faster than the first one, and had ended
            fraction *= 0.8
            continue
        assert code == EXIT_CODES[number], (stage, fraction, number, code, lines.seen[-5:])
        if place == "plan" and _count(output, "plan") > _count(output, "evaluate"):
            place = "evaluate"
        return output, place


def run_to_the_end(scenario: Path, output: Path) -> None:
    """Run a scenario without disturbance, in this process."""
    arguments = _arguments(scenario, output)
    with frozen_clock(), mock.patch.object(sys, "argv", ["frozen_clock.py", *arguments]):
        done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output


def results(output: Path) -> dict[str, bytes]:
    """Return the content of the files that the scenario's link leads to."""
    (link,) = (path for path in output.iterdir() if path.is_symlink())
    return {path.name: path.read_bytes() for path in link.iterdir()}


def paths_in(output: Path) -> set[str]:
    """Return all paths below an output folder, without the random names of results' folders."""
    return {
        re.sub(r"[0-9a-f]{32}(?=/|$)", "*", str(path.relative_to(output)))
        for path in output.rglob("*")
        if path.suffix != ".artefact"
    } | {str(path.relative_to(output)) for path in output.rglob("*.artefact")}


class _Lines:
    """The lines that a process writes to standard error, read as they come."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.seen: list[str] = []
        self._waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._read, args=(process,), daemon=True)
        self._thread.start()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        for line in process.stderr:
            self.seen.append(line)
            self._waiting.put(line)
        self._waiting.put("")

    def wait_for(self, stage: str, event: str = "begun") -> None:
        """Wait until an event of a stage is reported."""
        while f'"stage": "{stage}", "event": "{event}"' not in (
            line := self._waiting.get(timeout=_LONG_S)
        ):
            assert line, self.seen[-5:]

    def last_stage(self) -> str:
        """Return the stage that began last; the process must have ended."""
        self._thread.join(_LONG_S)
        return [found[1] for line in self.seen if (found := _BEGUN.search(line))][-1]


def _arguments(scenario: Path, output: Path) -> list[str]:
    return ["run", str(scenario), "--output", str(output), "--offline", "--json"]


def _command(scenario: Path, output: Path) -> list[str]:
    return [sys.executable, "-m", "tests.robustness.frozen_clock", *_arguments(scenario, output)]


def _count(output: Path, stage: str) -> int:
    """Return the number of a stage's artefacts."""
    return len(list(output.glob(f".artefacts/{stage}/*.artefact")))


def _wait_for_plan(output: Path, process: subprocess.Popen[str]) -> None:
    """Wait until a season is planned, and so is being evaluated."""
    deadline = time.monotonic() + _LONG_S
    while not _count(output, "plan"):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.002)


def _durations(scenario: Path, output: Path) -> dict[str, float]:
    """Run a scenario in a process of its own; return how long each stage takes, s."""
    seconds, planned = {}, 0.0
    with started(*_command(scenario, output)) as process:
        lines = _Lines(process)
        for stage in STAGES:
            if stage == "evaluate":
                seconds[stage] = planned
                continue
            lines.wait_for(stage)
            begun = time.monotonic()
            if stage == "plan":
                _wait_for_plan(output, process)
                begun_to_evaluate = time.monotonic()
            lines.wait_for(stage, "done")
            seconds[stage] = time.monotonic() - begun
            if stage == "plan":
                planned = time.monotonic() - begun_to_evaluate
        assert process.wait(_LONG_S) == 0
    return seconds


SEED = 20_260_111
KILLS = 50
_SIGNALS = tuple(EXIT_CODES)
_ISLAND = [[118.45, 10.22], [118.55, 10.22], [118.55, 10.28], [118.5, 10.31], [118.45, 10.28]]
# Of two seasons: between the two versions one is withdrawn, another is new.
_REGION = (
    small_region("killed")
    + """[chart]
source = {{ path = "./island.geojson", accuracy_m = 50 }}
tolerance_m = 500
[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["embedded-palawan"]
[[seasons]]
name = "{second}"
valid = "{valid}"
currents = ["{currents}"]
[planner]
classes = 2
"""
)


def kill_and_continue(bench: Bench, stage: str, fraction: float, number: signal.Signals) -> str:
    """Kill a run and start it again; check what each leaves, and return where it was killed."""
    output, place = killed(bench, stage, fraction, number)
    what = f"{number.name} {fraction:.2f} through {stage}, killed in {place}"
    assert results(output) in (bench.old, bench.new), f"{what}: results of two runs are mixed"
    run_to_the_end(bench.scenario, output)
    again = results(output)
    assert again.keys() == bench.new.keys(), what
    assert not [name for name in again if again[name] != bench.new[name]], what
    assert paths_in(output) == bench.paths, what
    return place


@pytest.mark.slow
def test_many_killed_runs_continue(tmp_path: Path) -> None:
    """Kills spread evenly over the stages, each of which meets every signal."""
    shape = {"type": "Polygon", "coordinates": [[*_ISLAND, _ISLAND[0]]]}
    (tmp_path / "island.geojson").write_text(json.dumps(shape))
    field = sea(np.arange(117.0, 121.0, 0.25), np.arange(8.0, 12.0, 0.25))
    write(tmp_path / "sea.nc", dataset(field))
    bench = Bench.prepare(
        tmp_path,
        _REGION.format(second="withdrawn", valid="2024-07-01", currents="./sea.nc"),
        _REGION.format(second="winter", valid="2024-12", currents="embedded-palawan"),
    )
    assert "killed-withdrawn.rtz" in bench.old.keys() - bench.new.keys()
    rng = random.Random(SEED)  # noqa: S311 - a test's seed
    rounds = -(-KILLS // len(STAGES))
    met: collections.Counter[str] = collections.Counter()
    for i in range(KILLS):
        stage, turn = STAGES[i % len(STAGES)], i // len(STAGES)
        fraction = (turn + rng.random()) / rounds
        met[kill_and_continue(bench, stage, fraction, _SIGNALS[turn % len(_SIGNALS)])] += 1
    print(f"{KILLS} kills: {dict(met)}")  # noqa: T201
    assert set(met) >= set(STAGES)  # some meet the stages between them, too
